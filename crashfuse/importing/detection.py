"""What a record tells by itself (unit, sign, time zero, earlier filtering), and the user's choices that replace it."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from crashfuse import errors
from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.campaign_folder.plausibility import CREEP_MPS, LEAST_M, STOPS, gap_s
from crashfuse.errors import DataError, Problem, UsageError, one_of, printable, refuse_if, require_a
from crashfuse.readers.record import Channels, PartialCondition, Record
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, USUAL_UNITS, acceleration_unit, speed
from crashfuse.signals.filters import CFC60_NOISE, CLASSES, free_travel_s, noise_share, onset
from crashfuse.signals.pulse import FloatArray, kinematics
from crashfuse.units import MS, G, Sentence, number, signed, time_text

_GIVEN = "given by the user"
NEAR_SPEED = "a change of velocity near the impact speed of {}"

_LONGEST_GAP_M = 10.0  # at 56 km/h more than half a second
_DEFAULT_CFC = 60.0
_CFC60_HZ = 110.0  # a low pass at or below this leaves nothing for CFC 60 (100 Hz) to remove
_BAND_HZ, _HIGH_SHARE = 250.0, 1e-3  # measured: CFC 60 2e-5…6e-5, CFC 100 2e-3, CFC 180 2e-2
_AROUND_PEAK_S = 0.15
_ENDS, _LARGE, _NOT_SMALL = 50, 0.5, 0.3  # part of a curve at its ends, and how large it is there
_AT_ONCE_S, _SUSPICIOUS_S = 5e-3, 10e-3
_QUIET_S, _SOFT_CONTACT_S, _OFFSET_MPS2 = 10e-3, 2e-3, 0.3 * G


@dataclass(frozen=True, slots=True)
class Choices:
    """User settings that replace detection; None or empty means detect. A UsageError refuses what cannot be."""

    channels: tuple[str, ...] = ()  # to average, by name
    unit: str | None = None  # of the acceleration, however it is spelt
    deceleration_sign: Literal["negative", "positive"] | None = None  # how the file writes deceleration
    time_zero_s: float | None = None  # of first contact, in the file's own time
    gap_m: float | None = None  # that CAE runs move before the barrier; one that decelerates before is left as it is
    channel_filter_class: float | Literal["none"] | None = None
    condition: PartialCondition = field(default_factory=PartialCondition)
    front_share: float | None = None  # of the mass

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", errors.several(self.channels))
        if self.unit is not None:
            object.__setattr__(self, "unit", acceleration_unit(self.unit))
        if self.deceleration_sign is not None:
            one_of("sign of a deceleration", self.deceleration_sign, dict.fromkeys(("negative", "positive")))
        cfc = self.channel_filter_class
        if not (cfc is None or (isinstance(cfc, str | int | float) and cfc in ("none", *CLASSES))):
            raise UsageError(f'A channel filter class is 60, 180, 600, 1000 or "none", not {printable(repr(cfc), 20)}.')
        require_a(PartialCondition, self.condition, "crashfuse.PartialCondition()")
        for name in ("time_zero_s", "gap_m", "front_share"):
            if (value := getattr(self, name)) is not None:
                errors.require_number(name, value)
        if self.gap_m is not None and not 0 <= self.gap_m <= _LONGEST_GAP_M:
            raise UsageError(f"gap_m is from 0 to {_LONGEST_GAP_M:g} m, not {self.gap_m:g}.")

    @property
    def stated(self) -> PartialCondition:
        """The condition as far as the user gave it, with the share of the front axle."""
        return self.condition if self.front_share is None else replace(self.condition, front_share=self.front_share)


@dataclass(frozen=True, slots=True)
class UnknownUnit(Problem):
    """A unit that neither a record nor its speed tells; other records may."""


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """A record on its way to a pulse."""

    record: Record
    choices: Choices
    role: Role
    speed_mps: float  # NaN if unknown
    steps: list[str]  # so far

    @property
    def is_moving(self) -> bool:
        """Whether the vehicle is known to be faster than at a creep."""
        return self.speed_mps > CREEP_MPS

    def fits(self, change_mps: float) -> bool:
        """Whether a change of velocity is about that of a vehicle that stops from its speed."""
        low, high = STOPS[self.role]
        return low <= abs(change_mps) / self.speed_mps <= high

    def fits_in(self, unit: str, gain: float) -> bool:
        """As :meth:`fits`, of a change in this unit of acceleration times seconds."""
        return self.is_moving and self.fits(gain * ACCELERATION_UNITS[unit])

    def delta_v(self, time_s: FloatArray, values: FloatArray) -> float:
        """As the function, from the user's time zero on: before it, a run may speed up."""
        zero_s = self.choices.time_zero_s
        crash = time_s >= (-np.inf if zero_s is None else zero_s)
        return delta_v(time_s[crash], values[crash]) if crash.sum() > 1 else delta_v(time_s, values)


def unit_and_sign(case: Case, channels: Channels, time_s: FloatArray, values: FloatArray) -> tuple[str, str]:
    """The unit of the numbers and the sign of deceleration; a unit is refused where only another fits the speed."""
    choices, steps, gain = case.choices, case.steps, case.delta_v(time_s, values)
    label = choices.unit or channels[0].unit
    asked = case if label else replace(case, role="tests")  # a unit is not told by a CAE run that may be odd
    fitting = [name for name in dict.fromkeys((label or "", *USUAL_UNITS)) if name and asked.fits_in(name, gain)]
    if label is None:
        what, advice = _unlike_an_acceleration(values), "give its unit (--unit)"
        refuse_if(what, case.record.source, "an acceleration", f"{channels[0].name}, {what}", advice)
        if len(fitting) != 1:
            expected, found = f"one of {', '.join(ACCELERATION_UNITS)}", "a unit that neither file nor speed tells"
            raise DataError(UnknownUnit(case.record.source, expected, found, advice))
        label = fitting[0]
        steps.append(f"Unit {label}, by the change of velocity; the file names none.")
    else:
        steps.append(f"Unit {label}, {_GIVEN if choices.unit else f'from {channels[0].unit_from}'}.")
    change = gain * ACCELERATION_UNITS[label]
    if fitting and label not in fitting:
        raise DataError(_unlike(case, time_s, change, label, f"check the unit: {fitting[0]} would fit (--unit)"))
    found = "negative" if gain <= 0 or case.speed_mps <= CREEP_MPS else "positive"
    sign = choices.deceleration_sign or found
    other, is_other = Sentence("a change of {}", speed(change)), case.is_moving and sign != found
    expected, advice = f"{sign} deceleration, as chosen", "remove --deceleration-sign"
    refuse_if(is_other, case.record.source, expected, other, advice)
    turned = "kept" if sign == "negative" else "turned, so that deceleration is negative"
    steps.append(Sentence(f"Sign {turned}: the file's change of velocity is {{}}.", speed(change)))
    return label, sign


def _unlike_an_acceleration(values: FloatArray) -> str:
    size, n = np.abs(values).max(), max(values.size // _ENDS, 1)
    first, last = abs(values[:n].mean()), abs(values[-n:].mean())
    if first > _LARGE * size:
        return "which begins at its largest value, as a velocity does"
    return "which does not end near 0, as a displacement or velocity does" if last > _NOT_SMALL * size else ""


def change_problem(case: Case, time_s: FloatArray, accel: FloatArray, unit: str) -> Problem | None:
    """The problem of a change of velocity that is unlike the known impact speed."""
    change = case.delta_v(time_s, accel)
    if not case.is_moving or case.fits(change):
        return None
    return _unlike(case, time_s, change, unit, crash_advice(case.record, "speed, unit, channels and time zero"))


def crash_advice(record: Record, doubtful: str) -> str:
    """What to do then; the crash may be of another kind."""
    setup = f" (the file calls it {record.other_setup!r})" if record.other_setup else ""
    return f"check {doubtful}; leave out other crashes{setup}"


def _unlike(case: Case, time_s: FloatArray, change_mps: float, unit: str, advice: str) -> Problem:
    found = Sentence(f"a change of {{}} in {unit}, in {time_text(time_s[-1] - time_s[0])}", speed(abs(change_mps)))
    return Problem(case.record.source, Sentence(NEAR_SPEED, speed(case.speed_mps)), found, advice)


def stated_zero(record: Record, time_s: FloatArray) -> str:
    """Why contact is at 0 of the file's time; empty if nothing tells."""
    begins = f"the file's time begins before 0, at {time_text(time_s[0])}" if time_s[0] < -MS else ""
    return record.own_time_zero or begins


def time_zero(case: Case, time_s: FloatArray, accel: FloatArray) -> float:
    """The time of first contact in the file's own time."""
    choices, role, speed_mps, steps = case.choices, case.role, case.speed_mps, case.steps
    start, end = float(time_s[0]), float(time_s[-1])
    begins = onset(time_s, accel)
    began = "never passes 0.5 g" if begins is None else f"begins at {time_text(begins.calm_s)}"
    stated = stated_zero(case.record, time_s)
    begin = 0.0 if stated else start
    gap = gap_s(time_s - begin, accel, speed_mps, choices.gap_m) if role == "cae" and choices.gap_m else 0.0
    if choices.time_zero_s is not None:
        zero, why = float(choices.time_zero_s), _GIVEN
    elif gap and choices.gap_m:
        zero, why = begin + gap, f"after a gap of {number(choices.gap_m / MS, '.4g')} mm, given by the user"
    elif stated:
        zero, why = 0.0, stated
    elif role == "cae" or begins is None or begins.calm_s - start < _AT_ONCE_S:
        zero, why = start, "the record begins at contact"
    else:
        zero, why = begins.calm_s, "deceleration begins there"
    is_outside, found = not start - step_of(time_s) <= zero <= end, f"{number(start / MS, '.4g')} to {time_text(end)}"
    expected, advice = f"time zero at {time_text(zero)} ({why})", "give that of first contact (--time-zero-ms)"
    refuse_if(is_outside, case.record.source, expected, f"a record from {found}", advice)
    steps.append(f"Time zero at {time_text(zero)} of the file: {why}; deceleration {began}.")
    if begins is not None and role == "tests" and abs(begins.calm_s - zero) > _SUSPICIOUS_S:
        steps.append("Careful: deceleration begins far from time zero; check it.")
    if begins is not None and role == "cae" and begins.is_sudden(zero):
        after = time_s >= zero
        free_m = speed_mps * free_travel_s(time_s[after], accel[after])
        if free_m > LEAST_M:
            take = f"take out a gap (--gap-mm {(free_m + speed_mps * gap) / MS:.0f})"
            steps.append(f"Careful: the vehicle moves {free_m / MS:.0f} mm from time zero before deceleration; {take}.")
    return zero


def filter_class(case: Case, channels: Channels, time_s: FloatArray, accel: FloatArray) -> float | None:
    """The channel filter class to apply; None for no filter."""
    chosen = case.choices.channel_filter_class
    if chosen is not None and chosen != "none":
        return float(chosen)
    why = filtered_before(channels, time_s, accel) if chosen is None else "chosen by the user"
    if why:
        case.steps.append(f"Not filtered: {why}.")
    return None if why else _DEFAULT_CFC


def filtered_before(channels: Channels, time_s: FloatArray, accel: FloatArray) -> str:
    """The evidence that a record was filtered to CFC 60 or below; empty if there is none."""
    cutoffs = [channel.cutoff_hz for channel in channels]
    if all(cutoff is not None and cutoff <= _CFC60_HZ for cutoff in cutoffs):
        return f"filtered at {cutoffs[0]:g} Hz already, by the file"
    level = np.linspace(accel[0], accel[-1], accel.size)  # unequal ends, as of a cut pulse, are not noise
    power = np.abs(np.fft.rfft(accel - level - (accel - level).mean())) ** 2
    share = power[np.fft.rfftfreq(accel.size, step_of(time_s)) > _BAND_HZ].sum() / max(power.sum(), 1e-300)
    noise = noise_share(accel, dt_s=step_of(time_s))
    if share < _HIGH_SHARE and noise < CFC60_NOISE:
        return f"above 400 Hz it holds {100 * noise:.1g} % of its peak, as after CFC 60"
    return ""


def report_offset(time_s: FloatArray, accel: FloatArray, zero_s: float, steps: list[str]) -> None:
    """Report the mean reading before contact, if the record starts early enough; it should be 0."""
    before = time_s < zero_s - _SOFT_CONTACT_S
    if zero_s - time_s[0] < _QUIET_S - step_of(time_s) or not before.any():
        return
    mean = float(accel[before].mean())
    advice = "Careful: correct the zero if nothing braked" if abs(mean) > _OFFSET_MPS2 else "Zero kept"
    steps.append(f"{advice}: before contact it reads {signed(mean / G, 2)} g on average.")


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
