"""The channels of a record that are averaged into the pulse: those chosen, or those proposed that agree."""

import shlex
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.campaign_folder.plausibility import CREEP_MPS
from crashfuse.errors import DataError, Problem, printable
from crashfuse.importing.choices import Choices
from crashfuse.importing.detection import around_peak, delta_v, own_zero
from crashfuse.importing.sampling import even, on_one_clock
from crashfuse.readers.credibility import Doubt
from crashfuse.readers.quantities import speed
from crashfuse.readers.record import Record, RecordedChannel
from crashfuse.readers.unit_spelling import ACCELERATION_UNITS
from crashfuse.signals.onset import smoothed
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.sensor_faults import confirmed, sensor_faults
from crashfuse.units import G
from crashfuse.wording import Sentence, joined, number, time_text

# Redundant sensors of one car, left and right too, differ by 2 % in ΔV, 0.2 ms in time and 12 % in shape.
_DISSENT = 0.2  # of the larger ΔV of two
_LAG_S = 2e-3
_SHAPE = 0.4  # sine of the angle between two signals: RMS of what one lacks of the other, over its RMS
_CARE = 0.45  # of these limits
_STEP_S = 1e-4
_ONSET = 0.05  # of the peak


def missing_choices(record: Record, choices: Choices) -> list[Problem]:
    """Missing choices about the channels: which ones, and their unit if there is no speed to infer it from."""
    chosen = record.chosen(choices.channels)
    missing = []
    if not chosen:
        expected = f"a channel of {record.id} that is known to be the vehicle's pulse"
        option = f"(--channel {shlex.quote(record.channels[0].name)})"
        advice = f"choose the one that is, or several to be averaged {option}"
        if all(channel.doubt == Doubt.FAILED or channel.is_simulated for channel in record.channels):
            expected = f"a sound channel of {record.id}"
            advice = f"get a sound one, or choose one that is not as bad {option}"
        missing.append(Problem(record.source, expected, record.listed, advice))
    speeds = (record.condition.speed_mps, choices.condition.speed_mps)
    if choices.unit is None and speeds == (None, None) and not any(one.unit for one in chosen or record.channels):
        expected = f"the unit of the acceleration of {record.id}"
        missing.append(Problem(record.source, expected, "none", "give the unit if the speed does not tell it (--unit)"))
    return missing


def unmeasured(record: Record, choices: Choices) -> list[Problem]:
    """The problem of a test whose channels, as the file says of itself, nobody measured."""
    simulated = [channel for channel in record.chosen(choices.channels) if channel.is_simulated]
    if not simulated:
        return []
    found = ", ".join(f"{channel.name} ({channel.remark})" for channel in simulated)
    advice = "import it as a CAE run (--as cae; beside tests --cae FILE), or correct the file if it was measured"
    return [Problem(record.source, f"measured channels of {record.id}", f"by its own account {found}", advice)]


def agreeing_channels(
    record: Record, choices: Choices, speed_mps: float, role: Role, steps: list[str]
) -> tuple[RecordedChannel, ...]:
    """The channels to average: those chosen, else the largest group of proposed channels that agree.

    They agree in their change of velocity, those of a test in time and in shape, too: in a CAE run all nodes have one
    clock. Where they agree only just, that is told with care.

    Raises
    ------
    DataError
        If no more than half of the proposed channels agree.
    """
    chosen = record.chosen(choices.channels)
    if choices.channels:
        steps.append(f"Channels chosen by the user: {', '.join(channel.name for channel in chosen)}.")
        if remarks := [f"{channel.name} ({channel.remark})" for channel in chosen if channel.remark]:
            steps.append(f"Careful: the file speaks against what was chosen: {', '.join(remarks)}.")
    else:
        chosen = _usable(record, chosen, steps)
    chosen = _in_one_unit(chosen, choices)
    if role == "tests":
        chosen = _sound(record, chosen, choices, steps)
    units = {choices.unit or channel.unit for channel in chosen}
    if len(chosen) == 1 or len(units) > 1 or speed_mps <= CREEP_MPS:
        return chosen
    signals = [_Signal.of(channel, record.source) for channel in chosen]
    agree = np.eye(len(signals), dtype=bool)
    for (i, one), (j, other) in combinations(enumerate(signals), 2):
        unlike = one.changes_unlike(other) if role == "cae" else bool(one.differences(other))
        agree[i, j] = agree[j, i] = not unlike
    most = int(agree.sum(axis=1).argmax())
    near = agree[most]
    majority, on_time = near.sum() * 2 > len(chosen), bool(own_zero(record, even(chosen[0], record.source)[0]))
    reference = signals[most]
    if on_time and not majority:
        reference = min(signals, key=lambda signal: abs(signal.onset_s))
    factor = ACCELERATION_UNITS.get(units.pop() or "")
    texts = [signal.compared(reference, factor) for signal in signals]
    careful = "Careful: the channels that are averaged differ, {}."
    if choices.channels and not near.all():
        steps.append(Sentence(careful, joined(texts, "; ")))
        return chosen
    if not majority:
        expected = f"channels of {record.id} that agree in time, shape and change of velocity"
        likely = f", likely {reference.name}, the closest to time zero" if on_time else ""
        advice = f"choose one{likely} (--channel {shlex.quote(reference.name)})"
        raise DataError(Problem(record.source, expected, joined(texts, "; "), advice))
    if not near.all():
        odd = joined([text for text, agrees in zip(texts, near, strict=True) if not agrees], "; ")
        steps.append(Sentence("Careful: left out, unlike the others: {}.", odd))
    alike = [signal for signal, agrees in zip(signals, near, strict=True) if agrees]
    if any(signal.differences(reference, _CARE) for signal in alike):
        steps.append(Sentence(careful, joined([signal.compared(reference, factor) for signal in alike], "; ")))
    return tuple(channel for channel, agrees in zip(chosen, near, strict=True) if agrees)


def _usable(record: Record, proposed: tuple[RecordedChannel, ...], steps: list[str]) -> tuple[RecordedChannel, ...]:
    """The proposed channels without those that cannot be read as a signal, unless none can."""
    problems: dict[str, Problem] = {}
    for channel in proposed:
        try:
            even(channel, record.source)
        except DataError as error:
            problems[channel.name] = error.problems[0]
    if not 0 < len(problems) < len(proposed):
        return proposed
    faults = "; ".join(f"{name}, with {one.found} instead of {one.expected}" for name, one in problems.items())
    steps.append(f"Careful: left out as unusable: {faults}.")
    return tuple(channel for channel in proposed if channel.name not in problems)


def _in_one_unit(channels: tuple[RecordedChannel, ...], choices: Choices) -> tuple[RecordedChannel, ...]:
    """The channels in the unit of the first, if all state one and the user gives none."""
    factors = [ACCELERATION_UNITS[channel.unit] for channel in channels if channel.unit]
    if choices.unit is not None or len(factors) < len(channels):
        return channels
    return tuple(
        replace(channel, values=channel.values * (factor / factors[0]), unit=channels[0].unit)
        for channel, factor in zip(channels, factors, strict=True)
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Signal:
    """A channel around its peak at CFC 60 and 10 kHz, to be compared with others.

    Parameters
    ----------
    gain : float
        Change of velocity, signed, in the channel's unit times seconds.
    """

    name: str
    gain: float
    time_s: FloatArray
    values: FloatArray

    @classmethod
    def of(cls, channel: RecordedChannel, source: str) -> "_Signal":
        time_s, values, _ = even(channel, source)
        near_s, near = around_peak(time_s, smoothed(time_s, values))
        grid = np.arange(near_s[0], near_s[-1], _STEP_S)
        return cls(channel.name, delta_v(time_s, values), grid, np.interp(grid, near_s, near))

    @property
    def onset_s(self) -> float:
        """When a twentieth of the peak is first reached."""
        size = np.abs(self.values)
        return float(self.time_s[int(np.argmax(size >= _ONSET * size.max()))])

    def changes_unlike(self, other: "_Signal", share: float = 1.0) -> bool:
        """Whether their changes of velocity differ by more than this share of the limit."""
        return abs(self.gain - other.gain) > share * _DISSENT * max(abs(self.gain), abs(other.gain))

    def differences(self, other: "_Signal", share: float = 1.0) -> list[str]:
        """In what it differs from another by more than this share of the limits; in words, but for ΔV."""
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
        """Its change of velocity (an integral without a factor to m/s²), and in what it differs from a reference."""
        integral = f"integral {number(self.gain, '.4g')} (unit not stated)"
        change = integral if factor is None else speed(self.gain * factor)
        differ = [] if self is reference else self.differences(reference, _CARE)
        return Sentence("{}: {}{}", self.name, change, "".join(f", {text}" for text in differ if text))


def _sound(
    record: Record, channels: tuple[RecordedChannel, ...], choices: Choices, steps: list[str]
) -> tuple[RecordedChannel, ...]:
    """The channels whose sensors did not fail; all of them if they were chosen or none is sound, which is told."""
    signals = {channel.name: even(channel, record.source)[:2] for channel in channels}
    failures: dict[str, Sentence] = {}
    for channel in channels:
        time_s, values = signals[channel.name]
        factor = ACCELERATION_UNITS.get(choices.unit or channel.unit or "", G)
        others = [np.interp(time_s, *signals[other.name]) for other in channels if other is not channel]
        expected = np.mean(others, axis=0) if others else values
        faults = confirmed(sensor_faults(time_s, values * factor), time_s, values * factor, expected * factor)
        if faults:
            clauses = joined([fault.text for fault in faults], "; ")
            failures[channel.name] = Sentence("{}: {}", printable(channel.name), clauses)
    sound = tuple(channel for channel in channels if channel.name not in failures)
    if failures and sound and not choices.channels:
        steps.append(Sentence("Left out, as a sensor failed: {}.", joined([*failures.values()], "; ")))
        return sound
    steps += [Sentence("Careful: {}; leave the test out, or mend its record.", each) for each in failures.values()]
    return channels


def averaged(
    record: Record, channels: tuple[RecordedChannel, ...], choices: Choices, steps: list[str]
) -> tuple[FloatArray, FloatArray]:
    """The time and the mean of the channels, in the unit of the first."""
    if choices.unit is None and len({channel.unit for channel in channels}) > 1:
        found = ", ".join(f"{channel.name} in {channel.unit or 'an unknown one'}" for channel in channels)
        advice = f"choose one (--channel {shlex.quote(channels[0].name)})"
        raise DataError(Problem(record.source, "channels of one unit to average", found, advice))
    time_s, values = on_one_clock(channels, record.source, steps)
    if len(channels) > 1:
        steps.append(f"{len(channels)} channels averaged.")
    return time_s, values.mean(axis=0)
