"""An approach at a condition: impossible ones are refused; fits and predictions are kept by all that decides them."""

import threading
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.approaches.base import Approach, Prediction
from crashfuse.approaches.displacement_domain.approach import DisplacementConfig, DisplacementDomain
from crashfuse.approaches.registry import APPROACHES
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import DT_S, kinematics
from crashfuse.signals.sensor_faults import SensorFault
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit, estimate_at, estimates_at, find_estimate, is_estimate_cached, store_estimate
from crashfuse.study.expected_rating import expected_rating
from crashfuse.units import G
from tests.conftest import not_none

pytestmark = pytest.mark.usefixtures("quick_networks", "one_cache")


@pytest.mark.parametrize(
    ("speed_mps", "said"),
    [*((v, "speed and weights above 0") for v in (0.0, -3.0)), (180.0, "at most 224 mph and 132277 lb")],
)
def test_an_impossible_speed_is_refused(campaign: Campaign, speed_mps: float, said: str) -> None:
    """Nothing crashes at a standstill, and no barrier test is made at 400 mph."""
    condition = replace(campaign.tests[0].condition, speed_mps=speed_mps)
    with pytest.raises(UsageError, match=said):
        estimate_at(campaign, condition, "displacement_domain")


@pytest.mark.parametrize("approach", APPROACHES)
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.slow
def test_far_beyond_the_library_the_vehicle_still_stops(campaign: Campaign, approach: str, factor: float) -> None:
    base = campaign.tests[1].condition
    condition = replace(
        base, front_weight_kg=factor * base.front_weight_kg, rear_weight_kg=factor * base.rear_weight_kg
    )
    prediction = estimate_at(campaign, condition, approach)
    velocity = kinematics(prediction.accel_mps2, condition.speed_mps, DT_S).velocity_mps
    assert 0.7 < (condition.speed_mps - velocity.min()) / condition.speed_mps < 1.6
    assert any("Extrapolation" in note for note in prediction.notes)


def test_a_prediction_says_whose_sensor_failed(campaign: Campaign) -> None:
    first, *others = campaign.tests
    failed = replace(first, faults=(SensorFault("lost", 0.03, 0.035, -20 * G, 9.0),))
    condition = first.condition
    for approach, notes in (("displacement_domain", 1), ("cae", 0)):
        for tests in ((failed, *others), campaign.tests, (failed, *others)):
            prediction = estimate_at(replace(campaign, tests=tests), condition, approach)
            named = [note for note in prediction.notes if "its signal is lost from 30.0 to 35.0 ms" in note]
            assert len(named) == (notes if failed in tests else 0)


@pytest.mark.slow
def test_a_fit_is_kept_in_the_cache_by_all_that_decides_it(
    campaign: Campaign, fitting_is_an_error: Callable[[], None], tmp_path: Path
) -> None:
    condition = campaign.tests[1].condition
    config, cache = StudyConfig(approaches=("displacement_domain",)), Cache(tmp_path)  # where no other test fitted
    first = Fit.of(campaign, "displacement_domain", config, Run(cache)).estimate(condition)
    fitting_is_an_error()
    again = Fit.of(campaign, "displacement_domain", config, Run(cache)).estimate(condition)
    assert again.accel_mps2.tobytes() == first.accel_mps2.tobytes()
    with pytest.raises(AssertionError, match="fitted again"):
        Fit.of(campaign.without(["T3"]), "displacement_domain", config, Run(cache))
    with pytest.raises(AssertionError, match="fitted again"):
        Fit.of(campaign, "displacement_domain", replace(config, seed=1), run=Run(cache))


@pytest.mark.slow
@pytest.mark.parametrize("order", [APPROACHES, APPROACHES[::-1]])
def test_several_approaches_say_together_what_each_says_alone(
    campaign: Campaign, order: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit, and what fused is made of is predicted once, in two threads, whoever comes first."""
    condition = replace(campaign.tests[1].condition, speed_mps=9.0)
    fits = [Fit.of(campaign, name) for name in order]
    alone = [fit.estimate(condition) for fit in fits]
    asked: dict[str, list[int]] = defaultdict(list)
    for approach in (TimeDomain, DisplacementDomain):

        def counted(self: Approach, at: Condition, predict: Callable[..., Prediction] = approach.predict) -> Prediction:
            asked[self.name].append(threading.get_ident())
            return predict(self, at)

        monkeypatch.setattr(approach, "predict", counted)
    together = estimates_at(fits, condition)
    (by_networks,), (by_none,) = asked["time_domain"], asked["displacement_domain"]
    assert by_networks != by_none
    assert [estimate.approach for estimate in together] == list(order)
    for one, other in zip(alone, together, strict=True):
        assert one.accel_mps2.tobytes() == other.accel_mps2.tobytes()
        ours, theirs = (e.draws_mps2 for e in (one, other))
        assert ours is theirs is None or (ours is not None and theirs is not None and np.array_equal(ours, theirs))
        assert one.notes == other.notes


@pytest.mark.slow
def test_parts_with_other_settings_are_not_shared(campaign: Campaign) -> None:
    condition = campaign.tests[1].condition
    fused = Fit.of(campaign, "fused")
    other = Fit.of(campaign, "time_domain", StudyConfig(seed=1))
    (_, together), alone = estimates_at([other, fused], condition), fused.estimate(condition)
    assert together.accel_mps2.tobytes() == alone.accel_mps2.tobytes()


def test_what_was_stored_is_found_with_all_that_is_told_of_it(campaign: Campaign) -> None:
    rest, config, cache = campaign.without(["T2"]), StudyConfig(), Cache()
    condition = replace(campaign.test("T2").condition, front_weight_kg=911.0)
    own = Fit.of(rest, "displacement_domain", config, Run(cache)).estimate(condition)
    store_estimate(own, rest, config, cache)
    found = not_none(find_estimate(rest, condition, "displacement_domain", config, cache))
    assert np.array_equal(found.accel_mps2, own.accel_mps2)
    assert np.array_equal(np.asarray(found.draws_mps2), np.asarray(own.draws_mps2))
    assert found.notes == own.notes
    assert found.metrics == own.metrics
    assert found.agreements == own.agreements
    assert expected_rating(found, rest) == expected_rating(own, rest)
    assert not is_estimate_cached(campaign, condition, "displacement_domain", config)


@pytest.mark.slow
def test_other_settings_are_another_prediction(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    condition = campaign.tests[0].condition
    estimate_at(campaign, condition, "displacement_domain")
    few = replace(DisplacementConfig.fast(), n_draws=20)
    monkeypatch.setattr(DisplacementConfig, "fast", lambda: few)
    assert len(not_none(estimate_at(campaign, condition, "displacement_domain").draws_mps2)) == 20
