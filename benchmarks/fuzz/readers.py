"""Processes that read mutated files, bounded and watched; one that dies is told and replaced."""

import multiprocessing
import random
import resource
import shutil
import time
import traceback
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final

from benchmarks.fuzz.material import material
from benchmarks.fuzz.targets import sound_answers, targets
from recorder.errors import PomologError

HANG_S: Final = 60.0  # an input takes some 20 ms; the machine may be busy
MEMORY_BYTES: Final = 3 << 30  # more than these processes have mapped before the first input

Report = tuple[int, str, str, float, int]  # number, verdict, detail, seconds, MB at most


def read_inputs(
    pipe: Connection, sound: Path, answers: dict[str, set[str]], seed: int, only: str
) -> None:
    """In a process: read the inputs whose numbers come through the pipe."""
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + MEMORY_BYTES,) * 2)
    known = [target for target in targets(sound) if only in target.name]
    folder = sound.parent / f"input-{multiprocessing.current_process().pid}"
    while (number := pipe.recv()) is not None:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        target = known[number % len(known)]
        path = target.make(sound, folder, random.Random(f"{seed} {number}"))
        started = time.perf_counter()
        verdict, detail = "refused", ""
        try:
            same = target.judge(path, folder) in answers[target.name]
            verdict = "same answer" if same else "WRONG" if target.sealed else "other answer"
        except PomologError as error:
            detail = " ".join(str(error).split())  # as the front door prints it
            if not detail or len(detail) > 1000:
                verdict = "NO LINE"
        except BaseException:
            verdict, detail = "CRASH", traceback.format_exc()
        seconds = time.perf_counter() - started
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        pipe.send((number, verdict, detail, seconds, peak_mb))


@dataclass(slots=True)
class Reader:
    """One process that reads inputs, and what it is at."""

    process: BaseProcess
    pipe: Connection
    number: int
    since: float = field(default_factory=time.monotonic)


class Fuzz:
    """Numbers in, verdicts out; a process that dies or hangs is told and replaced."""

    def __init__(self, folder: Path, seed: int, only: str) -> None:
        self.sound = folder / "sound"
        material(self.sound)
        self.answers = sound_answers(self.sound, folder / "first")
        self.names = [target.name for target in targets(self.sound) if only in target.name]
        self._args = (self.sound, self.answers, seed, only)

    def start(self, number: int) -> Reader:
        """A process on its first input."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=read_inputs, args=(theirs, *self._args), daemon=True)
        process.start()
        theirs.close()
        ours.send(number)
        return Reader(process, ours, number)

    def run(self, numbers: list[int], workers: int) -> list[Report]:
        """Read every input; reports in the order in which they came."""
        todo = numbers[::-1]
        readers = [self.start(todo.pop()) for _ in range(min(workers, len(todo)))]
        reports: list[Report] = []
        while readers:
            ready = wait([reader.pipe for reader in readers], timeout=1)
            for reader in list(readers):
                if reader.pipe in ready:
                    report = _received(reader)
                elif time.monotonic() - reader.since > HANG_S:
                    report = (reader.number, "HANG", f"more than {HANG_S:g} s", HANG_S, 0)
                else:
                    continue
                reports.append(report)
                dead = report[1] in ("HANG", "KILLED")
                if dead:
                    readers.remove(reader)
                    reader.process.kill()
                if todo and dead:
                    readers.append(self.start(todo.pop()))
                elif todo:
                    reader.number, reader.since = todo.pop(), time.monotonic()
                    reader.pipe.send(reader.number)
                elif not dead:
                    reader.pipe.send(None)
                    reader.process.join()
                    readers.remove(reader)
        return reports


def _received(reader: Reader) -> Report:
    try:
        report: Report = reader.pipe.recv()
    except (EOFError, ConnectionResetError):
        reader.process.join()
        return reader.number, "KILLED", f"exit {reader.process.exitcode}", 0.0, 0
    return report
