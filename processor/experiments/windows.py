"""A radius window from rig, range and size of fruit, where the paper has 30 to 60 px."""

from typing import Final

from processor.circles import RandomRing
from recorder.rectify import Rectification

NEAREST_M: Final = 0.36  # the front of the nearest fruit of the paper's 400 to 1500 mm
FARTHEST_M: Final = 1.6
RADII_M: Final = (0.030, 0.048)  # apples of 60 to 96 mm


def ring_of(rectification: Rectification) -> RandomRing:
    """The paper's ring method with a window of all radii that such fruit can have in the picture.

    With the paper's lens it is 22 to 154 px.
    """
    focal_px = rectification.focal_px
    return RandomRing(
        min_radius_px=focal_px * RADII_M[0] / FARTHEST_M,
        max_radius_px=focal_px * RADII_M[1] / NEAREST_M,
    )
