"""Workers that compute the tasks of a study: this process, other processes on this machine, or a Dask cluster.

The numbers are identical, bit for bit on machines of the same kind. If a worker dies, another takes its task over.
"""

import logging
import multiprocessing
import os
import queue
import re
import signal
import sys
import tempfile
import threading
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from numbers import Integral
from pathlib import Path
from typing import Any, ClassVar, TypeVar, Unpack

import joblib
from joblib.executor import get_memmapping_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from crashfuse.campaign import Campaign
from crashfuse.errors import CrashfuseError, UsageError, printable
from crashfuse.execution.cache import Cache, resume
from crashfuse.execution.progress import SILENT
from crashfuse.execution.run import Run, RunOptions, Work, Workers, give_back, share_one_heap
from crashfuse.version import versions

log = logging.getLogger(__name__)

T = TypeVar("T")
R = TypeVar("R")

_RESUME = "the same command with --resume continues there"
_LIVES = 3  # deaths of workers in a row, with nothing finished, before giving up
_GLANCE_S = 0.1  # interval at which pending tasks are polled
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_ADDRESS = re.compile(r"tcp://(\[[0-9a-fA-F:]+\]|[\w.-]+):\d{1,5}")
_ANSWER_S = 5.0  # time limit for a scheduler to answer
_WORKER_S = 30.0  # time limit for a scheduler without workers to get some
_TASKS = ("crashfuse.certification.certify", "crashfuse.study.learning_curve")  # with all that they import
_one_at_a_time = threading.Lock()  # the number of threads is a setting of the whole process


class OtherProcesses(Workers, ABC):
    """Base class of workers elsewhere. Exceptions in ``deaths`` mean that one died: its task is submitted again."""

    deaths: ClassVar[tuple[type[Exception], ...]]

    @abstractmethod
    def submitted(
        self, work: Work[T, R], campaign: Campaign, tasks: Mapping[int, T], cache: Cache
    ) -> AbstractContextManager[dict[int, Any]]:
        """Context of submitted tasks: futures of results, of files for this cache, and of why some are not kept."""

    def are_elsewhere(self, tasks: Sequence[object]) -> bool:  # noqa: ARG002 - others look at their number
        """They are."""
        return True

    def check(self) -> None:
        """Raise if no worker is left and none is expected."""

    def completed(self, work: Work[T, R], campaign: Campaign, tasks: Sequence[T], run: Run) -> Generator[list[R]]:
        """See :meth:`Workers.completed`."""
        if not self.are_elsewhere(tasks):
            yield from super().completed(work, campaign, tasks, run)
            return
        left, lives = dict(enumerate(tasks)), _LIVES
        while left:
            try:
                with self.submitted(work, campaign, left, run.cache) as futures:
                    while futures:
                        done = [number for number, future in futures.items() if future.done()]
                        for number in done:
                            result, files, lost = futures.pop(number).result()
                            run.cache.unpack(files)
                            run.cache.report_loss(lost)
                            del left[number]
                            lives = _LIVES
                            yield result
                        if not done:
                            self.check()
                            time.sleep(_GLANCE_S)
                            yield []  # lets the caller stop
            except self.deaths as error:
                lives -= 1
                if not lives:
                    self.check()
                    found = f"Workers died {_LIVES} times in a row, perhaps because memory ran out"
                    kept = resume(_RESUME, run.cache.folder)
                    raise CrashfuseError(f"{found}. {kept}; fewer --workers need less.") from error
                log.warning("A worker died (%s); its task is computed again.", type(error).__name__)


_Done = tuple[list[R], Mapping[str, bytes], str]  # results, files for the caller's cache, why none could be kept


@dataclass(frozen=True, slots=True)
class Local(OtherProcesses):
    """Processes on this machine, one per core by default; if one is enough, this process itself."""

    processes: int | None = None
    deaths = (BrokenProcessPool,)

    def are_elsewhere(self, tasks: Sequence[object]) -> bool:
        """A single task is computed here, as starting other processes takes seconds."""
        return min(self.processes or joblib.cpu_count(), len(tasks)) > 1

    @contextmanager
    def submitted(
        self, work: Work[T, R], campaign: Campaign, tasks: Mapping[int, T], cache: Cache
    ) -> Iterator[dict[int, Any]]:
        """The processes share the campaign's memory, and are reused by the next study."""
        n = min(self.processes or joblib.cpu_count(), len(tasks))
        # joblib keeps one executor for all: made its way, a Parallel of the caller's can follow
        executor = get_memmapping_executor(
            n, timeout=60, initializer=_begin, initargs=(os.getpid(),), env=_ONE_THREAD, max_nbytes=None
        )
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


def _in_process(work: Work[T, R], file: Path, task: T, cache: Cache) -> _Done[R]:
    try:
        return work(_campaign(file), task, Run(cache)), {}, cache.lost
    finally:
        give_back()


# arrays are read from the campaign's file on demand, so that all processes share one copy
_campaign = lru_cache(maxsize=1)(partial(joblib.load, mmap_mode="r"))


def _begin(parent: int) -> None:
    share_one_heap()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # its parent handles it
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    if sys.platform == "win32":
        if (process := multiprocessing.parent_process()) is not None:
            process.join()
    else:
        while os.getppid() == parent:
            time.sleep(1)
    os._exit(1)


@contextmanager
def running(campaign: Campaign, **options: Unpack[RunOptions]) -> Iterator[Run]:
    """Run on a Dask cluster if a scheduler is given, else in processes on this machine."""
    workers, scheduler = options.get("workers"), options.get("scheduler")
    if workers is not None and not (isinstance(workers, Integral) and workers >= 1):
        raise UsageError(f"The number of workers is 1 or more, not {printable(repr(workers), 20)}.")
    run = Run.of(campaign, options.get("cache"), options.get("watch", SILENT))
    if scheduler is None:
        yield replace(run, workers=Local(workers))
    else:
        with connected(scheduler) as cluster:
            yield replace(run, workers=cluster)


@contextmanager
def connected(scheduler: str) -> Iterator["Cluster"]:
    """Connect to the workers of the Dask scheduler at ``tcp://host:port``; raises if there are none or they differ.

    Dask sends objects and code by pickle, both ways: who can reach the scheduler or a worker can run code on all of
    them, and on this machine.
    """
    try:
        import distributed  # it takes a second
    except ModuleNotFoundError as error:
        raise UsageError('A Dask cluster needs, in a checkout: python -m pip install ".[dask]".') from error
    if not _ADDRESS.fullmatch(scheduler):
        raise UsageError(f"The address of a Dask scheduler looks like tcp://192.0.2.1:8786, not {scheduler!r}.")
    its_log = logging.getLogger("distributed")
    level = its_log.level
    its_log.setLevel(logging.CRITICAL)  # what matters is raised as an exception
    try:
        try:
            client = distributed.Client(scheduler, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise CrashfuseError(f"No Dask scheduler answers at {scheduler}.") from error
        with closing(client):
            cluster = Cluster(scheduler, client)
            cluster.check()
            for worker, found in client.run(versions_here, on_error="return").items():
                if isinstance(found, BaseException):
                    raise CrashfuseError(f"The Dask worker at {worker} cannot run crashfuse: {found}.") from found
                _compare(worker, found, versions_here())
            yield cluster
    finally:
        its_log.setLevel(level)


@dataclass(frozen=True, slots=True)
class Cluster(OtherProcesses):
    """Workers of a Dask scheduler, each of which gets the campaign once and computes one task at a time.

    Results are stored in its machine's cache and copied to the caller's; Dask resubmits the task of one that died.
    """

    scheduler: str
    client: Any
    deaths = (OSError, CancelledError)  # the connection was lost, and with it the data sent

    @contextmanager
    def submitted(
        self, work: Work[T, R], campaign: Campaign, tasks: Mapping[int, T], cache: Cache
    ) -> Iterator[dict[int, Any]]:
        """A task that has started is not interrupted, and its worker stores the result."""
        from distributed import KilledWorker

        self.check()
        sent = replace(campaign, cache_folder=None), cache.pack(cache.used)  # the folder is of this machine
        (shared,) = self.client.scatter([sent], broadcast=True, hash=False)
        submit, ours = self.client.submit, versions_here()
        futures = {n: submit(_at_worker, work, shared, task, ours, pure=False) for n, task in tasks.items()}
        try:
            yield futures
        except KilledWorker as error:
            found = "A task ended every Dask worker that took it up, perhaps because memory ran out"
            raise CrashfuseError(f"{found}. {resume(_RESUME, cache.folder)}.") from error
        finally:
            for future in futures.values():
                future.cancel()

    def check(self) -> None:
        """Wait for a lost scheduler to answer again, and for a worker to be available."""
        end = time.monotonic() + _ANSWER_S
        while self.client.status in ("running", "connecting"):
            try:
                if self.client.status == "running":
                    self.client.wait_for_workers(1, timeout=_WORKER_S)
                    return
            except TimeoutError as error:
                found = f"The Dask cluster at {self.scheduler} has no worker"
                raise CrashfuseError(f"{found}. {resume(_RESUME)}.") from error
            except OSError:  # the client may notice later that its scheduler is gone
                if time.monotonic() > end:
                    break
            time.sleep(_GLANCE_S)
        raise CrashfuseError(f"The Dask scheduler at {self.scheduler} is gone. {resume(_RESUME)}.")


def versions_here() -> dict[str, str]:
    """The versions, and what tells this code from that of another commit."""
    digest = Cache().digest
    return {**versions(), "crashfuse's code": " ".join(digest(module)[:12] for module in _TASKS)}


def _compare(worker: str, found: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    other = [f"{name} {found.get(name)} instead of {ours}" for name, ours in wanted.items() if found.get(name) != ours]
    if other:
        advice = "install the same there, and start it again"
        raise CrashfuseError(f"The Dask worker at {worker} has {', '.join(other)}: {advice}.")


def _at_worker(
    work: Work[T, R], shared: tuple[Campaign, Mapping[str, bytes]], task: T, wanted: Mapping[str, str]
) -> _Done[R]:
    from distributed import get_worker

    _compare(get_worker().address, versions_here(), wanted)  # the worker may have joined late
    campaign, files = shared
    cache = Cache()
    with _one_at_a_time:
        cache.unpack(files)
        result = work(campaign, task, Run(cache))
    return result, cache.pack(cache.used - files.keys()), cache.lost
