"""The condition of a record: weights that a user gives agree with each other, and with what a vehicle can weigh."""

import math
import re
from dataclasses import replace

import pytest

from crashfuse.errors import DataError, UsageError
from crashfuse.importing import Choices
from crashfuse.importing.pulse_conversion import complete_condition
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.units import KPH, KPH_KG, LB, MPH, MPH_LB, Sentence
from tests.conftest import problems_of
from tests.importing.crashes import CONDITION, SPEED_MPS, channel, record


def weights(one: Record, given: PartialCondition, share: float | None = None) -> tuple[float, float]:
    """Front and rear weight of a record completed with what is given."""
    found = complete_condition(one, Choices(condition=given, front_share=share), [], role="tests")
    return found.front_weight_kg, found.rear_weight_kg


@pytest.mark.parametrize(
    ("given", "share", "expected"),
    [
        (PartialCondition(mass_kg=1500, front_weight_kg=900), None, (900, 600)),
        (PartialCondition(mass_kg=1500, rear_weight_kg=700), None, (800, 700)),
        (PartialCondition(front_weight_kg=900, rear_weight_kg=600), None, (900, 600)),
        (PartialCondition(mass_kg=1505, front_weight_kg=900, rear_weight_kg=600), None, (900, 600)),
        (PartialCondition(front_weight_kg=900), 0.6, (900, 600)),
        (PartialCondition(rear_weight_kg=600), 0.6, (900, 600)),
        (PartialCondition(mass_kg=1500), 0.6, (900, 600)),
        (PartialCondition(front_weight_kg=900), None, (900, 750)),
        (PartialCondition(), 0.6, (1020, 680)),
    ],
)
def test_two_weights_of_the_user_tell_both_axles_whatever_the_file_says(
    given: PartialCondition, share: float | None, expected: tuple[float, float]
) -> None:
    """The file's 950 and 750 kg complete what the user leaves open, and nothing else."""
    assert weights(record(channel()), given, share) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("given", "share", "found"),
    [
        (PartialCondition(mass_kg=800, front_weight_kg=950), None, "do not add up"),
        (PartialCondition(mass_kg=800, rear_weight_kg=950), None, "do not add up"),
        (PartialCondition(None, 1650, 950, 800), None, "do not add up"),
        (PartialCondition(None, None, 950, 700), 0.3, "do not add up"),
        *((PartialCondition(), share, f"{share:.4g} ({100 * share:.4g} %)") for share in (0.0, 0.0057, 0.9, 57.0)),
    ],
)
def test_weights_that_a_user_cannot_mean_are_refused(given: PartialCondition, share: float | None, found: str) -> None:
    with pytest.raises(UsageError, match=re.escape(found)):
        weights(record(channel()), given, share)


def test_weights_of_a_file_that_contradict_each_other_are_refused_until_the_user_overrules_them() -> None:
    one = record(channel(), condition=PartialCondition(SPEED_MPS, 1850, 950, 700))
    with pytest.raises(DataError, match=r"weights of T1 that add up, found 950 kg .* 700 kg .* 1850 kg"):
        weights(one, PartialCondition())
    assert weights(one, PartialCondition(front_weight_kg=950, rear_weight_kg=900)) == (950, 900)


@pytest.mark.parametrize(
    ("front", "rear", "message"),
    [
        (0.957, 0.693, r"a mass of T1 of 300 to 60000 kg \(661 to 132277 lb\), found 1\.65 kg \(3\.638 lb\)"),
        (1e9, 750, "of 300 to 60000 kg"),
        (-1.0, 751, "axles of T1 that carry at least 50 kg .* found −1 kg"),
        (math.nan, 750, "of 300 to 60000 kg .* found nan kg"),
        (1640, 9.6, r"axles of T1 that carry at least 50 kg \(110 lb\), found 9\.6 kg"),
        (1400, 200, "20 to 80 % of the mass of T1 in front, found 88 %"),
    ],
)
def test_what_no_vehicle_weighs_is_refused(front: float, rear: float, message: str) -> None:
    with pytest.raises(DataError, match=message):
        weights(record(channel(), condition=PartialCondition(SPEED_MPS, None, front, rear)), PartialCondition())


def test_a_table_of_conditions_overrules_what_a_file_says_of_weights() -> None:
    axles = CONDITION.overruled(PartialCondition(front_weight_kg=1100, rear_weight_kg=900))
    assert (axles.mass_kg, axles.front_weight_kg, axles.rear_weight_kg) == (None, 1100, 900)
    heavier = CONDITION.overruled(PartialCondition(mass_kg=3400))
    assert (heavier.front_weight_kg, heavier.rear_weight_kg) == pytest.approx((1900, 1500))
    assert replace(CONDITION, mass_kg=None).overruled(PartialCondition(speed_mps=1.0)).front_weight_kg == 950


SPEEDS = {-5 * KPH: "−5 km/h (−3.107 mph)", 0.0: "0 km/h (0 mph)", 1e9 * MPH: "1.609e+09 km/h (1e+09 mph)"}


@pytest.mark.parametrize(("speed_mps", "found"), [*SPEEDS.items(), (math.nan, "nan km/h (nan mph)")])
def test_a_speed_that_no_crash_has_is_named_with_what_is_expected(speed_mps: float, found: str) -> None:
    one = record(channel(), condition=PartialCondition())
    lacking, speed = problems_of(lambda: weights(one, PartialCondition(speed_mps)))
    assert (lacking.expected, lacking.found, speed.found) == ("the weights on both axles of T1", "none", found)


@pytest.mark.parametrize(
    ("given", "share", "found"),
    [
        (PartialCondition(), 0.58, "the front share alone"),
        (PartialCondition(mass_kg=1650), None, "the mass alone"),
        (PartialCondition(), None, "none"),
    ],
)
def test_one_weight_that_was_given_is_named_where_another_is_asked_for(
    given: PartialCondition, share: float | None, found: str
) -> None:
    problems = problems_of(lambda: weights(record(channel(), condition=PartialCondition(SPEED_MPS)), given, share))
    assert [problem.found for problem in problems] == [found]


def test_weights_are_said_in_the_units_of_the_reader() -> None:
    steps, choices = list[str](), Choices(condition=PartialCondition(mass_kg=1000 * LB), front_share=0.58)
    complete_condition(record(channel(), condition=PartialCondition(SPEED_MPS)), choices, steps, role="tests")
    told = steps[-1]
    assert told == "Front weight 263 kg (580 lb): 58 % of 454 kg (1000 lb)."
    assert isinstance(told, Sentence)
    assert told.in_units(MPH_LB) == "Front weight 580 lb: 58 % of 1000 lb."
    assert told.in_units(KPH_KG) == "Front weight 263 kg: 58 % of 454 kg."
