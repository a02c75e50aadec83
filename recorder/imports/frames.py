"""Pictures from files or folders, of two views or one -> a session; their bytes stay."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from recorder.errors import PomologError
from recorder.one_view import NOMINAL, ONE_VIEW, nominal_camera, one_view_rig
from recorder.pictures import identify, read_picture, verify
from recorder.records import SIDES, Frame, Note, Side
from recorder.rig import Rig
from recorder.session_writer import SessionWriter

PICTURE_SUFFIXES: Final = frozenset((".png", ".jpg", ".jpeg", ".webp"))


def single_pictures(left: Path) -> tuple[tuple[Path, ...], ...]:
    """A file, or a folder's pictures, of one view.

    Raises:
        PomologError: nothing there.
    """
    if not left.exists():
        raise PomologError(f"no pictures at {left}; give a picture or a folder of them")
    return tuple((path,) for path in ((left,) if left.is_file() else pictures_in(left)))


def picture_pairs(left: Path, right: Path) -> tuple[tuple[Path, Path], ...]:
    """Two files, or two folders' pictures paired in name order.

    Raises:
        PomologError: nothing there, a file beside a folder, or folders of different length.
    """
    sides = {"LEFT": left, "RIGHT": right}
    for name, path in sides.items():
        if not path.exists():
            raise PomologError(f"no {name} pictures at {path}; give a picture or a folder of them")
    if left.is_file() and right.is_file():
        return ((left, right),)
    if left.is_file() != right.is_file():
        raise PomologError(f"{left} and {right}: give two pictures, or two folders of pictures")
    lefts, rights = pictures_in(left), pictures_in(right)
    if len(lefts) != len(rights):
        raise PomologError(
            f"{len(lefts)} pictures in {left} but {len(rights)} in {right}; "
            "they are paired in name order, so both folders need as many"
        )
    return tuple(zip(lefts, rights, strict=True))


def pictures_in(folder: Path) -> tuple[Path, ...]:
    """The pictures of a folder in name order.

    Raises:
        PomologError: there are none.
    """
    found = [p for p in folder.iterdir() if p.suffix.lower() in PICTURE_SUFFIXES]
    found.sort(key=lambda path: name_order(path.name))
    if not found:
        raise PomologError(f"no PNG, JPEG or WebP pictures in {folder}; is it the right folder?")
    return tuple(found)


def name_order(name: str) -> list[tuple[int, str]]:
    """What to sort names by, so that numbers stand by their value: 2.png before 10.png."""
    parts = re.split(r"([0-9]+)", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts if part]


def import_frames(
    pairs: tuple[tuple[Path, ...], ...],
    rig: Rig | None,
    out: Path,
    *,
    rate_hz: float = 1.0,
    metadata: Mapping[str, str] | None = None,
    lighting: Sequence[str] = (),
    tick: Callable[[], None] = lambda: None,
) -> None:
    """Write a session of the given picture pairs, `1 / rate_hz` seconds apart from time 0 on.

    Args:
        pairs: left and right files; of one view, left files alone.
        rig: its calibration; None: of one view, a nominal one of the first picture's size.
        out: the session to write.
        rate_hz: pairs a second.
        metadata: cultivar, site, ...
        lighting: nothing, one word for all pairs, or one a pair; a change is kept as a note.
        tick: called after each pair.

    Raises:
        PomologError: a picture is damaged or not of the rig's size, `out` cannot be written, or
            there are as many words for the light as neither one nor the pairs.
    """
    if len(lighting) not in (0, 1, len(pairs)):
        raise PomologError(
            f"{len(lighting)} words for the lighting of {len(pairs)} pairs; give one, or one a pair"
        )
    metadata = dict(metadata or {})
    if len(set(lighting)) == 1:
        metadata["lighting"] = lighting[0]
    step_ns = round(1e9 / rate_hz)
    if len(pairs[0]) == 1:
        metadata |= ONE_VIEW
    if rig is None:
        metadata |= NOMINAL
        rig = one_view_rig(nominal_camera(_read("left", pairs[0][0], 0, 0).size_px))
    with SessionWriter.create(out, rig, metadata) as session:
        for index, paths in enumerate(pairs):
            if len(set(lighting)) > 1 and (index == 0 or lighting[index] != lighting[index - 1]):
                session.write_note(Note(index * step_ns, f"lighting={lighting[index]}"))
            frames = [
                _read(side, path, index * step_ns, index)
                for side, path in zip(SIDES, paths, strict=False)
            ]
            if frames[0].size_px != frames[-1].size_px:
                raise PomologError(
                    f"{paths[0]} is {_size(frames[0])} px and {paths[-1]} {_size(frames[-1])}; "
                    "left and right must be of one size"
                )
            for frame, path in zip(frames, paths, strict=True):
                camera_px = rig.camera(frame.side).size_px
                if frame.size_px != camera_px:
                    raise PomologError(
                        f"{path} is {_size(frame)} px, but the rig's {frame.side} camera has "
                        f"{camera_px[0]} x {camera_px[1]}; give its own --rig"
                    )
                session.write_frame(frame)
            tick()
        columns = zip(SIDES, zip(*pairs, strict=True), strict=False)
        names: dict[str, str] = {s: "\n".join(p.name for p in column) for s, column in columns}
        session.add_metadata("pictures", names)


def _read(side: Side, path: Path, time_ns: int, sequence: int) -> Frame:
    data = read_picture(path)
    encoding, size_px = identify(data, str(path))
    verify(data, str(path))
    return Frame(side, time_ns, encoding, data, size_px, sequence)


def _size(frame: Frame) -> str:
    return f"{frame.size_px[0]} x {frame.size_px[1]}"
