"""Turning a record into a campaign pulse: condition, channels, unit, sign, time zero, filter; every step is reported.

The order matters: detecting unit and sign needs the impact speed, the filter needs the whole record including the part
before contact, and only then is the record cut to the crash.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from crashfuse.cae_library import RunQuality
from crashfuse.campaign_folder.condition_tables import Role, listed
from crashfuse.campaign_folder.plausibility import CREEP_MPS, MOVING, STOPS
from crashfuse.campaign_folder.pulse_files import SHORTEST_S, advice_if_short, rate_trouble
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, UsageError, collecting
from crashfuse.importing.channels import agreeing_channels, average, measurement_problems, missing_choices
from crashfuse.importing.detection import (
    Case,
    Choices,
    UnknownUnit,
    change_problem,
    crash_advice,
    delta_v,
    filter_class,
    filtered_before,
    report_offset,
    stated_zero,
    step_of,
    time_zero,
    unit_and_sign,
)
from crashfuse.readers.record import AxleWeights, PartialCondition, Record
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, speed, weight
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Kinematics, Pulse, kinematics
from crashfuse.units import MS, G
from crashfuse.wording import Sentence, number, time_text

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
_LONGER = {
    "tests": "export the whole record; or check time zero",
    "cae": "let the run go on to 100 ms, and copy all of its files; or check time zero",
}
_LONGEST_S = 0.2


@dataclass(frozen=True, slots=True)
class Lacking(Problem):
    """What a record's condition lacks."""

    quantity: str = ""
    record_id: str = ""


def complete_condition(
    record: Record, choices: Choices, steps: list[str], *, role: Role, also_missing: Sequence[Problem] = ()
) -> Condition:
    """Complete the condition of a record with the user's values, which take precedence.

    A mass without axle weights keeps the record's front-axle share, unless one is given. Missing, implausible or
    contradictory values raise a DataError, together with what is ``also_missing``; an impossible share, or weights from
    the user that contradict each other, raise a UsageError. A sentence is appended to ``steps`` for each thing done.
    """
    given, front_share = choices.condition, choices.front_share
    if front_share is not None and not _LEAST_SHARE <= front_share <= _MOST_SHARE:
        found = f"not {front_share:.4g} ({100 * front_share:.4g} %)"
        raise UsageError(f"The front axle carries a share of 0.2 to 0.8 of the mass (20 to 80 %), {found}.")
    if given != PartialCondition():
        steps.append("Of the condition, what the user gave overrules the file.")
    if contradiction := choices.weights.contradiction():
        template = "The weights that are given do not add up: {}; leave one of them out."
        raise UsageError(Sentence(template, contradiction))
    weights = record.condition.weights.overruled(choices.weights)
    if contradiction := weights.contradiction():
        advice = "correct the file, or give two of mass, front weight and rear weight"
        raise DataError(Problem(record.source, f"weights of {record.id} that add up", contradiction, advice))
    overruled = record.condition.overruled(given)
    front, rear = weights.axles()
    speed_mps, share = overruled.speed_mps, weights.front_share
    problems = [
        *missing_values(record.source, record.id, speed_mps, weights, record.no_speed),
        *also_missing,
        *_speed_problems(record, speed_mps, role),
        *_weights_problems(record, weights),
    ]
    if problems or speed_mps is None or front is None or rear is None:
        raise DataError(problems)
    if share is not None and weights.mass_kg is not None:
        template = f"Front weight {{}}: {100 * share:.4g} % of {{}}."
        steps.append(Sentence(template, weight(front), weight(weights.mass_kg)))
    return Condition.of_vector([float(speed_mps), float(front), float(rear)], overruled.factors)


def missing_values(
    source: str, record_id: str, speed_mps: float | None, weights: AxleWeights, no_speed: str = ""
) -> list[Lacking]:
    """What a condition lacks: the speed, and the weights on both axles."""

    def lacking(quantity: str, found: str, advice: str) -> Lacking:
        return Lacking(source, f"{quantity} of {record_id}", found, advice, quantity=quantity, record_id=record_id)

    missing = []
    if speed_mps is None:
        missing.append(lacking(_SPEED, no_speed or "none", _GIVE_SPEED))
    if None in weights.axles():
        missing.append(lacking(_WEIGHTS, weights.single_value(), _GIVE_ANOTHER if weights.n_stated else _GIVE_WEIGHTS))
    return missing


def joint_problems(problems: Sequence[Problem]) -> list[Problem]:
    """The problems of several records, with what their conditions lack told once.

    Options of the command give all records one condition; a table of conditions gives each its own.
    """
    alike: dict[tuple[str, str], list[Lacking]] = {}
    for problem in problems:
        if isinstance(problem, Lacking):
            alike.setdefault((problem.quantity, problem.found), []).append(problem)
    joint: list[Problem] = []
    for (quantity, found), several in alike.items():
        first, last = several[0].where, several[-1].where
        where = first if len({one.where for one in several}) == 1 else f"{first} to {last}"
        joint.append(Problem(where, f"{quantity} of {listed([one.record_id for one in several])}", found, _GIVE_EACH))
    return [*joint, *(problem for problem in problems if not isinstance(problem, Lacking))]


def _speed_problems(record: Record, speed_mps: float | None, role: Role) -> list[Problem]:
    if speed_mps is None or 0 < speed_mps <= _FASTEST_MPS or (speed_mps == 0 and role == "cae"):
        return []
    least = "0 or more" if role == "cae" else "more than 0"
    template = "an impact speed of {} of {}, and at most {}"
    expected = Sentence(template, record.id, least, speed(_FASTEST_MPS, form=".0f"))
    found = Sentence("{}", speed(speed_mps, form=".4g"))
    return [Problem(record.source, expected, found, "check the speed and its unit")]


def _weights_problems(record: Record, weights: AxleWeights) -> list[Problem]:
    front, rear = weights.axles()
    axles = [axle for axle in (front, rear) if axle is not None]
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


def _refuse_short(case: Case, time_s: FloatArray, values: FloatArray, unit: str | None) -> None:
    """Raise a DataError if a record is too short whatever its unit and speed, by the earliest contact that may be."""
    zero_s = case.choices.time_zero_s
    earliest = 0.0 if stated_zero(case.record, time_s) else float(time_s[0])
    end_s = float(time_s[-1]) - (earliest if zero_s is None else zero_s)
    if 0 < end_s < SHORTEST_S - step_of(time_s):
        factor = ACCELERATION_UNITS.get(case.choices.unit or unit or "", np.nan)
        advice = advice_if_short(float(time_s[-1] - time_s[0]), _LONGER[case.role])
        _refuse(case.record, end_s, case.speed_mps - abs(delta_v(time_s, values)) * factor, advice)


def _end_steps(record: Record, end_s: float, motion: Kinematics, role: Role) -> list[str]:
    """The sentences on the end of the record, if it comes early, and on when the vehicle stops.

    A record that ends (``end_s`` after contact) before 60 ms, or before 100 ms while the vehicle moves, is refused.
    """
    first, last, end = float(motion.velocity_mps[0]), float(motion.velocity_mps[-1]), time_text(end_s)
    sentences: list[str] = []
    if end_s < SHORTEST_S - motion.dt_s:
        _refuse(record, end_s, last, _LONGER[role])
    if end_s < GRID_S[-1] - motion.dt_s:
        if first > CREEP_MPS and last > MOVING * first:
            expected = "a record that lasts until the vehicle has stopped, or 100 ms"
            found = Sentence(f"{{}} left at its end, {end}", speed(last))
            raise DataError(Problem(record.source, expected, found, _LONGER[role]))
        careful = (
            f"Careful: the record ends {end} after contact{{}} and {number(motion.accel_mps2[-1] / G, '+.2g')} g; it "
            f"goes on with no acceleration, which nobody measured. Better {_LONGER[role].partition(';')[0]}."
        )
        sentences.append(Sentence(careful, _left(last)))
    if motion.t0_s <= GRID_S[-1]:
        crush = f"{motion.displacement_m.max() / MS:.0f} mm"
        return [*sentences, f"Zero velocity (TTZV) at {motion.t0_s / MS:.1f} ms, after {crush}."]
    by = min(motion.displacement_m.size - 1, round(GRID_S[-1] / motion.dt_s))
    within, moved = f"{min(end_s, GRID_S[-1]) / MS:.0f} ms", f"{motion.displacement_m[by] / MS:.0f} mm"
    later = Sentence(f"has {{}} left at {end}", speed(last))
    if np.isfinite(motion.t0_s):
        later = Sentence(f"stops at {motion.t0_s / MS:.1f} ms")
    careful = f"Careful: the vehicle does not stop within {within}; it has moved {moved} by then and {{}}."
    return [*sentences, Sentence(careful, later)]


def _left(speed_mps: float) -> str:
    return "" if np.isnan(speed_mps) else Sentence(" with {} left at its end", speed(speed_mps))


def _refuse(record: Record, end_s: float, left_mps: float, advice: str) -> None:
    expected = "a record of at least 60 ms from contact (100 ms is best)"
    raise DataError(Problem(record.source, expected, Sentence(f"{time_text(end_s)}{{}}", _left(left_mps)), advice))


@dataclass(frozen=True, eq=False, slots=True)
class Settled:
    """A record ready to be added to a campaign.

    Parameters
    ----------
    pulse : Pulse
        Deceleration negative, m/s², time 0 at first contact; filtered and cut, or whole and raw if the campaign's own
        ``channel_filter_class`` is to filter it.
    unit, deceleration_sign, time_zero_s
        Of the numbers in the file: their unit, whether deceleration is negative or positive, and when contact is.
    channel_filter_class : float or None
        Class the record was filtered with here; None if it was not.
    steps : tuple of str
        Everything that was found and done, in order.
    quality : RunQuality
        What the solver says of a CAE run; nothing of a test.
    """

    id: str
    source: str
    condition: Condition
    pulse: Pulse
    channels: tuple[str, ...]
    unit: str
    deceleration_sign: str
    time_zero_s: float
    channel_filter_class: float | None
    steps: tuple[str, ...]
    quality: RunQuality = field(default_factory=RunQuality)
    role: Role = "tests"

    def __repr__(self) -> str:
        return f"<Settled {self.id!r}: {self.condition}>"


def settle(record: Record, choices: Choices = Choices(), *, role: Role = "tests", raw: bool = False) -> Settled:
    """Turn a record into a pulse of the campaign.

    A DataError says that something needed is neither in the record nor in the choices, or that the pulse contradicts
    the speed; a UsageError that a choice does not exist.

    Parameters
    ----------
    role : {"tests", "cae"}
        A CAE run starts at contact unless its time says otherwise, and may stop early or late.
    raw : bool
        Leave filtering and cutting to the campaign's own ``channel_filter_class``.
    """
    steps = list(record.steps)
    if record.other_setup and role == "tests":
        steps.append(f"Careful: not a full-frontal barrier crash, by its own account: {record.other_setup}.")
    missing = missing_choices(record, choices)
    if role == "tests":
        missing += measurement_problems(record, choices)
    try:
        condition = complete_condition(record, choices, steps, role=role, also_missing=missing)
    except DataError as error:
        raise DataError([*error.problems, *_pulse_problems(record, choices, role, raw=raw)]) from None
    return settled_at(record, choices, condition, role, steps, raw=raw)


def _pulse_problems(record: Record, choices: Choices, role: Role, *, raw: bool) -> list[Problem]:
    """What is wrong with a pulse whose condition is not complete; nobody should look for that of one to be refused."""
    if not record.chosen(choices.channels):
        return []
    speed_mps = record.condition.overruled(choices.condition).speed_mps
    if speed_mps is None or _speed_problems(record, speed_mps, role):
        speed_mps = math.nan
    problems: list[Problem] = []
    with collecting(problems):
        settled_at(record, choices, Condition.of_vector([speed_mps, 1.0, 1.0]), role, [], raw=raw)
    # the unit that a speed may tell is asked for along with the speed
    return [problem for problem in problems if not (math.isnan(speed_mps) and isinstance(problem, UnknownUnit))]


def settled_at(
    record: Record, choices: Choices, condition: Condition, role: Role, steps: list[str], *, raw: bool
) -> Settled:
    """Settle the pulse of a record whose condition is known; otherwise as :func:`settle`.

    Without its speed (NaN), a pulse is checked as far as that is possible.
    """
    case = Case(record, choices, role, condition.speed_mps, steps)
    channels = agreeing_channels(case)
    time_s, values = average(case, channels)
    if slow := rate_trouble(step_of(time_s), float(time_s[-1] - time_s[0])):
        raise DataError(Problem(record.source, *slow))
    _refuse_short(case, time_s, values, channels[0].unit)
    unit, sign = unit_and_sign(case, channels, time_s, values)
    accel = values * ACCELERATION_UNITS[unit] * (1 if sign == "negative" else -1)
    zero_s = time_zero(case, time_s, accel)
    report_offset(time_s, accel, zero_s, steps)
    unlike = change_problem(case, time_s, accel, unit)
    if raw:
        before = filtered_before(channels, time_s, accel)
        again = f"Careful: {before}; the campaign filters it again."
        steps.append(again if before else "Raw: the campaign filters it with its own channel_filter_class.")
    cfc = None if raw else filter_class(case, channels, time_s, accel)
    if cfc is not None:
        accel = _filtered(record, accel, cfc, step_of(time_s), steps)
    pulse = _cut(time_s - zero_s, accel, raw=raw, filtered=cfc is not None)
    _check(case, pulse, unlike)
    names = tuple(channel.name for channel in channels)
    quality = record.quality if role == "cae" else RunQuality()
    found = unit, sign, zero_s, cfc, tuple(steps)
    return Settled(record.id, record.source, condition, pulse, names, *found, quality, role)


def _filtered(record: Record, accel: FloatArray, cfc: float, step_s: float, steps: list[str]) -> FloatArray:
    try:
        filtered = cfc_filter(accel, cfc=cfc, dt_s=step_s)
    except DataError as error:
        raise DataError([replace(problem, where=record.source) for problem in error.problems]) from None
    steps.append(f"Filtered with CFC {cfc:g}, the whole record, before it was cut.")
    return filtered


def _cut(time_s: FloatArray, accel: FloatArray, *, raw: bool, filtered: bool) -> Pulse:
    """The record from contact to 200 ms at its own rate (at most 12.5 kHz if filtered); if raw, all of it."""
    if raw:
        return Pulse(time_s, accel)
    step = max(step_of(time_s), DT_S) if filtered else step_of(time_s)
    last = min(time_s[-1], _LONGEST_S)
    grid = step * np.arange(max(int(np.floor(last / step + 1e-6)) + 1, 2))
    return Pulse(grid, np.interp(grid, time_s, accel))


def _check(case: Case, pulse: Pulse, unlike: Problem | None) -> None:
    """Reject what a campaign would reject: sampled too slowly, too short, still moving at its end, unlike its speed.

    Its end comes before ``unlike``, the problem of its change of velocity: what ends too early has not lost its speed.
    """
    record, speed_mps = case.record, case.speed_mps
    after = (pulse.time_s >= 0) & (pulse.time_s <= _LONGEST_S)
    motion = kinematics(pulse.accel_mps2[after], speed_mps, pulse.dt_s)
    sentences = _end_steps(record, float(pulse.time_s[-1]), motion, case.role)
    if unlike is not None:
        raise DataError(unlike)
    low, high = STOPS[case.role]
    taken = (speed_mps - motion.velocity_mps.min()) / max(speed_mps, 1e-9)
    if case.is_moving and not low <= taken <= high:
        template = "a change of velocity near the impact speed of {} from contact on"
        found, advice = f"{100 * taken:.0f} % of it", crash_advice(record, "time zero, unit and channels")
        raise DataError(Problem(record.source, Sentence(template, speed(speed_mps)), found, advice))
    case.steps.extend(sentences)
