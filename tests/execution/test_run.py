"""A run says where results are kept: with a cache nothing is written elsewhere. One heap, one thread."""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import crashfuse
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution import run
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import UNKEPT, Run, one_thread, one_thread_throughout
from crashfuse.study.config import StudyConfig

CONFIG = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(60.0,))


@pytest.fixture
def default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The platform's cache folder, which nobody has written to."""
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path / "default"))
    return tmp_path / "default"


@pytest.fixture
def grouped(campaign: Campaign) -> Campaign:
    """With four tests at one speed, which are compared with each other."""
    first = campaign.tests[0]
    at = [Condition.of_vector(first.condition.vector + np.array([0, kg, 0])) for kg in (5, 10, 15)]
    more = [CrashTest(f"R{number}", condition, first.pulse) for number, condition in enumerate(at)]
    return Campaign("Grouped", campaign.cae, (*campaign.tests[::3], *more))


@pytest.mark.slow
def test_with_a_cache_nothing_is_written_into_the_default_one(grouped: Campaign, default: Path, tmp_path: Path) -> None:
    """Not by a study, its files and its figures, nor by any other computation and what is asked of it afterwards."""
    cache = Cache(tmp_path / "cache")
    study = crashfuse.run_study(grouped, CONFIG, held_out=["R1", "T4"], cache=cache, workers=2)
    study.write(tmp_path / "study")
    study.plot("T4", "bias parts")
    fused = crashfuse.predict(grouped, grouped.tests[0].condition, "displacement_domain", CONFIG, cache=cache)
    fused.write(tmp_path / "prediction")
    crashfuse.sweep(grouped, grouped.tests[0].condition, (15.0, 16.0), "displacement_domain", cache=cache)
    crashfuse.next_test(grouped, cache=cache)
    crashfuse.learning_curve(grouped, StudyConfig(approaches=("cae",)), repeats=0, cache=cache, workers=1)
    criteria = [{"metric": "max_crush", "at_most": 600.0}, {"metric": "rating", "window_ms": 60.0, "at_least": 0.8}]
    matrix = grouped.tests_frame.head(2)
    verdicts = crashfuse.certify(grouped, criteria, matrix, approach="cae", cache=cache, workers=1)
    verdicts.write(tmp_path / "certification")
    assert not default.exists() or [path for path in default.rglob("*") if path.is_file()] == []
    kinds = {path.name for path in cache.folder.iterdir()}
    assert kinds >= {"code", "departures", "emulator", "fits", "predictions", "repeatability", "forecasts"}


def test_a_campaign_keeps_to_the_cache_of_its_run(campaign: Campaign, default: Path, tmp_path: Path) -> None:
    """Until another run is given another; the default one needs no saying."""
    other = Run(Cache(tmp_path)).bind(campaign)
    assert Run.of(other).cache.folder == tmp_path
    assert Run().bind(campaign) is campaign
    assert Run.of(Run().bind(other)).cache.folder == default
    assert other.fingerprint == campaign.fingerprint


def test_a_fit_by_hand_keeps_nothing(campaign: Campaign, default: Path) -> None:

    def work(_campaign: Campaign, task: str, unkept: Run) -> list[str]:
        return [unkept.get_or_compute("kind", {}, lambda: (task, {}), str)]

    assert [*UNKEPT.completed(work, campaign, ["a", "b"])] == [["a"], ["b"]]
    assert not default.exists()


def test_memory_can_be_given_back_anywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """With glibc it returns what is free; with another C library nothing is done."""
    run.give_back()
    monkeypatch.setattr(sys, "platform", "win32")
    run._glibc.cache_clear()
    run.share_one_heap()
    run.give_back()
    run._glibc.cache_clear()


def _threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.mark.parametrize("limit", [one_thread, one_thread_throughout])
def test_who_leaves_first_does_not_end_it_for_others(limit: Callable[[], AbstractContextManager[None]]) -> None:
    with threadpool_limits(2, user_api="blas"):
        before, first, second = _threads(), ExitStack(), ExitStack()
        first.enter_context(limit())
        second.enter_context(limit())
        first.close()
        assert _threads() == {1}
        second.close()
        assert _threads() == before
