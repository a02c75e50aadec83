"""Rangefinders with a tenth of their answers damaged on the line: what is kept, what is false.

    python -m benchmarks.rangefinders [ANSWERS]

Devices talk over ptys through pyserial. The last column is what the same bytes would have given if
two answers did not have to agree (protocols without a checksum).
"""

import random
import sys
import time
from typing import Final

from recorder.equipment import RangefinderDriver, RangefinderSettings
from recorder.ledger import RANGEFINDER_COUNTS, StreamLedger
from recorder.rangefinder_loop import RangefinderLoop
from recorder.rangefinders import Answer, Confirmation
from recorder.rangefinders.typed import read_typed
from tests.line_devices import DAMAGES
from tests.test_rangefinders import DEVICES, TRUE_WITHIN_M

FAULTS: Final = 0.1


def measure(driver: RangefinderDriver, answers: int, confirm_m: float | None) -> tuple[int, ...]:
    """Sent, damaged, kept, faults seen, false."""
    got: list[Answer] = []
    ledger = StreamLedger(RANGEFINDER_COUNTS)

    def distance_m(n: int) -> float:
        return 1.0 + 0.5 * (n // 40)  # a new fruit every 40 answers

    with DEVICES[driver](distance_m=distance_m, faults=FAULTS, seed=11) as device:
        settings = RangefinderSettings(
            driver=driver, port=device.path, rate_hz=100, confirm_m=confirm_m
        )
        loop = RangefinderLoop(
            settings, ledger, 1.0, lambda answer, *_: got.append(answer), lambda _: None
        )
        loop.start()
        while len(device.sent) < answers:
            time.sleep(0.02)
        loop.stop()
        true = set(device.sent)
        sent, damaged = len(device.sent), device.damaged
    kept = [answer.range_m for answer in got if answer.range_m is not None]
    false = sum(min(abs(r - t) for t in true) > TRUE_WITHIN_M[driver] for r in kept)
    return sent, damaged, len(kept), ledger.faults, false


def measure_typed(answers: int, times: int) -> tuple[int, ...]:
    """The same for a meter that types `4,532 m`, each distance once or twice."""
    chance = random.Random(11)
    damaged = kept = faults = false = 0
    confirmation = Confirmation(0.005 if times > 1 else 0.0)
    for number in range(answers):
        true_m = 1.0 + number // times / 10
        line = f"{true_m:.3f} m".replace(".", ",").encode()
        if chance.random() < FAULTS:
            damaged += 1
            line = chance.choice(DAMAGES)(chance, line)
        found = read_typed(line.decode("latin-1"))
        answer = confirmation.check(found.answer) if found else None
        faults += found is None or found.answer.fault
        if answer is not None and answer.range_m is not None:
            kept += 1
            false += abs(answer.range_m - true_m) > 0.0005
    return answers, damaged, kept, faults, false


def main(answers: int) -> None:
    """Print the table."""
    print(f"{'driver':18} {'sent':>5} {'damaged':>8} {'kept':>5} {'faults':>7} {'false':>6}  alone")
    for driver in DEVICES:
        row = measure(driver, answers, None)  # type: ignore[arg-type]  # the keys are drivers
        alone = measure(driver, answers, 0.0)[-1]  # type: ignore[arg-type]  # as above
        print(f"{driver:18} {row[0]:5} {row[1]:8} {row[2]:5} {row[3]:7} {row[4]:6} {alone:6}")
    row, alone = measure_typed(answers, 2), measure_typed(answers, 1)[-1]
    print(f"{'typed (twice)':18} {row[0]:5} {row[1]:8} {row[2]:5} {row[3]:7} {row[4]:6} {alone:6}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
