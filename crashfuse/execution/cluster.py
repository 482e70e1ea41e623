"""Workers of a Dask cluster.

Dask sends Python objects and code by pickle, both ways: anyone who can reach the scheduler, or any worker, can run code
on all of them and on this machine. So use it only with a cluster and a network that you trust. It is used only where
an address is given, never by the dashboard.
"""

import logging
import re
import threading
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

from crashfuse.campaign import Campaign
from crashfuse.errors import CrashfuseError, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.code_digest import code_digest
from crashfuse.execution.progress import SILENT
from crashfuse.execution.workers import GLANCE_S, RESUME, R, T, Work, Workers
from crashfuse.version import versions

try:
    import distributed
except ModuleNotFoundError as error:
    raise UsageError('A Dask cluster needs an extra: python -m pip install "crashfuse[dask]".') from error

_ADDRESS = re.compile(r"tcp://(\[[0-9a-fA-F:]+\]|[\w.-]+):\d{1,5}")
_ANSWER_S = 5.0  # time limit for a scheduler to answer
_WORKER_S = 30.0  # time limit for a scheduler without workers to get some
_TASKS = ("crashfuse.certification.certify", "crashfuse.study.learning_curve")  # with all that they import

_one_at_a_time = threading.Lock()  # the number of threads is a setting of the whole process


@contextmanager
def connected(scheduler: str) -> Iterator["Cluster"]:
    """Connect to the workers of the Dask scheduler at ``tcp://host:port``; raises if there are none or they differ."""
    if not _ADDRESS.fullmatch(scheduler):
        raise UsageError(f"The address of a Dask scheduler looks like tcp://192.0.2.1:8786, not {scheduler!r}.")
    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL)  # what matters is raised as an exception
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
        log.setLevel(level)


@dataclass(frozen=True, slots=True)
class Cluster(Workers):
    """Workers of a Dask scheduler.

    The campaign and the tasks' shared data are sent to each worker once. A worker stores its results in its own
    machine's cache, and they are copied to the caller's. Its process computes one task at a time, whatever its threads;
    Dask resubmits the task of a worker that died to another worker.
    """

    scheduler: str
    client: Any
    deaths = (OSError, CancelledError)  # the connection was lost, and with it the data sent

    @contextmanager
    def submitted(
        self, work: Work[T, R], campaign: Campaign, tasks: Mapping[int, T], cache: Cache
    ) -> Iterator[dict[int, Any]]:
        """See :class:`Workers`; a task that has started is not interrupted, and its worker stores the result."""
        self.check()
        (shared,) = self.client.scatter([(campaign, cache.pack(cache.used))], broadcast=True, hash=False)
        submit, ours = self.client.submit, versions_here()
        futures = {n: submit(_at_worker, work, shared, task, ours, pure=False) for n, task in tasks.items()}
        try:
            yield futures
        except distributed.KilledWorker as error:
            raise CrashfuseError(
                f"A task ended every Dask worker that took it up, perhaps because memory ran out. {RESUME}."
            ) from error
        finally:
            for future in futures.values():
                future.cancel()

    def check(self) -> None:
        """Wait for a lost scheduler to answer again, and for a worker to be available."""
        while self.client.status == "connecting":
            time.sleep(GLANCE_S)
        if self.client.status != "running":
            raise CrashfuseError(f"The Dask scheduler at {self.scheduler} is gone. {RESUME}.")
        try:
            self.client.wait_for_workers(1, timeout=_WORKER_S)
        except TimeoutError as error:
            raise CrashfuseError(f"The Dask cluster at {self.scheduler} has no worker. {RESUME}.") from error


def versions_here() -> dict[str, str]:
    """Versions of everything that determines the numbers, and what tells its code from that of another commit."""
    return {**versions(), "crashfuse's code": " ".join(code_digest(module)[:12] for module in _TASKS)}


def _compare(worker: str, found: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    differing = [f"{name} {found.get(name)} instead of {own}" for name, own in wanted.items() if found.get(name) != own]
    if differing:
        raise CrashfuseError(
            f"The Dask worker at {worker} has {', '.join(differing)}: install the same there, and start it again."
        )


def _at_worker(
    work: Work[T, R], shared: tuple[Campaign, Mapping[str, bytes]], task: T, wanted: Mapping[str, str]
) -> tuple[list[R], dict[str, bytes]]:
    """Compute a task with this machine's cache; also returns the files for the caller's cache."""
    _compare(distributed.get_worker().address, versions_here(), wanted)  # the worker may have joined late
    campaign, files = shared
    cache = Cache()
    with _one_at_a_time:
        cache.unpack(files)
        result = work(campaign, task, cache, SILENT)
    return result, cache.pack(cache.used - files.keys())
