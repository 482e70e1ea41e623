"""Computations in the background: queued and watched from any page, one for all who want the same.

A job knows nothing of Streamlit. Its thread writes plain numbers, and a page reads them at any time; closing or
reloading the page changes nothing.
"""

import logging
import os
import queue
import sys
import threading
import time
from collections.abc import Callable, Hashable, Mapping
from typing import Any, Generic, Literal, TypeVar

from crashfuse.errors import OUT_OF_MEMORY, Cancelled, CrashfuseError, out_of_memory
from crashfuse.execution.progress import Progress, Watch
from crashfuse.execution.time_left import TimeLeft
from crashfuse.reporting.watched import Step, Watched
from crashfuse.ui import journal
from crashfuse.ui.address import Place
from crashfuse.ui.visitors import Visitor

State = Literal["waiting", "running", "done", "failed", "cancelled"]
T = TypeVar("T")

_NICE = 5  # beside pages: a third of their share of a core that both want
_KEPT = 24  # finished jobs; a whole study takes about 120 MB, one test 5 MB

log = logging.getLogger(__name__)


class Job(Generic[T]):
    """A computation, its progress and its outcome; the title tells those who want it what is computed."""

    def __init__(self, title: str, work: Callable[[Watch], T]) -> None:
        self.title = title
        self.wanted_by: set[Visitor] = set()
        self.places: dict[Visitor, Place] = {}  # where each of them asked for it, and will look for the result
        self.state: State = "waiting"
        self.part: T | None = None  # while it runs: what is known of the result, replaced as more is known
        self.result: T | None = None  # what the work returned, once done
        self.message = ""  # one sentence on why it failed
        self._time: TimeLeft | None = None
        self._work: Callable[[Watch], T] | None = work
        self._joining = threading.Lock()
        self._cancel = threading.Event()
        self._ended = threading.Event()
        self._watch = Watched(self._report, self._cancel, self._show_part, self._expect)

    @property
    def active(self) -> bool:
        """True if it is waiting or running."""
        return self.state in ("waiting", "running")

    @property
    def cancelling(self) -> bool:
        """True if it was told to stop but has not stopped yet."""
        return self.active and self._cancel.is_set()

    @property
    def steps(self) -> dict[str, Step]:
        """Every step so far, in order of start."""
        return self._watch.steps

    @property
    def left_s(self) -> float | None:
        """Seconds until the result, or None while unknown."""
        return self._time.left_s(time.monotonic()) if self._time is not None else None

    @property
    def share(self) -> float:
        """Share of the whole time that is over, 0 to 1."""
        return self._time.share(time.monotonic()) if self._time is not None else 0.0

    def join(self, visitor: Visitor) -> None:
        """Note that someone wants it, unless it is being stopped already."""
        with self._joining:
            if not self._cancel.is_set():
                self.wanted_by.add(visitor)

    def cancel(self, visitor: Visitor) -> None:
        """Note that someone wants it no more; once nobody does, it stops at its next report, at once while it waits."""
        with self._joining:
            self.wanted_by.discard(visitor)
            if self.wanted_by:
                return
            self._cancel.set()
            if self.state != "waiting":
                return
            self.state, self._work = "cancelled", None  # what is ahead of it may take hours
        journal.note(visitor, f"cancelled: {self.title}")
        self._ended.set()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until it has ended; False on timeout."""
        return self._ended.wait(timeout_s)

    def run(self) -> None:
        """Compute, unless it was cancelled before; any error becomes the job's state and message."""
        with self._joining:
            if self.state != "waiting":
                return
            work, self._work = self._work, None  # so that the objects the work refers to can be freed
            self.state, wanted_by = "running", self.wanted_by.copy()
        journal.note(wanted_by, f"started: {self.title}")
        try:
            if work is not None:
                self.result = work(self._watch)
            self.state = "done"
        except Cancelled:
            self.state = "cancelled"
        except CrashfuseError as error:
            self.message, self.state = str(error), "failed"
        except Exception as error:
            if out_of_memory(error):
                self.message, self.state = OUT_OF_MEMORY, "failed"
                return
            log.exception("%s failed", self.title)
            self.message = f"This should not have happened ({type(error).__name__}: {error}); the log has the details."
            self.state = "failed"
        finally:
            self.part = None
            told = f" ({self.message})" if self.message else ""
            journal.note(wanted_by | self.wanted_by, f"{self.state}: {self.title}{told}")
            self._ended.set()

    def _show_part(self, part: T) -> None:
        self.part = part

    def _expect(self, seconds: Mapping[str, float]) -> None:
        self._time = TimeLeft(seconds, time.monotonic())

    def _report(self, progress: Progress) -> None:
        if self._time is not None:
            self._time.take(progress, time.monotonic())


class Jobs:
    """The queue: one job at a time, first come, first served; the latest results are kept.

    ``ended`` counts the jobs that were queued and have ended.
    """

    def __init__(self) -> None:
        self.ended = 0
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
        at_once: bool = False,
    ) -> Job[T]:
        """Queue work for someone, or join the job that is doing it or has done it; short work may start at once."""
        with self._lock:
            job = self._jobs.get(key)
            if job is not None:
                job.join(visitor)
                if job.state == "done" or (job.active and not job.cancelling):
                    return job
                del self._jobs[key]  # what is begun again is the latest
            job = self._jobs[key] = Job(title, work)
            job.join(visitor)
            finished = [old for old, kept in self._jobs.items() if not kept.active]
            for old in finished[: max(len(finished) - _KEPT, 0)]:
                del self._jobs[old]
        if at_once:
            threading.Thread(target=job.run, name=title, daemon=True).start()
        else:
            self._queue.put(job)
        return job

    def _serve(self) -> None:
        _yield_to_pages()
        while True:
            self._queue.get().run()
            self.ended += 1


def _yield_to_pages() -> None:
    """Let pages go before the work of this thread, and before the threads and processes that it starts (Linux)."""
    if sys.platform == "linux":
        this = os.PRIO_PROCESS, threading.get_native_id()
        os.setpriority(*this, os.getpriority(*this) + _NICE)  # of a server that is itself nice, nicer still
