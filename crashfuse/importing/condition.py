"""The condition of a record, completed with values from the user."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from crashfuse.campaign_folder.columns import listed
from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.readers.axle_weights import AxleWeights
from crashfuse.readers.quantities import speed, weight
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.wording import Sentence

_FASTEST_MPS = 100.0
_LIGHTEST_KG, _HEAVIEST_KG, _LIGHTEST_AXLE_KG = 300.0, 60_000.0, 50.0
_LEAST_SHARE, _MOST_SHARE = 0.2, 0.8  # of the mass on the front axle
_SPEED, _WEIGHTS = "the impact speed", "the weights on both axles"
_GIVE_EACH = "add a row for each to a table of conditions (--conditions TABLE)"
_GIVE_SPEED = "give the speed (--speed-kph V, or --speed-mph V)"
_GIVE_WEIGHTS = (
    "give both axle weights, or the mass and the front axle's share of it "
    "(--front-weight-kg F --rear-weight-kg R, or --mass-kg M --front-share S)"
)
_GIVE_ANOTHER = (
    "give another of mass, front weight, rear weight and front share "
    "(--mass-kg M, --front-weight-kg F, --rear-weight-kg R or --front-share S)"
)
_CHECK_WEIGHTS = "check the weights and their unit"


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
    role: Role,
    also_missing: Sequence[Problem] = (),
) -> Condition:
    """Complete the condition of a record with the user's values, which take precedence.

    A mass without axle weights keeps the record's front-axle share, unless one is given. Missing, implausible or
    contradictory values raise a DataError; an impossible share, or weights from the user that contradict each other,
    raise a UsageError.

    Parameters
    ----------
    steps : list of str
        A sentence is appended for each thing done.
    role : {"tests", "cae"}
        A CAE run may start at rest, a test may not.
    also_missing : sequence of Problem
        Other values missing from the record, reported together with those missing here.
    """
    if front_share is not None and not _LEAST_SHARE <= front_share <= _MOST_SHARE:
        found = f"not {front_share:.4g} ({100 * front_share:.4g} %)"
        raise UsageError(f"The front axle carries a share of 0.2 to 0.8 of the mass (20 to 80 %), {found}.")
    if given != PartialCondition():
        steps.append("Of the condition, what the user gave overrules the file.")
    own = replace(given.weights, front_share=front_share)
    if contradiction := own.contradiction():
        told = "The weights that are given do not add up: {}; leave one of them out."
        raise UsageError(Sentence(told, contradiction))
    weights = record.condition.weights.overruled(own)
    if contradiction := weights.contradiction():
        advice = "correct the file, or give two of mass, front weight and rear weight"
        raise DataError(Problem(record.source, f"weights of {record.id} that add up", contradiction, advice))
    known = record.condition.overruled(given)
    front, rear = weights.axles()
    speed_mps, share = known.speed_mps, weights.front_share
    problems = [
        *missing_values(record.source, record.id, speed_mps, weights, record.no_speed),
        *also_missing,
        *speed_trouble(record, speed_mps, role),
        *_weights_trouble(record, weights),
    ]
    if problems or speed_mps is None or front is None or rear is None:
        raise DataError(problems)
    if share is not None and weights.mass_kg is not None:
        told = f"Front weight {{}}: {100 * share:.4g} % of {{}}."
        steps.append(Sentence(told, weight(front), weight(weights.mass_kg)))
    return Condition.of_vector([float(speed_mps), float(front), float(rear)], known.factors)


def missing_values(
    source: str, record_id: str, speed_mps: float | None, weights: AxleWeights, no_speed: str = ""
) -> list[Lacking]:
    """What a condition lacks: the speed, and the weights on both axles."""

    def lacking(quantity: str, found: str, advice: str) -> Lacking:
        expected = f"{quantity} of {record_id}"
        return Lacking(source, expected, found, advice, quantity=quantity, record_id=record_id)

    missing = []
    if speed_mps is None:
        missing.append(lacking(_SPEED, no_speed or "none", _GIVE_SPEED))
    if None in weights.axles():
        missing.append(lacking(_WEIGHTS, weights.alone(), _GIVE_ANOTHER if weights.told else _GIVE_WEIGHTS))
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


def speed_trouble(record: Record, speed_mps: float | None, role: Role) -> list[Problem]:
    """The problem of a speed, if it is known, that no crash has."""
    if speed_mps is None or 0 < speed_mps <= _FASTEST_MPS or (speed_mps == 0 and role == "cae"):
        return []
    least = "0 or more" if role == "cae" else "more than 0"
    expected = Sentence(
        "an impact speed of {} of {}, and at most {}", record.id, least, speed(_FASTEST_MPS, form=".0f")
    )
    found = Sentence("{}", speed(speed_mps, form=".4g"))
    return [Problem(record.source, expected, found, "check the speed and its unit")]


def _weights_trouble(record: Record, weights: AxleWeights) -> list[Problem]:
    """The problem of weights that no vehicle has, as far as they are known."""
    front, rear = weights.axles()
    axles = [each for each in (front, rear) if each is not None]
    mass = sum(axles) if len(axles) > 1 else weights.mass_kg
    if mass is not None and not _LIGHTEST_KG <= mass <= _HEAVIEST_KG:
        expected = Sentence("a mass of {} of {}", record.id, weight(_LIGHTEST_KG, _HEAVIEST_KG, between=" to "))
        return [Problem(record.source, expected, Sentence("{}", weight(mass, form=".4g")), _CHECK_WEIGHTS)]
    if axles and not min(axles) >= _LIGHTEST_AXLE_KG:
        expected = Sentence("axles of {} that carry at least {}", record.id, weight(_LIGHTEST_AXLE_KG))
        return [Problem(record.source, expected, Sentence("{}", weight(min(axles), form=".4g")), _CHECK_WEIGHTS)]
    if front is not None and rear is not None and not _LEAST_SHARE <= (share := front / (front + rear)) <= _MOST_SHARE:
        carries = f"a front axle of {record.id} that carries 20 to 80 % of the mass"
        return [Problem(record.source, carries, f"{100 * share:.0f} %", "check which axle is which, and the share")]
    return []
