"""JSON files of others: read, and what is wrong with one told in a line."""

import json
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from recorder.errors import PomologError
from recorder.text_files import read_text


def read_json(path: Path) -> Any:
    """What a JSON file holds.

    Raises:
        PomologError: it cannot be read, or is not JSON.
    """
    try:
        return json.loads(read_text(path, "JSON"))
    except (ValueError, RecursionError) as error:  # also a number of thousands of digits
        raise PomologError(
            f"{path} is not JSON: {str(error)[:200]}; is it the right file?"
        ) from None


def wrong_entry(path: Path, error: ValidationError, wanted: str) -> PomologError:
    """The first entry of a file that is not as wanted."""
    first = error.errors()[0]
    place = ", ".join(map(str, first["loc"]))
    return PomologError(f"{path}, entry ({place}): {first['msg']}; {wanted}")
