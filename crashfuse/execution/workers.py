"""Workers that compute the tasks of a study: this process, other processes on this machine, or a Dask cluster.

The numbers are identical, bit for bit on machines of the same kind. If a worker dies, only its current task is lost:
another worker takes it over, and finished results are in the cache.
"""

import logging
import multiprocessing
import os
import queue
import signal
import sys
import tempfile
import threading
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import joblib
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from crashfuse.campaign import Campaign
from crashfuse.errors import CrashfuseError
from crashfuse.execution.cache import Cache
from crashfuse.execution.memory import give_back, share_one_heap
from crashfuse.execution.progress import SILENT, Watch

log = logging.getLogger(__name__)

T = TypeVar("T")
R = TypeVar("R")

Work = Callable[[Campaign, T, Cache, Watch], list[R]]
"""Computes one task of a campaign; importable in another process, as its tasks can be pickled."""

RESUME = "Whatever was finished is in the cache: the same command with --resume continues from there"
_LIVES = 3  # deaths of workers in a row, with nothing finished, before giving up
GLANCE_S = 0.1  # interval at which pending tasks are polled
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class Workers(ABC):
    """Base class of workers. Exceptions in ``deaths`` mean that a worker died: its task is submitted again."""

    deaths: ClassVar[tuple[type[Exception], ...]]

    @abstractmethod
    def submitted(
        self, work: Work[T, R], campaign: Campaign, tasks: Mapping[int, T], cache: Cache
    ) -> AbstractContextManager[dict[int, Any]]:
        """Submit tasks; returns joblib's or Dask's futures. Unfinished ones are cancelled when the context ends.

        A future's result is what the work returned, and files for the caller's cache.
        """

    def are_elsewhere(self, tasks: Sequence[object]) -> bool:  # noqa: ARG002 - others look at their number
        """Whether this process only waits for these tasks, and can compute something else meanwhile."""
        return True

    def check(self) -> None:  # noqa: B027 - processes on this machine can always be started
        """Raise if no worker is left and none is expected."""

    def completed(
        self,
        work: Work[T, R],
        campaign: Campaign,
        tasks: Sequence[T],
        cache: Cache,
        watch: Watch,  # noqa: ARG002 - progress of tasks in other processes is not reported
    ) -> Generator[list[R]]:
        """Yield the results of each task once it is done, in any order; occasionally an empty list.

        Entries :attr:`~crashfuse.execution.cache.Cache.used` so far are what all tasks share. The watch is told
        about tasks computed in this process only. Raises if workers die repeatedly.
        """
        left, lives = dict(enumerate(tasks)), _LIVES
        while left:
            try:
                with self.submitted(work, campaign, left, cache) as futures:
                    while futures:
                        done = [number for number, future in futures.items() if future.done()]
                        for number in done:
                            result, files = futures.pop(number).result()
                            cache.unpack(files)
                            del left[number]
                            lives = _LIVES
                            yield result
                        if not done:
                            self.check()
                            time.sleep(GLANCE_S)
                            yield []  # lets the caller stop
            except self.deaths as error:
                lives -= 1
                if not lives:
                    raise CrashfuseError(
                        f"Workers died {_LIVES} times in a row, perhaps because memory ran out. {RESUME}; "
                        "fewer --workers need less memory."
                    ) from error
                log.warning("A worker died (%s); its task is computed again.", type(error).__name__)


@dataclass(frozen=True, slots=True)
class Local(Workers):
    """Processes on this machine, one per core by default; if one is enough, this process itself."""

    processes: int | None = None
    deaths = (BrokenProcessPool,)

    def completed(
        self, work: Work[T, R], campaign: Campaign, tasks: Sequence[T], cache: Cache, watch: Watch
    ) -> Generator[list[R]]:
        """See :class:`Workers`."""
        if self.are_elsewhere(tasks):
            return Workers.completed(self, work, campaign, tasks, cache, watch)
        return (work(campaign, task, cache, watch) for task in tasks)

    def are_elsewhere(self, tasks: Sequence[object]) -> bool:
        """See :class:`Workers`; a single task is computed here, as starting other processes takes seconds."""
        return min(self.processes or joblib.cpu_count(), len(tasks)) > 1

    @contextmanager
    def submitted(
        self, work: Work[T, R], campaign: Campaign, tasks: Mapping[int, T], cache: Cache
    ) -> Iterator[dict[int, Any]]:
        """See :class:`Workers`; the processes share the campaign's memory, and are reused by the next study."""
        n = min(self.processes or joblib.cpu_count(), len(tasks))
        executor = get_reusable_executor(n, timeout=60, initializer=_begin, initargs=(os.getpid(),), env=_ONE_THREAD)
        with tempfile.TemporaryDirectory(prefix="crashfuse-", ignore_cleanup_errors=True) as folder:
            file = Path(folder, "campaign")
            joblib.dump(campaign, file)
            with warnings.catch_warnings():  # joblib warns when it replaces workers whose memory has grown
                warnings.filterwarnings("ignore", category=UserWarning, module="joblib")
                try:
                    yield {n: executor.submit(_in_process, work, file, task, cache) for n, task in tasks.items()}
                except BaseException:
                    with suppress(queue.Empty):  # else loky stumbles over tasks that no worker has been handed yet
                        while True:
                            executor._work_ids.get_nowait()
                    executor.shutdown(kill_workers=True)
                    raise


def _in_process(work: Work[T, R], file: Path, task: T, cache: Cache) -> tuple[list[R], dict[str, bytes]]:
    try:
        return work(_campaign(file), task, cache, SILENT), {}
    finally:
        give_back()


# arrays are read from the campaign's file on demand, so that all processes share one copy
_campaign = lru_cache(maxsize=1)(partial(joblib.load, mmap_mode="r"))


def _begin(parent: int) -> None:
    """Make a worker ignore Ctrl-C, which its parent handles, and end when its parent does; it has one heap."""
    share_one_heap()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """Wait for the parent to end, which may have been killed, then exit."""
    if sys.platform == "win32":
        if (process := multiprocessing.parent_process()) is not None:
            process.join()
    else:
        while os.getppid() == parent:
            time.sleep(1)
    os._exit(1)
