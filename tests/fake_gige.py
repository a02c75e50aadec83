"""A software GigE Vision camera that serves known pictures: python -m tests.fake_gige ADDRESS.

Aravis' own GvFakeCamera over real UDP. Each picture's first 16 bytes are the true moment (host
monotonic ns) and a count; the rest is one of 16 pictures of noise, dimmed by the exposure time.
"""

import ctypes
import signal
import struct
import sys
import time
from typing import Any

import numpy as np
import numpy.typing as npt

HEADER = struct.Struct("<QQ")
PICTURES = 16
FULL_EXPOSURE_US = 10_000  # the fake camera's factory setting


def noise(seed: int, size: int, exposure_us: int = FULL_EXPOSURE_US) -> npt.NDArray[np.uint8]:
    """The (16, size) pictures of the camera of that seed."""
    pictures = np.random.default_rng(seed).integers(0, 256, (PICTURES, size), dtype=np.uint8)
    gain = min(1.0, exposure_us / FULL_EXPOSURE_US)
    return pictures if gain == 1.0 else (pictures * gain).astype(np.uint8)


def seed_of(address: str) -> int:
    return int(address.rsplit(".", maxsplit=1)[1])


def expected(address: str, data: bytes) -> bytes:
    """The picture that the camera at that address must have sent, from its own header."""
    _, count = HEADER.unpack_from(data)
    return data[: HEADER.size] + noise_cache(address, len(data))[count % PICTURES, 16:].tobytes()


_cache: dict[tuple[str, int], npt.NDArray[np.uint8]] = {}


def noise_cache(address: str, size: int) -> npt.NDArray[np.uint8]:
    if (address, size) not in _cache:
        _cache[address, size] = noise(seed_of(address), size)
    return _cache[address, size]


def serve(address: str, lost_ratio: float) -> None:
    import gi

    gi.require_version("Aravis", "0.8")
    from gi.repository import Aravis

    library = ctypes.CDLL("libaravis-0.8.so.0")
    void, u32 = ctypes.c_void_p, ctypes.c_uint32
    fill_type = ctypes.CFUNCTYPE(None, void, void, u32, u32, u32)
    library.arv_buffer_get_data.restype = void
    library.arv_buffer_get_data.argtypes = [void, void]
    library.arv_fake_camera_get_payload.restype = ctypes.c_size_t
    library.arv_fake_camera_get_payload.argtypes = [void]
    library.arv_fake_camera_set_fill_pattern.argtypes = [void, fill_type, void]
    camera = Aravis.GvFakeCamera.new(address, f"POMOLOG-{seed_of(address)}")
    if lost_ratio:
        camera.set_property("gvsp-lost-ratio", lost_ratio)
    fake = hash(camera.get_fake_camera())  # PyGObject's hash is the address
    ready: dict[tuple[int, int], Any] = {}
    count = 0

    def fill(buffer: int, _: int, exposure_us: int, gain: int, pixel_format: int) -> None:  # noqa: ARG001  # the callback's signature
        nonlocal count
        taken_ns = time.monotonic_ns()
        size = library.arv_fake_camera_get_payload(fake)
        if (size, exposure_us) not in ready:
            ready.clear()
            ready[size, exposure_us] = noise(seed_of(address), size, exposure_us)
        picture = ready[size, exposure_us][count % PICTURES]
        place = library.arv_buffer_get_data(buffer, None)
        ctypes.memmove(place, picture.ctypes.data, size)
        ctypes.memmove(place, HEADER.pack(taken_ns, count), HEADER.size)
        count += 1

    callback = fill_type(fill)
    library.arv_fake_camera_set_fill_pattern(fake, callback, None)
    if not camera.is_running():
        sys.exit(f"the fake camera at {address} does not run; is the address there?")
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    signal.pause()  # until killed


if __name__ == "__main__":
    serve(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 0.0)
