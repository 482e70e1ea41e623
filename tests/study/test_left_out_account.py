"""The account of a left-out test: what was expected, what came out, with its neighbours and without them."""

from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import store_estimate
from crashfuse.study.expected_rating import expected_rating
from crashfuse.study.recommendation import account, worst_test
from crashfuse.study.study import Fold, Study
from tests.conftest import not_none
from tests.study.test_recommendation import estimate

CONFIG = StudyConfig(approaches=("cae", "displacement_domain"))


def fold(campaign: Campaign, test_id: str, own: float, of_others: float) -> Fold:
    """A fold in which the displacement domain is off by a factor in its test, by another in those it left out."""
    test, rest = campaign.test(test_id), campaign.without([test_id])
    better = estimate("displacement_domain", rest, test, own, 0.1)
    left_out = {other.id: of_others * other.pulse.accel_mps2 for other in rest.tests}
    raw = estimate("cae", rest, test, 0.5)
    return Fold.of(test, (raw, replace(better, left_out_mps2=left_out)), CONFIG.windows_ms)


def test_a_test_far_below_its_expectation_is_told_with_its_range_and_its_rating(campaign: Campaign) -> None:
    """Others are predicted to 1 %, this one is half of what was measured; over which window is said."""
    found = account(campaign, CONFIG, fold(campaign, "T3", 0.5, 0.99))
    assert found.approach == "displacement_domain"
    assert found.disappoints
    assert found.expected is not None
    assert found.expected.surprise(found.rating) == "far below what was expected"
    assert (found.neighbours, found.departure) == (1, None)
    assert account(campaign, CONFIG, fold(campaign, "T3", 0.5, 0.99), 20.0).window_ms == 20.0


def test_a_test_that_comes_out_like_the_others_is_as_expected(campaign: Campaign) -> None:
    found = account(campaign, CONFIG, fold(campaign, "T3", 0.93, 0.93))
    assert not found.disappoints
    assert found.inside == 1.0


def test_the_worst_test_of_each_view_is_told_as_it_was_left_out_there(campaign: Campaign) -> None:
    """Alone T3, with its rating without T2, at its speed; of speed groups T2, by the approach asked for."""
    alone = [fold(campaign, test, 0.6 if test == "T3" else 0.97, 0.97) for test in campaign.test_ids]
    apart = [fold(campaign, test, 0.7 if test == "T2" else 0.8, 0.97) for test in campaign.test_ids]
    groups = Study(campaign, replace(CONFIG, leave_out="speed group"), tuple(apart))
    study = Study(campaign, replace(CONFIG, leave_out="both"), tuple(alone), speed_groups=groups)
    found = worst_test(study)
    assert found.test.id == "T3"
    assert found.without_neighbours == groups.fold("T3").ratings["displacement_domain"][60.0].overall
    assert worst_test(study) is found
    found = worst_test(groups, approach="displacement_domain")
    assert found.rating == groups.fold("T2").ratings["displacement_domain"][60.0].overall
    assert (found.test.id, found.with_group, found.without_neighbours) == ("T2", True, None)
    assert worst_test(groups, approach="cae").rating < found.rating


def test_a_prediction_without_the_neighbours_that_was_made_before_is_found(campaign: Campaign) -> None:
    """A study has left T3 out with T2; a comparison of T3 alone rates that prediction."""
    cache, test = Cache(), campaign.test("T3")
    rest = campaign.without(campaign.speed_group("T3"))
    assert account(campaign, CONFIG, fold(campaign, "T3", 0.6, 0.97), cache=cache).without_neighbours is None
    own = estimate("displacement_domain", rest, test, 1.0)
    errors = {name: np.zeros(0) for name in METRIC_LABELS}
    perfect = replace(own, prediction=Prediction(test.condition, test.pulse.accel_mps2), metric_errors=errors)
    store_estimate(perfect, rest, CONFIG, cache)
    found = account(campaign, CONFIG, fold(campaign, "T3", 0.6, 0.97), cache=cache)
    assert found.without_neighbours == pytest.approx(1.0)


def test_ranges_and_grades_agree_with_what_is_displayed(campaign: Campaign) -> None:
    """0.94 is Good, as Excellent is above it; a surprise is judged by the digits of the range."""
    found = not_none(expected_rating(estimate("displacement_domain", campaign, campaign.test("T3"), 1.0), campaign))
    told = replace(found, lower=0.8849, upper=0.9404, least=0.7, most=0.98)
    assert told.range == "0.88 to 0.94"
    assert told.grades == "Good"
    assert told.outcome(0.8801) == "Expected 0.88 to 0.94 (80 %), came out 0.880 (Good): as expected."
    assert told.outcome(0.8004).endswith("came out 0.800 (Good): below what was expected.")  # the grade of its rating
    assert told.outcome(0.878).endswith("came out 0.878 (Good): below what was expected.")  # not what 0.88 begins with
    assert told.surprise(0.75) == "below what was expected"
    assert told.surprise(0.96) == "above what was expected"
    assert told.surprise(0.59) == "far below what was expected"
    assert replace(told, upper=0.951).grades == "Good to Excellent"
