"""Turning a record into a campaign pulse: channels, unit, sign, time zero, filter; every step reported and overridable.

The order matters: detecting unit and sign needs the impact speed, the filter needs the whole record including the part
before contact, and only then is the record cut to the crash.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.campaign_folder.plausibility import CREEP_MPS, STOPS
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, collecting
from crashfuse.importing.channels import agreeing_channels, averaged, missing_choices, unmeasured
from crashfuse.importing.choices import Choices
from crashfuse.importing.condition import complete_condition, speed_trouble
from crashfuse.importing.detection import (
    UnknownUnit,
    change_trouble,
    doubts,
    filter_class,
    filtered_before,
    offset_before,
    step_of,
    time_zero,
    unit_and_sign,
)
from crashfuse.importing.duration import end_told, refuse_short, refuse_slow
from crashfuse.readers.quantities import speed
from crashfuse.readers.record import Record
from crashfuse.readers.unit_spelling import ACCELERATION_UNITS
from crashfuse.run_quality import RunQuality
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, FloatArray, Pulse, kinematics
from crashfuse.wording import Sentence

_LONGEST_S = 0.2


@dataclass(frozen=True, eq=False, slots=True)
class Settled:
    """A record ready to be added to a campaign.

    Parameters
    ----------
    pulse : Pulse
        Deceleration negative, m/s², time 0 at first contact; filtered and cut, or whole and raw if the campaign's own
        ``channel_filter_class`` is to filter it.
    unit : str
        Unit of the numbers in the file.
    deceleration_sign : str
        Whether the file writes deceleration as negative or as positive numbers.
    time_zero_s : float
        Time of first contact in the file's own time.
    channel_filter_class : float or None
        Class the record was filtered with here; None if it was not.
    steps : tuple of str
        Everything that was found and done, in order.
    quality : RunQuality
        What the solver says of a CAE run; nothing of a test.
    role : {"tests", "cae"}
        What it is.
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

    Parameters
    ----------
    role : {"tests", "cae"}
        A CAE run starts at contact unless its time says otherwise, and may stop early or late.
    raw : bool
        Leave filtering and cutting to the campaign's own ``channel_filter_class``.

    Raises
    ------
    DataError
        If something needed is neither in the record nor in the choices, or the pulse contradicts the speed.
    UsageError
        If a choice does not exist.
    """
    steps = list(record.steps)
    if record.other_setup and role == "tests":
        steps.append(f"Careful: not a full-frontal barrier crash, by its own account: {record.other_setup}.")
    missing = missing_choices(record, choices)
    if role == "tests":
        missing += unmeasured(record, choices)
    try:
        condition = complete_condition(
            record,
            choices.condition,
            choices.front_share,
            steps,
            role=role,
            also_missing=missing,
        )
    except DataError as error:
        raise DataError([*error.problems, *_pulse_problems(record, choices, role, raw=raw)]) from None
    return settled_at(record, choices, condition, role, steps, raw=raw)


def _pulse_problems(record: Record, choices: Choices, role: Role, *, raw: bool) -> list[Problem]:
    """What is wrong with a pulse whose condition is not complete; nobody should look for that of one to be refused."""
    if not record.chosen(choices.channels):
        return []
    speed_mps = record.condition.overruled(choices.condition).speed_mps
    if speed_mps is None or speed_trouble(record, speed_mps, role):
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
    channels = agreeing_channels(record, choices, condition.speed_mps, role, steps)
    time_s, values = averaged(record, channels, choices, steps)
    refuse_slow(record, time_s)
    refuse_short(record, time_s, values, choices, channels[0].unit, condition.speed_mps, role)
    unit, sign = unit_and_sign(record, channels, time_s, values, condition.speed_mps, choices, role, steps)
    accel = values * ACCELERATION_UNITS[unit] * (1 if sign == "negative" else -1)
    zero_s = time_zero(record, time_s, accel, condition.speed_mps, choices, role, steps)
    offset_before(time_s, accel, zero_s, steps)
    unlike = change_trouble(record, time_s, accel, unit, condition.speed_mps, role)
    if raw:
        before = filtered_before(channels, time_s, accel)
        again = f"Careful: {before}; the campaign filters it again."
        steps.append(again if before else "Raw: the campaign filters it with its own channel_filter_class.")
    cfc = None if raw else filter_class(channels, time_s, accel, choices, steps)
    if cfc is not None:
        accel = _filtered(record, accel, cfc, step_of(time_s), steps)
    pulse = _cut(time_s - zero_s, accel, raw=raw, filtered=cfc is not None)
    _check(record, pulse, condition.speed_mps, unlike, role, steps)
    names = tuple(channel.name for channel in channels)
    quality = record.quality if role == "cae" else RunQuality()
    told = tuple(steps)
    return Settled(record.id, record.source, condition, pulse, names, unit, sign, zero_s, cfc, told, quality, role)


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


def _check(
    record: Record, pulse: Pulse, speed_mps: float, unlike: Problem | None, role: Role, steps: list[str]
) -> None:
    """Reject what a campaign would reject: sampled too slowly, too short, still moving at its end, unlike its speed.

    Its end comes before ``unlike``, the problem of its change of velocity: what ends too early has not lost its speed.
    """
    after = (pulse.time_s >= 0) & (pulse.time_s <= _LONGEST_S)
    motion = kinematics(pulse.accel_mps2[after], speed_mps, pulse.dt_s)
    told = end_told(record, float(pulse.time_s[-1]), motion, role)
    if unlike is not None:
        raise DataError(unlike)
    low, high = STOPS[role]
    taken = (speed_mps - motion.velocity_mps.min()) / max(speed_mps, 1e-9)
    if speed_mps > CREEP_MPS and not low <= taken <= high:
        template = "a change of velocity near the impact speed of {} from contact on"
        found, advice = f"{100 * taken:.0f} % of it", doubts(record, "time zero, unit and channels")
        raise DataError(Problem(record.source, Sentence(template, speed(speed_mps)), found, advice))
    steps += told
