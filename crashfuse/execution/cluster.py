"""Folds on a Dask cluster.

Dask sends Python objects and code by pickle, both ways: whoever can reach the scheduler, or any worker, can run code on
all of them and on this machine. So this is for a cluster that you trust, in a network that you trust, and it is used
where an address is given and nowhere else; the dashboard never does.

Every machine needs the same versions of ``crashfuse[dask]`` and what it depends on; then ``dask scheduler`` on one, and
``dask worker tcp://host:8786 --nworkers N --nthreads 1`` on each. A task that was begun is not interrupted by
cancelling: its worker ends it and keeps what came out.
"""

import logging
import platform
import re
import threading
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import closing, contextmanager
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from crashfuse.campaign import Campaign
from crashfuse.errors import CrashfuseError, UsageError
from crashfuse.execution.cache import Cache, code_digest
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.workers import RESUME, R, Task, Work, WorkerDied, until_done
from crashfuse.version import __version__

try:
    import distributed
except ModuleNotFoundError as error:
    raise UsageError('A Dask cluster takes an extra: python -m pip install "crashfuse[dask]".') from error

_ADDRESS = re.compile(r"tcp://(\[[0-9a-fA-F:]+\]|[\w.-]+):\d{1,5}")
_ANSWER_S = 5.0  # within which a scheduler answers
_WORKER_S = 30.0  # within which one without workers gets some
_GLANCE_S = 0.2
_PACKAGES = ("numpy", "scipy", "scikit-learn", "torch")  # that decide the last bits

_one_at_a_time = threading.Lock()  # how many threads compute is a setting of the whole process

Files = Mapping[str, bytes]
Done = tuple[list[R], Files]


@contextmanager
def connected(scheduler: str) -> Iterator["Cluster"]:
    """Connect to the workers of a Dask scheduler.

    Parameters
    ----------
    scheduler : str
        Its address, ``tcp://host:port``.

    Yields
    ------
    Cluster

    Raises
    ------
    UsageError
        If the address is none, or Dask is not installed.
    CrashfuseError
        If the cluster cannot be reached, has no worker, or one with other versions.
    """
    if not _ADDRESS.fullmatch(scheduler):
        raise UsageError(f"The address of a Dask scheduler looks like tcp://192.0.2.1:8786, not {scheduler!r}.")
    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL)  # what matters is raised
    try:
        try:
            client = distributed.Client(scheduler, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise CrashfuseError(f"No Dask scheduler answers at {scheduler}.") from error
        with closing(client):
            cluster = Cluster(scheduler, client)
            cluster.check()
            yield cluster
    finally:
        log.setLevel(level)


@dataclass(frozen=True, slots=True)
class Cluster:
    """Workers of a Dask scheduler.

    The campaign and what the folds share is sent to each once. A worker keeps what it does in the cache of its own
    machine, and it comes back into the caller's. Its process computes one task at a time, whatever its threads.

    Parameters
    ----------
    scheduler : str
    client : distributed.Client
    """

    scheduler: str
    client: Any

    def check(self) -> None:
        """Ask every worker for its versions: what another code computes is not what this one would.

        Raises
        ------
        CrashfuseError
            If there is none, or one whose versions differ.
        """
        self._wait_for_workers()
        for address, found in self.client.run(versions, on_error="return").items():
            if isinstance(found, BaseException):
                raise CrashfuseError(f"The Dask worker at {address} cannot run crashfuse: {found}.") from found
            _compare(address, found, versions())

    def completed(
        self,
        work: Work[R],
        campaign: Campaign,
        tasks: Sequence[Task],
        cache: Cache,
        watch: Watch,  # noqa: ARG002 - what a task reports stays where it is done
    ) -> Generator[list[R]]:
        """As :class:`crashfuse.execution.workers.Workers` has it."""
        shared = campaign, cache.pack(cache.used)

        def attempt(left: Sequence[tuple[int, Task]]) -> Generator[tuple[int | None, list[R]]]:
            return self._attempt(work, shared, left, cache)

        return until_done(attempt, tasks)

    def _attempt(
        self, work: Work[R], shared: tuple[Campaign, Files], tasks: Sequence[tuple[int, Task]], cache: Cache
    ) -> Generator[tuple[int | None, list[R]]]:
        self._check_connection()
        futures: dict[int, Any] = {}
        try:
            self._wait_for_workers()
            futures = self._submit(work, shared, tasks)
            glanced = time.monotonic()
            while futures:
                for number in [number for number, future in futures.items() if future.done()]:
                    result, files = futures.pop(number).result()
                    cache.unpack(files)
                    yield number, result
                if time.monotonic() - glanced > _ANSWER_S:
                    self._wait_for_workers()
                    glanced = time.monotonic()
                time.sleep(_GLANCE_S)
                yield None, []
        except distributed.KilledWorker as error:
            raise CrashfuseError(
                f"A task ended every Dask worker that took it up, by its memory perhaps. {RESUME}."
            ) from error
        except (OSError, CancelledError) as error:
            raise WorkerDied("the Dask cluster lost what was sent to it.") from error
        finally:
            for future in futures.values():
                future.cancel()

    def _submit(
        self, work: Work[R], shared: tuple[Campaign, Files], tasks: Sequence[tuple[int, Task]]
    ) -> dict[int, Any]:
        """Send tasks to the cluster; each waits for the earlier ones of its fold, and is best done where they were."""
        (sent,) = self.client.scatter([shared], broadcast=True, hash=False)
        wanted = versions()
        futures: dict[int, Any] = {}
        folds: dict[tuple[str, ...], list[Any]] = {}
        for number, task in tasks:
            earlier = folds.setdefault(task.fold, [])
            futures[number] = self.client.submit(_at_worker, work, sent, task, list(earlier), wanted, pure=False)
            earlier.append(futures[number])
        return futures

    def _check_connection(self) -> None:
        """Wait while the client looks for a scheduler that it has lost."""
        while self.client.status == "connecting":
            time.sleep(_GLANCE_S)
        if self.client.status != "running":
            raise CrashfuseError(f"The Dask scheduler at {self.scheduler} is gone. {RESUME}.")

    def _wait_for_workers(self) -> None:
        try:
            self.client.wait_for_workers(1, timeout=_WORKER_S)
        except TimeoutError as error:
            raise CrashfuseError(f"The Dask cluster at {self.scheduler} has no worker. {RESUME}.") from error


def versions() -> dict[str, str]:
    """Versions of all that decides the numbers."""
    python = ".".join(platform.python_version_tuple()[:2])
    packages = {name: metadata.version(name) for name in _PACKAGES}
    return {"Python": python, "crashfuse": __version__, "crashfuse's code": code_digest()[:12], **packages}


def _compare(worker: str, found: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    differing = [
        f"{name} {found.get(name)} instead of {ours}" for name, ours in wanted.items() if found.get(name) != ours
    ]
    if differing:
        raise CrashfuseError(
            f"The Dask worker at {worker} has {', '.join(differing)}: install the same there, and start it again."
        )


def _at_worker(
    work: Work[R],
    shared: tuple[Campaign, Files],
    task: Task,
    earlier: Sequence[Done[R]],
    wanted: Mapping[str, str],
) -> Done[R]:
    """Do a task with what is kept on this machine; returns what came out, and what the caller may want to keep."""
    _compare(distributed.get_worker().address, versions(), wanted)  # it may have come late
    campaign, files = shared
    cache = Cache()
    known = dict(files)
    for _, learned in earlier:
        known |= learned
    with _one_at_a_time:
        cache.unpack(known)
        result = work(campaign, task, cache, SILENT)
    return result, cache.pack(cache.used - known.keys())
