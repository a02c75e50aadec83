import io
import struct
import zlib
from contextlib import suppress

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from recorder.errors import PomologError
from recorder.pictures import MAX_SIDE_PX, decode, identify, verify
from recorder.records import Encoding, Frame
from tests.builders import SIZE_PX, encoded, frame, picture

COMPRESSED: list[Encoding] = ["jpeg", "png", "webp"]


def png_claiming(width_px: int, height_px: int) -> bytes:
    """A PNG of a few bytes whose header says that it is huge."""
    header = struct.pack(">IIBBBBB", width_px, height_px, 8, 2, 0, 0, 0)
    parts = [b"\x89PNG\r\n\x1a\n"]
    for name, data in ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b"")):
        parts.append(struct.pack(">I", len(data)) + name + data)
        parts.append(struct.pack(">I", zlib.crc32(name + data)))
    return b"".join(parts)


@pytest.mark.parametrize("encoding", COMPRESSED)
def test_a_header_says_format_and_size(encoding: Encoding) -> None:
    assert identify(encoded(encoding, size_px=(40, 24)), "x") == (encoding, (40, 24))


@pytest.mark.parametrize("data", [b"", b"hello", encoded("png")[:20], b"GIF89a" + bytes(100)])
def test_what_is_no_picture_is_named(data: bytes) -> None:
    with pytest.raises(PomologError, match=r"^a\.png is not a PNG, JPEG or WebP picture"):
        identify(data, "a.png")


@pytest.mark.parametrize(
    ("width_px", "height_px"),
    [(MAX_SIDE_PX + 1, 10), (10, 2**31 - 1), (MAX_SIDE_PX, MAX_SIDE_PX), (12_000, 12_000)],
)
def test_an_absurd_size_is_refused_by_the_header_alone(width_px: int, height_px: int) -> None:
    with pytest.raises(PomologError, match="is it damaged"):
        identify(png_claiming(width_px, height_px), "a.png")
    with pytest.raises(PomologError, match="is it complete"):
        verify(png_claiming(width_px, height_px), "a.png")


@pytest.mark.parametrize("encoding", COMPRESSED)
@pytest.mark.parametrize("part", [0.5, 0.9, 0.99])
def test_a_picture_cut_short_is_refused(encoding: Encoding, part: float) -> None:
    data = encoded(encoding, size_px=(200, 160))
    verify(data, "a")
    with pytest.raises(PomologError, match=r"^a cannot be decoded .*is it complete\?"):
        verify(data[: int(part * len(data))], "a")


def test_a_png_cut_short_anywhere_is_refused() -> None:
    data = encoded("png")
    for cut in range(1, len(data)):
        with pytest.raises(PomologError):
            verify(data[:-cut], "a")


def test_a_damaged_png_is_refused_or_decodes_without_a_word(
    capfd: pytest.CaptureFixture[str],
) -> None:
    whole = encoded("png")
    for at in range(len(whole)):
        data = whole[:at] + bytes([whole[at] ^ (1 << at % 8)]) + whole[at + 1 :]
        with suppress(PomologError):
            identify(data, "a")
            verify(data, "a")
            assert np.array_equal(decode(Frame("left", 0, "png", data, SIZE_PX)), picture())
    assert capfd.readouterr().err == ""  # OpenCV itself must not add lines of its own


@given(
    encoding=st.sampled_from(COMPRESSED),
    at=st.floats(0, 1, exclude_max=True),
    new=st.binary(max_size=8),
)
@settings(max_examples=400, deadline=None)  # a busy machine is no failure
def test_a_damaged_picture_is_a_picture_or_one_line(
    encoding: Encoding, at: float, new: bytes
) -> None:
    data = encoded(encoding)
    place = int(at * len(data))
    data = data[:place] + new + data[place + len(new) :]
    for look in (identify, verify):
        with suppress(PomologError):
            look(data, "a")


def test_png_and_raw_frames_decode_to_their_pixels() -> None:
    for encoding in ("png", "bgr8"):
        assert np.array_equal(decode(frame(encoding=encoding)), picture())


def test_a_bayer_frame_of_red_light_decodes_to_red() -> None:
    # rows R G R G ... and G B G B ...: GenICam's BayerRG8, which OpenCV once called BG
    mosaic = np.zeros((48, 64), np.uint8)
    mosaic[::2, ::2] = 200
    found = decode(Frame("left", 0, "bayer_rggb8", mosaic.tobytes(), SIZE_PX))
    middle = found[10:-10, 10:-10].reshape(-1, 3)
    assert middle.min(axis=0).tolist() == [0, 0, 200]
    assert middle.max(axis=0).tolist() == [0, 0, 200]


def test_a_grey_picture_decodes_to_three_channels() -> None:
    done, data = cv2.imencode(".png", picture()[..., 0])
    assert done
    found = decode(Frame("left", 0, "png", data.tobytes(), SIZE_PX))
    assert np.array_equal(found, np.dstack([picture()[..., 0]] * 3))


def test_an_orientation_tag_does_not_turn_a_picture() -> None:
    stream = io.BytesIO()
    exif = Image.Exif()
    exif[0x0112] = 6  # "turn by 90 degrees", as telephones write it
    Image.fromarray(picture()[..., ::-1]).save(stream, "JPEG", exif=exif)
    data = stream.getvalue()
    assert identify(data, "a") == ("jpeg", SIZE_PX)
    assert decode(Frame("left", 0, "jpeg", data, SIZE_PX)).shape == (48, 64, 3)


@pytest.mark.parametrize("encoding", ["jpeg", "png", "webp", "bayer_rggb8", "bgr8"])
@pytest.mark.parametrize("data", [b"", b"x", bytes(64 * 48 + 1)])
def test_bytes_that_are_not_what_they_claim_are_named(encoding: Encoding, data: bytes) -> None:
    with pytest.raises(PomologError, match=r"the right frame at 5 ns is no 64 x 48"):
        decode(Frame("right", 5, encoding, data, SIZE_PX))


def test_a_picture_of_another_size_than_its_frame_claims_is_refused() -> None:
    with pytest.raises(PomologError, match="is no 64 x 40"):
        decode(Frame("left", 0, "png", encoded(), (64, 40)))
