"""Mitsuba, loaded so that a missing or unfit library is one line and never an aborted process."""

import os
import re
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from recorder.errors import PomologError

VARIANT: Final = "llvm_ad_rgb"
LLVM_MAJOR: Final = 19  # what Dr.Jit 1.5 works with; older ones abort the process at first use
_LLVM_VARIABLE: Final = "DRJIT_LIBLLVM_PATH"
_LLVM_FOLDERS: Final = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt")
_INSTALL_LLVM: Final = (
    f"on Debian or Ubuntu: apt-get install libllvm{LLVM_MAJOR}; elsewhere set "
    f"{_LLVM_VARIABLE} to its file"
)

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A triangle mesh.

    Attributes:
        points_m: (V, 3) float.
        faces: (F, 3) int, into the points.
        normals: (V, 3) float, unit.
        uv: (V, 2) float, into the material's texture.
    """

    points_m: Floats
    faces: npt.NDArray[np.int64]
    normals: Floats
    uv: Floats

    @staticmethod
    def joined(parts: "list[Surface]") -> "Surface":
        """All of them as one; faces keep the parts' order."""
        offsets = np.cumsum([0, *(len(part.points_m) for part in parts)])
        return Surface(
            np.concatenate([part.points_m for part in parts]),
            np.concatenate([p.faces + o for p, o in zip(parts, offsets, strict=False)]),
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.uv for part in parts]),
        )


@cache
def load_mitsuba() -> Any:
    """Import Mitsuba and choose its variant; the module.

    Raises:
        PomologError: Mitsuba or its LLVM is missing or of a version that would abort the process.
    """
    missing = [name for name in ("drjit", "mitsuba", "mitsuba_oidn") if find_spec(name) is None]
    if missing:  # only looked for: importing drjit would load whatever LLVM it finds
        raise PomologError(
            f"the digital orchard needs {', '.join(missing)}, which is not installed; "
            "try: pip install 'pomolog[orchard]'"
        )
    library = find_llvm()
    os.environ[_LLVM_VARIABLE] = str(library)
    try:
        mitsuba = import_module("mitsuba")
        mitsuba.set_variant(VARIANT)
        found = import_module("drjit").detail.llvm_version()
    except (ImportError, RuntimeError, AttributeError) as error:
        raise PomologError(
            f"mitsuba cannot start ({error}); try: pip install --force-reinstall "
            f"'mitsuba==3.9.*', and for LLVM {_INSTALL_LLVM}"
        ) from None
    if found[0] != LLVM_MAJOR:
        raise PomologError(
            f"{library} is LLVM {found[0]}, the digital orchard needs {LLVM_MAJOR}; {_INSTALL_LLVM}"
        )
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba


def find_llvm() -> Path:
    """The LLVM library of the right version, found by name: loading a wrong one may abort us.

    Raises:
        PomologError: there is none.
    """
    named = os.environ.get(_LLVM_VARIABLE)
    if named:
        major = _llvm_major(Path(named))
        if not Path(named).is_file():
            raise PomologError(f"{_LLVM_VARIABLE} names no file ({named}); {_INSTALL_LLVM}")
        if major != LLVM_MAJOR:
            raise PomologError(
                f"{_LLVM_VARIABLE} names LLVM {major or 'of an unknown version'} ({named}), the "
                f"digital orchard needs {LLVM_MAJOR}; {_INSTALL_LLVM}"
            )
        return Path(named)
    seen: set[int] = set()
    for folder in map(Path, _LLVM_FOLDERS):
        for pattern in ("libLLVM*.so*", "*/libLLVM*.so*", "llvm*/lib/libLLVM*"):
            for library in sorted(folder.glob(pattern)):
                major = _llvm_major(library)
                if major == LLVM_MAJOR:
                    return library
                seen |= {major} - {None} if major is not None else set()
    other = f" (found only {', '.join(map(str, sorted(seen)))})" if seen else ""
    raise PomologError(
        f"the digital orchard needs LLVM {LLVM_MAJOR}, which is not here{other}; {_INSTALL_LLVM}"
    )


def _llvm_major(library: Path) -> int | None:
    """The major version that a library's (resolved) name tells: libLLVM-14.so, libLLVM.so.19.1."""
    for name in (library.name, library.resolve().name):
        match = re.search(r"libLLVM-(\d+)|libLLVM\.(?:so|dylib)\.(\d+)", name)
        if match:
            return int(match[1] or match[2])
    return None


def load_part(name: Literal["drjit", "mitsuba_oidn"]) -> Any:
    """A library that comes with Mitsuba, untyped: the stubs that they ship do not parse."""
    load_mitsuba()
    return import_module(name)


def make_mesh(name: str, surface: Surface, material: Any) -> Any:
    """A Mitsuba mesh of that surface and material."""
    mi = load_mitsuba()
    properties = mi.Properties()
    properties["bsdf"] = material
    mesh = mi.Mesh(
        name,
        len(surface.points_m),
        len(surface.faces),
        has_vertex_normals=True,
        has_vertex_texcoords=True,
        props=properties,
    )
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(_flat(surface.points_m))
    parameters["vertex_normals"] = mi.Float(_flat(surface.normals))
    parameters["vertex_texcoords"] = mi.Float(_flat(surface.uv))
    parameters["faces"] = mi.UInt32(np.ascontiguousarray(surface.faces, np.uint32).ravel())
    parameters.update()
    return mesh


def _flat(values: Floats) -> npt.NDArray[np.float32]:
    return np.ascontiguousarray(values, np.float32).ravel()


def texture(picture: npt.NDArray[np.uint8]) -> dict[str, Any]:
    """A Mitsuba texture of an (H, W, 3) uint8 sRGB picture; row 0 is v = 0."""
    mi = load_mitsuba()
    return {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture)), "raw": False}


def rays(origins_m: Floats, directions: npt.NDArray[np.floating[Any]]) -> Any:
    """Mitsuba rays from (3,) or (N, 3) origins along (N, 3) unit directions."""
    mi = load_mitsuba()
    origin = np.broadcast_to(origins_m, directions.shape)
    return mi.Ray3f(*(
        vector(*(mi.Float(np.ascontiguousarray(values[:, k], np.float32)) for k in range(3)))
        for vector, values in ((mi.Point3f, origin), (mi.Vector3f, directions))
    ))  # fmt: skip
