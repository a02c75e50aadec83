"""A rig's files: which format one is in, and reading and writing it."""

import re
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, Literal, get_args

from recorder.errors import PomologError
from recorder.files import replacing, writable
from recorder.records import SIDES
from recorder.rig import Rig
from recorder.rig_formats.kalibr import is_kalibr, kalibr_text, rig_of_kalibr
from recorder.rig_formats.opencv import opencv_text, read_opencv
from recorder.rig_formats.ours import equipment_of, read_rig_toml, toml_text
from recorder.rig_formats.ros import camera_info_text, is_camera_info, rig_of_camera_infos
from recorder.rig_formats.yaml_text import parse
from recorder.text_files import read_text

Format = Literal["pomolog", "opencv", "ros", "kalibr"]
YAML: Final = (".yaml", ".yml")
_KINDS: Final = "a rig.toml, an OpenCV stereo YAML, a ROS camera_info pair, or a Kalibr camchain"
_SIDE_WORD: Final = re.compile(r"left|right", re.IGNORECASE)


def read_rig(path: Path) -> Rig:
    """Read a rig from any of the four formats, told apart by what is in the file.

    A ROS pair is a folder with left.yaml and right.yaml, either of the two files, or both with a
    comma between them.

    Raises:
        PomologError: no such file, not a rig, or numbers that no rig can have.
    """
    pair = _named_pair(path)
    if pair is None and path.suffix.lower() not in (".toml", *YAML):
        raise PomologError(f"{path} is no rig: give {_KINDS}")
    missing = [one for one in pair or (path,) if not one.is_file()]
    if missing:
        raise PomologError(f"no rig at {missing[0]}; give --rig an existing .toml or .yaml")
    try:
        if pair is not None:
            return _read_pair(*pair)
        return read_rig_toml(path) if path.suffix.lower() == ".toml" else _read_yaml(path)
    except PomologError as error:
        said = str(error).removeprefix(f"{path} ").removeprefix("is ")  # some name it already
        raise PomologError(f"{path}: {said}") from None


def _read_yaml(path: Path) -> Rig:
    content = parse(read_text(path, "a calibration", "calibration"))
    if content is None:
        return read_opencv(path)
    if is_kalibr(content):
        return rig_of_kalibr(content)
    if is_camera_info(content):
        return _read_pair(*_partners(path))
    raise PomologError(
        "neither a Kalibr camchain (cam0, cam1) nor a ROS camera_info (camera_matrix, "
        "projection_matrix), and not an OpenCV YAML (it begins with %YAML); see docs/calibration.md"
    )


def _read_pair(left: Path, right: Path) -> Rig:
    contents: list[Mapping[str, Any]] = []
    for path in (left, right):
        content = parse(read_text(path, "a calibration", "calibration"))
        if content is None or not is_camera_info(content):
            raise PomologError(
                f"{path.name} is no ROS camera_info; "
                "name the two that are: --rig left.yaml,right.yaml"
            )
        contents.append(content)
    return rig_of_camera_infos(contents[0], contents[1])


def _named_pair(path: Path) -> tuple[Path, Path] | None:
    """The two files that one argument names, or None: it names one."""
    if path.is_dir():
        found = {
            side: [p for p in sorted(path.iterdir()) if p.suffix.lower() in YAML and side in p.stem]
            for side in SIDES
        }
        if all(len(files) == 1 for files in found.values()):
            return found["left"][0], found["right"][0]
        raise PomologError(
            f"no rig at {path}: a folder is a ROS camera_info pair and has one left and one right "
            ".yaml; or name the two: --rig left.yaml,right.yaml"
        )
    left, comma, right = str(path).partition(",")
    if comma and not path.exists():
        return Path(left), Path(right)
    return None


def _partners(path: Path) -> tuple[Path, Path]:
    """Both files of a pair, one of which was named."""
    found = _SIDE_WORD.search(path.name)
    if found is None:
        raise PomologError(
            "it is one camera's camera_info; name both with a comma: --rig left.yaml,right.yaml"
        )
    word = found[0].lower()
    other = path.with_name(
        path.name[: found.start()]
        + ("right" if word == "left" else "left")
        + path.name[found.end() :]
    )
    if not other.is_file():
        raise PomologError(
            f"it is one camera's camera_info, and there is no {other.name} beside it; "
            "name both with a comma: --rig left.yaml,right.yaml"
        )
    return (path, other) if word == "left" else (other, path)


def format_of(path: Path) -> Format:
    """The format that a name to write asks for.

    Raises:
        PomologError: an ending that no format has.
    """
    suffix = path.suffix.lower()
    if suffix == ".toml":
        return "pomolog"
    if not suffix or path.is_dir() or "," in path.name:
        return "ros"
    if suffix not in YAML:
        raise PomologError(
            f"cannot tell a rig's format from {path.name}; give -o rig.toml, rig.yaml (OpenCV), "
            "camchain.yaml (Kalibr), a folder (ROS), or --to"
        )
    if "camchain" in path.stem.lower() or "kalibr" in path.stem.lower():
        return "kalibr"
    return "ros" if _SIDE_WORD.search(path.stem) else "opencv"


def write_rig(rig: Rig, path: Path, to: Format | None = None) -> tuple[Path, ...]:
    """Write a rig; a ROS pair becomes left.yaml and right.yaml in the folder `path`.

    An existing rig.toml keeps its tables of equipment.

    Returns:
        The files that were written.

    Raises:
        PomologError: the format has no place for this rig, or the file cannot be written.
    """
    to = to or format_of(path)
    texts = _texts(rig, path, to)
    with ExitStack() as stack:
        parts = {name: stack.enter_context(replacing(name)) for name in texts}
        for name, text in texts.items():
            with writable(name):
                parts[name].write_text(text, encoding="utf-8")
    return tuple(texts)


def _texts(rig: Rig, path: Path, to: Format) -> dict[Path, str]:
    if to == "pomolog":
        return {path: toml_text(rig, equipment_of(path))}
    if to == "opencv":
        return {path: opencv_text(rig)}
    if to == "kalibr":
        return {path: kalibr_text(rig)}
    left, right = _ros_names(path)
    return {left: camera_info_text(rig, "left"), right: camera_info_text(rig, "right")}


def _ros_names(path: Path) -> tuple[Path, Path]:
    """Where a ROS pair goes: two names, names made of one, or a folder."""
    if "," in str(path):
        left, _, right = str(path).partition(",")
        return Path(left), Path(right)
    found = _SIDE_WORD.search(path.stem) if path.suffix.lower() in YAML else None
    if found is None:
        if path.suffix.lower() in YAML:
            raise PomologError(
                f"a ROS pair is two files; give -o a folder, or {path.stem}-left.yaml"
            )
        return path / "left.yaml", path / "right.yaml"
    before, after = path.name[: found.start()], path.name[found.end() :]
    return path.with_name(f"{before}left{after}"), path.with_name(f"{before}right{after}")


def as_format(word: str) -> Format:
    """A format by its name.

    Raises:
        PomologError: no such format.
    """
    for name in get_args(Format):
        if word == name:
            return name  # type: ignore[no-any-return]
    raise PomologError(f"no format {word!r}; give --to {', '.join(get_args(Format))}")
