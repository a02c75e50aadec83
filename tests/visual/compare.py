"""Pictures held against small references, by how much of them differs plainly."""

from pathlib import Path

import cv2
import numpy as np

from tests.visual.headless import Pixels

REFERENCES = Path(__file__).parent / "references"
COMMAND = "python -m tests.visual.update"
WIDTH_PX = 480
# Other drivers draw letters and edges a little otherwise; a ring that is gone or of another colour
# is about 0.3 % of such a picture
PLAIN = 48  # of 255, in any channel, after smoothing
TOLERATED = 0.002  # of the pixels


def small(picture: Pixels) -> Pixels:
    """As references are kept, smoothed so that edges may lie a pixel aside."""
    height_px = round(picture.shape[0] * WIDTH_PX / picture.shape[1])
    shrunk = cv2.resize(picture, (WIDTH_PX, height_px), interpolation=cv2.INTER_AREA)
    return np.asarray(shrunk, np.uint8)


def difference(picture: Pixels, reference: Pixels) -> float:
    """The share of pixels that differ plainly; 1 where the sizes do."""
    if picture.shape != reference.shape:
        return 1.0
    smooth = [cv2.blur(one, (3, 3)).astype(int) for one in (picture, reference)]
    return float((np.abs(smooth[0] - smooth[1]).max(axis=2) > PLAIN).mean())


def read(name: str) -> Pixels:
    """The reference of that name."""
    found = cv2.imread(str(REFERENCES / f"{name}.jpg"), cv2.IMREAD_COLOR)
    assert found is not None, f"no reference {name}; make it with: {COMMAND}"
    return np.asarray(cv2.cvtColor(found, cv2.COLOR_BGR2RGB), np.uint8)


def write(name: str, picture: Pixels) -> None:
    """Keep a picture as the reference of that name."""
    REFERENCES.mkdir(exist_ok=True)
    turned = cv2.cvtColor(small(picture), cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(REFERENCES / f"{name}.jpg"), turned, [cv2.IMWRITE_JPEG_QUALITY, 85])
