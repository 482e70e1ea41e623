"""An approach at a condition: impossible ones are refused; fits and predictions are kept by all that decides them."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from crashfuse.approaches import APPROACHES
from crashfuse.approaches.displacement_domain import DisplacementConfig
from crashfuse.campaign import Campaign
from crashfuse.config import StudyConfig
from crashfuse.errors import UsageError
from crashfuse.estimate import Fit, estimate_at
from crashfuse.pulse import DT_S, kinematics

pytestmark = pytest.mark.usefixtures("quick_networks")


@pytest.mark.parametrize("speed_mps", [0.0, -3.0, float("nan")])
def test_a_condition_without_speed_is_refused(campaign: Campaign, speed_mps: float) -> None:
    """Nothing crashes at a standstill."""
    condition = replace(campaign.tests[0].condition, speed_mps=speed_mps)
    with pytest.raises(UsageError, match="speed and weights above 0"):
        estimate_at(campaign, condition, "displacement_domain")


@pytest.mark.parametrize("approach", APPROACHES)
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_far_beyond_the_library_the_vehicle_still_stops(campaign: Campaign, approach: str, factor: float) -> None:
    """At half and twice the weights every approach predicts a crash, and flags the extrapolation."""
    base = campaign.tests[1].condition
    condition = replace(
        base, front_weight_kg=factor * base.front_weight_kg, rear_weight_kg=factor * base.rear_weight_kg
    )
    prediction = estimate_at(campaign, condition, approach).prediction
    velocity = kinematics(prediction.accel_mps2, condition.speed_mps, DT_S).velocity_mps
    assert 0.7 < (condition.speed_mps - velocity.min()) / condition.speed_mps < 1.6
    assert any("Extrapolation" in note for note in prediction.notes)


def test_other_settings_are_another_prediction(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is kept is kept by the settings, not by the preset's name."""
    condition = campaign.tests[0].condition
    estimate_at(campaign, condition, "displacement_domain")
    few = replace(DisplacementConfig.fast(), n_draws=20)
    monkeypatch.setattr(DisplacementConfig, "fast", lambda: few)
    draws = estimate_at(campaign, condition, "displacement_domain").prediction.draws_mps2
    assert draws is not None
    assert len(draws) == 20


def test_a_fit_is_kept_in_the_cache_by_all_that_decides_it(
    campaign: Campaign, fitting_is_an_error: Callable[[], None]
) -> None:
    """The second fit learns nothing; with one test less it has to."""
    condition = campaign.tests[1].condition
    config = StudyConfig(approaches=("displacement_domain",))
    first = Fit.of(campaign, "displacement_domain", config).estimate(condition)
    fitting_is_an_error()
    again = Fit.of(campaign, "displacement_domain", config).estimate(condition)
    assert again.prediction.accel_mps2.tobytes() == first.prediction.accel_mps2.tobytes()
    with pytest.raises(AssertionError, match="fitted again"):
        Fit.of(campaign.without(["T3"]), "displacement_domain", config)
    with pytest.raises(AssertionError, match="fitted again"):
        Fit.of(campaign, "displacement_domain", replace(config, seed=1))
