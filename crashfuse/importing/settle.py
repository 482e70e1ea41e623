"""Turning a record into a campaign pulse: channels, unit, sign, time zero, filter; every step reported and overridable.

The order matters: detecting unit and sign needs the impact speed, the filter needs the whole record including the part
before contact, and only then is the record cut to the crash.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.campaign_folder.plausibility import CREEP_MPS, STOPS
from crashfuse.campaign_folder.recorded_pulse import SLOWEST_S
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, UsageError, collecting
from crashfuse.importing.choices import Choices
from crashfuse.importing.condition import complete_condition
from crashfuse.importing.detection import (
    delta_v,
    filter_class,
    filtered_before,
    offset_before,
    speed_text,
    step_of,
    time_zero,
    unit_and_sign,
    unlike_speed,
)
from crashfuse.importing.duration import end_told, refuse_short
from crashfuse.importing.sampling import even, on_one_clock
from crashfuse.readers.record import ACCELERATION_UNITS, Record, RecordedChannel, quoted
from crashfuse.run_quality import RunQuality
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, FloatArray, Pulse, kinematics
from crashfuse.wording import number

_LONGEST_S = 0.2
_DISSENT = 0.2  # of the larger ΔV of two


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
    try:
        condition = complete_condition(
            record,
            choices.condition,
            choices.front_share,
            steps,
            standstill=role == "cae",
            also_missing=missing,
        )
    except DataError as error:
        speed = record.condition.overruled(choices.condition).speed_mps
        problems = list(error.problems)
        if speed is not None and not missing:  # nobody should look for weights of a pulse that will be refused
            with collecting(problems):
                settled_at(record, choices, Condition(speed, 1.0, 1.0), role, [], raw=raw)
        raise DataError(problems) from None
    return settled_at(record, choices, condition, role, steps, raw=raw)


def settled_at(
    record: Record, choices: Choices, condition: Condition, role: Role, steps: list[str], *, raw: bool
) -> Settled:
    """Settle the pulse of a record whose condition is known; otherwise as :func:`settle`."""
    channels = _channels(record, choices, condition.speed_mps, steps)
    time_s, values = _average(record, channels, choices, steps)
    refuse_short(record, time_s, values, choices.unit or channels[0].unit, condition.speed_mps, role)
    unit, sign = unit_and_sign(record, channels, time_s, values, condition.speed_mps, choices, role, steps)
    accel = values * ACCELERATION_UNITS[unit] * (1 if sign == "negative" else -1)
    zero_s = time_zero(record, time_s, accel, choices, role, steps)
    offset_before(time_s, accel, zero_s, steps)
    if raw:
        before = filtered_before(channels, time_s, accel)
        again = f"Careful: {before}; the campaign filters it again."
        steps.append(again if before else "Raw: the campaign filters it with its own channel_filter_class.")
    cfc = None if raw else filter_class(channels, time_s, accel, choices, steps)
    if cfc is not None:
        accel = _filtered(record, accel, cfc, step_of(time_s), steps)
    pulse = _cut(time_s - zero_s, accel, raw=raw, filtered=cfc is not None)
    _check(record, pulse, condition, role, steps)
    names = tuple(channel.name for channel in channels)
    quality = record.quality if role == "cae" else RunQuality()
    told = tuple(steps)
    return Settled(record.id, record.source, condition, pulse, names, unit, sign, zero_s, cfc, told, quality, role)


def missing_choices(record: Record, choices: Choices) -> list[Problem]:
    """Missing choices about the channels: which ones, and their unit if there is no speed to infer it from."""
    chosen = record.chosen(choices.channels)
    missing = []
    if not chosen:
        expected = f"a channel of {record.id} that is known to be the vehicle's pulse"
        advice = f"choose the one that is, or several to be averaged (--channel {quoted(record.channels[0].name)})"
        missing.append(Problem(record.source, expected, record.listed, advice))
    speeds = (record.condition.speed_mps, choices.condition.speed_mps)
    if choices.unit is None and speeds == (None, None) and not any(one.unit for one in chosen or record.channels):
        expected = f"the unit of the acceleration of {record.id}"
        missing.append(Problem(record.source, expected, "none", "give the unit if the speed does not tell it (--unit)"))
    return missing


def _channels(record: Record, choices: Choices, speed_mps: float, steps: list[str]) -> tuple[RecordedChannel, ...]:
    """The channels to average: those chosen, else the largest group of proposed channels whose ΔV agrees."""
    chosen = record.chosen(choices.channels)
    if choices.channels:
        steps.append(f"Channels chosen by the user: {', '.join(channel.name for channel in chosen)}.")
    units = {choices.unit or channel.unit for channel in chosen}
    if len(chosen) == 1 or len(units) > 1 or speed_mps <= CREEP_MPS:
        return chosen
    gains = np.array([delta_v(*even(channel, record.source)[:2]) for channel in chosen])
    agree = np.abs(gains[:, None] - gains) <= _DISSENT * np.maximum.outer(np.abs(gains), np.abs(gains))
    with_most = agree[agree.sum(axis=1).argmax()]
    if with_most.all():
        return chosen
    factor = ACCELERATION_UNITS.get(units.pop() or "")
    told = [
        f"{channel.name}: "
        + (f"{number(gain, '.4g')} of its unit times s" if factor is None else speed_text(gain * factor))
        for channel, gain in zip(chosen, gains.tolist(), strict=True)
    ]
    if choices.channels:
        steps.append(f"Careful: the channels that are averaged differ in their changes of velocity, {', '.join(told)}.")
        return chosen
    if with_most.sum() * 2 <= len(chosen):
        expected, found = f"channels of {record.id} that agree in their change of velocity", ", ".join(told)
        raise DataError(Problem(record.source, expected, found, "choose one (--channel)"))
    odd = ", ".join(text for text, near in zip(told, with_most, strict=True) if not near)
    steps.append(f"Left out for a change of velocity unlike the others': {odd}.")
    return tuple(channel for channel, near in zip(chosen, with_most, strict=True) if near)


def _average(
    record: Record, channels: tuple[RecordedChannel, ...], choices: Choices, steps: list[str]
) -> tuple[FloatArray, FloatArray]:
    """The time and the mean of the channels, in the unit of the first."""
    if choices.unit is not None and choices.unit not in ACCELERATION_UNITS:
        raise UsageError(f"There is no unit {choices.unit!r} of acceleration; take {', '.join(ACCELERATION_UNITS)}.")
    if choices.unit is None and len({channel.unit for channel in channels}) > 1:
        found = ", ".join(f"{channel.name} in {channel.unit or 'an unknown one'}" for channel in channels)
        raise DataError(Problem(record.source, "channels of one unit to average", found, "choose some of them"))
    time_s, values = on_one_clock(channels, record.source, steps)
    if len(channels) > 1:
        steps.append(f"{len(channels)} channels averaged.")
    return time_s, values.mean(axis=0)


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


def _check(record: Record, pulse: Pulse, condition: Condition, role: Role, steps: list[str]) -> None:
    """Reject what a campaign would reject: a record too short, sampled too slowly, or still moving at its end."""
    if pulse.dt_s > SLOWEST_S:
        found = f"{1 / pulse.dt_s:.0f} Hz"
        raise DataError(Problem(record.source, "at least 1000 samples a second", found, "export at a higher rate"))
    after = (pulse.time_s >= 0) & (pulse.time_s <= _LONGEST_S)
    motion = kinematics(pulse.accel_mps2[after], condition.speed_mps, pulse.dt_s)
    told = end_told(record, float(pulse.time_s[-1]), motion, role)
    low, high = STOPS[role]
    taken = (condition.speed_mps - motion.velocity_mps.min()) / max(condition.speed_mps, 1e-9)
    if condition.speed_mps > CREEP_MPS and not low <= taken <= high:
        expected = f"a change of velocity near the impact speed of {speed_text(condition.speed_mps)} from contact on"
        found, advice = f"{100 * taken:.0f} % of it", unlike_speed(record, "time zero, unit and channels")
        raise DataError(Problem(record.source, expected, found, advice))
    steps += told
