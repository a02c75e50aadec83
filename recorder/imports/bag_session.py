"""A bag of others -> a session: pictures, calibration, readings, depth, on one clock."""

import heapq
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recorder.errors import PomologError
from recorder.imports.bag import Bag, Topic
from recorder.imports.bag_messages import BagRange, decode
from recorder.imports.bag_ours import from_bag, our_topics
from recorder.imports.bag_pictures import to_depth, to_frame
from recorder.imports.bag_plan import AGAIN, ImportPlan, Times, plan_import
from recorder.imports.bag_roles import Roles
from recorder.mcap_records import RawMessage, reporting_damage
from recorder.pairing import pair_by_time
from recorder.records import SIDES, RangeReading
from recorder.rig import Rig
from recorder.session import DEFAULT_MAX_SKEW_NS
from recorder.session_writer import SessionWriter


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
    plan = plan_import(bag, roles, rig, times, offsets_ns or {}, tolerance_ns, metadata or {})
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


def _in_time(plan: ImportPlan) -> Iterator[_Item]:
    """Every message with its role; streams of one offset are read together, and all merged."""
    groups: dict[int, dict[str, str]] = {0: dict.fromkeys(our_topics(plan.bag), "ours")}
    for role, name in plan.roles.items():
        if not role.endswith("-info"):
            groups.setdefault(plan.offsets_ns.get(role, 0), {})[name] = role
    streams = [_stream(plan, names, offset_ns) for offset_ns, names in groups.items()]
    return heapq.merge(*streams, key=lambda item: item.time_ns)


def _stream(plan: ImportPlan, names: Mapping[str, str], offset_ns: int) -> Iterator[_Item]:
    for message in plan.bag.messages(tuple(names)):
        role, topic = names[message.topic], plan.bag.topics[message.topic]
        if role == "ours":
            yield _Item(role, message.log_ns, topic, message)
            continue
        with reporting_damage(plan.bag.path, f"a message of {topic.name}", AGAIN):
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


def _outcome(plan: ImportPlan, seen: Mapping[str, list[int]]) -> Imported:
    tolerance_ns = int(plan.metadata.get("max_skew_ns", DEFAULT_MAX_SKEW_NS))
    left, right = (np.sort(np.array(seen[side], np.int64)) for side in SIDES)
    pairs = pair_by_time(left, right, tolerance_ns)
    near = pair_by_time(left, right, 10**18)
    gaps_ns = right[near[:, 1]] - left[near[:, 0]]
    return Imported(
        len(left), len(right), len(pairs), len(seen["range"]), len(seen["depth"]), plan.times,
        int(np.median(gaps_ns)) if len(gaps_ns) else None, tolerance_ns, plan.remarks,
    )  # fmt: skip
