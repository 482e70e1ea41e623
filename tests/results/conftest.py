"""A test and predictions of it with known bands, for figures and their numbers."""

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.results.plots.curves import Predictions


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
