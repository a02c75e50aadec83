"""The colours of every picture and page, in one place: what stands for what, and never two things.

Told apart by every kind of colour sight (after Okabe and Ito), and seen on white as on black.
"""

from typing import Final

Colour = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""

TRUTH: Final[Colour] = (30, 136, 229)  # blue: what is known to be there
ESTIMATE: Final[Colour] = (240, 140, 0)  # orange: what the method says
ALONE: Final[Colour] = (190, 90, 180)  # purple: fruit of one view without a partner
REJECTED: Final[Colour] = (150, 150, 150)  # grey: tried and given up, or counted neither way

# what holding the two together says
HIT: Final[Colour] = (0, 158, 115)
FALSE: Final[Colour] = (213, 50, 40)
MISSED: Final[Colour] = (86, 180, 233)
VERDICTS: Final[dict[str, Colour]] = {"right": HIT, "wrong": FALSE, "missed": MISSED}
KINDS: Final[dict[str, Colour]] = {  # of worst cases
    "missed": MISSED,
    "false": FALSE,
    "wrong match": ALONE,
    "range": ESTIMATE,
}
# one method against another
CHANGES: Final[dict[str, Colour]] = {"gained": HIT, "lost": FALSE, "moved": ESTIMATE}

STAGES: Final[dict[str, Colour]] = {
    "decode": REJECTED,
    "rectify": (120, 94, 60),
    "recognise": (213, 94, 0),
    "clean": (0, 114, 178),
    "circles": (0, 158, 115),
    "match": (204, 121, 167),
    "triangulate": (200, 170, 20),
}
SIDES: Final[dict[str, Colour]] = {"left": (0, 114, 178), "right": (213, 94, 0)}


def as_hex(colour: Colour) -> str:
    """The colour as pages and charts name it, "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
