"""The condition of a record, completed with values from the user."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crashfuse.campaign_folder.columns import listed
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.wording import number

_LIGHTEST_KG, _HEAVIEST_KG, _LIGHTEST_AXLE_KG = 300.0, 60_000.0, 50.0
_LEAST_SHARE, _MOST_SHARE = 0.2, 0.8  # of the mass on the front axle
_SPEED, _WEIGHTS = "the impact speed", "the weights on both axles"
_GIVE_EACH = "add a row for each to a table of conditions (--conditions TABLE)"
_GIVE_SPEED = "give the speed (--speed-kph V, or --speed-mph V)"
_GIVE_WEIGHTS = (
    "give both axle weights, or the mass and the front axle's share of it "
    "(--front-weight-kg F --rear-weight-kg R, or --mass-kg M --front-share S)"
)
_GIVE_SHARE = (
    "give the front axle's share of the mass, or both axle weights "
    "(--front-share S, or --front-weight-kg F --rear-weight-kg R)"
)


@dataclass(frozen=True, slots=True)
class Lacking(Problem):
    """What a record's condition lacks."""

    quantity: str = ""
    record_id: str = ""


def complete_condition(
    record: Record,
    given: PartialCondition,
    front_share: float | None,
    steps: list[str],
    *,
    standstill: bool,
    also_missing: Sequence[Problem] = (),
) -> Condition:
    """Complete the condition of a record with the user's values, which take precedence.

    A mass without axle weights keeps the record's front-axle share, unless one is given. Missing, implausible or
    contradictory values raise a DataError; an impossible share or weights from the user raise a UsageError.

    Parameters
    ----------
    steps : list of str
        A sentence is appended for each thing done.
    standstill : bool
        Whether a speed of 0 is allowed (a CAE run may start at rest, a test may not).
    also_missing : sequence of Problem
        Other values missing from the record, reported together with those missing here.
    """
    if front_share is not None and not 0 < front_share < 1:
        raise UsageError(f"The front axle carries a share between 0 and 1 of the mass, not {front_share:g}.")
    if given != PartialCondition():
        steps.append("Of the condition, what the user gave overrules the file.")
    own = replace(given.weights, front_share=front_share)
    if contradiction := own.contradiction():
        raise UsageError(f"The weights that are given do not add up: {contradiction}; leave one of them out.")
    weights = record.condition.weights.overruled(own)
    if contradiction := weights.contradiction():
        advice = "correct the file, or give two of mass, front weight and rear weight"
        raise DataError(Problem(record.source, f"weights of {record.id} that add up", contradiction, advice))
    known = record.condition.overruled(given).weighing(weights)
    if weights.front_share is not None and weights.mass_kg is not None and known.front_weight_kg is not None:
        share, front = 100 * weights.front_share, known.front_weight_kg
        steps.append(f"Front weight {front:.0f} kg: {share:.4g} % of {weights.mass_kg:g} kg.")
    return _sound(record, known, standstill, also_missing)


def _sound(record: Record, known: PartialCondition, standstill: bool, also_missing: Sequence[Problem]) -> Condition:
    speed, front, rear = known.speed_mps, known.front_weight_kg, known.rear_weight_kg
    missing = [*missing_values(record.source, record.id, known, record.no_speed), *also_missing]
    if missing or speed is None or front is None or rear is None:
        raise DataError(missing)
    finite = bool(np.isfinite([speed, front, rear]).all())
    if not finite or front <= 0 or rear <= 0 or speed < 0 or (speed == 0 and not standstill):
        expected = f"a speed and weights above 0 for {record.id}"
        found = f"{number(speed, 'g')} m/s, {number(front, 'g')} kg and {number(rear, 'g')} kg"
        raise DataError(Problem(record.source, expected, found, "give the right ones"))
    if trouble := _weights_trouble(record, front, rear):
        raise DataError(trouble)
    return Condition(float(speed), float(front), float(rear), known.factors)


def missing_values(source: str, record_id: str, known: PartialCondition, no_speed: str = "") -> list[Lacking]:
    """What a condition lacks: the speed, and the weights on both axles."""

    def lacking(quantity: str, found: str, advice: str) -> Lacking:
        expected = f"{quantity} of {record_id}"
        return Lacking(source, expected, found, advice, quantity=quantity, record_id=record_id)

    missing = []
    if known.speed_mps is None:
        missing.append(lacking(_SPEED, no_speed or "none", _GIVE_SPEED))
    if known.front_weight_kg is None or known.rear_weight_kg is None:
        mass = known.mass_kg
        found, advice = ("none", _GIVE_WEIGHTS) if mass is None else (f"a mass of {mass:.5g} kg alone", _GIVE_SHARE)
        missing.append(lacking(_WEIGHTS, found, advice))
    return missing


def told_of_several(problems: Sequence[Problem]) -> list[Problem]:
    """The problems of several records, with what their conditions lack told once.

    Options of the command give all records one condition; a table of conditions gives each its own.
    """
    alike: dict[tuple[str, str], list[Lacking]] = {}
    for problem in problems:
        if isinstance(problem, Lacking):
            alike.setdefault((problem.quantity, problem.found), []).append(problem)
    told: list[Problem] = []
    for (quantity, found), own in alike.items():
        where = own[0].where if len({one.where for one in own}) == 1 else f"{own[0].where} to {own[-1].where}"
        told.append(Problem(where, f"{quantity} of {listed([one.record_id for one in own])}", found, _GIVE_EACH))
    return [*told, *(problem for problem in problems if not isinstance(problem, Lacking))]


def _weights_trouble(record: Record, front: float, rear: float) -> Problem | None:
    """The problem of weights that no vehicle has, if any."""
    mass, share = front + rear, front / (front + rear)
    if not _LIGHTEST_KG <= mass <= _HEAVIEST_KG:
        expected = f"a mass of {record.id} between {_LIGHTEST_KG:g} and {_HEAVIEST_KG:,.0f} kg"
        return Problem(record.source, expected, f"{mass:.4g} kg", "check the weights and their unit")
    if min(front, rear) < _LIGHTEST_AXLE_KG:
        expected = f"axles of {record.id} that carry at least {_LIGHTEST_AXLE_KG:g} kg"
        return Problem(record.source, expected, f"{min(front, rear):.4g} kg", "check the weights and their unit")
    if not _LEAST_SHARE <= share <= _MOST_SHARE:
        expected = f"a front axle of {record.id} that carries {_LEAST_SHARE:.0%} to {_MOST_SHARE:.0%} of the mass"
        return Problem(record.source, expected, f"{share:.0%}", "check which axle is which, and the share")
    return None
