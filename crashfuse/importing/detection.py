"""Detection from a record itself: unit and sign (from the impact speed), time zero, earlier filtering."""

from dataclasses import dataclass

import numpy as np

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.campaign_folder.gap import LEAST_M, gap_s
from crashfuse.campaign_folder.plausibility import CREEP_MPS, STOPS
from crashfuse.errors import DataError, Problem
from crashfuse.importing.choices import Choices
from crashfuse.readers.quantities import speed
from crashfuse.readers.record import Record, RecordedChannel
from crashfuse.readers.unit_spelling import ACCELERATION_UNITS
from crashfuse.signals.filters import CFC60_NOISE, noise_share
from crashfuse.signals.onset import free_travel_s, onset
from crashfuse.signals.pulse import FloatArray, kinematics
from crashfuse.units import MS, G
from crashfuse.wording import Sentence, number, signed, time_text

_NO_SIGN = "let the record tell its sign (remove --deceleration-sign)"
_DEFAULT_CFC = 60.0
_CFC60_HZ = 110.0  # a low pass at or below this leaves nothing for CFC 60 (100 Hz) to remove
_BAND_HZ, _HIGH_SHARE = 250.0, 1e-3  # measured: CFC 60 2e-5…6e-5, CFC 100 2e-3, CFC 180 2e-2
_AROUND_PEAK_S = 0.15
_AT_ONCE_S, _SUSPICIOUS_S = 5e-3, 10e-3
_QUIET_S, _SOFT_CONTACT_S, _OFFSET_MPS2 = 10e-3, 2e-3, 0.3 * G


@dataclass(frozen=True, slots=True)
class UnknownUnit(Problem):
    """A unit that neither a record nor its speed tells; other records may."""


def unit_and_sign(
    record: Record,
    channels: tuple[RecordedChannel, ...],
    time_s: FloatArray,
    values: FloatArray,
    speed_mps: float,
    choices: Choices,
    role: Role,
    steps: list[str],
) -> tuple[str, str]:
    """The unit of the numbers and the sign of deceleration; a unit is refused where only another fits the speed.

    The speed may be unknown (NaN).
    """
    gain = delta_v(time_s, values)
    moving = speed_mps > CREEP_MPS
    fitting = [name for name, factor in ACCELERATION_UNITS.items() if moving and _fits(gain * factor, speed_mps, role)]
    label = choices.unit or channels[0].unit
    if label is None:
        if len(fitting) != 1:
            expected = f"an acceleration whose unit is known ({', '.join(ACCELERATION_UNITS)})"
            check = Sentence("check the impact speed of {}, or give" if moving else "give", speed(speed_mps))
            give = Sentence("{} its unit (--unit), or convert it to one of these", check)
            raise DataError(UnknownUnit(record.source, expected, "a unit that neither file nor speed tells", give))
        label = fitting[0]
        steps.append(f"Unit {label}: the file names none, this one gives the change of velocity that the speed asks.")
    elif choices.unit:
        steps.append(f"Unit {label}, given by the user.")
    else:
        steps.append(f"Unit {label}, from {channels[0].unit_from}.")
    change = gain * ACCELERATION_UNITS[label]
    if fitting and label not in fitting:
        advice = f"check the unit: {fitting[0]} would fit (--unit)"
        raise DataError(_unlike(record, time_s, change, label, speed_mps, advice))
    found = "negative" if gain <= 0 or speed_mps <= CREEP_MPS else "positive"
    sign = choices.deceleration_sign or found
    if moving and sign != found:
        told = Sentence("a change of {}", speed(change))
        raise DataError(Problem(record.source, f"{sign} deceleration, as chosen", told, _NO_SIGN))
    turned = "kept" if sign == "negative" else "turned, so that deceleration is negative"
    steps.append(Sentence(f"Sign {turned}: the file's change of velocity is {{}}.", speed(change)))
    return label, sign


def change_trouble(
    record: Record, time_s: FloatArray, accel: FloatArray, unit: str, speed_mps: float, role: Role
) -> Problem | None:
    """The problem of a change of velocity that is unlike the impact speed, if it is and the speed is known."""
    change = delta_v(time_s, accel)
    if not speed_mps > CREEP_MPS or _fits(change, speed_mps, role):
        return None
    return _unlike(record, time_s, change, unit, speed_mps, doubts(record, "speed, unit, channels and time zero"))


def doubts(record: Record, doubtful: str) -> str:
    """Advice where the change of velocity is unlike the impact speed: the crash may be of another kind."""
    if record.other_setup:
        return f"the file calls the test {record.other_setup!r}, and only full-frontal barrier crashes can be used"
    return f"check {doubtful}; if it is no full-frontal barrier crash (but car to car, or small overlap), leave it out"


def _fits(change_mps: float, speed_mps: float, role: Role) -> bool:
    low, high = STOPS[role]
    return low <= abs(change_mps) / speed_mps <= high


def _unlike(record: Record, time_s: FloatArray, change_mps: float, unit: str, speed_mps: float, advice: str) -> Problem:
    expected = Sentence("a change of velocity near the impact speed of {}", speed(speed_mps))
    lasts = time_text(time_s[-1] - time_s[0])
    found = Sentence(f"a change of {{}} in {unit}, in {lasts}", speed(abs(change_mps)))
    return Problem(record.source, expected, found, advice)


def own_zero(record: Record, time_s: FloatArray) -> str:
    """Why contact is at 0 of the file's time, by that time alone; empty if it tells nothing."""
    begins = f"the file's time begins before 0, at {time_text(time_s[0])}" if time_s[0] < -MS else ""
    return record.own_time_zero or begins


def time_zero(
    record: Record,
    time_s: FloatArray,
    accel: FloatArray,
    speed_mps: float,
    choices: Choices,
    role: Role,
    steps: list[str],
) -> float:
    """The time of first contact in the file's own time."""
    start, end = float(time_s[0]), float(time_s[-1])
    begins = onset(time_s, accel)
    began = "never passes 0.5 g" if begins is None else f"begins at {time_text(begins.calm_s)}"
    own = own_zero(record, time_s)
    begin = 0.0 if own else start
    gap = gap_s(time_s - begin, accel, speed_mps, choices.gap_m) if role == "cae" and choices.gap_m else 0.0
    if choices.time_zero_s is not None:
        zero, why = float(choices.time_zero_s), "given by the user"
    elif gap and choices.gap_m:
        zero, why = begin + gap, f"after a gap of {number(choices.gap_m / MS, '.4g')} mm, given by the user"
    elif own:
        zero, why = 0.0, own
    elif role == "cae" or begins is None or begins.calm_s - start < _AT_ONCE_S:
        zero, why = start, "the record begins at contact"
    else:
        zero, why = begins.calm_s, "deceleration begins there"
    if not start - step_of(time_s) <= zero <= end:
        found = f"a record from {number(start / MS, '.4g')} to {time_text(end)}"
        expected = f"time zero at {time_text(zero)} ({why})"
        raise DataError(Problem(record.source, expected, found, "give the time of first contact (--time-zero-ms)"))
    steps.append(f"Time zero at {time_text(zero)} of the file: {why}; deceleration {began}.")
    if begins is not None and role == "tests" and abs(begins.calm_s - zero) > _SUSPICIOUS_S:
        steps.append("Careful: deceleration begins far from time zero; check the time of first contact.")
    if begins is not None and role == "cae" and begins.is_sudden(zero):
        after = time_s >= zero
        free_m = speed_mps * free_travel_s(time_s[after], accel[after])
        if free_m > LEAST_M:
            steps.append(
                f"Careful: the vehicle moves {free_m / MS:.0f} mm after time zero before it decelerates. Take a gap "
                f"before the barrier out (--gap-mm {(free_m + speed_mps * gap) / MS:.0f})."
            )
    return zero


def filter_class(
    channels: tuple[RecordedChannel, ...], time_s: FloatArray, accel: FloatArray, choices: Choices, steps: list[str]
) -> float | None:
    """The channel filter class to apply; None for no filter."""
    chosen = choices.channel_filter_class
    if chosen == "none":
        steps.append("Not filtered, as chosen by the user.")
        return None
    if chosen is not None:
        return float(chosen)
    if why := filtered_before(channels, time_s, accel):
        steps.append(f"Not filtered: {why}.")
        return None
    return _DEFAULT_CFC


def filtered_before(channels: tuple[RecordedChannel, ...], time_s: FloatArray, accel: FloatArray) -> str:
    """The evidence that a record has already been filtered to CFC 60 or below; empty if there is none."""
    cutoffs = [channel.cutoff_hz for channel in channels]
    if all(cutoff is not None and cutoff <= _CFC60_HZ for cutoff in cutoffs):
        return f"the file says that it has gone through {cutoffs[0]:g} Hz already"
    level = np.linspace(accel[0], accel[-1], accel.size)  # unequal ends, as of a cut pulse, are not noise
    power = np.abs(np.fft.rfft(accel - level - (accel - level).mean())) ** 2
    share = power[np.fft.rfftfreq(accel.size, step_of(time_s)) > _BAND_HZ].sum() / max(power.sum(), 1e-300)
    noise = noise_share(accel, dt_s=step_of(time_s))
    if share < _HIGH_SHARE and noise < CFC60_NOISE:
        return f"above 400 Hz it holds {100 * noise:.1g} % of its peak, as after CFC 60"
    return ""


def offset_before(time_s: FloatArray, accel: FloatArray, zero_s: float, steps: list[str]) -> None:
    """Report the mean reading before contact, if the record starts early enough; it should be 0."""
    before = time_s < zero_s - _SOFT_CONTACT_S
    if zero_s - time_s[0] < _QUIET_S - step_of(time_s) or not before.any():
        return
    mean = float(accel[before].mean())
    told = f"before contact it reads {signed(mean / G, 2)} g on average"
    if abs(mean) > _OFFSET_MPS2:
        steps.append(f"Careful: {told}; if the vehicle did not brake then, export it with its zero corrected.")
    else:
        steps.append(f"Zero kept: {told}.")


def delta_v(time_s: FloatArray, values: FloatArray) -> float:
    """The largest change of velocity around the peak, signed, in the unit of the values times seconds."""
    velocity = kinematics(around_peak(time_s, values)[1], 0.0, step_of(time_s)).velocity_mps
    return float(velocity[np.abs(velocity).argmax()])


def around_peak(time_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The part of a record within 150 ms of its largest value."""
    near = np.abs(time_s - time_s[np.abs(values).argmax()]) <= _AROUND_PEAK_S
    return time_s[near], values[near]


def step_of(time_s: FloatArray) -> float:
    """The time step of even sampling."""
    return float((time_s[-1] - time_s[0]) / (time_s.size - 1))
