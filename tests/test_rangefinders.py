"""Rangefinders through pyserial on pty pairs, with faults on the line."""

import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from recorder.equipment import RangefinderSettings
from recorder.errors import PomologError
from recorder.ledger import RANGEFINDER_COUNTS, StreamLedger
from recorder.rangefinder_loop import RangefinderLoop
from recorder.rangefinders import Answer, Confirmation
from recorder.rangefinders.benewake import Benewake
from recorder.rangefinders.dimetix import Dimetix, with_even_parity
from recorder.rangefinders.lightware import LightWareBinary, LightWareText, crc16, packet
from recorder.rangefinders.typed import read_typed
from tests.line_devices import (
    LineDevice,
    benewake_frame,
    dimetix_answer,
    lightware_answer,
    lightware_packet,
)
from tests.real_parts import need_module

DEVICES: dict[str, Callable[..., LineDevice]] = {
    "dimetix": lambda **more: LineDevice(
        dimetix_answer, start=with_even_parity(b"s0h\r\n"), **more
    ),
    "lightware": lambda **more: LineDevice(lightware_answer, hear=b"d", **more),
    "lightware-binary": lambda **more: LineDevice(lightware_packet, hear=packet(44), **more),
    "benewake": lambda **more: LineDevice(benewake_frame, **more),
}
TRUE_WITHIN_M = {
    "dimetix": 0.0051,
    "lightware": 0.101,
    "lightware-binary": 0.0051,
    "benewake": 0.0051,
}


@contextmanager
def listening(
    settings: RangefinderSettings, ledger: StreamLedger | None = None
) -> Iterator[tuple[RangefinderLoop, list[tuple[Answer, bool, int | None]], list[str]]]:
    need_module("serial", "serial")
    answers: list[tuple[Answer, bool, int | None]] = []
    told: list[str] = []
    loop = RangefinderLoop(
        settings,
        ledger or StreamLedger(RANGEFINDER_COUNTS),
        0.5,
        lambda answer, _, asked, apple: answers.append((answer, asked, apple)),
        told.append,
    )
    loop.start()
    try:
        yield loop, answers, told
    finally:
        loop.stop()
        assert loop.failure is None


def until(done: Callable[[], bool], seconds: float = 8.0) -> None:
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.01)
    assert done()


@pytest.mark.parametrize("driver", DEVICES)
def test_with_a_tenth_of_the_answers_damaged_no_reading_is_false(driver: str) -> None:
    ledger = StreamLedger(RANGEFINDER_COUNTS)
    scene = lambda n: 1.0 + 0.5 * (n // 40)  # noqa: E731  # a new fruit every 40 answers
    with DEVICES[driver](distance_m=scene, faults=0.1) as device:
        settings = RangefinderSettings(driver=driver, port=device.path, rate_hz=100)  # type: ignore[arg-type]  # the keys are drivers
        with listening(settings, ledger) as (_, answers, _):
            until(lambda: len(device.sent) >= 300, 20)
    good = [answer.range_m for answer, *_ in answers if answer.range_m is not None]
    true = set(device.sent)
    within = TRUE_WITHIN_M[driver]
    false = [r for r in good if min(abs(r - t) for t in true) > within]
    assert false == []
    assert device.damaged > 15
    assert ledger.faults > 0.5 * device.damaged
    assert len(good) > 0.7 * len(device.sent)


@pytest.mark.parametrize("driver", DEVICES)
def test_a_device_that_falls_silent_is_opened_anew(driver: str) -> None:
    ledger = StreamLedger(RANGEFINDER_COUNTS)
    with DEVICES[driver]() as device:
        settings = RangefinderSettings(driver=driver, port=device.path, rate_hz=50)  # type: ignore[arg-type]  # as above
        with listening(settings, ledger) as (_, answers, told):
            until(lambda: any(a.range_m for a, *_ in answers))
            device.silent.set()
            until(lambda: ledger.reopened >= 1)
            device.silent.clear()
            before = len(answers)
            until(lambda: any(a.range_m for a, *_ in answers[before:]))
    assert "silent" in told[0]


def test_the_key_takes_the_next_good_reading_for_the_apple_named() -> None:
    with DEVICES["dimetix"]() as device:
        settings = RangefinderSettings(driver="dimetix", port=device.path)
        with listening(settings) as (loop, answers, _):
            until(lambda: len(answers) > 3)
            loop.want(7)
            until(lambda: any(asked for _, asked, _ in answers))
    asked = [(answer.range_m, apple) for answer, asked, apple in answers if asked]
    assert asked == [(1.234, 7)]


def test_a_key_without_a_good_reading_says_so() -> None:
    with LineDevice(
        lambda _: with_even_parity(b"g0@E255\r\n"), start=with_even_parity(b"s0h\r\n")
    ) as device:
        settings = RangefinderSettings(driver="dimetix", port=device.path)
        with listening(settings) as (loop, answers, told):
            until(lambda: len(answers) > 0)
            loop.want(None)
            until(lambda: bool(told))
    assert "no reading" in told[0]
    assert answers[0][0] == Answer(None, "E255", "g0@E255")


def test_a_port_that_is_not_there_is_one_line() -> None:
    need_module("serial", "serial")
    with (
        pytest.raises(PomologError, match="is it plugged in"),
        listening(RangefinderSettings(driver="dimetix", port="/dev/no-such-port")),
    ):
        pass


def test_parity_is_refused_where_there_is_none() -> None:
    settings = RangefinderSettings(driver="benewake", port="/dev/null", parity="even")
    with pytest.raises(PomologError, match="no parity"), listening(settings):
        pass


def test_dimetix_checks_every_bit_and_reads_tenths_of_a_millimetre() -> None:
    whole = dimetix_answer(4.5327)
    assert Dimetix().feed(whole) == [Answer(4.5327, "ok", "g0h+00045327")]
    for place in range(len(whole) - 2):
        for bit in range(8):
            flipped = bytearray(whole)
            flipped[place] ^= 1 << bit
            (answer,) = Dimetix().feed(bytes(flipped))
            assert answer.fault
    assert Dimetix("none").feed(b"g0?\r\ng0@E256\r\n") == [Answer(None, "E256", "g0@E256")]


@pytest.mark.parametrize(
    ("line", "range_m", "status"),
    [
        ("98.67", 98.67, "ok"),
        ("?LD 98.67", 98.67, "ok"),
        ("ld,0:23.67", 23.67, "ok"),
        ("230.00", None, "no signal"),
        ("-1.00", None, "no signal"),
        ("9.7", None, "fault: no answer"),
        ("98.67 98.67", None, "fault: no answer"),
    ],
)
def test_lightware_lines(line: str, range_m: float | None, status: str) -> None:
    (answer,) = LightWareText().feed(f"{line}\r\n".encode())
    assert (answer.range_m, answer.status, answer.raw) == (range_m, status, line)


def test_lightware_packets_hold_against_their_crc() -> None:
    assert crc16(b"123456789") == 0x31C3  # CRC-16/XMODEM's check value
    whole = lightware_packet(2.5)
    assert [a.range_m for a in LightWareBinary().feed(whole * 2)] == [2.5, 2.5]
    reader = LightWareBinary()
    split = [a for byte in whole for a in reader.feed(bytes((byte,)))]
    assert [a.range_m for a in split] == [2.5]
    for place in range(len(whole)):
        for bit in range(8):
            flipped = bytearray(whole)
            flipped[place] ^= 1 << bit
            answers = LightWareBinary().feed(bytes(flipped) + whole)
            assert [a.range_m for a in answers if a.range_m] in ([2.5], [])


def test_benewake_finds_the_frame_after_any_single_fault() -> None:
    frame = benewake_frame(1.5)
    rng = random.Random(3)
    for _ in range(2000):
        damaged = bytearray(frame)
        damaged[rng.randrange(9)] = rng.randrange(256)
        if rng.random() < 0.5:
            del damaged[rng.randrange(9)]
        answers = Benewake().feed(frame + bytes(damaged) + frame + frame + frame)
        ranges = [a.range_m for a in answers if a.range_m is not None]
        assert set(ranges) == {1.5}
        assert len(ranges) >= 2


def test_an_endless_line_is_a_fault_and_not_memory() -> None:
    reader = LightWareText()
    answers = [a for _ in range(100) for a in reader.feed(b"7" * 50)]
    assert answers
    assert all(answer.fault for answer in answers)


def test_an_unconfirmed_distance_is_kept_as_text_only() -> None:
    confirmation = Confirmation(0.005)
    seen = [confirmation.check(Answer(r, "ok", str(r))) for r in (1.0, 1.001, 9.0, 1.002, 1.001)]
    assert [answer.range_m for answer in seen] == [None, 1.001, None, 1.002, 1.001]
    assert (seen[2].status, seen[2].raw) == ("unconfirmed", "9.0")


@pytest.mark.parametrize(
    ("line", "range_m", "apple"),
    [
        ("4,532 m", 4.532, None),
        ("4.532m", 4.532, None),
        ("4532 mm", 4.532, None),
        ("3.2 # tree 7", 3.2, None),
        ("3.2 # apple 7", 3.2, 7),
        ("321 cm #12", 3.21, 12),
        ("1,85", 1.85, None),
    ],
)
def test_typed_distances(line: str, range_m: float, apple: int | None) -> None:
    found = read_typed(line)
    assert found is not None
    assert found.answer.range_m == pytest.approx(range_m, abs=1e-9)
    assert (found.apple_id, found.answer.raw) == (apple, line)


@pytest.mark.parametrize(
    "line",
    ["4,532 mm", "4532", "4.5.3 m", "4,5x2 m", "900 m", "0 m", "1.2 m1.2 m", "3 apples fell"],
)
def test_what_can_be_read_in_two_ways_is_refused(line: str) -> None:
    found = read_typed(line)
    assert found is not None
    assert found.answer.range_m is None
    assert found.answer.fault
    assert found.answer.raw == line


@pytest.mark.parametrize("line", ["tree 7, south side", "lighting=back", "# 3.2"])
def test_other_lines_are_notes(line: str) -> None:
    assert read_typed(line) is None


def test_a_distance_typed_twice_stands_where_that_is_asked_for() -> None:
    confirmation = Confirmation(0.005)
    lines = ("4,532 m", "4,532 m", "3,200 m", "3,700 m", "3,200 m")
    read = [found.answer for line in lines if (found := read_typed(line))]
    assert [confirmation.check(answer).range_m for answer in read] == [
        None, 4.532, None, None, 3.2,
    ]  # fmt: skip
