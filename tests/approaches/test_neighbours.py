"""What is near a condition is named with its differences."""

from dataclasses import replace

from crashfuse.approaches.calibration import DECAYS, decay_over_speed
from crashfuse.approaches.neighbours import doubtful_tests, nearest_tests
from crashfuse.campaign import Campaign
from crashfuse.signals.sensor_faults import SensorFault
from crashfuse.units import LB, MPH, G


def test_the_nearest_test_comes_first_with_its_differences(campaign: Campaign) -> None:
    """T3 at 26 mph is 2 mph faster than a condition of its weights at 24 mph."""
    condition = replace(campaign.test("T3").condition, speed_mps=25.8 * MPH, front_weight_kg=2090 * LB)
    first, second = nearest_tests(campaign, condition, n=2)
    assert (first.id, second.id) == ("T3", "T2")
    assert first.differences(condition) == "T3 (+0.2 mph, front −10 lb, rear 0 lb)"


def test_a_test_of_this_speed_is_nearer_than_one_of_another_speed_and_the_very_weights(campaign: Campaign) -> None:
    """At 35 mph 100 lb are less than 10 mph, however narrow the range of weights is."""
    first, second, *_ = campaign.tests
    fast = replace(first, condition=replace(first.condition, speed_mps=35 * MPH))
    condition = replace(fast.condition, front_weight_kg=fast.condition.front_weight_kg + 100 * LB)
    both = replace(campaign, tests=(replace(second, condition=replace(condition, speed_mps=25 * MPH)), fast))
    assert [own.id for own in nearest_tests(both, condition)] == [first.id, second.id]


def test_a_test_whose_sensor_failed_is_named_where_it_is_near(campaign: Campaign) -> None:
    slowest, *others = campaign.tests
    failed = replace(slowest, faults=(SensorFault("saturated", 0.03, 0.05, -20 * G, 9.0),))
    doubtful = replace(campaign, tests=(failed, *others))
    assert doubtful_tests(doubtful, slowest.condition) == (failed,)
    assert doubtful_tests(doubtful, others[-1].condition) == ()
    assert doubtful_tests(campaign, slowest.condition) == ()


def test_a_correction_decays_over_speed_only_where_no_speed_left_out_is_worse_for_it() -> None:
    """Two groups that ask for a decay of 1 and of 0.5 get what is best in all; one that asks for none has its way."""
    one, half, none = 2 * abs(DECAYS - 1), abs(DECAYS - 0.5), 0.1 * DECAYS
    assert decay_over_speed({(0,): [one], (1, 2): [half - 0.1, half + 0.1]}) == 1.0
    assert decay_over_speed({(0,): [one], (1,): [half], (3,): [none]}) == 0.0
    assert decay_over_speed({(0,): [one - one[0]], (1,): [0 * one]}) == 1.0
    assert decay_over_speed({(0,): [-0.01 * DECAYS]}) == decay_over_speed({}) == 0.0, "too little to be worth it"
