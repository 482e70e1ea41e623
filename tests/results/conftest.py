"""A test, predictions of it with known bands and a study off by known factors, for figures and their numbers."""

from collections.abc import Mapping

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.results.plots.curves import Predictions
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.study import Fold, Study


@pytest.fixture
def test(campaign: Campaign) -> CrashTest:
    """A test at 25 mph."""
    return campaign.test("T2")


@pytest.fixture
def predictions(campaign: Campaign, test: CrashTest) -> Predictions:
    """The paired CAE run, and the same with 101 draws that lie -50 to +50 m/s² off it."""
    return with_and_without_band(campaign, test, "fused")


def with_and_without_band(campaign: Campaign, test: CrashTest, banded: str) -> Predictions:
    """The paired CAE run, and the same under another name with 101 draws that lie -50 to +50 m/s² off it."""
    run = campaign.cae.paired_run(test.condition)
    assert run is not None
    accel = campaign.cae.accel_mps2[run].astype(float)
    draws = accel + np.arange(-50.0, 51.0)[:, None]
    return {"cae": Prediction(test.condition, accel), banded: Prediction(test.condition, accel, draws)}


def scaled_study(campaign: Campaign, held_out: tuple[str, ...], scales: Mapping[str, float]) -> Study:
    """A study in which each approach is off by its own factor, over 20 and 60 ms."""
    config, folds = StudyConfig(approaches=tuple(scales), seed=7, windows_ms=(20.0, 60.0)), []
    for test in map(campaign.test, held_out):
        pulses = {name: scale * test.pulse.accel_mps2 for name, scale in scales.items()}
        own = [Estimate(test.condition, accel, approach=name) for name, accel in pulses.items()]
        folds.append(Fold.of(test, own, config.windows_ms))
    return Study(campaign, config, tuple(folds))
