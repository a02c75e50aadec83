"""Truth from pictures: a folder of masks, and a list of apples, -> a labelled session."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Protocol, cast

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from recorder.errors import PomologError
from recorder.files import replacing
from recorder.imports.frames import pictures_in
from recorder.imports.json_files import read_json, wrong_entry
from recorder.message_writer import MessageWriter
from recorder.objects import Place
from recorder.pictures import identify, read_picture, verify
from recorder.profile import TRUTH_TOPICS
from recorder.records import (
    SIDES,
    UNCOUNTED,
    AppleTruth,
    FrameTruth,
    Labels,
    StereoPair,
    TruthPoint,
)
from recorder.session import Session
from recorder.truth_messages import encode_truth


class _ViewEntry(BaseModel):
    visible_fraction: Annotated[float, Field(ge=0, le=1)] | None = None


class _AppleEntry(BaseModel):
    """One apple of the JSON file; keys that are not ours are somebody's own notes."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    id: Annotated[int, Field(gt=0, lt=UNCOUNTED)]
    centre_m: tuple[float, float, float]
    radius_m: Annotated[float, Field(gt=0, lt=1)]
    left: _ViewEntry | None = None
    right: _ViewEntry | None = None
    truth_point: TruthPoint = "centre"

    def truth(self) -> AppleTruth:
        # a view of `null` says that the apple is not in it; no view at all says nothing
        absent = 0.0 if "left" in self.model_fields_set else None
        left = self.left.visible_fraction if self.left else absent
        absent = 0.0 if "right" in self.model_fields_set else None
        right = self.right.visible_fraction if self.right else absent
        return AppleTruth(self.id, self.centre_m, self.radius_m, left, right, self.truth_point)


_APPLES = TypeAdapter(list[list[_AppleEntry]])


class MaskTruth:
    """A folder's masks, frame by frame: DIR/left/*.png, DIR/right/*.png, and perhaps the apples.

    Args:
        folder: holds `left` or `right` or both, or the masks themselves (of the left view);
            16-bit labels, or 8-bit masks of 0 and 255.
        apples: JSON, a list with one entry a frame, each a list of apples.
        partial: unlabelled fruit exist, so fruit found elsewhere are no mistakes.
        instances: 8-bit masks hold a number an apple, of one view only (MinneApple).

    Raises:
        PomologError: no masks there, or the JSON is not of that form.
    """

    def __init__(
        self,
        folder: Path,
        apples: Path | None = None,
        *,
        partial: bool = False,
        instances: bool = False,
    ) -> None:
        self._masks = {
            side: pictures_in(folder / side) for side in SIDES if (folder / side).is_dir()
        }
        if not self._masks and any(folder.glob("*.png")):
            self._masks = {SIDES[0]: pictures_in(folder)}
        if not self._masks:
            raise PomologError(
                f"no left or right folder of masks in {folder}; is it the right folder?"
            )
        self._instances = instances
        self._apples = None if apples is None else _read_apples(apples)
        self._partial = partial
        self._folder = folder

    def require(self, pairs: int, session: Place) -> None:
        """Hold the number of masks and apple lists against the session's.

        Raises:
            PomologError: there are more or fewer than stereo pairs.
        """
        counts = {str(self._folder / side): len(files) for side, files in self._masks.items()}
        if self._apples is not None:
            counts["the list of apples"] = len(self._apples)
        for what, count in counts.items():
            if count != pairs:
                raise PomologError(
                    f"{what} has {count} frames, but {session} has {pairs} stereo pairs; "
                    "give one a pair, in the order of the frames"
                )

    def truth(self, pair: StereoPair) -> FrameTruth:
        """The truth of one pair, read from its masks.

        Raises:
            PomologError: a mask is of another size than its picture, or no label picture.
        """
        labels: dict[str, Labels] = {}
        identified = True
        for side, files in self._masks.items():
            path, size_px = files[pair.index], pair.frame(side).size_px
            labels[side], known = _read_mask(path, size_px, instances=self._instances)
            identified = identified and known
        apples = None if self._apples is None else self._apples[pair.index]
        return FrameTruth(
            labels.get("left"), labels.get("right"), apples, self._partial, identified,
            shared=not self._instances,
        )  # fmt: skip


class Truth(Protocol):
    """Where the truth of a session's pairs comes from: masks, or labels of others."""

    def require(self, pairs: int, session: Place) -> None:
        """Make sure that it fits the session."""

    def truth(self, pair: StereoPair) -> FrameTruth | None:
        """The truth of one pair; None where nobody said anything."""


def label_session(
    session: Session, labels: Truth, out: Path, tick: Callable[[], None] = lambda: None
) -> None:
    """Copy a session message by message and give its pairs their truth; older truth is replaced.

    Raises:
        PomologError: the labels do not fit the session, or `out` cannot be written.
    """
    labels.require(len(session), session.path)
    lefts = {int(left) for left, _ in session.pair_times_ns()}
    pairs = session.pairs()
    with replacing(out) as part, part.open("wb") as stream:
        writer = MessageWriter(stream, session.metadata, raw_images=session.raw_images)
        for message in session.messages():
            if message.topic in TRUTH_TOPICS:
                continue
            writer.copy(message)
            if message.topic == "/left/image" and message.log_ns in lefts:
                lefts.remove(message.log_ns)
                pair = next(pairs)
                truth = labels.truth(pair)
                if truth and session.one_view:  # its numbers are of one view, whoever gave them
                    truth = replace(truth, shared=True)
                for topic, encoded in encode_truth(pair.time_ns, truth) if truth else ():
                    writer.write(topic, pair.time_ns, encoded.SerializeToString())
                tick()
        if session.picture_names:
            writer.add_metadata("pictures", session.picture_names)
        if session.ledger:
            writer.add_metadata("ledger", session.ledger)
        writer.finish()


def _read_apples(path: Path) -> tuple[tuple[AppleTruth, ...], ...]:
    try:
        entries = _APPLES.validate_python(read_json(path))
    except ValidationError as error:
        wanted = "it must be a list with one list of apples a frame"
        raise wrong_entry(path, error, wanted) from None
    frames = tuple(tuple(apple.truth() for apple in frame) for frame in entries)
    for number, frame in enumerate(frames):
        if len({apple.id for apple in frame}) < len(frame):
            raise PomologError(
                f"{path}, frame {number}: an apple's id stands twice; give each its own"
            )
    return frames


def _read_mask(path: Path, size_px: tuple[int, int], *, instances: bool) -> tuple[Labels, bool]:
    """Labels, and whether they tell one apple from another (16 bits) or not (0 and 255)."""
    data = read_picture(path)
    encoding, _ = identify(data, str(path))
    verify(data, str(path))  # first: OpenCV prints what it thinks of a damaged file
    mask = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if encoding != "png" or mask is None or mask.ndim != 2:
        raise PomologError(f"{path} is no mask: give a 16-bit or an 8-bit grey PNG")
    if (mask.shape[1], mask.shape[0]) != size_px:
        raise PomologError(
            f"{path} is {mask.shape[1]} x {mask.shape[0]} px, its picture {size_px[0]} x "
            f"{size_px[1]}; masks must be of the recorded pictures' size"
        )
    if mask.dtype == np.uint16:
        return cast("Labels", mask), True
    if instances:
        return mask.astype(np.uint16), True
    if set(np.unique(mask).tolist()) <= {0, 255}:
        return (mask // 255).astype(np.uint16), False
    raise PomologError(
        f"{path} has 8 bits and other values than 0 and 255; labels need 16 bits, or --instances"
    )
