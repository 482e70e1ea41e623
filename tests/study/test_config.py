"""What makes a study impossible is said before anything is computed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.errors import DataError, UsageError
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.study.config import StudyConfig, StudyPlan, telling_test
from crashfuse.study.running import run_study
from crashfuse.units import MPH


def test_a_plan_names_each_test_once(campaign: Campaign) -> None:
    assert StudyPlan(campaign).held_out == campaign.test_ids
    assert StudyPlan(campaign, held_out=("T4", "T1", "T4")).held_out == ("T4", "T1")


def test_both_ways_to_leave_out_are_planned_where_both_are_possible(campaign: Campaign) -> None:
    both = StudyConfig(leave_out="both")
    assert [config.leave_out for config in StudyPlan(campaign, both).configs] == ["test", "speed group"]
    assert len(StudyPlan(replace(campaign, tests=campaign.tests[:1] * 2), both).configs) == 1


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"approaches": ("magic",)}, "There is no approach 'magic'; choose from cae, lf_tcn, time_domain"),
        ({"approaches": "fusd"}, "There is no approach 'fusd'; did you mean fused"),
        ({"approaches": ()}, "Name at least one approach"),
        ({"preset": "slow"}, "There is no preset 'slow'; choose from fast, paper"),
        ({"device": "gpu"}, "There is no device 'gpu'; did you mean cpu"),
        ({"seed": -1}, "Seed must be between 0 and 4294967295, got -1"),
        ({"seed": 2**32}, "Seed must be between 0 and 4294967295, got 4294967296"),
        ({"seed": "1"}, "Seed must be between 0 and 4294967295, got 1"),
        ({"windows_ms": (5.0,)}, "A rating window of 5 ms is not possible; choose 10 to 100 ms"),
        ({"windows_ms": ()}, "Name at least one rating window"),
        ({"windows_ms": 0.06}, "A rating window of 0.06 ms is not possible"),
        ({"leave_out": "speed groups"}, "did you mean speed group"),
    ],
)
def test_an_impossible_setting_is_refused_where_it_is_stated(settings: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        StudyConfig(**settings)


def test_a_preset_that_does_not_act_is_refused_and_of_several_approaches_it_is_said_of_which(
    campaign: Campaign,
) -> None:
    """Fused has no other preset; pages go on with the one that acts."""
    alone = StudyConfig(approaches=("cae", "fused"), preset="paper")
    with pytest.raises(UsageError, match=r"paper does not act on cae, fused.*acts on lf_tcn, time_domain, displ"):
        StudyPlan(campaign, alone)
    assert (alone.under_preset, alone.effective) == ((), replace(alone, preset="fast"))
    several = replace(alone, approaches=("fused", "lf_tcn"))
    several.check()
    assert (several.under_preset, several.effective) == (("lf_tcn",), several)


def test_a_single_test_or_speed_group_cannot_be_left_out(campaign: Campaign) -> None:
    """Nothing would remain to learn from."""
    with pytest.raises(UsageError, match="at least 2 tests"):
        run_study(campaign.without(["T1", "T2", "T3"]))
    with pytest.raises(UsageError, match="All tests are of one speed group"):
        run_study(replace(campaign, tests=campaign.tests[:1] * 2), StudyConfig(leave_out="speed group"))


def test_a_test_that_is_flat_over_a_window_is_named_before_anything_is_computed(campaign: Campaign) -> None:
    late = np.where(GRID_S < 0.025, 0.0, campaign.test("T1").pulse.accel_mps2)
    tests = (replace(campaign.tests[0], pulse=Pulse(GRID_S, late)), *campaign.tests[1:])
    with pytest.raises(DataError, match="T1: expected a pulse that varies over 0–20 ms"):
        run_study(replace(campaign, tests=tests), StudyConfig(windows_ms=(20.0, 60.0)))


def test_a_window_beyond_the_end_of_a_held_out_record_is_refused(campaign: Campaign) -> None:
    """Nobody measured what it would be rated against; up to its end, and with other tests held out, it can be."""
    cut = replace(campaign, tests=(replace(campaign.tests[0], recorded_s=0.0799), *campaign.tests[1:]))
    for windows, held_out in (((80.0,), ("T1",)), ((100.0,), ("T2",))):
        StudyPlan(cut, StudyConfig(windows_ms=windows), held_out)
    with pytest.raises(DataError, match=r"T1: expected a record over 0–90 ms, found 79\.9 ms; rate a shorter window"):
        StudyPlan(cut, StudyConfig(windows_ms=(60.0, 90.0)), ("T2", "T1"))


def at(campaign: Campaign, *speeds_mph: float) -> Campaign:
    one = campaign.tests[0]
    conditions = [replace(one.condition, speed_mps=speed * MPH) for speed in speeds_mph]
    tests = (replace(one, id=name, condition=at) for name, at in zip("ABCDEFGH", conditions, strict=False))
    return replace(campaign, tests=tuple(tests))


@pytest.mark.parametrize(
    ("speeds_mph", "chosen"),
    [
        ((8, 12, 17, 22, 25, 25, 35, 35), "D"),  # the nearest to the middle, 21.5 mph
        ((35, 8, 30), "C"),  # 8 and 35 have no neighbour on one side, however the table is sorted
        ((8, 34, 35), "B"),  # 34 and 35 are one speed group, so that none lies between: the nearest to the middle
        ((25, 25.5, 24.8), "A"),  # one speed group: equal, so the nearest to the middle
        ((30,), "A"),
    ],
)
def test_it_lies_between_others_near_the_middle_of_the_speeds(
    campaign: Campaign, speeds_mph: tuple[float, ...], chosen: str
) -> None:
    assert telling_test(at(campaign, *speeds_mph)).id == chosen
