"""The condition of a record: weights that a user gives agree with each other, and with what a vehicle can weigh."""

from dataclasses import replace

import pytest

from crashfuse.errors import DataError, UsageError
from crashfuse.importing.condition import complete_condition
from crashfuse.readers.record import PartialCondition, Record
from tests.importing.crashes import CONDITION, SPEED_MPS, channel, record


def weights(one: Record, given: PartialCondition, share: float | None = None) -> tuple[float, float]:
    """Front and rear weight of a record completed with what is given."""
    found = complete_condition(one, given, share, [], standstill=False)
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
        (PartialCondition(mass_kg=800, front_weight_kg=950), None, "950 kg in front with a mass of 800 kg"),
        (PartialCondition(mass_kg=800, rear_weight_kg=950), None, "950 kg at the rear with a mass of 800 kg"),
        (PartialCondition(None, 1650, 950, 800), None, "950 kg in front and 800 kg at the rear with a mass of 1650 kg"),
        (PartialCondition(None, None, 950, 700), 0.3, r"57\.6 % of the mass in front with a front share of 30 %"),
    ],
)
def test_weights_of_the_user_that_contradict_each_other_are_refused(
    given: PartialCondition, share: float | None, found: str
) -> None:
    """None of them is dropped in silence."""
    with pytest.raises(UsageError, match=f"do not add up: {found}; leave one of them out"):
        weights(record(channel()), given, share)


def test_weights_of_a_file_that_contradict_each_other_are_refused_until_the_user_overrules_them() -> None:
    """950 and 700 kg are no 1850 kg."""
    one = record(channel(), condition=PartialCondition(SPEED_MPS, 1850, 950, 700))
    with pytest.raises(
        DataError, match="weights of T1 that add up, found 950 kg in front and 700 kg at the rear with a"
    ):
        weights(one, PartialCondition())
    assert weights(one, PartialCondition(front_weight_kg=950, rear_weight_kg=900)) == (950, 900)


@pytest.mark.parametrize(
    ("front", "rear", "message"),
    [
        (0.957, 0.693, r"a mass of T1 between 300 and 60,000 kg, found 1\.65 kg; check the weights and their unit"),
        (1e9, 750, "between 300 and 60,000 kg"),
        (1640, 9.6, r"axles of T1 that carry at least 50 kg, found 9\.6 kg"),
        (1400, 200, "a front axle of T1 that carries 20% to 80% of the mass, found 88%"),
    ],
)
def test_what_no_vehicle_weighs_is_refused(front: float, rear: float, message: str) -> None:
    """Tonnes under kg, a share under a weight, axles exchanged: a sentence each."""
    with pytest.raises(DataError, match=message):
        weights(record(channel(), condition=PartialCondition(SPEED_MPS, None, front, rear)), PartialCondition())


def test_a_table_of_conditions_overrules_what_a_file_says_of_weights() -> None:
    """Axle weights of a table put the file's mass aside, a mass keeps the file's share of the front axle."""
    axles = CONDITION.overruled(PartialCondition(front_weight_kg=1100, rear_weight_kg=900))
    assert (axles.mass_kg, axles.front_weight_kg, axles.rear_weight_kg) == (None, 1100, 900)
    heavier = CONDITION.overruled(PartialCondition(mass_kg=3400))
    assert (heavier.front_weight_kg, heavier.rear_weight_kg) == pytest.approx((1900, 1500))
    assert replace(CONDITION, mass_kg=None).overruled(PartialCondition(speed_mps=1.0)).front_weight_kg == 950
