"""The channels of a record that are averaged into the pulse, those chosen or those that agree, and their sampling."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from crashfuse.campaign_folder.plausibility import CREEP_MPS
from crashfuse.campaign_folder.pulse_files import UNEVEN
from crashfuse.errors import Problem, collecting, printable, refusal, refuse_if
from crashfuse.importing.detection import Case, Choices, around_peak, delta_v, stated_zero
from crashfuse.readers.members import ONE_CLOCK
from crashfuse.readers.record import Channels, Record, RecordedChannel
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, Doubt, speed
from crashfuse.signals.filters import smoothed
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.sensor_faults import confirmed, sensor_faults
from crashfuse.units import G, Sentence, joined, number, time_text

_LATEST_S = 1e9  # no clock counts farther
_STRONGEST = 1e12  # in any unit; squares of more overflow in the end
_GAP = 3.0  # steps
_FEWEST = 20

# Redundant sensors of one car, left and right too, differ by 2 % in ΔV, 0.2 ms in time and 12 % in shape.
_DISSENT = 0.2  # of the larger ΔV of two
_LAG_S = 2e-3
_SHAPE = 0.4  # sine of the angle between two signals: RMS of what one lacks of the other, over its RMS
_CARE = 0.45  # of these limits
_STEP_S = 1e-4
_ONSET = 0.05  # of the peak


def resample_evenly(channel: RecordedChannel, where: str) -> tuple[FloatArray, FloatArray, str]:
    """Time and values at even sampling, and a sentence if that took more than rounding; a DataError for gaps."""
    place = f"{where}, {channel.name}"
    time, values = np.asarray(channel.time_s, dtype=np.float64), np.asarray(channel.values, dtype=np.float64)
    finite = np.flatnonzero(np.isfinite(values))
    n, is_few = finite.size, time.shape != values.shape or finite.size < _FEWEST
    refuse_if(is_few, place, f"at least {_FEWEST} samples", f"{n}", "export the whole record")
    time, values = (of[finite[0] : finite[-1] + 1] for of in (time, values))
    lacks, repair = not np.isfinite([time, values]).all(), "repair the record"
    refuse_if(lacks, place, "a number in each sample", "samples without one", repair)
    for numbers, most, what in ((time, _LATEST_S, "times in s"), (values, _STRONGEST, "accelerations")):
        largest = float(np.abs(numbers).max())
        refuse_if(largest > most, place, f"{what} of a crash", f"{largest:.3g}", repair)
    steps = np.diff(time)
    at, step = int(np.argmax(steps <= 0)), float(np.median(steps))
    found = f"{time_text(time[at + 1], 6)} in sample {at + 2}, after {time_text(time[at], 6)}"
    refuse_if(steps.min() <= 0, place, "time that increases", found, f"{ONE_CLOCK}, or more digits")
    found = f"a step of {time_text(steps.max())} among steps of {time_text(step)}"
    refuse_if(steps.max() > _GAP * step, place, "evenly sampled time", found, "export the record without gaps")
    clock = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)
    if clock.size == time.size and np.abs(steps - step).max() <= UNEVEN * step:
        return clock, values, ""
    lost = np.rint(steps / step).astype(int) - 1
    note = f"{channel.name}, sampled unevenly, is interpolated to {1 / step:.0f} Hz."
    if lost.any() and np.abs(steps - (lost + 1) * step).max() <= UNEVEN * step:
        first_s = time[int(np.argmax(lost > 0))]
        lacking = f"{channel.name} lacks {lost.sum()} of {clock.size} samples, the first after {time_text(first_s, 6)}"
        note = f"Careful: {lacking}; interpolated."
    return clock, np.interp(clock, time, values), note


def _on_one_clock(channels: Sequence[RecordedChannel], where: str, steps: list[str]) -> tuple[FloatArray, FloatArray]:
    """The time in common, and the values then, shape (n_channels, n)."""
    evens = [resample_evenly(channel, where) for channel in channels]
    steps.extend(note for *_, note in evens if note)
    times = [time for time, *_ in evens]
    first, step = times[0], times[0][1] - times[0][0]
    tolerance = UNEVEN * step
    begin, end = max(time[0] for time in times) - tolerance, min(time[-1] for time in times) + tolerance
    clock = first[(first >= begin) & (first <= end)]
    for channel, time in zip(channels, times, strict=True):
        if abs(time[1] - time[0] - step) > tolerance or clock.size < _FEWEST:
            shown = ((channels[0].name, first), (channel.name, time))
            found = ", ".join(f"{name} at {1 / (t[1] - t[0]):.6g} Hz from {time_text(t[0], 6)}" for name, t in shown)
            raise refusal(where, "channels sampled alike to average", found, _choose(channels[0]))
    if any(abs(time[0] - first[0]) > tolerance for time in times):
        starts = ", ".join(f"{one.name} from {time_text(t[0], 6)}" for one, t in zip(channels, times, strict=True))
        steps.append(f"Recorded over different times, {starts}; averaged where all were recorded.")
    steps.append(f"Recorded at {(clock.size - 1) / (clock[-1] - clock[0]):.6g} Hz from {time_text(clock[0], 6)}.")
    return clock, np.array([np.interp(clock, time, values) for time, values, _ in evens])


def _choose(channel: "RecordedChannel | _Signal", what: str = "one") -> str:
    return f"choose {what} (--channel {shlex.quote(channel.name)})"


def missing_choices(record: Record, choices: Choices) -> list[Problem]:
    """The channels, and their unit if there is no speed to infer it from."""
    chosen = record.chosen(choices.channels)
    missing = []
    if not chosen:
        is_bad = all(channel.doubt == Doubt.FAILED or channel.is_simulated for channel in record.channels)
        expected = "a sound channel of {}" if is_bad else "the channel of {} that is the vehicle's pulse"
        advice = _choose(record.channels[0], "one, or several to be averaged")
        missing.append(Problem(record.source, expected.format(record.id), record.listed, advice))
    speeds = (record.condition.speed_mps, choices.condition.speed_mps)
    if choices.unit is None and speeds == (None, None) and not any(one.unit for one in chosen or record.channels):
        expected = f"the unit of the acceleration of {record.id}"
        missing.append(Problem(record.source, expected, "none", "give it (--unit)"))
    return missing


def measurement_problems(record: Record, choices: Choices) -> list[Problem]:
    """The problem of a test whose channels, as the file says of itself, nobody measured."""
    simulated = [channel for channel in record.chosen(choices.channels) if channel.is_simulated]
    found = f"by its own account {', '.join(f'{channel.name} ({channel.remark})' for channel in simulated)}"
    problem = Problem(record.source, f"measured channels of {record.id}", found, "import it as a CAE run (--as cae)")
    return [problem] * bool(simulated)


def agreeing_channels(case: Case) -> Channels:
    """Those chosen, else most of them: alike in change of velocity, in a test also in time and shape."""
    record, choices, steps = case.record, case.choices, case.steps
    chosen = record.chosen(choices.channels)
    if choices.channels:
        steps.append(f"Channels chosen by the user: {', '.join(channel.name for channel in chosen)}.")
        if remarks := [f"{channel.name} ({channel.remark})" for channel in chosen if channel.remark]:
            steps.append(f"Careful: chosen against the file's account: {', '.join(remarks)}.")
    else:
        chosen = _usable(record, chosen, steps)
    chosen = _in_one_unit(chosen, choices)
    if case.role == "tests":
        chosen = _sound(case, chosen)
    units = {choices.unit or channel.unit for channel in chosen}
    if len(chosen) == 1 or len(units) > 1 or case.speed_mps <= CREEP_MPS:
        return chosen
    signals = [_Signal.of(channel, record.source) for channel in chosen]
    agree = np.eye(len(signals), dtype=bool)
    for (i, one), (j, other) in combinations(enumerate(signals), 2):
        unlike = one.changes_unlike(other) if case.role == "cae" else bool(one.differences(other))
        agree[i, j] = agree[j, i] = not unlike
    most = int(agree.sum(axis=1).argmax())
    near = agree[most]
    majority = near.sum() * 2 > len(chosen)
    on_time = bool(stated_zero(record, resample_evenly(chosen[0], record.source)[0]))
    reference = min(signals, key=lambda signal: abs(signal.onset_s)) if on_time and not majority else signals[most]
    factor = ACCELERATION_UNITS.get(units.pop() or "")
    texts = [signal.compared(reference, factor) for signal in signals]
    careful = "Careful: averaged channels differ, {}."
    if choices.channels and not near.all():
        steps.append(Sentence(careful, joined(texts, "; ")))
        return chosen
    if not majority:
        raise refusal(record.source, f"channels of {record.id} that agree", joined(texts, "; "), _choose(reference))
    if not near.all():
        odd = joined([text for text, agrees in zip(texts, near, strict=True) if not agrees], "; ")
        steps.append(Sentence("Careful: left out, unlike the others: {}.", odd))
    alike = [signal for signal, agrees in zip(signals, near, strict=True) if agrees]
    if any(signal.differences(reference, _CARE) for signal in alike):
        steps.append(Sentence(careful, joined([signal.compared(reference, factor) for signal in alike], "; ")))
    return tuple(channel for channel, agrees in zip(chosen, near, strict=True) if agrees)


def _usable(record: Record, proposed: Channels, steps: list[str]) -> Channels:
    problems: dict[str, list[Problem]] = {channel.name: [] for channel in proposed}
    for channel in proposed:
        with collecting(problems[channel.name]):
            resample_evenly(channel, record.source)
    usable = tuple(channel for channel in proposed if not problems[channel.name])
    if not 0 < len(usable) < len(proposed):
        return proposed
    faults = "; ".join(f"{name} ({of[0].found})" for name, of in problems.items() if of)
    steps.append(f"Careful: left out as unusable: {faults}.")
    return usable


def _in_one_unit(channels: Channels, choices: Choices) -> Channels:
    factors = [ACCELERATION_UNITS[channel.unit] for channel in channels if channel.unit]
    if choices.unit is not None or len(factors) < len(channels):
        return channels
    unit, pairs = channels[0].unit, zip(channels, factors, strict=True)
    return tuple(replace(one, values=one.values * (factor / factors[0]), unit=unit) for one, factor in pairs)


@dataclass(frozen=True, eq=False, slots=True)
class _Signal:
    """A channel around its peak at CFC 60 and 10 kHz, and its signed change of velocity."""

    name: str
    gain: float
    time_s: FloatArray
    values: FloatArray

    @classmethod
    def of(cls, channel: RecordedChannel, source: str) -> "_Signal":
        time_s, values, _ = resample_evenly(channel, source)
        near_s, near = around_peak(time_s, smoothed(time_s, values))
        grid = np.arange(near_s[0], near_s[-1], _STEP_S)
        return cls(channel.name, delta_v(time_s, values), grid, np.interp(grid, near_s, near))

    @property
    def onset_s(self) -> float:
        size = np.abs(self.values)
        return float(self.time_s[int(np.argmax(size >= _ONSET * size.max()))])

    def changes_unlike(self, other: "_Signal", share: float = 1.0) -> bool:
        return abs(self.gain - other.gain) > share * _DISSENT * max(abs(self.gain), abs(other.gain))

    def differences(self, other: "_Signal", share: float = 1.0) -> list[str]:
        if self.gain * other.gain <= 0:
            return ["of the other sign" if self.gain * other.gain else ""]
        differ = [""] if self.changes_unlike(other, share) else []
        if self.changes_unlike(other):
            return differ  # of another crash, or of none
        n = self.values.size + other.values.size
        spectrum = np.fft.rfft(self.values, n) * np.conj(np.fft.rfft(other.values, n))
        alike = np.fft.irfft(spectrum, n) / np.sqrt((self.values**2).sum() * (other.values**2).sum())
        most = int(alike.argmax())
        lag_s = (most if most < self.values.size else most - n) * _STEP_S + self.time_s[0] - other.time_s[0]
        if abs(lag_s) > share * _LAG_S:
            differ.append(f"{time_text(abs(lag_s), 3)} {'later' if lag_s > 0 else 'earlier'} than {other.name}")
        if (shape := float(np.sqrt(max(1 - alike[most] ** 2, 0.0)))) > share * _SHAPE:
            differ.append(f"{100 * shape:.0f} % off the shape of {other.name}")
        return differ

    def compared(self, reference: "_Signal", factor: float | None) -> str:
        integral = f"integral {number(self.gain, '.4g')} (unit not stated)"
        change = integral if factor is None else speed(self.gain * factor)
        differ = [] if self is reference else self.differences(reference, _CARE)
        return Sentence("{}: {}{}", self.name, change, "".join(f", {text}" for text in differ if text))


def _sound(case: Case, channels: Channels) -> Channels:
    signals = {channel.name: resample_evenly(channel, case.record.source)[:2] for channel in channels}
    failures: dict[str, Sentence] = {}
    for channel in channels:
        time_s, values = signals[channel.name]
        factor = ACCELERATION_UNITS.get(case.choices.unit or channel.unit or "", G)
        others = [np.interp(time_s, *signals[other.name]) for other in channels if other is not channel]
        accel, others = values * factor, [other * factor for other in others]
        expected = np.mean(others, axis=0) if others else accel
        if faults := confirmed(sensor_faults(time_s, accel), time_s, accel, expected, others):
            clauses = joined([fault.text for fault in faults], "; ")
            failures[channel.name] = Sentence("{}: {}", printable(channel.name), clauses)
    sound = tuple(channel for channel in channels if channel.name not in failures)
    if failures and sound and not case.choices.channels:
        case.steps.append(Sentence("Left out, as a sensor failed: {}.", joined([*failures.values()], "; ")))
        return sound
    case.steps.extend(Sentence("Careful: {}; mend its record, or leave it out.", fault) for fault in failures.values())
    return channels


def average(case: Case, channels: Channels) -> tuple[FloatArray, FloatArray]:
    """The time and the mean of the channels, in the unit of the first."""
    source = case.record.source
    if case.choices.unit is None and len({channel.unit for channel in channels}) > 1:
        found = ", ".join(f"{channel.name} in {channel.unit or 'an unknown one'}" for channel in channels)
        raise refusal(source, "channels of one unit to average", found, _choose(channels[0]))
    time_s, values = _on_one_clock(channels, source, case.steps)
    if len(channels) > 1:
        case.steps.append(f"{len(channels)} channels averaged.")
    return time_s, values.mean(axis=0)
