"""Turning a record into a campaign pulse: condition, channels, unit, sign, time zero, filter, cut; each step is told.

Unit and sign need the impact speed; the filter needs the whole record, also before contact.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from crashfuse.cae_library import RunQuality
from crashfuse.campaign_folder.condition_tables import Role, listed
from crashfuse.campaign_folder.plausibility import CREEP_MPS, LONG_ENOUGH, MOVING, STOPS, WHICH_AXLE
from crashfuse.campaign_folder.pulse_files import SHORTEST_S, advice_if_short, rate_trouble
from crashfuse.condition import About, Condition
from crashfuse.errors import DataError, Problem, UsageError, collecting, refusal, refuse_if
from crashfuse.importing import detection
from crashfuse.importing.channels import agreeing_channels, average, measurement_problems, missing_choices
from crashfuse.importing.detection import Case, Choices, UnknownUnit
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, speed, weight
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Kinematics, Pulse, kinematics
from crashfuse.signals.wall import Wall
from crashfuse.units import MS, G, Sentence, number, time_text

_FASTEST_MPS = 100.0
_LIGHTEST_KG, _HEAVIEST_KG, _LIGHTEST_AXLE_KG = 300.0, 60_000.0, 50.0
_LEAST_SHARE, _MOST_SHARE = 0.2, 0.8  # of the mass on the front axle
_GIVE_EACH = "give a table of conditions (--conditions TABLE)"
_GIVE_SPEED = "give the speed (--speed-kph V, --speed-mph V)"
_GIVE_WEIGHTS = "give two (--mass-kg, --front-weight-kg, --rear-weight-kg, --front-share)"
_LONGER = {
    "tests": "export the whole record; check time zero",
    "cae": "run it to 100 ms, and copy all files; check time zero",
}
_LONGEST_S, _LEAST = 0.2, "at least 60 ms from contact"


@dataclass(frozen=True, slots=True)
class Lacking(Problem):
    """What a record's condition lacks."""

    quantity: str = ""
    record_id: str = ""


def complete_condition(
    record: Record, choices: Choices, steps: list[str], *, role: Role, also_missing: Sequence[Problem] = ()
) -> Condition:
    """The condition of a record with the user's values; a DataError says what lacks, ``also_missing`` too."""
    given, of_front = choices.stated, choices.front_share
    if of_front is not None and not _LEAST_SHARE <= of_front <= _MOST_SHARE:
        raise UsageError(f"The front axle carries a share of 0.2 to 0.8, not {of_front:.4g} ({100 * of_front:.4g} %).")
    if choices.condition != PartialCondition():
        steps.append("Of the condition, what the user gave overrules the file.")
    if contradiction := given.contradiction():
        raise UsageError(Sentence("The given weights do not add up: {}; leave one out.", contradiction))
    weights, overruled = record.condition.weights_by(given), record.condition.overruled(given)
    contradiction, advice = weights.contradiction(), f"correct the file, or {_GIVE_WEIGHTS}"
    refuse_if(contradiction, record.source, f"weights of {record.id} that add up", contradiction, advice)
    front, rear = weights.axles()
    speed_mps, share, mass_kg = overruled.speed_mps, weights.front_share, weights.mass_kg
    stated = replace(weights, speed_mps=speed_mps)
    problems = [*missing_values(record.source, record.id, stated, record.no_speed), *also_missing]
    problems += [*_speed_problems(record, speed_mps, role), *_weights_problems(record, weights)]
    if problems or speed_mps is None or front is None or rear is None:
        raise DataError(problems)
    if share is not None and mass_kg is not None:
        steps.append(Sentence(f"Front weight {{}}: {100 * share:.4g} % of {{}}.", weight(front), weight(mass_kg)))
    return Condition.of_vector([float(speed_mps), float(front), float(rear)], overruled.factors)


def missing_values(source: str, record_id: str, stated: PartialCondition, no_speed: str = "") -> list[Lacking]:
    """What a condition lacks: the speed, and the weights on both axles."""

    def lacking(quantity: str, found: str, advice: str) -> Lacking:
        return Lacking(source, f"{quantity} of {record_id}", found, advice, quantity=quantity, record_id=record_id)

    speed = lacking("the impact speed", no_speed or "none", _GIVE_SPEED)
    weights = lacking("the weights on both axles", stated.stated, _GIVE_WEIGHTS)
    return [*[speed] * (stated.speed_mps is None), *[weights] * (None in stated.axles())]


def joint_problems(problems: Sequence[Problem]) -> list[Problem]:
    """The problems of several records, with what their conditions lack told once."""
    alike: dict[tuple[str, str], list[Lacking]] = {}
    joint, others = list[Problem](), list[Problem]()
    for problem in problems:
        if isinstance(problem, Lacking):
            alike.setdefault((problem.quantity, problem.found), []).append(problem)
        else:
            others.append(problem)
    for (quantity, found), several in alike.items():
        where = " to ".join(dict.fromkeys((several[0].where, several[-1].where)))
        joint.append(Problem(where, f"{quantity} of {listed([one.record_id for one in several])}", found, _GIVE_EACH))
    return joint + others


def _speed_problems(record: Record, speed_mps: float | None, role: Role) -> list[Problem]:
    if speed_mps is None or 0 < speed_mps <= _FASTEST_MPS or (speed_mps == 0 and role == "cae"):
        return []
    expected = Sentence("an impact speed of {} above 0, and at most {}", record.id, speed(_FASTEST_MPS, form=".0f"))
    found = Sentence("{}", speed(speed_mps, form=".4g"))
    return [Problem(record.source, expected, found, "check the speed and its unit")]


def _weights_problems(record: Record, weights: PartialCondition) -> list[Problem]:
    axles = [axle for axle in weights.axles() if axle is not None]
    mass = sum(axles) if len(axles) > 1 else weights.mass_kg
    expected, wrong = "", 0.0
    if mass is not None and not _LIGHTEST_KG <= mass <= _HEAVIEST_KG:
        whole = weight(_LIGHTEST_KG, _HEAVIEST_KG, between=" to ")
        expected, wrong = Sentence("a mass of {} of {}", record.id, whole), mass
    elif axles and not min(axles) >= _LIGHTEST_AXLE_KG:
        least = weight(_LIGHTEST_AXLE_KG)
        expected, wrong = Sentence("axles of {} that carry at least {}", record.id, least), min(axles)
    elif len(axles) > 1 and not _LEAST_SHARE <= (share := axles[0] / sum(axles)) <= _MOST_SHARE:
        carries = f"20 to 80 % of the mass of {record.id} in front"
        return [Problem(record.source, carries, f"{100 * share:.0f} %", WHICH_AXLE)]
    found, advice = Sentence("{}", weight(wrong, form=".4g")), "check the weights and their unit"
    return [Problem(record.source, expected, found, advice)] if expected else []


def _refuse_short(case: Case, time_s: FloatArray) -> None:
    zero_s = case.choices.time_zero_s
    earliest = 0.0 if detection.stated_zero(case.record, time_s) else float(time_s[0])
    end_s = float(time_s[-1]) - (earliest if zero_s is None else zero_s)
    is_short = 0 < end_s < SHORTEST_S - detection.step_of(time_s)
    advice = advice_if_short(float(time_s[-1] - time_s[0]), _LONGER[case.role])
    refuse_if(is_short, case.record.source, _LEAST, time_text(end_s), advice)


def _end_steps(case: Case, end_s: float, motion: Kinematics) -> list[str]:
    first, last, end = float(motion.velocity_mps[0]), float(motion.velocity_mps[-1]), time_text(end_s)
    sentences: list[str] = []
    refuse_if(end_s < SHORTEST_S - motion.dt_s, case.record.source, _LEAST, end, _LONGER[case.role])
    if end_s < GRID_S[-1] - motion.dt_s:
        moves, found = last > MOVING * first, Sentence(f"{{}} left at its end, {end}", speed(last))
        refuse_if(first > CREEP_MPS and moves, case.record.source, LONG_ENOUGH, found, _LONGER[case.role])
        last_g, better = number(motion.accel_mps2[-1] / G, "+.2g"), _LONGER[case.role].partition(";")[0]
        ends = f"Careful: the record ends {end} after contact at {last_g} g; it goes on with no acceleration, which"
        sentences.append(f"{ends} nobody measured. Better {better}.")
    if motion.t0_s <= GRID_S[-1]:
        crush = f"{motion.displacement_m.max() / MS:.0f} mm"
        return [*sentences, f"Zero velocity (TTZV) at {motion.t0_s / MS:.1f} ms, after {crush}."]
    by = min(motion.displacement_m.size - 1, round(GRID_S[-1] / motion.dt_s))
    within, moved = f"{min(end_s, GRID_S[-1]) / MS:.0f} ms", f"{motion.displacement_m[by] / MS:.0f} mm"
    left = Sentence(f"has {{}} left at {end}", speed(last))
    later = f"stops at {motion.t0_s / MS:.1f} ms" if np.isfinite(motion.t0_s) else left
    careful = f"Careful: the vehicle does not stop within {within}; it has moved {moved} by then and {{}}."
    return [*sentences, Sentence(careful, later)]


@dataclass(frozen=True, eq=False, slots=True)
class Settled:
    """A record ready to be added to a campaign."""

    id: str
    source: str
    condition: Condition
    pulse: Pulse  # from contact on, filtered and cut; or whole and raw, for the campaign to filter
    channels: tuple[str, ...]
    unit: str  # of the numbers in the file, as are the next two
    deceleration_sign: str
    time_zero_s: float
    channel_filter_class: float | None  # with which it was filtered here
    steps: tuple[str, ...]  # everything that was found and done, in order
    quality: RunQuality = field(default_factory=RunQuality)  # of a CAE run
    role: Role = "tests"
    about: About = ()
    wall: Wall | None = None

    def __repr__(self) -> str:
        return f"<Settled {self.id!r}: {self.condition}>"


def settle(record: Record, choices: Choices = Choices(), *, role: Role = "tests", raw: bool = False) -> Settled:
    """Turn a record into a pulse of the campaign; ``raw`` leaves filtering and cutting to the campaign.

    A DataError says what is lacking, or that the pulse contradicts the speed.
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
    if not record.chosen(choices.channels):
        return []
    speed_mps = record.condition.overruled(choices.condition).speed_mps
    if speed_mps is not None and _speed_problems(record, speed_mps, role):
        speed_mps = None
    problems, condition = list[Problem](), Condition.of_vector([speed_mps or 0.0, 1.0, 1.0])
    with collecting(problems):
        settled_at(record, choices, condition, role, [], raw=raw, has_speed=speed_mps is not None)
    # the unit that a speed may tell is asked for along with the speed
    return [problem for problem in problems if not (speed_mps is None and isinstance(problem, UnknownUnit))]


def settled_at(
    record: Record,
    choices: Choices,
    condition: Condition,
    role: Role,
    steps: list[str],
    *,
    raw: bool,
    has_speed: bool = True,
) -> Settled:
    """As :func:`settle`, of a known condition; without a speed a pulse is checked as far as that is possible."""
    case = Case(record, choices, role, condition.speed_mps if has_speed else math.nan, steps)
    channels = agreeing_channels(case)
    time_s, values = average(case, channels)
    if slow := rate_trouble(detection.step_of(time_s), float(time_s[-1] - time_s[0])):
        raise refusal(record.source, *slow)
    _refuse_short(case, time_s)
    unit, sign = detection.unit_and_sign(case, channels, time_s, values)
    accel = values * ACCELERATION_UNITS[unit] * (1 if sign == "negative" else -1)
    zero_s = detection.time_zero(case, time_s, accel)
    detection.report_offset(time_s, accel, zero_s, steps)
    unlike = detection.change_problem(case, time_s, accel, unit)
    if raw:
        before = detection.filtered_before(channels, time_s, accel)
        again = f"Careful: {before}; the campaign filters it again."
        steps.append(again if before else "Raw: the campaign filters it by its channel_filter_class.")
    cfc = None if raw else detection.filter_class(case, channels, time_s, accel)
    if cfc is not None:
        try:
            accel = cfc_filter(accel, cfc=cfc, dt_s=detection.step_of(time_s))
        except DataError as error:
            raise DataError([replace(problem, where=record.source) for problem in error.problems]) from None
        steps.append(f"Filtered with CFC {cfc:g}, the whole record, before it was cut.")
    pulse = _cut(time_s - zero_s, accel, raw=raw, filtered=cfc is not None)
    _check(case, pulse, unlike)
    names = tuple(channel.name for channel in channels)
    quality = record.quality if role == "cae" else RunQuality()
    about = record.about_with(channels if role == "tests" else ())
    wall: Wall | None = None
    problems: list[Problem] = []
    with collecting(problems):
        wall = None if record.wall is None else record.wall.from_contact(zero_s)
    steps += [f"Careful: the force of the barrier is left out: {problem.found}." for problem in problems[:1]]
    done = unit, sign, zero_s, cfc, tuple(steps)
    return Settled(record.id, record.source, condition, pulse, names, *done, quality, role, about, wall)


def _cut(time_s: FloatArray, accel: FloatArray, *, raw: bool, filtered: bool) -> Pulse:
    """To 200 ms from contact, at its own rate (at most 12.5 kHz if filtered); if raw, all of it."""
    if raw:
        return Pulse(time_s, accel)
    step = max(detection.step_of(time_s), DT_S) if filtered else detection.step_of(time_s)
    grid = step * np.arange(max(int(np.floor(min(time_s[-1], _LONGEST_S) / step + 1e-6)) + 1, 2))
    return Pulse(grid, np.interp(grid, time_s, accel))


def _check(case: Case, pulse: Pulse, unlike: Problem | None) -> None:
    record, speed_mps = case.record, case.speed_mps
    after = (pulse.time_s >= 0) & (pulse.time_s <= _LONGEST_S)
    motion = kinematics(pulse.accel_mps2[after], speed_mps, pulse.dt_s)
    sentences = _end_steps(case, float(pulse.time_s[-1]), motion)
    if unlike is not None:
        raise DataError(unlike)
    low, high = STOPS[case.role]
    taken = (speed_mps - motion.velocity_mps.min()) / max(speed_mps, 1e-9)
    expected = Sentence(f"{detection.NEAR_SPEED} from contact on", speed(speed_mps))
    is_other, advice = not low <= taken <= high, detection.crash_advice(record, "time zero, unit and channels")
    refuse_if(case.is_moving and is_other, record.source, expected, f"{100 * taken:.0f} % of it", advice)
    case.steps.extend(sentences)
