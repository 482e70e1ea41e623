"""What rating may be expected is learned from tests that were left out, and from how well draws agree."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.rating import rate_windows
from crashfuse.study.estimate import Estimate
from crashfuse.study.expected_rating import expected_rating
from crashfuse.study.rating_distribution import RatingDistribution, agreement
from crashfuse.units import MPH
from tests.conftest import not_none


def drawn(accel_mps2: FloatArray, spread: float) -> FloatArray:
    """Draws of a relative spread."""
    return accel_mps2 * (1 + spread * np.linspace(-1, 1, 41)[:, None])


def at(
    campaign: Campaign, mph: float, left_out: Mapping[str, FloatArray], spread: float = 0.1, there: float = 0.1
) -> Estimate:
    """An estimate at the campaign's weights and this speed, with bands of a relative width there and here."""
    condition, pulse = replace(campaign.tests[0].condition, speed_mps=mph * MPH), campaign.tests[0].pulse.accel_mps2
    agreements = {
        test: agreement(Prediction(condition, accel, drawn(accel, there))) for test, accel in left_out.items()
    }
    return Estimate(
        "displacement_domain", Prediction(condition, pulse, drawn(pulse, spread)), {}, 0.0, left_out, agreements
    )


def test_the_nearest_tests_stand_beside_it(campaign: Campaign) -> None:
    """At 30 mph those of 25, 26 and 35 mph count, each rated against its own pulse; the one of 15 mph does not."""
    softer = {test.id: 0.8 * test.pulse.accel_mps2 for test in campaign.tests}
    found = not_none(expected_rating(at(campaign, 30.4, softer), campaign))
    ratings = [
        rate_windows(test.pulse, replace(test.pulse, accel_mps2=softer[test.id]), [60.0])[60.0].overall
        for test in campaign.tests[1:]
    ]
    assert found.tests == ("T3", "T4", "T2")
    assert found.mean == pytest.approx(sum(ratings) / 3)
    assert (found.lowest, found.highest) == (min(ratings), max(ratings))
    assert found.reach_mps == pytest.approx(5.4 * MPH)


def test_a_test_as_near_as_the_last_is_not_left_unsaid(campaign: Campaign) -> None:
    """At 24.95 mph the third is 9.95 mph away, and a fourth, 10.02 mph away, is told to be as near."""
    speeds = {"T1": 15.0, "T2": 25.0, "T3": 26.0, "T4": 34.97}
    tests = tuple(
        replace(test, condition=replace(test.condition, speed_mps=speeds[test.id] * MPH)) for test in campaign.tests
    )
    softer = {test.id: 0.8 * test.pulse.accel_mps2 for test in tests}
    for mph, said in ((24.95, {"T1", "T2", "T3", "T4"}), (24.85, {"T1", "T2", "T3"})):
        found = not_none(expected_rating(at(campaign, mph, softer), replace(campaign, tests=tests)))
        assert set(found.tests) == said


@pytest.mark.parametrize(("mph", "guessed"), [(9.9, True), (10.1, False), (39.9, False), (40.1, True)])
def test_far_beyond_all_tests_there_is_no_grade(campaign: Campaign, mph: float, guessed: bool) -> None:
    """The tests, of 15 to 35 mph, say nothing of how errors grow there; a guess that is Excellent is none."""
    softer = {test.id: 0.8 * test.pulse.accel_mps2 for test in campaign.tests}
    found = not_none(expected_rating(at(campaign, mph, softer), campaign))
    assert found.beyond is guessed
    assert (found.grades in found.sentence) is not guessed


def test_the_range_rests_on_all_tests_by_distance_and_on_the_bands(campaign: Campaign) -> None:
    """It is that of the rating's distribution; a band twice as wide as those of the left-out tests lowers it."""
    softer = {test.id: 0.8 * test.pulse.accel_mps2 for test in campaign.tests}
    alike, wider = (not_none(expected_rating(at(campaign, 30.4, softer, spread), campaign)) for spread in (0.1, 0.3))
    ratings = [
        rate_windows(test.pulse, replace(test.pulse, accel_mps2=softer[test.id]), [60.0])[60.0].overall
        for test in campaign.tests
    ]
    away = np.abs([test.condition.speed_mps - 30.4 * MPH for test in campaign.tests])
    known, here = at(campaign, 30.4, softer, 0.3).agreements, agreement(at(campaign, 30.4, softer, 0.3).prediction)
    own = RatingDistribution.learned(np.array(ratings), away, np.array(list(known.values())), here)
    assert (wider.lower, wider.median, wider.upper) == pytest.approx([own.quantile(share) for share in (0.1, 0.5, 0.9)])
    assert wider.median < alike.median
    assert wider.lower < alike.lower


def test_a_condition_farther_from_tests_than_they_from_each_other_is_flagged(campaign: Campaign) -> None:
    """The nearest three to 60 mph have neighbours within 9 mph of them; 60 mph has none within 25."""
    known = {test.id: test.pulse.accel_mps2 for test in campaign.tests}
    near, far = (not_none(expected_rating(at(campaign, mph, known), campaign)) for mph in (30.0, 60.0))
    assert not near.farther
    assert far.farther
    assert (near.side, far.side) == ("", "slower")


@pytest.mark.parametrize(
    ("mph", "said"),
    [(14.5, "within"), (13.1, "within"), (12.9, "faster"), (35.5, "within"), (36.9, "within"), (37.1, "slower")],
)
def test_a_condition_hardly_beyond_all_tests_has_tests_on_no_side(campaign: Campaign, mph: float, said: str) -> None:
    """The tests are of 15 to 35 mph; nearer than 2 mph is at about the speed of one of them."""
    known = {test.id: test.pulse.accel_mps2 for test in campaign.tests}
    found = not_none(expected_rating(at(campaign, mph, known), campaign))
    assert found.side == ("" if said == "within" else said)
    assert f" {said} " in found.sentence


def test_where_no_test_was_left_out_nothing_is_expected(campaign: Campaign) -> None:
    """The paper's preset does not ask."""
    assert expected_rating(at(campaign, 30.0, {}), campaign) is None
