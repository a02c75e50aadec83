"""A picture to draw on without a screen: photographs, circles, lines and text, to PNG or JPEG."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from processor.charts import font_file
from processor.palette import Colour
from recorder.records import Picture

PAPER: Final[Colour] = (255, 255, 255)
INK: Final[Colour] = (28, 30, 33)
SOFT: Final[Colour] = (91, 97, 104)
LINE: Final[Colour] = (217, 220, 224)
_SHIFT: Final = 4  # OpenCV draws at sixteenths of a pixel

Circle = tuple[float, float, float]
"""x, y, radius in pixels."""


@dataclass(frozen=True, slots=True)
class _Text:
    x: float
    y: float
    words: str
    size: int
    colour: Colour
    bold: bool
    anchor: str
    halo: bool


class Canvas:
    """A picture of that size, in RGB; text is set when it is encoded, so that it lies on top.

    Args:
        width_px: its width.
        height_px: its height.
    """

    def __init__(self, width_px: int, height_px: int) -> None:
        self.pixels: npt.NDArray[np.uint8] = np.full((height_px, width_px, 3), PAPER, np.uint8)
        self._texts: list[_Text] = []

    def text(
        self, x: float, y: float, words: str, *, size: int = 14, colour: Colour = INK,
        bold: bool = False, anchor: str = "la", halo: bool = False,
    ) -> None:  # fmt: skip
        """Write words.

        Args:
            x: of the anchor.
            y: of the anchor.
            words: one line.
            size: of the type, pixels.
            colour: of the type.
            bold: heavier.
            anchor: Pillow's: "la" left and top, "rm" right and middle, ...
            halo: a dark rim, to be read on photographs.
        """
        self._texts.append(_Text(x, y, words, size, colour, bold, anchor, halo))

    def panel(
        self,
        x: int,
        y: int,
        picture: Picture,
        scale: float,
        *,
        origin: tuple[float, float] = (0, 0),
    ) -> "Panel":
        """Put a picture there, enlarged by `scale`, and give it to be drawn on.

        Args:
            x: of its left edge.
            y: of its upper edge.
            picture: (H, W, 3) BGR, or (H, W) grey.
            scale: canvas pixels a pixel of the picture.
            origin: what the picture's first pixel is called by who draws on it.
        """
        height, width = (max(1, round(n * scale)) for n in picture.shape[:2])
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        shown = cv2.resize(picture, (width, height), interpolation=way)
        colour = cv2.COLOR_GRAY2RGB if shown.ndim == 2 else cv2.COLOR_BGR2RGB
        place = self.pixels[y : y + height, x : x + width]
        place[:] = cv2.cvtColor(shown, colour)[: place.shape[0], : place.shape[1]]
        return Panel(self, x, y, place, scale, origin)

    def fill(self, x: int, y: int, width: int, height: int, colour: Colour) -> None:
        """A filled box."""
        self.pixels[y : y + height, x : x + width] = colour

    def png(self) -> bytes:
        """The picture as PNG."""
        return self._encoded("png", compress_level=6)

    def jpeg(self, quality: int = 82) -> bytes:
        """The picture as JPEG."""
        return self._encoded("jpeg", quality=quality, optimize=True)

    def _encoded(self, kind: str, **how: Any) -> bytes:
        from PIL import Image, ImageDraw

        image = Image.fromarray(self.pixels)
        pen = ImageDraw.Draw(image)
        for text in self._texts:
            rim = {"stroke_width": 2, "stroke_fill": INK} if text.halo else {}
            pen.text(
                (text.x, text.y), text.words, font=_font(text.size, text.bold), fill=text.colour,
                anchor=text.anchor, **cast("Any", rim),
            )  # fmt: skip
        buffer = io.BytesIO()
        image.save(buffer, kind, **how)
        return buffer.getvalue()


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """A picture on a canvas, drawn on in its own pixels; what lies outside it is cut off."""

    canvas: Canvas
    x: int
    y: int
    pixels: npt.NDArray[np.uint8]  # (H, W, 3), a part of the canvas's own
    scale: float
    origin: tuple[float, float]

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height on the canvas."""
        return self.pixels.shape[1], self.pixels.shape[0]

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Where a pixel of the picture lies in the panel."""
        left, top = self.origin
        return (x - left + 0.5) * self.scale - 0.5, (y - top + 0.5) * self.scale - 0.5

    def circle(self, circle: Circle, colour: Colour, width: int = 2, *, dark: bool = False) -> None:
        """A circle; `dark` puts a dark rim below it, to be seen on bright ground."""
        x, y, radius = circle
        if not all(np.isfinite(circle)) or radius * self.scale > 1e4:
            return
        centre = _fixed(*self.place(x, y))
        size = max(1, round(radius * self.scale * (1 << _SHIFT)))
        for shade, extra in (((20, 20, 20), 2), (colour, 0)) if dark else ((colour, 0),):
            cv2.circle(self.pixels, centre, size, shade, width + extra, cv2.LINE_AA, _SHIFT)

    def lines(
        self, points: Sequence[tuple[float, float]], colour: Colour, width: int = 1,
        *, closed: bool = False,
    ) -> None:  # fmt: skip
        """Straight lines from point to point."""
        if len(points) < 2:
            return
        places = np.array([_fixed(*self.place(x, y)) for x, y in points], np.int32)
        cv2.polylines(self.pixels, [places], closed, colour, width, cv2.LINE_AA, _SHIFT)

    def text(self, x: float, y: float, words: str, **how: Any) -> None:
        """Words at a pixel of the picture, where that is within the panel."""
        across, down = self.place(x, y)
        width, height = self.size_px
        if 0 <= across < width and 0 <= down < height:
            self.canvas.text(self.x + across, self.y + down, words, **how)


def _fixed(x: float, y: float) -> tuple[int, int]:
    limit = 1 << 20  # beyond it OpenCV's arithmetic runs over
    return tuple(round(min(max(v * (1 << _SHIFT), -limit), limit)) for v in (x, y))  # type: ignore[return-value]


@cache
def _font(size: int, bold: bool) -> Any:
    from PIL import ImageFont

    return ImageFont.truetype(font_file(bold=bold), size)
