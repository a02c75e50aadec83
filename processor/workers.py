"""Who does the work of a replay: this process, a pool of processes, or a cluster.

All three take jobs and give back each with its result. A worker that dies is replaced and its
job done again; a job that kills its workers is given up, and the others go on.
"""

import traceback
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Final, Protocol

from processor.pool import processes
from processor.slices import Join, Joined, Slice, Tick
from recorder.errors import PomologError

TRIES_ALONE: Final = 2  # after a first death in company: a job that kills its worker thrice is bad

Job = Slice | Join
Result = Joined | PomologError | None


class Crew(Protocol):
    """Workers: jobs in, results out in whatever order they are done."""

    @property
    def room(self) -> int:
        """How many more jobs it takes now."""

    def submit(self, job: Job) -> None:
        """Hand over a job."""

    def next_done(self) -> tuple[Job, Result]:
        """Wait for a job; an error is its result, whatever went wrong."""


@contextmanager
def hire(workers: int, cluster: str, tick: Tick) -> Iterator[Crew]:
    """The workers asked for; they go when the context ends.

    Args:
        workers: processes on this machine; 1 works here.
        cluster: the address of a Dask scheduler, or empty.
        tick: called with the number of pairs that are done.

    Raises:
        PomologError: no cluster answers there.
    """
    if cluster:
        from processor.cluster import Cluster

        with Cluster(cluster, tick) as far:
            yield far
    elif workers > 1:
        pool = Pool(workers, tick)
        try:
            yield pool
        finally:
            pool.close()
    else:
        yield Here(tick)


class Here:
    """This process, one job at a time."""

    def __init__(self, tick: Tick) -> None:
        self._tick = tick
        self._jobs: deque[Job] = deque()

    @property
    def room(self) -> int:
        """For one job."""
        return 1 - len(self._jobs)

    def submit(self, job: Job) -> None:
        """Keep a job until `next_done`."""
        self._jobs.append(job)

    def next_done(self) -> tuple[Job, Result]:
        """Do it."""
        job = self._jobs.popleft()
        try:
            return job, job(self._tick)
        except PomologError as error:
            error.__cause__ = error.__context__ = None  # their frames hold files open
            return job, error.with_traceback(None)
        except Exception as bug:
            return job, our_bug(job, bug)


class Pool:
    """Processes on this machine."""

    def __init__(self, workers: int, tick: Tick) -> None:
        self._workers = workers
        self._tick = tick
        self._pool = processes(workers)
        self._running: dict[Future[Joined | None], Job] = {}
        self._suspects: deque[Job] = deque()  # one of them killed a worker

    @property
    def room(self) -> int:
        """For one job a worker, and one each that waits; for none while one is suspected."""
        return 0 if self._suspects else 2 * self._workers - len(self._running)

    def submit(self, job: Job) -> None:
        """Queue a job."""
        try:
            self._running[self._pool.submit(job)] = job
        except BrokenProcessPool:  # just now; the job is innocent, and is done all the same
            self._suspects.append(job)

    def next_done(self) -> tuple[Job, Result]:
        """Wait for any job."""
        while self._running:
            done, _ = wait(self._running, return_when=FIRST_COMPLETED)
            future = done.pop()
            job = self._running.pop(future)
            if found := self._settled(job, future):
                return found
            self._suspects.append(job)
        job = self._suspects.popleft()
        if not self._suspects:
            self._pool.shutdown()
            self._pool = processes(self._workers)
        return self._alone(job)

    def _alone(self, job: Job) -> tuple[Job, Result]:
        """Find out whether it was this one, in a process of its own."""
        for _ in range(TRIES_ALONE):
            with processes(1) as pool:
                if found := self._settled(job, pool.submit(job)):
                    return found
        return job, killer(job, "with fewer --workers")

    def _settled(self, job: Job, future: Future[Joined | None]) -> tuple[Job, Result] | None:
        """A job and what became of it; None: its worker died."""
        try:
            result = future.result()
        except BrokenProcessPool:
            return None
        except PomologError as error:
            return job, error
        except Exception as bug:
            return job, our_bug(job, bug)
        self._tick(job.pairs)
        return job, result

    def close(self) -> None:
        """Let the workers go; what they have not begun is dropped."""
        self._pool.shutdown(cancel_futures=True)


def killer(job: Job, now: str) -> PomologError:
    """The line for a job that kills whoever does it."""
    return PomologError(
        f"{job}: every worker on it was killed, perhaps for want of memory; "
        f"run the same command again {now}, it goes on"
    )


def our_bug(job: Job, bug: Exception) -> PomologError:
    """The line for a job that met a mistake of ours: one session must not stop a season."""
    frames = traceback.extract_tb(bug.__traceback__)
    where = f" in {frames[-1].filename}:{frames[-1].lineno}" if frames else ""
    reason = " ".join(str(bug).split())[:200]
    return PomologError(
        f"{job}: a bug of pomolog ({type(bug).__name__}: {reason}{where}); please report it"
    )
