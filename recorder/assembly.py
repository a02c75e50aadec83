"""Stereo pairs put together from a session's messages as they pass, in bounded memory."""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from recorder.container import Container
from recorder.errors import PomologError
from recorder.mcap_records import RawMessage
from recorder.objects import Place
from recorder.one_view import black_frame
from recorder.profile import (
    IMAGE_TOPICS,
    TRUTH_TOPICS,
    decode_depth,
    decode_frame,
    decode_reading,
)
from recorder.records import SIDES, Frame, FrameTruth, RangeReading, Side, StereoPair
from recorder.rig import Rig
from recorder.truth_messages import decode_labels, decode_truth

READING_WINDOW_NS: Final = 500_000_000  # a reading further away than this belongs to no pair


@dataclass(frozen=True, slots=True, eq=False)
class Assembly:
    """What is known of a session before its messages are read.

    Attributes:
        path: for messages to people.
        container: the open file.
        rig: its calibration, which every picture must fit.
        times_ns: (P, 2) left and right times of every pair.
        indexed: the times of each view's frames, by topic.
        one_view: the right frames are black.
        max_skew_ns: depth further from a left frame than this belongs to no pair.
        conditions: what held at a time.
    """

    path: Place
    container: Container
    rig: Rig
    times_ns: npt.NDArray[np.int64]
    indexed: Mapping[str, set[int]]
    one_view: bool
    max_skew_ns: int
    conditions: Callable[[int], dict[str, str]]

    def pairs(
        self, start: int, stop: int, window: tuple[int | None, int | None]
    ) -> Iterator[StereoPair]:
        """Gather each pair's messages as they pass; a pair is whole once its window is over."""
        times = self.times_ns
        topics = {*IMAGE_TOPICS.values(), *TRUTH_TOPICS, "/rangefinder", "/depth"}
        pair_of = {
            (topic, int(times[i, column])): i
            for column, known in enumerate(
                ((IMAGE_TOPICS["left"], *TRUTH_TOPICS), (IMAGE_TOPICS["right"],))
            )  # the left frame's time names the pair, so all of its truth has that time
            for topic in known
            for i in range(start, stop)
        }
        lefts = times[:, 0].tolist()
        found: dict[int, dict[str, RawMessage]] = {}
        readings: dict[int, list[RangeReading]] = {}
        due = start
        for message in self.container.messages(topics, *window):
            if message.log_ns not in self.indexed.get(message.topic, (message.log_ns,)):
                raise ValueError(f"a {message.topic} that is not indexed")  # no CRC covers that
            while due < stop and message.log_ns > int(times[due].max()) + READING_WINDOW_NS:
                yield self._pair(due, found.pop(due, {}), readings.pop(due, []))
                due += 1
            if message.topic == "/rangefinder":
                nearest = _nearest_place(lefts, message.log_ns)
                if abs(lefts[nearest] - message.log_ns) <= READING_WINDOW_NS:
                    readings.setdefault(nearest, []).append(decode_reading(message))
                continue
            if message.topic == "/depth":
                self._place_depth(message, lefts, found)
                continue
            index = pair_of.get((message.topic, message.log_ns))
            if index is not None:
                found.setdefault(index, {}).setdefault(message.topic, message)
        for index in range(due, stop):
            yield self._pair(index, found.pop(index, {}), readings.pop(index, []))

    def _place_depth(
        self, message: RawMessage, lefts: Sequence[int], found: dict[int, dict[str, RawMessage]]
    ) -> None:
        """Give a depth picture to the pair of its moment, if none is nearer."""
        index = _nearest_place(lefts, message.log_ns)
        held = found.setdefault(index, {}).get("/depth")
        gaps_ns = [abs(lefts[index] - m.log_ns) for m in (message, held) if m is not None]
        if gaps_ns[0] <= self.max_skew_ns and gaps_ns[0] == min(gaps_ns):
            found[index]["/depth"] = message

    def _pair(
        self, index: int, found: Mapping[str, RawMessage], readings: Sequence[RangeReading]
    ) -> StereoPair:
        sides = SIDES[:1] if self.one_view else SIDES
        missing = [IMAGE_TOPICS[side] for side in sides if IMAGE_TOPICS[side] not in found]
        if missing:
            raise PomologError(
                f"{self.path} is damaged (its index has a {missing[0]} for pair {index} that is "
                f"not there); try: pomolog salvage {self.path} -o whole.mcap"
            )
        left = self._frame("left", found["/left/image"], index)
        right = (
            black_frame(left)
            if self.one_view
            else self._frame("right", found["/right/image"], index)
        )
        return StereoPair(
            index,
            left,
            right,
            tuple(readings),
            self._truth(found),
            self.conditions(left.time_ns),
            decode_depth(found["/depth"]) if "/depth" in found else None,
        )

    def _frame(self, side: Side, message: RawMessage, index: int) -> Frame:
        frame = decode_frame(side, message, self.container.schema_name(message.topic) or "")
        wanted = self.rig.camera(side).size_px
        if frame.size_px != wanted:
            raise PomologError(
                f"the {side} picture of pair {index} in {self.path} is {frame.size_px[0]} x "
                f"{frame.size_px[1]} px, its calibration {wanted[0]} x {wanted[1]}; "
                "import it again with the right --rig"
            )
        return frame

    def _truth(self, found: Mapping[str, RawMessage]) -> FrameTruth | None:
        if not any(topic in found for topic in TRUTH_TOPICS):
            return None
        left, right = (
            decode_labels(found[topic], self.rig.camera(side).size_px) if topic in found else None
            for side in SIDES
            for topic in (f"/truth/{side}",)
        )
        if "/truth/apples" not in found:
            return FrameTruth(left, right)
        truth = decode_truth(found["/truth/apples"], left, right)
        if self.one_view and truth.apples:  # there is no right view in which they could be seen
            unseen = tuple(replace(apple, right_visible=0.0) for apple in truth.apples)
            return replace(truth, apples=unseen)
        return truth


def _nearest_place(sorted_times: Sequence[int], time_ns: int) -> int:
    after = bisect_left(sorted_times, time_ns)
    candidates = [i for i in (after - 1, after) if 0 <= i < len(sorted_times)]
    return min(candidates, key=lambda i: abs(sorted_times[i] - time_ns))
