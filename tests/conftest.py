"""What many tests need: a small campaign with closed-form pulses, in memory and on disk, and a cache of their own."""

import gc
import os
import shutil
import sys
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeVar
from uuid import uuid4

import pandas as pd
import pytest
from hypothesis import settings

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import DataError, Problem
from crashfuse.execution.progress import Progress, Watch
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.testing import small_campaign
from crashfuse.units import LB, MPH, MS, G

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "tests" / "data"
collect_ignore = ["data"]  # the tests of the example package run where it is installed
SHARED = Path(os.environ.get("CRASHFUSE_SHARED", ROOT.parent / "shared"))
"""Vectors, worlds and real records that are not part of the project; tests of them run where they are there."""

needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason=f"needs curves and records of others in {SHARED}, or in CRASHFUSE_SHARED"
)
"""Skips a test that reads from there, and says so. Where the folder is there, a file that it lacks is an error."""

OTHER_READERS = Path(os.environ.get("CRASHFUSE_READERS", ROOT.parent / "other-readers"))
"""Programs of others that read what we write: tests/other_readers.txt says which, and how they get there."""

needs_other_readers = pytest.mark.skipif(
    not OTHER_READERS.is_dir(), reason=f"needs the programs of tests/other_readers.txt in {OTHER_READERS}"
)
"""Skips a test that uses them, and says so."""

Capture = pytest.CaptureFixture[str]
T = TypeVar("T")


def problems_of(call: Callable[[], object]) -> tuple[Problem, ...]:
    """All that a call is refused for."""
    with pytest.raises(DataError) as refused:
        call()
    assert not any("\n" in str(problem) for problem in refused.value.problems)
    return tuple(refused.value.problems)


def not_none(value: T | None) -> T:
    """A value that has to be there."""
    assert value is not None
    return value


def cancelled_after(is_reached: Callable[[Progress], bool], seen: list[Progress] | None = None) -> Watch:
    """A watch that is cancelled at the report after the one that reaches this; it keeps what it has ``seen``."""
    cancel = threading.Event()

    def take(progress: Progress) -> None:
        if seen is not None:
            seen.append(progress)
        if is_reached(progress):
            cancel.set()

    return Watch(take, cancel)


def with_pulse(campaign: Campaign, test_id: str, accel_mps2: FloatArray) -> Campaign:
    """The campaign with another pulse of one test."""
    pulse = Pulse(GRID_S, accel_mps2)
    return replace(campaign, tests=tuple(replace(t, pulse=pulse) if t.id == test_id else t for t in campaign.tests))


settings.register_profile("ours", deadline=None)  # machines are noisy: speed is a benchmark's matter
settings.load_profile("ours")


def pytest_configure() -> None:
    """Compiled code is kept; while all tests are read, which is not in vain, nothing is searched for waste."""
    sys.dont_write_bytecode = False  # a hundred processes would compile the program anew, and each worker all tests
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    gc.disable()  # else a third of the time that it takes


def pytest_collection_finish() -> None:
    """From here on there is waste."""
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes() -> None:
    """Where tests run side by side, each keeps to one core, as contended threads cost more."""
    os.environ["OMP_NUM_THREADS"] = "1"
    os.environ["LOKY_MAX_CPU_COUNT"] = "1"  # for studies that are not told how many processes to take


@pytest.hookimpl(wrapper=True, optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> Generator[None, int, int]:
    """One worker more than cores where browser tests run, too: they mostly wait, and others use the time."""
    cores = yield
    return cores if config.option.markexpr == "not slow" else cores + 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """Files are kept together; those of the browser in two halves, so that two workers start servers and browsers."""
    from xdist.scheduler import LoadFileScheduling

    halves = {path.name: str(n % 2) for n, path in enumerate(sorted((ROOT / "tests" / "browser").glob("test_*.py")))}

    class Halves(LoadFileScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            file = Path(str(super()._split_scope(nodeid)))
            return f"browser {halves[file.name]}" if file.parent.name == "browser" else file.as_posix()

    return Halves(config, log) if config.getoption("dist") == "loadfile" else None


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, none of which then runs alone in the end: of the browser, of whole programs, the others."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))

    def order(item: pytest.Item) -> tuple[bool, bool, int]:
        return item.path.parent.name != "browser", item.path.parent.name != "tests", -slow[item.path]

    items.sort(key=order)


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Bytes are no name of a test: they are unreadable, and those of an archive differ between two processes."""
    return argname if isinstance(val, bytes) else None


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """No test reads or writes the user's cache; the folder is made by whoever needs it, as most tests do not."""
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path_factory.getbasetemp() / "caches" / uuid4().hex))


@pytest.fixture(scope="module", autouse=True)
def few_draws() -> Iterator[None]:
    """Few draws of a band are rated: of a small study all of them would take longer than all else together."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("crashfuse.study.repeatability._N_DRAWS", 10)
        patch.setattr("crashfuse.study.study._RATED_DRAWS", 10)
        yield


@pytest.fixture(scope="session")
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the cache of all tests that do not mind who has learned what they need, in whatever process."""
    folder = tmp_path_factory.getbasetemp()
    return (folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder) / "cache"


@pytest.fixture
def one_cache(own_cache: None, shared_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    """What one test has learned the next one finds."""
    monkeypatch.setenv("CRASHFUSE_CACHE", str(shared_cache))


@pytest.fixture(scope="module")
def quick_networks() -> Iterator[None]:
    """Within one test module the fast preset trains a network of a second: small, and short."""
    small = TcnConfig(members=2, channels=8, epochs=1, min_steps=60, tuning_steps=40)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TcnConfig, "fast", lambda: small)
        yield


@pytest.fixture
def fitting_is_an_error(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Called, it makes every way to learn fail from then on."""

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("fitted again")

    def forbid() -> None:
        for name in (
            "crashfuse.approaches.time_domain.lf_tcn.train",
            "crashfuse.approaches.time_domain.approach.fine_tune",
            "crashfuse.approaches.time_domain.fine_tuning.Increments.fit",
            "crashfuse.approaches.displacement_domain.gaussian_process.GaussianProcess.fit",
            "crashfuse.approaches.displacement_domain.table4_bias.Table4Bias.fit",
        ):
            monkeypatch.setattr(name, forbidden)

    return forbid


@pytest.fixture(scope="session")
def campaign() -> Campaign:
    """The small campaign."""
    return small_campaign()


@pytest.fixture(scope="session")
def sample() -> Campaign:
    """The sample campaign: repeats at two speeds, with scatter and noise."""
    return load_campaign(ROOT / "sample_data")


@pytest.fixture
def campaign_folder(campaign_on_disk: Path, tmp_path: Path) -> Path:
    """The small campaign as a folder of the test's own."""
    return shutil.copytree(campaign_on_disk, tmp_path / "campaign")


@pytest.fixture(scope="session")
def campaign_on_disk(campaign: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small campaign as a folder that all tests share and none changes."""
    return write_campaign(campaign, tmp_path_factory.mktemp("shared") / "campaign")


def write_campaign(campaign: Campaign, folder: Path) -> Path:
    """Write a campaign folder: one CSV a test, one Parquet table for the CAE runs."""
    (folder / "tests").mkdir(parents=True)
    condition_table([(test.id, test.condition) for test in campaign.tests]).to_csv(folder / "tests.csv", index=False)
    condition_table(zip(campaign.cae.ids, campaign.cae.conditions, strict=True)).to_csv(folder / "cae.csv", index=False)
    for test in campaign.tests:
        pulse_table(test.pulse.accel_mps2).to_csv(folder / "tests" / f"{test.id}.csv", index=False)
    tidy_table(campaign).to_parquet(folder / "cae_pulses.parquet", index=False)
    return folder


def content_of(folder: Path) -> dict[str, bytes]:
    """All files by their path, hidden ones too."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def condition_table(rows: object) -> pd.DataFrame:
    """Ids and conditions as a table in mph and lb, with the factors as columns."""
    return pd.DataFrame(
        {
            "id": run_id,
            "speed_mph": c.speed_mps / MPH,
            "front_weight_lb": c.front_weight_kg / LB,
            "rear_weight_lb": c.rear_weight_kg / LB,
            **dict(c.factors),
        }
        for run_id, c in rows  # type: ignore[attr-defined]
    )


def pulse_table(accel_mps2: FloatArray) -> pd.DataFrame:
    """One pulse as a table in ms and g."""
    return pd.DataFrame({"time_ms": (GRID_S / MS).round(6), "acceleration_g": accel_mps2 / G})


def tidy_table(campaign: Campaign) -> pd.DataFrame:
    """All CAE pulses as one tidy table."""
    tables = [
        pulse_table(accel.astype(float)).assign(id=i)
        for i, accel in zip(campaign.cae.ids, campaign.cae.accel_mps2, strict=True)
    ]
    return pd.concat(tables)[["id", "time_ms", "acceleration_g"]]
