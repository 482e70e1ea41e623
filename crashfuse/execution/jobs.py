"""Computations in the background of a server, queued, shared by its visitors and watched by them."""

import logging
import math
import os
import queue
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from statistics import median
from typing import Any, Generic, Literal, TypeVar

from crashfuse.errors import OUT_OF_MEMORY, Cancelled, CrashfuseError, out_of_memory
from crashfuse.execution.progress import Progress, Watch
from crashfuse.execution.training_progress import Watched
from crashfuse.execution.visitors import Visitor, note_in_log

_LOOPS, _USUAL_S = 500_000, 0.0155  # of the processor that expected seconds are of
_LEAST, _MOST = 0.7, 1.5  # times what is expected; once more than that where others compute, whose work may end or grow
_LATEST = 3  # jobs that tell how fast this machine is; more would tell how it was
_SKIPPED = 0.2  # of what is expected: it was read rather than computed
_BUSY = 1.5


def slowness() -> float:
    """How many times longer than on a quiet usual core a fixed piece of work takes now."""
    begun = time.perf_counter()
    for _ in range(_LOOPS):
        pass
    return (time.perf_counter() - begun) / _USUAL_S


class Pace:
    """What the latest jobs took for what was expected of them."""

    def __init__(self) -> None:
        self._ratios = deque[float](maxlen=_LATEST)

    def learn(self, expected_s: float, took_s: float) -> None:
        """Take a finished job into account."""
        if took_s > _SKIPPED * expected_s > 0:
            self._ratios.append(took_s / expected_s)

    def range_s(self, usual_s: float, slow: float) -> tuple[float, float]:
        """Seconds from–to of what takes ``usual_s`` on two quiet usual cores, if all is now this many times slower."""
        expected = usual_s * slow * (median(self._ratios) if self._ratios else 1.0)
        return _LEAST * expected, _MOST * expected * (_MOST if slow > _BUSY else 1.0)


State = Literal["waiting", "running", "done", "failed", "cancelled"]
T = TypeVar("T")
_NICE = 5  # beside pages: a third of their share of a core that both want
_STOPS_S = 30.0  # after it was cancelled, without a report; the code of another package may never stop
_SILENT_S = 1800.0  # without a report; no step of ours takes that long
_LOOK_S = 1.0
_KEPT = 24  # finished jobs; a whole study takes about 120 MB, one test 5 MB
log = logging.getLogger(__name__)


class Job(Generic[T]):
    """A computation, its progress and its outcome."""

    def __init__(self, title: str, work: Callable[[Watch], T], pace: Pace, usual_s: float = 0.0) -> None:
        self.title = title
        self.expected_s: tuple[float, float] | None = None  # from–to, once it runs, if anything is known of it
        self._pace, self._usual_s = pace, usual_s
        self.wanted_by: set[Visitor] = set()
        self._asked_by: set[Visitor] = set()  # those who have cancelled it since among them
        self.places: dict[Visitor, Any] = {}  # where each of them asked for it, and will look for the result
        self.state: State = "waiting"
        self.part: T | None = None  # while it runs: what is known of the result, replaced as more is known
        self.result: T | None = None  # what the work returned, once done
        self.message = ""  # one sentence on why it failed
        self._heard = math.inf  # when it reported last
        self._began_s: float | None = None
        self._work: Callable[[Watch], T] | None = work
        self._joining = threading.Lock()
        self._cancel = threading.Event()
        self._ended = threading.Event()
        self._watch = Watched(self._report, self._cancel, self._show_part)
        self.steps = self._watch.steps  # so far, in order of start

    @property
    def active(self) -> bool:
        """True if it is waiting or running."""
        return self.state in ("waiting", "running")

    @property
    def cancelling(self) -> bool:
        """True if it was told to stop but has not stopped yet."""
        return self.active and self._cancel.is_set()

    @property
    def elapsed_s(self) -> float:
        """Seconds since it began; 0 while it waits."""
        return 0.0 if self._began_s is None else time.monotonic() - self._began_s

    def join(self, visitor: Visitor) -> None:
        """Note that someone wants it, unless it is being stopped already."""
        with self._joining:
            if not self._cancel.is_set():
                self.wanted_by.add(visitor)
                self._asked_by.add(visitor)

    def cancel(self, visitor: Visitor) -> None:
        """Note that someone wants it no more; once nobody does, it stops at its next report, at once while it waits."""
        with self._joining:
            self.wanted_by.discard(visitor)
            if self.wanted_by:
                return
            self._cancel.set()
            self._heard = time.monotonic()
            if self.state != "waiting":
                return
            self.state, self._work = "cancelled", None  # at once: what is ahead of it may take hours
        self._end("cancelled")

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until it has ended; False on timeout."""
        return self._ended.wait(timeout_s)

    def compute(self) -> None:
        """Compute in a thread of its own, and wait until it has ended, or does not report any more."""
        threading.Thread(target=self._run, name="crashfuse-jobs", daemon=True).start()
        while not self.wait(_LOOK_S):
            if time.monotonic() - self._heard > (_STOPS_S if self.cancelling else _SILENT_S):
                log.warning("%s has not reported for long; others are computed beside it.", self.title)
                if self.cancelling:
                    self._end("cancelled")
                return

    def _run(self) -> None:
        with self._joining:
            if self.state != "waiting":
                return
            work, self._work = self._work, None  # so that the objects the work refers to can be freed
            self.state, self._heard = "running", time.monotonic()
            known = 0 < self._usual_s < math.inf
            self._began_s, slow = self._heard, slowness() if known else 1.0
            self.expected_s = self._pace.range_s(self._usual_s, slow) if known else None
            note_in_log(self.wanted_by, f"started: {self.title}")
        try:
            result = None if work is None else work(self._watch)
            if known:
                self._pace.learn(self._usual_s * slow, self.elapsed_s)
            self._end("done", result=result)
        except Cancelled:
            self._end("cancelled")
        except CrashfuseError as error:
            self._end("failed", str(error))
        except BaseException as error:  # SystemExit, too: the thread is the last to know of it
            if out_of_memory(error):
                self._end("failed", OUT_OF_MEMORY)
                return
            log.exception("%s failed", self.title)
            text = f"This should not have happened ({type(error).__name__}: {error}); the log has the details."
            self._end("failed", text)

    def _end(self, state: State, message: str = "", result: T | None = None) -> None:
        with self._joining:
            if self._ended.is_set():
                return
            self.result, self.part, self.message, self.state = result, None, message, state
            note_in_log(self._asked_by, f"{state}: {self.title}{f' ({message})' if message else ''}")
            self._ended.set()

    def _show_part(self, part: T) -> None:
        self.part = part

    def _report(self, _: Progress) -> None:
        self._heard = time.monotonic()


class Jobs:
    """The queue: one job at a time, first come, first served; the latest results are kept."""

    def __init__(self) -> None:
        self.ended, self.pace = 0, Pace()  # of those that were queued
        self._lock = threading.Lock()
        self._jobs: dict[Hashable, Job[Any]] = {}
        self._queue: queue.SimpleQueue[Job[Any]] = queue.SimpleQueue()
        # a daemon thread, so that Ctrl-C ends the server even during training
        threading.Thread(target=self._serve, name="crashfuse-jobs", daemon=True).start()

    def get(self, key: Hashable) -> Job[Any] | None:
        """The job with this key, if there is one."""
        return self._jobs.get(key)

    @property
    def active(self) -> list[Job[Any]]:
        """Running and waiting jobs, in order."""
        with self._lock:
            return [job for job in self._jobs.values() if job.active]

    def start(
        self,
        key: Hashable,
        title: str,
        work: Callable[[Watch], T],
        visitor: Visitor,
        *,
        usual_s: float = 0.0,
        at_once: bool = False,
    ) -> Job[T]:
        """Queue work for someone, or join its job; short work may start at once. ``usual_s``: on two quiet cores."""
        with self._lock:
            job = self._jobs.get(key)
            if job is not None:
                job.join(visitor)
                if job.state == "done" or (job.active and not job.cancelling):
                    return job
                del self._jobs[key]  # what is begun again is the latest
            job = self._jobs[key] = Job(title, work, self.pace, usual_s)
            job.join(visitor)
            finished = [old for old, kept in self._jobs.items() if not kept.active]
            for old in finished[: max(len(finished) - _KEPT, 0)]:
                del self._jobs[old]
        if at_once:
            threading.Thread(target=job.compute, name=title, daemon=True).start()
        else:
            self._queue.put(job)
        return job

    def _serve(self) -> None:
        if sys.platform == "linux":  # pages go before what this thread does and starts
            this = os.PRIO_PROCESS, threading.get_native_id()
            os.setpriority(*this, os.getpriority(*this) + _NICE)  # of a server that is itself nice, nicer still
        while True:
            self._queue.get().compute()
            self.ended += 1
