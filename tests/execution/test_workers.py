"""Where folds are computed: the same numbers everywhere, and who dies costs only what it was at."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

import joblib
import psutil
import pytest

from crashfuse import cli
from crashfuse.campaign import Campaign
from crashfuse.errors import Cancelled, CrashfuseError, UsageError
from crashfuse.execution import workers
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import Progress, Watch
from crashfuse.execution.run import Run, Work, Workers
from crashfuse.execution.workers import Cluster, Local, connected
from crashfuse.study.config import StudyConfig
from crashfuse.study.running import run_study
from tests.conftest import Capture

pytestmark = pytest.mark.slow

CONFIG = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(60.0,))
TASKS = [f"task {number}" for number in range(8)]


def fatal_once(deaths: Path, lives: int = 1) -> Work[str, str]:
    """Work that ends its own process as often as it is told, in the second task, and returns the task otherwise."""

    def work(_campaign: Campaign, task: str, _run: Run) -> list[str]:
        import os
        import signal
        import time

        died = len(list(deaths.iterdir()))
        if task == "task 1" and died < lives:
            (deaths / str(died)).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.05)
        return [task]

    return work


def done_by(workers: Workers, work: Work[str, str], campaign: Campaign, cache: Path) -> list[str]:
    return sorted(chain(*workers.completed(work, campaign, TASKS, Run(Cache(cache)))))


@pytest.fixture
def deaths(tmp_path: Path) -> Path:
    folder = tmp_path / "deaths"
    folder.mkdir()
    return folder


def test_joblib_goes_on_after_workers_as_before(campaign: Campaign, tmp_path: Path, deaths: Path) -> None:
    """A notebook's own parallel work and a study's take turns: both have the one executor that joblib keeps."""
    for _ in range(2):
        assert done_by(Local(2), fatal_once(deaths, lives=0), campaign, tmp_path) == TASKS
        assert joblib.Parallel(2)(joblib.delayed(abs)(number) for number in (-1, -2)) == [1, 2]


def test_a_process_that_is_killed_costs_only_what_it_was_at(
    campaign: Campaign, tmp_path: Path, deaths: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert done_by(Local(2), fatal_once(deaths), campaign, tmp_path) == TASKS
    assert len(list(deaths.iterdir())) == 1
    assert "A worker died" in caplog.text


def test_processes_that_die_again_and_again_end_the_study(campaign: Campaign, tmp_path: Path, deaths: Path) -> None:
    with pytest.raises(CrashfuseError, match=r"memory ran out.* --resume .*fewer --workers"):
        done_by(Local(2), fatal_once(deaths, lives=99), campaign, tmp_path)
    assert len(list(deaths.iterdir())) < 10


def test_what_a_worker_could_not_keep_is_said_here(
    campaign: Campaign, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Once, with the reason, however many workers met it: nobody reads what they log."""
    (tmp_path / "kind").touch()  # in the place of a folder
    here = Cache(tmp_path)

    def work(_campaign: Campaign, task: str, run: Run) -> list[str]:
        run.cache.put("kind", {"task": task}, {})
        return [task]

    assert sorted(chain(*Local(2).completed(work, campaign, TASKS, Run(here)))) == TASKS
    assert here.lost
    assert [record.message for record in caplog.records if record.levelname == "WARNING"] == [
        f"Results cannot be kept in {tmp_path}: {here.lost}"
    ]


_SLEEPING = """
import sys, time
from pathlib import Path
from crashfuse.execution.run import Run
from crashfuse.execution.workers import Local

folder = sys.argv[1]
def work(campaign, task, run, folder=folder):
    Path(folder, task).touch()
    time.sleep(60)

list(Local(2).completed(work, None, ["a", "b"], Run()))
"""


def workers_of(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    found = psutil.Process(process.pid).children(recursive=True)
    return [child for child in found if "popen_loky" in " ".join(child.cmdline())]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_who_started_them(tmp_path: Path, number: signal.Signals) -> None:
    with subprocess.Popen([sys.executable, "-c", _SLEEPING, str(tmp_path)], stderr=subprocess.DEVNULL) as parent:
        _wait(lambda: len(list(tmp_path.iterdir())) == 2)
        workers = workers_of(parent)
        assert len(workers) == 2
        parent.send_signal(number)
        assert not psutil.wait_procs(workers, timeout=40)[1]


def test_ctrl_c_is_one_sentence_and_leaves_no_process(campaign_on_disk: Path, tmp_path: Path) -> None:
    arguments = ["study", str(campaign_on_disk), "--out", str(tmp_path / "out"), "--workers", "2"]
    command = [sys.executable, "-m", "crashfuse", *arguments, "--approach", "cae", "displacement_domain"]
    ignored = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)
    signal.signal(signal.SIGINT, ignored)
    with process as study:
        _wait((Cache().folder / "predictions").exists)
        workers = workers_of(study)
        os.killpg(study.pid, signal.SIGINT)
        _, said = study.communicate(timeout=120)
    assert study.returncode == cli.INTERRUPTED
    assert b"continues there" in said
    assert b"Traceback" not in said
    assert not psutil.wait_procs(workers, timeout=60)[1]


@dataclass
class Dask:
    """A scheduler and its workers, each a process on this machine with a cache of its own."""

    folder: Path
    address: str
    scheduler: subprocess.Popen[bytes]
    workers: dict[str, subprocess.Popen[bytes]]

    @classmethod
    def start(cls, folder: Path) -> "Dask":
        file = folder / "scheduler.json"
        process = _dask(folder, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
        _wait(lambda: file.exists() and file.read_text().endswith("}"))
        return cls(folder, json.loads(file.read_text())["address"], process, {})

    def add(self, *names: str) -> None:
        for name in names:
            options = ("--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--name", name)
            self.workers[name] = _dask(self.folder, "worker", self.address, *options)

    def cache(self, name: str) -> Path:
        return self.folder / f"cache of {name}"

    def stop(self) -> None:
        for process in (*self.workers.values(), self.scheduler):
            process.kill()
            process.wait()


def _dask(folder: Path, role: str, *options: str) -> subprocess.Popen[bytes]:
    name = options[-1] if role == "worker" else role
    environment = {**os.environ, "CRASHFUSE_CACHE": str(folder / f"cache of {name}"), "DASK_CONFIG": str(folder)}
    environment["DASK_TEMPORARY_DIRECTORY"] = str(folder)
    command = [sys.executable, "-m", f"distributed.cli.dask_{role}", *options, "--no-dashboard"]
    with (folder / f"{name}.log").open("wb") as log:
        return subprocess.Popen(command, stdout=log, stderr=log, env=environment)


def _wait(what: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 240  # on a busy machine
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture(scope="module")
def dask(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dask]:
    """A scheduler with two workers, which one test after the other takes apart."""
    started = Dask.start(tmp_path_factory.mktemp("dask"))
    started.add("one", "two")
    yield started
    started.stop()


def test_a_cluster_gives_what_one_process_gives(campaign: Campaign, dask: Dask, tmp_path: Path) -> None:
    """To the bit; nothing is learned twice on the cluster, and all of it ends up in the caller's cache."""
    study, seen = partial(run_study, campaign, CONFIG, held_out=["T1", "T2"]), list[Progress]()
    here = study(cache=Cache(tmp_path / "here"), workers=1)
    there = study(cache=Cache(tmp_path / "there"), watch=Watch(seen.append), scheduler=dask.address)
    for a, b in zip(here.folds, there.folds, strict=True):
        assert a.ratings == b.ratings
        for x, y in zip(a.estimates, b.estimates, strict=True):
            assert x.accel_mps2.tobytes() == y.accel_mps2.tobytes()
            assert x.left_out_mps2.keys() == y.left_out_mps2.keys()
            assert {**x.state, "seconds": 0} == {**y.state, "seconds": 0}
    files = {path.relative_to(tmp_path / "here") for path in (tmp_path / "here").rglob("*.bin")}
    assert files == {path.relative_to(tmp_path / "there") for path in (tmp_path / "there").rglob("*.bin")}
    # learned by two, they would differ in the seconds that took; where both have one, it was sent
    fits = {(path.name, path.read_bytes()) for name in dask.workers for path in dask.cache(name).glob("fits/*.bin")}
    assert len(fits) == 4
    emulators = [path.read_bytes() for name in dask.workers for path in dask.cache(name).glob("emulator/*.bin")]
    assert set(emulators) == {path.read_bytes() for path in (tmp_path / "there").glob("emulator/*.bin")}
    assert [p.done for p in seen if p.step == "Held-out predictions"][-1] == 4


def test_a_cluster_knows_when_to_stop(campaign: Campaign, dask: Dask) -> None:
    def stop(progress: Progress) -> None:
        if progress.step == "Held-out predictions":
            raise Cancelled("Stopped.")

    with pytest.raises(Cancelled):
        run_study(campaign, CONFIG, held_out=["T3"], watch=Watch(stop), scheduler=dask.address)


def test_a_worker_of_a_cluster_that_is_killed_costs_only_what_it_was_at(
    campaign: Campaign, dask: Dask, tmp_path: Path, deaths: Path
) -> None:
    with connected(dask.address) as workers:
        assert done_by(workers, fatal_once(deaths), campaign, tmp_path) == TASKS
    assert sum(process.poll() is None for process in dask.workers.values()) == 1


def test_a_worker_of_other_versions_is_refused(campaign: Campaign, dask: Dask, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = {**workers.versions_here(), "numpy": "1.26.4"}
    monkeypatch.setattr(workers, "versions_here", lambda: ours)
    with pytest.raises(CrashfuseError, match=r"worker at tcp://\S+ has numpy [\d.]+ instead of 1.26.4: install"):
        run_study(campaign, CONFIG, scheduler=dask.address)


def test_a_cluster_without_workers_is_waited_for_in_vain(
    campaign: Campaign, dask: Dask, tmp_path: Path, deaths: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the last one dies in mid-study, and if none is there, a sentence says so before long."""
    with connected(dask.address) as workers:
        monkeypatch.setattr("crashfuse.execution.workers._WORKER_S", 0.5)
        with pytest.raises(CrashfuseError, match=r"has no worker.*--resume"):
            done_by(workers, fatal_once(deaths, lives=2), campaign, tmp_path / "cache")
    monkeypatch.setattr("crashfuse.execution.workers._ANSWER_S", 2.0)
    with pytest.raises(CrashfuseError, match="has no worker"):
        run_study(campaign, CONFIG, scheduler=dask.address)


def test_a_scheduler_that_dies_ends_the_study(campaign: Campaign, dask: Dask, tmp_path: Path) -> None:
    """A sentence says how to go on. This is the last test of the cluster."""
    dask.add("the last")
    with connected(dask.address) as workers:

        def work(campaign: Campaign, task: str, run: Run) -> list[str]:  # noqa: ARG001
            return [task]

        found = workers.completed(work, campaign, TASKS, Run(Cache(tmp_path / "cache")))
        while not next(found):
            pass
        dask.scheduler.kill()
        with pytest.raises(CrashfuseError, match=r"scheduler at tcp://\S+ is gone.*--resume"):
            list(found)


def test_a_scheduler_that_died_is_named_before_its_client_notices(campaign: Campaign, tmp_path: Path) -> None:
    """Until then the client counts as running, and whatever it is asked fails as if workers had died."""

    class Client:
        asked = 0

        @property
        def status(self) -> str:
            return "running" if self.asked <= 4 else "closed"

        def wait_for_workers(self, *_: object, **__: object) -> None:
            self.asked += 1
            if self.asked > 1:
                raise ConnectionError

        def scatter(self, *_: object, **__: object) -> None:
            raise ConnectionError

    with pytest.raises(CrashfuseError, match=r"scheduler at tcp://host:1 is gone.*--resume"):
        done_by(Cluster("tcp://host:1", Client()), fatal_once(tmp_path), campaign, tmp_path)


def test_an_unreachable_scheduler_is_one_sentence(campaign_on_disk: Path, tmp_path: Path, capsys: Capture) -> None:
    command = ["study", str(campaign_on_disk), "--out", str(tmp_path / "out"), "--scheduler", "tcp://127.0.0.1:9"]
    assert cli.main(command) == cli.WRONG_DATA
    assert capsys.readouterr().err == "crashfuse: No Dask scheduler answers at tcp://127.0.0.1:9.\n"


@pytest.mark.parametrize("address", ["localhost:8786", "http://localhost:8786", "tcp://localhost", "tcp://a b:1"])
def test_what_is_no_address_is_wrong_usage(campaign: Campaign, address: str) -> None:
    with pytest.raises(UsageError, match="looks like tcp://"):
        run_study(campaign, CONFIG, scheduler=address)
