"""Tests over speed: those at about one speed, and some spread evenly."""

from dataclasses import replace

from crashfuse.campaign import Campaign
from crashfuse.units import MPH


def test_tests_within_two_miles_an_hour_are_one_speed_group(campaign: Campaign) -> None:
    """25 and 26 mph belong together, 15 and 35 stand alone; a chain of small steps is one group."""
    groups = [campaign.speed_group(test_id) for test_id in campaign.test_ids]
    assert groups == [("T1",), *[("T2", "T3")] * 2, ("T4",)]
    speeds = (30.0, 33.4, 31.5, 25.0)
    chain = tuple(
        replace(test, condition=replace(test.condition, speed_mps=speed * MPH))
        for test, speed in zip(campaign.tests, speeds, strict=True)
    )
    assert replace(campaign, tests=chain).speed_group("T2") == ("T1", "T2", "T3")


def test_many_tests_are_thinned_out_evenly_over_speed(campaign: Campaign) -> None:
    """Of 40 tests at 1 to 40 mph four are kept, the slowest and the fastest too, in the order of the table."""
    base = campaign.tests[0]
    speeds = range(40, 0, -1)
    tests = (replace(base, id=f"M{v}", condition=replace(base.condition, speed_mps=v * MPH)) for v in speeds)
    many = replace(campaign, tests=tuple(tests))
    assert many.evenly_over_speed(4).test_ids == ("M40", "M27", "M14", "M1")
    assert many.evenly_over_speed(40) is many
    assert many.evenly_over_speed(4).evenly_over_speed(4).test_ids == ("M40", "M27", "M14", "M1")
