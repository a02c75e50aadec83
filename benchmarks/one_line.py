"""Bad input of a benchmark: one line and exit 1, as of every command."""

import sys
from collections.abc import Callable
from functools import wraps

from recorder.errors import PomologError


def one_line(main: Callable[[], None]) -> Callable[[], None]:
    """A benchmark's `main` that ends with the line of the error that it meets."""

    @wraps(main)
    def told() -> None:
        try:
            main()
        except PomologError as error:
            sys.exit(str(error))

    return told
