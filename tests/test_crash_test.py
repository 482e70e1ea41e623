"""Tests over speed: those at about one speed, and some spread evenly."""

from collections.abc import Sequence
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.campaign import Campaign
from crashfuse.crash_test import speed_groups
from crashfuse.study.facts import campaign_facts
from crashfuse.units import KPH, MPH, said


@pytest.mark.parametrize(
    ("speeds", "groups"),
    [
        ((15.0, 25.0, 26.0, 35.0), (0, 1, 1, 2)),  # one step is a tenth of the others
        ((30.0, 32.1, 34.5, 36.9, 39.2, 42.1) * 2, (0, 1, 2, 3, 4, 5) * 2),  # a ladder, each step twice
        ((30.0, 32.0, 34.0, 36.0, 38.0, 60.0), (0, 1, 2, 3, 4, 5)),  # a test far away joins no others
        ((19.4, 20.6, 29.2, 30.3, 39.8, 41.1), (0, 0, 1, 1, 2, 2)),  # as they scatter about 20, 30, 40
        ((15.0, 18.0, 21.0, 50.0, 53.0), (0, 1, 2, 3, 4)),  # two ladders, none of about one speed
        ((20.0, 21.0, 24.0), (0, 0, 1)),  # three times as wide, exactly
        ((20.0, 21.0, 23.9), (0, 1, 2)),
    ],
)
def test_speed_groups_are_apart_by_more_than_they_are_wide(speeds: Sequence[float], groups: Sequence[int]) -> None:
    assert [tuple(speed_groups(np.array(speeds) * unit)) for unit in (1.0, KPH, MPH)] == [groups] * 3


@given(st.lists(st.integers(1, 400), min_size=1, max_size=12), st.randoms(use_true_random=False))
def test_speed_groups_are_of_any_unit_and_order(tenths: list[int], random: Random) -> None:
    """Gaps between them are over 2 % and three times the widest, unless nothing wider than 2 % is within any."""
    speeds = np.sort(np.array(tenths) / 10)
    groups, order = speed_groups(speeds), random.sample(range(speeds.size), speeds.size)
    assert np.array_equal(speed_groups(speeds[order] / KPH), groups[order])
    parted, gaps = np.diff(groups) == 1, np.diff(speeds)
    widest, wide = max(np.ptp(speeds[groups == group]) for group in groups), gaps / speeds[1:]
    assert (wide[parted] > 0.0199).all()
    assert (gaps[parted] > 2.999 * widest).all() or (wide[~parted] < 0.0201).all()


def test_one_speed_alone_is_stated(campaign: Campaign) -> None:
    alike = replace(campaign, tests=(campaign.tests[0], replace(campaign.tests[0], id="T5")))
    assert alike.speed_group("T1") == ("T1", "T5")
    for those, sentences in ((alike, ["All 2 tests are at about 15.0 mph: no speed can be left out."]), (campaign, [])):
        facts = (fact for fact in campaign_facts(those) if fact.code == "tests.one_speed")
        assert [said(fact.sentence, those.units) for fact in facts] == sentences


def test_many_tests_are_thinned_out_evenly_over_speed(campaign: Campaign) -> None:
    """Of 40 tests at 1 to 40 mph four are kept, the slowest and the fastest too, in the order of the table."""
    base = campaign.tests[0]
    speeds = range(40, 0, -1)
    tests = (replace(base, id=f"M{v}", condition=replace(base.condition, speed_mps=v * MPH)) for v in speeds)
    many = replace(campaign, tests=tuple(tests))
    assert many.evenly_over_speed(4).test_ids == ("M40", "M27", "M14", "M1")
    assert many.evenly_over_speed(40) is many
    assert many.evenly_over_speed(4).evenly_over_speed(4).test_ids == ("M40", "M27", "M14", "M1")
