"""The condition of a record, completed by what the user knows."""

from dataclasses import replace

import numpy as np

from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.formats.record import PartialCondition, Record
from crashfuse.pulse import Condition


def complete_condition(
    record: Record, given: PartialCondition, front_share: float | None, steps: list[str], *, standstill: bool
) -> Condition:
    """Complete what a record says of its condition.

    Parameters
    ----------
    record : Record
    given : PartialCondition
        By the user; it overrules the record. A mass without axle weights keeps the record's share of the front axle.
    front_share : float or None
        Share of the mass on the front axle, by the user.
    steps : list of str
        What was done is appended.
    standstill : bool
        Whether a speed of 0 is a condition (a CAE run may start there, a test may not).

    Raises
    ------
    DataError
        If speed or an axle weight is known to neither, or makes no sense.
    UsageError
        If the share is none.
    """
    known = record.condition.overruled(given)
    if given != PartialCondition():
        steps.append("Of the condition, what the user gave overrules the file.")
    front, rear, mass = known.front_weight_kg, known.rear_weight_kg, known.mass_kg
    if front_share is not None:
        if not 0 < front_share < 1:
            raise UsageError(f"The front axle carries a share between 0 and 1 of the mass, not {front_share:g}.")
        mass = front + rear if mass is None and front is not None and rear is not None else mass
        front = rear = None
    elif given.mass_kg is not None and (given.front_weight_kg, given.rear_weight_kg) == (None, None) and front and rear:
        front_share, front, rear = front / (front + rear), None, None
    if front_share is not None and mass is not None:
        front, rear = front_share * mass, mass - front_share * mass
        steps.append(f"Front weight {front:.0f} kg: {100 * front_share:.4g} % of {mass:g} kg.")
    elif mass is not None and front is not None and rear is None:
        rear = mass - front
    elif mass is not None and rear is not None and front is None:
        front = mass - rear
    return _sound(record, replace(known, front_weight_kg=front, rear_weight_kg=rear), standstill)


def _sound(record: Record, known: PartialCondition, standstill: bool) -> Condition:
    speed, front, rear = known.speed_mps, known.front_weight_kg, known.rear_weight_kg
    weights = "give both axle weights, or the mass and the front axle's share of it"
    if speed is None or front is None or rear is None:
        wanted = (
            ("impact speed", speed, "give the speed"),
            ("front weight", front, weights),
            ("rear weight", rear, weights),
        )
        raise DataError(
            [
                Problem(record.source, f"the {what} of {record.id}", "none", how)
                for what, value, how in wanted
                if value is None
            ]
        )
    finite = bool(np.isfinite([speed, front, rear]).all())
    if not finite or front <= 0 or rear <= 0 or speed < 0 or (speed == 0 and not standstill):
        expected, found = f"a speed and weights above 0 for {record.id}", f"{speed:g} m/s, {front:g} kg and {rear:g} kg"
        raise DataError(Problem(record.source, expected, found, "give the right ones"))
    return Condition(float(speed), float(front), float(rear), known.factors)
