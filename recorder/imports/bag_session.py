"""A bag of others -> a session: pictures, calibration, readings, depth, on one clock."""

import heapq
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from recorder.errors import PomologError
from recorder.imports.bag import Bag, Topic
from recorder.imports.bag_messages import BagImage, BagRange, BagTransform, decode
from recorder.imports.bag_ours import from_bag, our_topics
from recorder.imports.bag_pictures import picture_size_px, to_depth, to_frame
from recorder.imports.bag_rig import Frames, single_rig, stereo_rig, with_rangefinder
from recorder.imports.bag_roles import Roles, first_message
from recorder.mcap_records import RawMessage, reporting_damage
from recorder.one_view import NOMINAL, ONE_VIEW, nominal_camera, one_view_rig
from recorder.pairing import pair_by_time
from recorder.profile import PROFILE
from recorder.records import SIDES, RangeReading
from recorder.rig import USUAL_STD_M, Rig
from recorder.session import DEFAULT_MAX_SKEW_NS
from recorder.session_writer import SessionWriter

Times = Literal["header", "arrival"]

_CLOCKS_AGREE_NS: Final = 10_000_000_000  # headers that lag more apart are of several clocks


@dataclass(frozen=True, slots=True)
class Imported:
    """What became of a bag."""

    left: int
    right: int
    pairs: int
    readings: int
    depths: int
    times: Times
    nearest_ns: int | None  # median of right minus left, of frames nearest to each other
    tolerance_ns: int = DEFAULT_MAX_SKEW_NS
    remarks: tuple[str, ...] = ()

    def summary(self) -> str:
        """In words, for a line."""
        views = f"{self.pairs} stereo pairs" if self.right else f"{self.left} pictures of one view"
        parts = [views]
        parts += [f"{self.readings} range readings"] if self.readings else []
        parts += [f"{self.depths} depth pictures"] if self.depths else []
        clock = "of their headers" if self.times == "header" else "of their arrival"
        return f"{', '.join(parts)}, at the times {clock}"

    def advice(self) -> Iterator[str]:
        """What to try where frames found no partner."""
        lone = self.left - self.pairs
        if not self.right or not lone or self.nearest_ns is None:
            return
        gap_ms, limit_ms = self.nearest_ns / 1e6, self.tolerance_ns / 1e6
        line = f"{lone} of {self.left} left pictures have no right one within {limit_ms:g} ms"
        if abs(self.nearest_ns) > self.tolerance_ns:
            which = "later" if gap_ms > 0 else "before"
            line += (
                f"; the nearest is usually {abs(gap_ms):.1f} ms {which}: a clock's "
                f"offset? --offset right={-gap_ms:.1f}ms; loosely triggered? "
                f"--tolerance {math.ceil(abs(gap_ms) * 1.5)}ms"
            )
        yield line


@dataclass(frozen=True, slots=True, eq=False)
class _Item:
    """One message on its way."""

    role: str
    time_ns: int
    topic: Topic
    message: RawMessage
    decoded: Any = None


@dataclass(slots=True)
class _Plan:
    """All that is decided before the first frame is written."""

    bag: Bag
    roles: Roles
    rig: Rig
    times: Times
    offsets_ns: Mapping[str, int]
    metadata: dict[str, str]
    raw: bool
    remarks: list[str] = field(default_factory=list)


def import_bag(
    bag: Bag,
    roles: Roles,
    out: Path,
    *,
    rig: Rig | None = None,
    times: Times | None = None,
    offsets_ns: Mapping[str, int] | None = None,
    tolerance_ns: int | None = None,
    metadata: Mapping[str, str] | None = None,
    tick: Callable[[], None] = lambda: None,
) -> Imported:
    """Write a session of a bag's topics.

    Args:
        bag: the bag.
        roles: the topic of each role, from `assign_roles`.
        out: the session to write.
        rig: instead of the bag's calibrations.
        times: of the headers, or of arrival; None takes the headers' where they agree.
        offsets_ns: role -> what to add to its times.
        tolerance_ns: the largest skew of a pair; the session keeps it.
        metadata: lighting, cultivar, site, ...
        tick: called after each picture.

    Raises:
        PomologError: no rig, a message is damaged or of a kind that cannot be kept, or `out`
            cannot be written.
    """
    if roles.left is None:
        raise PomologError(f"no left view chosen of {bag.path}; say --left TOPIC")
    plan = _plan(bag, roles, rig, times, dict(offsets_ns or {}), tolerance_ns, metadata or {})
    seen: dict[str, list[int]] = {role: [] for role in ("left", "right", "range", "depth")}
    with SessionWriter.create(out, plan.rig, plan.metadata, raw_images=plan.raw) as session:
        for item in _in_time(plan):
            if item.role == "ours":
                session.copy(from_bag(bag, item.topic, item.message))
                continue
            if item.time_ns < 0:
                raise PomologError(f"--offset puts {item.topic.name} before time 0; is it right?")
            _write(session, item, keep_readings="/pomolog/rangefinder" not in bag.topics)
            seen[item.role].append(item.time_ns)
            tick()
        if not seen["left"]:
            raise PomologError(
                f"no left picture came out of {roles.left} in {bag.path}; say --left TOPIC"
            )
        for name, entries in bag.records.items():
            session.add_metadata(name, entries)
    return _outcome(plan, seen)


_AGAIN: Final = "mcap doctor {path}"  # which says what is wrong with it


def _plan(
    bag: Bag,
    roles: Roles,
    rig: Rig | None,
    times: Times | None,
    offsets_ns: Mapping[str, int],
    tolerance_ns: int | None,
    metadata: Mapping[str, str],
) -> _Plan:
    for role in offsets_ns:
        if role == "left" or getattr(roles, role, None) is None:
            raise PomologError(
                f"--offset {role}: right, range or depth can be shifted, if chosen; leave it out"
            )
    remarks: list[str] = []
    before = {k: v for k, v in bag.metadata.items() if k not in _WRITTEN_ANEW}
    about = {"made_by": "import bag", **before, **metadata}
    if roles.right is None:
        about |= ONE_VIEW
    if tolerance_ns is not None:
        about["max_skew_ns"] = str(tolerance_ns)
    found = rig or _bag_rig(bag, roles, remarks, about)
    if rig and roles.range and rig.rangefinder is None:
        remarks.append("readings are kept, but the given rig has no [rangefinder] to place them")
    raw = _first_image(bag, roles.left).size_px is not None
    clock = times or _clock(bag, roles, remarks)
    return _Plan(bag, roles, found, clock, offsets_ns, about, raw, remarks)


_WRITTEN_ANEW: Final = frozenset(("profile", "images", "rig", "rangefinder_std_m", "crc32"))


def _first_image(bag: Bag, topic: str | None) -> BagImage:
    assert topic is not None
    image = first_message(bag, bag.topics[topic])
    assert isinstance(image, BagImage)
    return image


def _bag_rig(bag: Bag, roles: Roles, remarks: list[str], about: dict[str, str]) -> Rig:
    """The rig of the bag's calibrations and transforms."""
    frames = Frames(_transforms(bag))
    ours = bag.metadata.get("profile") == PROFILE
    rectified = "image_rect" in (roles.left or "")  # image_proc's names
    left, right = (
        first_message(bag, bag.topics[name]) if name else None
        for name in (roles.left_info, roles.right_info)
    )
    if roles.right is None:
        if left is None:
            size_px = picture_size_px(_first_image(bag, roles.left), roles.left or "")
            about |= NOMINAL
            remarks.append("no calibration of the left camera: a nominal one is kept; or --rig")
            rig = one_view_rig(nominal_camera(size_px))
        else:
            rig = single_rig(left, rectified=rectified)
    elif left is None or right is None:
        side = "left" if left is None else "right"
        raise PomologError(
            f"no calibration of the {side} camera in {bag.path}; give its topic with "
            f"--{side}-info, or a calibration with --rig"
        )
    else:
        rig = stereo_rig(left, right, frames, rectified=rectified, transforms_first=ours)
    if roles.range is None:
        return rig
    left_frame = left.stamp.frame_id if left else ""
    beam: BagRange = first_message(bag, bag.topics[roles.range])
    pose = frames.pose(beam.stamp.frame_id, left_frame)
    if pose is None:
        remarks.append(
            f"no transform from {left_frame or 'the left camera'} to {beam.stamp.frame_id!r}: "
            "readings are kept, but where their beam is nobody knows; give --rig with [rangefinder]"
        )
        return rig
    std_m = float(bag.metadata.get("rangefinder_std_m", USUAL_STD_M))
    return with_rangefinder(rig, pose, beam.direction, std_m)


def _transforms(bag: Bag) -> list[BagTransform]:
    found: list[BagTransform] = []
    names = {
        t.name: t for t in bag.of_kind("transforms")
        if t.encoding != "cdr" or t.name.endswith("tf_static")
    }  # fmt: skip
    with reporting_damage(bag.path, "its transforms", _AGAIN):
        for message in bag.messages(tuple(names)):
            found += decode(names[message.topic], message)
            if len(found) > 10_000:
                break  # moving frames of Foxglove; the first of each child are long there
    return found


def _clock(bag: Bag, roles: Roles, remarks: list[str]) -> Times:
    """The headers' times, unless one has none or they are of several clocks."""
    lags: dict[str, int] = {}
    for role, name in roles.items():
        if role.endswith("-info"):
            continue
        stamp_ns = first_message(bag, bag.topics[name]).stamp.time_ns
        message = bag.first(name)
        assert message is not None
        if stamp_ns == 0 and message.log_ns != 0:
            remarks.append(f"times of arrival: {name} has none in its headers")
            return "arrival"
        lags[name] = message.log_ns - stamp_ns
    if max(lags.values()) - min(lags.values()) > _CLOCKS_AGREE_NS:
        apart_s = (max(lags.values()) - min(lags.values())) / 1e9
        remarks.append(f"times of arrival: the headers' clocks are {apart_s:.0f} s apart")
        return "arrival"
    return "header"


def _in_time(plan: _Plan) -> Iterator[_Item]:
    """Every message with its role; streams of one offset are read together, and all merged."""
    groups: dict[int, dict[str, str]] = {0: dict.fromkeys(our_topics(plan.bag), "ours")}
    for role, name in plan.roles.items():
        if not role.endswith("-info"):
            groups.setdefault(plan.offsets_ns.get(role, 0), {})[name] = role
    streams = [_stream(plan, names, offset_ns) for offset_ns, names in groups.items()]
    return heapq.merge(*streams, key=lambda item: item.time_ns)


def _stream(plan: _Plan, names: Mapping[str, str], offset_ns: int) -> Iterator[_Item]:
    for message in plan.bag.messages(tuple(names)):
        role, topic = names[message.topic], plan.bag.topics[message.topic]
        if role == "ours":
            yield _Item(role, message.log_ns, topic, message)
            continue
        with reporting_damage(plan.bag.path, f"a message of {topic.name}", _AGAIN):
            decoded = decode(topic, message)
        time_ns = message.log_ns
        if plan.times == "header":
            if decoded.stamp.time_ns == 0 and time_ns != 0:
                raise PomologError(
                    f"a message of {topic.name} has no time in its header; try: --times arrival"
                )
            time_ns = decoded.stamp.time_ns
        yield _Item(role, time_ns + offset_ns, topic, message, decoded)


def _write(session: SessionWriter, item: _Item, *, keep_readings: bool) -> None:
    """Write one message in its role."""
    if item.role == "range":
        if keep_readings:
            session.write_reading(reading_of(item.decoded, item.time_ns))
    elif item.role == "depth":
        session.write_depth(to_depth(item.decoded, item.time_ns, item.topic.name))
    else:
        side = SIDES[item.role == "right"]
        sequence = item.message.sequence
        session.write_frame(to_frame(item.decoded, side, item.time_ns, sequence, item.topic.name))


def reading_of(message: BagRange, time_ns: int) -> RangeReading:
    """A distance with what REP 117 says of infinite ones: -inf too near, inf nothing, NaN wrong."""
    value = message.range_m
    if math.isnan(value):
        status = "invalid"
    elif value == -math.inf or value < message.least_m:
        status = "too near"
    elif value == math.inf or (0 < message.most_m < value):
        status = "nothing met"
    else:
        status = "ok"
    known = value if status == "ok" else None
    return RangeReading(time_ns, known, None, status, repr(value))


def _outcome(plan: _Plan, seen: Mapping[str, list[int]]) -> Imported:
    tolerance_ns = int(plan.metadata.get("max_skew_ns", DEFAULT_MAX_SKEW_NS))
    left, right = (np.sort(np.array(seen[side], np.int64)) for side in SIDES)
    pairs = pair_by_time(left, right, tolerance_ns)
    near = pair_by_time(left, right, 10**18)
    gaps_ns = right[near[:, 1]] - left[near[:, 0]]
    return Imported(
        len(left), len(right), len(pairs), len(seen["range"]), len(seen["depth"]), plan.times,
        int(np.median(gaps_ns)) if len(gaps_ns) else None, tolerance_ns, tuple(plan.remarks),
    )  # fmt: skip
