"""Predictions are kept by all that decides them, and found again whole."""

from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.config import DisplacementConfig
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.estimate_cache import estimate_at, find_estimate, is_estimate_cached, store_estimate
from crashfuse.study.expected_rating import expected_rating

pytestmark = pytest.mark.usefixtures("one_cache")


def test_what_was_stored_is_found_with_all_that_is_told_of_it(campaign: Campaign) -> None:
    """Pulse, draws, metrics with intervals and the rating that is expected; not at another condition."""
    rest, config, cache = campaign.without(["T2"]), StudyConfig(), Cache()
    condition = replace(campaign.test("T2").condition, front_weight_kg=911.0)
    own = Fit.of(rest, "displacement_domain", config, cache=cache).estimate(condition)
    store_estimate(own, rest, config, cache)
    found = find_estimate(rest, condition, "displacement_domain", config, cache)
    assert found is not None
    assert np.array_equal(found.prediction.accel_mps2, own.prediction.accel_mps2)
    assert np.array_equal(np.asarray(found.prediction.draws_mps2), np.asarray(own.prediction.draws_mps2))
    assert found.prediction.notes == own.prediction.notes
    assert found.metrics == own.metrics
    assert found.agreements == own.agreements
    assert expected_rating(found, rest) == expected_rating(own, rest)
    assert not is_estimate_cached(campaign, condition, "displacement_domain", config, cache)


@pytest.mark.slow
def test_other_settings_are_another_prediction(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is kept is kept by the settings, not by the preset's name."""
    condition = campaign.tests[0].condition
    estimate_at(campaign, condition, "displacement_domain")
    few = replace(DisplacementConfig.fast(), n_draws=20)
    monkeypatch.setattr(DisplacementConfig, "fast", lambda: few)
    draws = estimate_at(campaign, condition, "displacement_domain").prediction.draws_mps2
    assert draws is not None
    assert len(draws) == 20
