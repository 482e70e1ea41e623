"""What rating may be expected is what tests near it were rated when they were left out."""

from dataclasses import replace

import pytest

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.signals.rating import rate_windows
from crashfuse.study.expected_rating import expected_rating
from crashfuse.units import MPH


def at(campaign: Campaign, mph: float) -> Condition:
    """A condition of the campaign's weights at this speed."""
    return replace(campaign.tests[0].condition, speed_mps=mph * MPH)


def test_it_is_the_mean_over_the_nearest_tests(campaign: Campaign) -> None:
    """At 30 mph those of 25, 26 and 35 mph count, each rated against its own pulse; the one of 15 mph does not."""
    softer = {test.id: 0.8 * test.pulse.accel_mps2 for test in campaign.tests}
    found = expected_rating(softer, campaign, at(campaign, 30.4), 60.0)
    assert found is not None
    ratings = [
        rate_windows(test.pulse, replace(test.pulse, accel_mps2=softer[test.id]), [60.0])[60.0].overall
        for test in campaign.tests[1:]
    ]
    assert found.tests == ("T3", "T4", "T2")
    assert found.mean == pytest.approx(sum(ratings) / 3)
    assert (found.lowest, found.highest) == (min(ratings), max(ratings))
    assert found.reach_mps == pytest.approx(5.4 * MPH)


def test_a_perfect_record_is_told_with_its_count(campaign: Campaign) -> None:
    """Tests predicted as they were measured rate 1, and the sentence says how many there are."""
    perfect = {test.id: test.pulse.accel_mps2 for test in campaign.tests}
    found = expected_rating(perfect, campaign, at(campaign, 25.5))
    assert found is not None
    assert found.sentence.startswith("Expected rating over 0–60 ms: 1.00 (Excellent); 3 left-out tests within")


def test_a_condition_farther_from_tests_than_they_from_each_other_is_flagged(campaign: Campaign) -> None:
    """The nearest three to 60 mph have neighbours within 9 mph of them; 60 mph has none within 25."""
    known = {test.id: test.pulse.accel_mps2 for test in campaign.tests}
    near, far = (expected_rating(known, campaign, at(campaign, mph)) for mph in (30.0, 60.0))
    assert near is not None
    assert far is not None
    assert not near.farther
    assert far.farther
    assert far.sentence.startswith("Expected rating over 0–60 ms: less than the")


def test_where_no_test_was_left_out_nothing_is_expected(campaign: Campaign) -> None:
    """The paper's preset does not ask."""
    assert expected_rating({}, campaign, at(campaign, 30.0)) is None
