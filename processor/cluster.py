"""A Dask cluster as the workers of a replay: the only importer of Dask.

Dask replaces workers and does their jobs again by itself, until several have died over a job
(`distributed.scheduler.allowed-failures`, 3). It blames all jobs that a dead worker had, so such a
job is tried once more alone. Whoever can reach a Dask scheduler can run code on it, so it belongs
into a network of one's own, or behind Dask's TLS: see docs/scale.md.
"""

import threading
import warnings
from collections import deque
from typing import Any, Final, Self

from processor.slices import Joined, Tick
from processor.workers import Job, Result, killer, our_bug
from recorder.errors import PomologError

CONNECT_S: Final = 15
_one_at_a_time = threading.Lock()  # in a worker of several threads; a slice is one thread's work


class Cluster:
    """The workers of a Dask scheduler. Use it as a context manager.

    Args:
        address: the scheduler's, like tcp://10.0.0.1:8786.
        tick: called with the number of pairs that are done.

    Raises:
        PomologError: Dask is not installed, no scheduler answers, or it has no workers.
    """

    def __init__(self, address: str, tick: Tick) -> None:
        try:
            import distributed
            from distributed.comm.core import CommClosedError
        except ImportError:
            raise PomologError(
                "--cluster needs Dask; install it: pip install 'pomolog[cluster]'"
            ) from None
        self._killed = distributed.KilledWorker
        self._gone = (distributed.CancelledError, CommClosedError)
        self._address = address
        self._tick = tick
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # versions are compared by our own jobs
                self._client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split())[:200]
            raise PomologError(
                f"no Dask scheduler at {address} ({reason}); start one with: dask scheduler"
            ) from None
        self._running: dict[Any, Job] = {}
        self._suspects: deque[Job] = deque()  # one of them killed workers
        self._done = distributed.as_completed(loop=self._client.loop)
        if not self._threads():
            self._client.close()
            raise PomologError(
                f"the cluster at {address} has no workers; start some with: dask worker {address}"
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.cancel(list(self._running), force=True)
        self._client.close()

    def _threads(self) -> int:
        return sum(self._client.nthreads().values())

    @property
    def room(self) -> int:
        """For one job a thread, and one each that waits; for none while one is suspected."""
        return 0 if self._suspects else max(2, 2 * self._threads()) - len(self._running)

    def submit(self, job: Job) -> None:
        """Queue a job; its paths must mean the same on every worker."""
        future = self._client.submit(_do, job, pure=False)
        self._running[future] = job
        self._done.add(future)

    def next_done(self) -> tuple[Job, Result]:
        """Wait for any job.

        Raises:
            PomologError: the scheduler is gone.
        """
        while self._running:
            job, result, killed = self._settled()
            if not killed:
                return job, result
            self._suspects.append(job)
        self.submit(self._suspects.popleft())  # alone: Dask blames all that a dead worker had
        return self._settled()[:2]

    def _settled(self) -> tuple[Job, Result, bool]:
        """A job, what became of it, and whether it was there when several workers died."""
        future = next(self._done)
        job = self._running.pop(future)
        try:
            result: Joined | None = future.result()
        except PomologError as error:
            return job, error, False
        except self._killed:
            return job, killer(job, "with more memory a worker"), True
        except self._gone:
            raise PomologError(
                f"the cluster at {self._address} is gone; run the same command again, it goes on"
            ) from None
        except ImportError as error:
            lacking = f"{job}: a worker lacks something ({error})"
            return job, PomologError(f"{lacking}; install the same pomolog on every one"), False
        except Exception as bug:
            return job, our_bug(job, bug), False
        self._tick(job.pairs)
        return job, result, False


def _do(job: Job) -> Joined | None:
    with _one_at_a_time:
        return job()
