"""The one exception that a user sees as a line: what is wrong, where, and what now."""


class PomologError(Exception):
    """An expected failure: bad input, a missing file, no room on the disk.

    The message is one line that says what, where and what now. The command line prints it and
    exits with 1; anything else that escapes is our own bug and shows its traceback.
    """


class TornFileError(PomologError):
    """A recording that ends in the middle: `pomolog salvage` can make it whole."""


class NewerProfileError(PomologError):
    """A file of a profile that a later pomolog writes: whoever wants to read it updates."""


def newer_profile(what: object, profile: str, ours: str) -> NewerProfileError:
    """The line for a session or results of a newer profile."""
    return NewerProfileError(
        f"{what} has profile {profile}, newer than this pomolog's {ours}; update pomolog to read it"
    )
