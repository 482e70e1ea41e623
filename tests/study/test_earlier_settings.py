"""Other settings with which a test was predicted before: of the same data, still in the cache, and not the same."""

from dataclasses import replace
from pathlib import Path

import pytest

from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.study.config import StudyConfig
from crashfuse.study.earlier_settings import earlier_settings, past_settings
from crashfuse.study.history import PastResult
from crashfuse.study.running import run_study

SHOWN = StudyConfig(approaches=("cae", "displacement_domain"))
OTHERS = [replace(SHOWN, seed=1), replace(SHOWN, seed=1, leave_out="speed group")]


@pytest.fixture
def cache(shared_cache: Path) -> Cache:
    """Where the predictions are."""
    return Cache(shared_cache)


@pytest.fixture
def past(campaign: Campaign, cache: Cache) -> list[PastResult]:
    """T2 was left out alone and with its speed group by seed 1, and alone by the seed that is shown."""
    both = replace(SHOWN, seed=1, leave_out="both")
    studies = [run_study(campaign, config, held_out=["T2"], cache=cache, workers=1) for config in (both, SHOWN)]
    return [PastResult.of_study(study) for study in studies]


def test_each_other_seed_and_way_is_found_once(campaign: Campaign, cache: Cache, past: list[PastResult]) -> None:
    """Not those that are shown, however often they were computed."""
    assert earlier_settings([*past, *past], campaign, "T2", "displacement_domain", SHOWN, cache) == OTHERS
    shown = OTHERS[1]
    assert earlier_settings(past, campaign, "T2", "displacement_domain", shown, cache) == [OTHERS[0], SHOWN]


def test_those_shown_are_among_all_that_are_past(campaign: Campaign, past: list[PastResult]) -> None:
    """Each once, of this test and approach alone."""
    assert past_settings([*past, *past], campaign, "T2", "cae", SHOWN) == [*OTHERS, SHOWN]
    assert past_settings(past, campaign, "T3", "cae", SHOWN) == []
    assert past_settings(past, campaign, "T2", "fused", SHOWN) == []


def test_what_would_be_the_same_prediction_is_none(campaign: Campaign, cache: Cache, past: list[PastResult]) -> None:
    """The raw CAE model knows no seed."""
    assert earlier_settings(past, campaign, "T2", "cae", SHOWN, cache) == OTHERS[1:]


def test_other_tests_other_data_and_a_deleted_cache_offer_nothing(
    campaign: Campaign, cache: Cache, past: list[PastResult], tmp_path: Path
) -> None:
    """Nor does an approach that was not among those of the study."""
    assert earlier_settings(past, campaign, "T3", "displacement_domain", SHOWN, cache) == []
    assert earlier_settings(past, campaign.without(["T4"]), "T2", "displacement_domain", SHOWN, cache) == []
    assert earlier_settings(past, campaign, "T2", "lf_tcn", SHOWN, cache) == []
    assert earlier_settings(past, campaign, "T2", "displacement_domain", SHOWN, Cache(tmp_path)) == []
