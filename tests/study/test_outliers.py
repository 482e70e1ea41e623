"""A test stands apart if it differs from each neighbour more than any two of them do from each other."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.outliers import Departure, departure, departures, with_both_folds
from crashfuse.units import G
from tests.conftest import not_none


@pytest.fixture(scope="module")
def model(campaign: Campaign) -> CaeModel:
    """The CAE model of the small campaign."""
    return CaeModel().fit(campaign.cae)


def at_one_speed(campaign: Campaign, scales: Sequence[float]) -> Campaign:
    """Tests at one condition, the pulse of T2 stretched in time by these factors and weakened by the same."""
    base = campaign.test("T2")
    tests = []
    for number, scale in enumerate(scales, start=1):
        accel = np.interp(base.pulse.time_s / scale, base.pulse.time_s, base.pulse.accel_mps2) / scale
        tests.append(replace(base, id=f"S{number}", pulse=replace(base.pulse, accel_mps2=accel)))
    return replace(campaign, tests=tuple(tests))


def test_the_odd_one_of_four_stands_apart_and_none_of_the_others(campaign: Campaign, model: CaeModel) -> None:
    """Three alike, one whose pulse lasts 30 % longer: by its bias and by its pulse."""
    group = at_one_speed(campaign, [1.0, 1.02, 0.98, 1.3])
    found = {test: departure(group, test, model) for test in group.test_ids}
    assert [test for test, own in found.items() if own is not None and own.apart] == ["S4"]
    odd = not_none(found["S4"])
    assert (odd.neighbours, odd.alone) == (("S1", "S2", "S3"), ())
    other = replace(group.tests[3], condition=replace(group.tests[3].condition, factors=(("drive", "RWD"),)))
    assert not_none(departure(replace(group, tests=(*group.tests[:3], other)), "S4", model)).alone == ("drive RWD",)
    assert (len(odd.ratings), len(odd.ratings_between)) == (3, 3)
    assert departures(group) == (odd,)
    assert departures(replace(group)) == (odd,)  # as it was kept in the cache
    three = at_one_speed(campaign, [1.0, 1.02, 1.3])  # one is always farther from both others
    assert (departure(three, "S3", model), departures(three), departure(campaign, "T2", model)) == (None, (), None)


def test_the_numbers_are_ratings_and_differences_of_bias(campaign: Campaign, model: CaeModel) -> None:
    """Mean of both directions; tests at one condition differ in bias as they do in the pulse itself."""
    group = at_one_speed(campaign, [1.0, 1.02, 0.98, 1.3])
    found = not_none(departure(group, "S4", model))
    one, other = group.test("S4").pulse, group.test("S1").pulse
    both = [rate_windows(*pair, [60.0])[60.0].overall for pair in ((one, other), (other, one))]
    assert found.ratings[0] == pytest.approx(np.mean(both))
    same = not_none(departure(at_one_speed(campaign, [1.0] * 4), "S1", model))
    assert same.bias_mps2 == pytest.approx([0.0] * 3)
    assert same.ratings == pytest.approx([1.0] * 3)
    assert not same.apart


def test_a_faster_neighbour_is_scaled_to_the_tests_speed(campaign: Campaign, model: CaeModel) -> None:
    """A pulse in proportion to the speed is the same pulse."""
    group = at_one_speed(campaign, [1.0] * 4)
    first, *others = group.tests
    condition = replace(first.condition, speed_mps=1.02 * first.condition.speed_mps)
    faster = replace(first, condition=condition, pulse=replace(first.pulse, accel_mps2=1.02 * first.pulse.accel_mps2))
    assert not_none(departure(replace(group, tests=(faster, *others)), "S1", model)).ratings == pytest.approx([1.0] * 3)


def test_both_the_bias_and_the_pulse_have_to_differ() -> None:
    """One alone happens too easily."""
    alike = Departure(
        "A", ("B", "C", "D"), 15.0, 60.0, (3.0, 4.0, 5.0), (1.0, 2.0, 2.5), (0.5, 0.6, 0.7), (0.8, 0.9, 0.9)
    )
    assert alike.apart
    assert not replace(alike, ratings=(0.5, 0.6, 0.85)).apart
    assert not replace(alike, ratings=(0.95,) * 3, ratings_between=(0.96,) * 3).apart  # as good as a repeat gets
    assert not replace(alike, bias_mps2=(2.0, 4.0, 5.0)).apart


def test_near_a_test_apart_draws_show_both_ways_to_fold_and_the_average_the_usual_one() -> None:
    """A fit that learned half of the difference: what it learned is taken out, then 1.5 of 5 draws have all of it."""
    usual, rng = -20 * G * np.sin(np.pi * np.clip(GRID_S / 0.07, 0, 1)), np.random.default_rng(1)
    difference = -6 * G * np.exp(-(((GRID_S - 0.04) / 0.005) ** 2))
    condition = Condition.of(speed_mps=14.0, front_weight_kg=900, rear_weight_kg=700)
    odd = CrashTest("S4", condition, Pulse(GRID_S, usual + difference))
    apart = Departure("S4", ("S1", "S2", "S3"), 14.0, 60.0, (9.0,) * 3, (1.0,) * 3, (0.5,) * 3, (0.9,) * 3)
    fitted = usual + 0.5 * difference
    faster = replace(condition, speed_mps=1.02 * 14.0)
    noise = G * rng.standard_normal((200, 1))
    prediction = Prediction(faster, 1.02 * fitted, 1.02 * fitted + noise - noise.mean())
    both = with_both_folds(prediction, apart, odd, usual, fitted)
    assert both.apart is not None
    assert both.draws_mps2 is not None
    assert both.apart.sum() == 60
    np.testing.assert_allclose(both.accel_mps2, 1.02 * usual, atol=1e-9)
    moved = both.draws_mps2 - (noise - noise.mean())
    np.testing.assert_allclose(moved[~both.apart], np.tile(1.02 * usual, (140, 1)), atol=1e-9)
    np.testing.assert_allclose(moved[both.apart], np.tile(1.02 * (usual + difference), (60, 1)), atol=1e-9)
    assert both.apart_as == "S4"
    alone = replace(prediction, draws_mps2=None)
    assert with_both_folds(alone, apart, odd, usual, fitted) is alone
