"""Where the folds of a study are computed: in this process, in others beside it, or on a Dask cluster.

The numbers are the same, to the bit on one kind of machine. A worker that dies costs what was at work and no more:
other workers, or fresh ones, take that up, and whatever was finished is in the cache.
"""

import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from typing import Protocol, TypeVar

import joblib
from joblib.externals.loky.process_executor import BrokenProcessPool

from crashfuse.campaign import Campaign, CrashTest
from crashfuse.errors import CrashfuseError
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch

log = logging.getLogger(__name__)

R = TypeVar("R")

_LIVES = 3  # how often in a row workers may die and nothing gets done
RESUME = "What was finished is in the cache: the same command with --resume goes on from there"


@dataclass(frozen=True, eq=False, slots=True)
class Task:
    """What is computed at one go: an approach's predictions of tests that are all learned about from the same others.

    Attributes
    ----------
    approach : str
    tests : tuple of CrashTest
    """

    approach: str
    tests: tuple[CrashTest, ...]

    @property
    def fold(self) -> tuple[str, ...]:
        """Ids of its tests: tasks of one fold make use of each other."""
        return tuple(test.id for test in self.tests)


Work = Callable[[Campaign, Task, Cache, Watch], list[R]]
"""What is done for each task, importable in another process."""


class Workers(Protocol):
    """Who does the tasks."""

    def completed(
        self, work: Work[R], campaign: Campaign, tasks: Sequence[Task], cache: Cache, watch: Watch
    ) -> Generator[list[R]]:
        """Yield what the work returns for each task as it gets done, in any order; an empty list now and then.

        Parameters
        ----------
        work : callable
        campaign : Campaign
        tasks : sequence of Task
            Those of one fold in the order in which they find in the cache what the ones before have learned.
        cache : Cache
            What was :attr:`~crashfuse.execution.cache.Cache.used` of it is what all tasks share.
        watch : Watch
            Told what a task does, where that can be told.

        Raises
        ------
        CrashfuseError
            If workers die again and again.
        """


class WorkerDied(Exception):
    """Some work has to be done again."""


def workers_at(scheduler: str | None, processes: int | None) -> AbstractContextManager[Workers]:
    """Workers of a Dask cluster, if a scheduler is named, else processes on this machine.

    Raises
    ------
    CrashfuseError
        If the cluster cannot be reached or does not have the same versions.
    """
    if scheduler is None:
        return nullcontext(Local(processes))
    from crashfuse.execution.cluster import connected  # takes a second, and an extra

    return connected(scheduler)


@dataclass(frozen=True, slots=True)
class Local:
    """Processes on this machine, on joblib; a single one is this very process.

    Parameters
    ----------
    processes : int, optional
        Default: one for each core, or a single one where they would take longer to start than to work.
    """

    processes: int | None = None

    def completed(
        self, work: Work[R], campaign: Campaign, tasks: Sequence[Task], cache: Cache, watch: Watch
    ) -> Generator[list[R]]:
        """As :class:`Workers` has it."""
        alone = len({task.fold for task in tasks}) < 2  # processes take seconds to start
        processes = self.processes or (1 if alone else min(joblib.cpu_count(), len(tasks)))
        if processes == 1:
            return (work(campaign, task, cache, watch) for task in tasks)
        return until_done(lambda left: _in_processes(processes, work, campaign, left, cache), tasks)


def until_done(
    attempt: Callable[[Sequence[tuple[int, Task]]], Generator[tuple[int | None, list[R]]]], tasks: Sequence[Task]
) -> Generator[list[R]]:
    """Attempt what is left of the tasks again and again, as long as something gets done.

    Parameters
    ----------
    attempt : callable
        Given tasks with their numbers, it yields the number of each that is done and what came out of it (None and
        nothing now and then), and raises :class:`WorkerDied`.
    tasks : sequence of Task

    Raises
    ------
    CrashfuseError
        If workers die again and again.
    """
    left, lives = dict(enumerate(tasks)), _LIVES
    while left:
        try:
            with closing(attempt(list(left.items()))) as completed:
                for number, result in completed:
                    if number is not None:
                        del left[number]
                        lives = _LIVES
                    yield result
        except WorkerDied as error:
            lives -= 1
            if not lives:
                raise CrashfuseError(
                    f"Workers died {_LIVES} times in a row, out of memory perhaps. {RESUME}; "
                    "fewer --workers need less memory."
                ) from error
            log.warning("A worker died: %s What it was at is done again.", error)


def _in_processes(
    processes: int, work: Work[R], campaign: Campaign, tasks: Sequence[tuple[int, Task]], cache: Cache
) -> Generator[tuple[int, list[R]]]:
    pool = joblib.Parallel(
        processes, return_as="generator_unordered", batch_size=1, initializer=_begin, initargs=(os.getpid(),)
    )
    completed = pool(joblib.delayed(_numbered)(number, work, campaign, task, cache) for number, task in tasks)
    with warnings.catch_warnings():
        # joblib warns of workers that it renews when they have grown, and of what a cancelled study leaves undone
        warnings.filterwarnings("ignore", category=UserWarning, module="joblib")
        try:
            for result in completed:  # noqa: UP028 - "yield from" would close the pool outside the filter
                yield result
        except BrokenProcessPool as error:
            raise WorkerDied("its process was ended from outside.") from error
        finally:
            completed.close()


def _numbered(number: int, work: Work[R], campaign: Campaign, task: Task, cache: Cache) -> tuple[int, list[R]]:
    return number, work(campaign, task, cache, SILENT)


def _begin(parent: int) -> None:
    """Make a worker leave Ctrl-C to its parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """Wait for the end of the parent, which may have been killed, and end."""
    if sys.platform == "win32":
        if (process := multiprocessing.parent_process()) is not None:
            process.join()
    else:
        while os.getppid() == parent:
            time.sleep(1)
    os._exit(1)
