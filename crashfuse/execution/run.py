"""How a computation runs, which changes no number: where results are kept, who computes and watches, its threads."""

import ctypes
import sys
import threading
from collections.abc import Callable, Generator, Hashable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Self, TypedDict, TypeVar

import numpy.typing as npt
from threadpoolctl import ThreadpoolController, threadpool_limits

from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache, Entry, NoCache
from crashfuse.execution.progress import SILENT, Watch

T = TypeVar("T")
R = TypeVar("R")

_ARENA_MAX = -8  # parameter of mallopt, in <malloc.h>
_lock = threading.Lock()
_limit = ExitStack()
_within = 0


class Workers:
    """Who computes the tasks of a study: this process, one after the other."""

    def are_elsewhere(self, tasks: Sequence[object]) -> bool:  # noqa: ARG002 - others look at their number
        """Whether this process only waits for these tasks, and can compute something else meanwhile."""
        return False

    def completed(self, work: "Work[T, R]", campaign: Campaign, tasks: Sequence[T], run: "Run") -> Generator[list[R]]:
        """Yield the results of each task once it is done, in any order; occasionally an empty list."""
        yield from (work(campaign, task, run) for task in tasks)


class RunOptions(TypedDict, total=False):
    """How a computation is to run, which changes no number: keywords of whatever asks for one."""

    cache: Cache | None  # keeps what is finished: what was stopped goes on there; by default the campaign's
    watch: Watch  # hears of the progress, and cancels; that of a study is shown what is known, each time that more is
    workers: int | None  # number of processes; by default one per core
    scheduler: str | None  # address of a Dask scheduler (tcp://host:port), whose workers then compute


@dataclass(frozen=True, slots=True)
class Run:
    """Made once where a computation is asked for, and passed whole to all that computes."""

    cache: Cache = field(default_factory=Cache)  # keeps what is finished; by default in the platform's folder
    watch: Watch = SILENT  # hears of the progress, and cancels
    workers: Workers = field(default_factory=Workers)  # who computes tasks; by default this process
    memory: dict[Hashable, Any] | None = None  # of one task: what fits by several seeds have in common

    @classmethod
    def of(cls, campaign: Campaign, cache: Cache | None = None, watch: Watch = SILENT) -> Self:
        """One in this process; without a cache, in that of the campaign."""
        return cls(cache or Cache(campaign.cache_folder), watch)

    def bind(self, campaign: Campaign) -> Campaign:
        """The campaign of which everything that is computed later, for a figure say, is kept in this cache, too."""
        folder = self.cache.folder
        is_bound = Cache(campaign.cache_folder).folder == folder
        return campaign if is_bound else replace(campaign, cache_folder=folder)

    def anew(self) -> Self:
        """The same run with a cache of which nothing was used."""
        return replace(self, cache=self.cache.anew())

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What was made under this key in the same task, or is made now; always made now outside of one."""
        memory = {} if self.memory is None else self.memory
        if key not in memory:
            memory[key] = make()
        made: T = memory[key]
        return made

    def get_or_compute(
        self,
        kind: str,
        key: Mapping[str, object],
        compute: Callable[[], tuple[T, Mapping[str, npt.ArrayLike]]],
        restore: Callable[[Entry], T],
    ) -> T:
        """See :meth:`crashfuse.execution.cache.Cache.get_or_compute`."""
        return self.cache.get_or_compute(kind, key, compute, restore, self.watch)

    def completed(self, work: "Work[T, R]", campaign: Campaign, tasks: Sequence[T]) -> Generator[list[R]]:
        """See :meth:`Workers.completed`."""
        return self.workers.completed(work, campaign, tasks, self)


Work = Callable[[Campaign, T, Run], list[R]]
"""Computes one task of a campaign; importable in another process, as its tasks can be pickled."""

UNKEPT = Run(NoCache())
"""Of a fit made by hand: in this process, unwatched, and nothing is kept."""


@cache
def _glibc() -> ctypes.CDLL | None:
    library = ctypes.CDLL(None) if sys.platform == "linux" else None
    return library if library is not None and hasattr(library, "malloc_trim") else None


def share_one_heap() -> None:
    """Let all threads allocate from the first one's heap: freed memory stays with glibc, a third of one that trains."""
    if (library := _glibc()) is not None:
        library.mallopt(_ARENA_MAX, 1)


def give_back() -> None:
    """Return what is free to the system, in some milliseconds."""
    if (library := _glibc()) is not None:
        library.malloc_trim(0)


@contextmanager
def one_thread_throughout() -> Iterator[None]:
    """:func:`one_thread`, and one thread for whatever computes by OpenMP in the calling thread, PyTorch among it."""
    with one_thread(), threadpool_limits(1, user_api="openmp"):  # a limit of OpenMP is each thread's own
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Context in which NumPy and SciPy compute with one thread, in the whole process; entered and left in any order.

    Two contended threads cost many times the work of one, and change the numbers.
    """
    global _within
    with _lock:
        if not _within:
            _limit.enter_context(_libraries().limit(limits=1))
        _within += 1
    try:
        yield
    finally:
        with _lock:
            _within -= 1
            if not _within:
                _limit.close()


@cache  # to look for them at every turn would take milliseconds of each prediction
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401 - it has a BLAS of its own, which has to be there when libraries are looked for

    return ThreadpoolController().select(user_api="blas")
