"""Sensors that fail within a crash: saturated, held at a value, lost for milliseconds, a spike, noise from then on.

A record is looked at sample by sample, where equal samples tell, and in a band of some 200 Hz, in which CFC 60 is
undone: a dropout has its edges again, a flat top its corners. Limits stand beside what sound records reach.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter1d

from crashfuse.signals.filters import cfc_filter, cfc_gain
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MS, G, Sentence, acceleration, number

Kind = Literal["saturated", "held", "lost", "spike", "noise"]
_Fall = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]  # of the means of stretches, and of both sides

LIKELY = 0.5
"""Least strength of a fault that is worth a comparison with other records."""
_CFC = 60.0
_SLOWEST_HZ, _BAND_HZ = 2000, 1000  # least rate at which CFC 60 is undone; what is looked at of what it left
_PADDING_S = 0.02
_FILTERED = 0.25  # of the amplitude at 125–250 Hz lies at 250–500 Hz after CFC 60, at most; of noise or a jump, more
_RISE = 1.5  # of the amplitude with frequency, where nothing but rounding is left
_FLAT_BAND = 1.1  # the same at 250–400 Hz: the spectrum of an impulse is flat, that of a crash falls
_IN_CRASH = 0.1  # of the peak at CFC 60: from the first to the last such sample
_SAME = 1e-7  # of the peak, by which equal values differ in another unit
_JUMP = 0.05  # of the peak
_RUN_S, _RUN = 2e-3, 4  # of equal samples; sound: 0.6 ms
_LONGER, _LONGEST = 2, 4  # times the longest run at another value, at the extreme, and where the signal hardly leaps
_RINGS = 0.9  # of the extreme: what a filter makes of the corners of a flat top goes beyond it
_TOP, _AT_TOP = 8, 2.0  # samples at the extreme, and their ratio to those just below; sound: 0.8
_FINE, _FEWEST = 1e-4, 8  # s, a time step in the band, and samples of what is called flat
_FLAT, _FLOOR = 22.0, 0.002  # ratio of the fall on both sides to the range between, a share of the peak at least
_LOST, _ZERO = 6.0, 0.1  # the same of a gap, and its level as a share of what is around
_HELD, _HELD_FLOOR = 80.0, 5e-4  # the same on one side
_LEAP = 4.0  # the same within 0.3 ms
_SPIKE, _SPIKE_S, _SPIKE_MPS2 = 4.0, 1.6e-3, 8 * G
_BUMP, _BUMP_S = 4.5, 0.8e-3
_WIDER, _BENT, _FWHM = 1.3, 1.15, 2.355  # limits in widths of an impulse, see below; of a Gaussian at half its height
_SMOOTH_S = 0.4e-3  # of a raw record, so that noise makes no inflection
_NEAR_S, _BESIDE_S, _SHARED = 2.5e-3, 4e-3, 0.5  # of a spike, of a bump; share of a spike that is the structure's
_AROUND_S = 30e-3
_BEYOND_S, _EDGE_S = 1e-3, 4e-3
_CUT, _ODD = 1.3, 1.5  # of the level, and of the difference elsewhere; sound, with a flat top: 1.24 and 3.1
_NOISE, _NOISE_MPS2, _BLOCK_S, _LEAST_S, _STEADY = 2.2, 0.8 * G, 10e-3, 2.5e-3, 5.0
# Beside records alike, once the vehicle has left the barrier; sound: 3.1
_RIPPLE, _RIPPLE_S, _CALM_S, _QUIET = 3.5, 4e-3, 0.08, 0.3 * G


@dataclass(frozen=True, slots=True)
class SensorFault:
    """What happened to a sensor, from when to when, and its size."""

    kind: Kind
    start_s: float
    end_s: float
    size_mps2: float  # signed level, that around what is lost, signed height of a spike, or root mean square of noise
    strength: float  # from 1 on, the record alone shows it; from LIKELY on it is one if other records do not show it

    @property
    def text(self) -> str:
        """What happened, when and how much, as a clause."""
        size, start, end = acceleration(self.size_mps2), *(number(at / MS, ".1f") for at in (self.start_s, self.end_s))
        return {
            "saturated": Sentence(f"its sensor is saturated, flat at {{}} between {start} and {end} ms", size),
            "held": Sentence(f"its signal is held at {{}} from {start} to {end} ms", size),
            "lost": Sentence(f"its signal is lost from {start} to {end} ms: it drops from {{}} to zero", size),
            "spike": Sentence(f"its signal has a spike of {{}} at {start} ms", size),
            "noise": Sentence(f"its signal is noisy from {start} ms on, by {{}} (RMS)", size),
        }[self.kind]


class _Signal(NamedTuple):
    """A record at even steps, the places between which the vehicle crashes, and the peak at CFC 60 there.

    In a band an impulse is a Gaussian of standard deviation ``impulse_s``, NaN if none can be told there.
    """

    time_s: FloatArray
    accel: FloatArray
    step_s: float
    first: int
    last: int
    peak: float
    impulse_s: float = 0.0

    def fault(self, kind: Kind, first: int, last: int, size: float, strength: float) -> SensorFault:
        return SensorFault(kind, float(self.time_s[first]), float(self.time_s[last]), float(size), float(strength))

    def samples(self, lasts_s: float) -> int:
        return max(round(lasts_s / self.step_s), 1)

    def above_median(self, half_s: float) -> FloatArray:
        half = self.samples(half_s)
        windows = sliding_window_view(np.pad(self.accel, half, mode="edge"), 2 * half + 1)
        return np.asarray(self.accel - np.median(windows, axis=1))


def sensor_faults(time_s: FloatArray, accel_mps2: FloatArray) -> tuple[SensorFault, ...]:
    """What looks like a fault of the sensor in a record at its own rate, raw or filtered, in the order of time."""
    step_s = float((time_s[-1] - time_s[0]) / (time_s.size - 1))
    is_too_coarse = time_s.size * step_s < _PADDING_S or 1 / step_s < 10 * _CFC
    if is_too_coarse or (signals := _signals(time_s, accel_mps2)) is None:
        return ()
    raw, band, hidden, above = signals
    found: list[SensorFault] = []
    noise = *_noisy_end(raw), *_noise(raw, hidden), *_noise(raw, above)
    sudden = *_equal_samples(raw), *(one for one in noise if one.strength >= 1), *_lost(band), *_spike(raw, band)
    for one in (*sudden, *_flat_top(band), *_left_at_once(raw), *_held(band), *noise):
        apart = (one.start_s >= other.end_s + _EDGE_S or other.start_s >= one.end_s + _EDGE_S for other in found)
        if one.strength >= LIKELY and all(apart):  # edges of one are no other
            found.append(one)
    return tuple(sorted(found, key=lambda one: one.start_s))


def confirmed(
    faults: Sequence[SensorFault],
    time_s: FloatArray,
    accel_mps2: FloatArray,
    expected_mps2: FloatArray,
    alike_mps2: Sequence[FloatArray] = (),
) -> tuple[SensorFault, ...]:
    """The faults that a record shows alone, and of the others those that are not expected there.

    A spike that most records of about the same condition (``alike_mps2``) show, too, is none.
    """
    off = accel_mps2 - expected_mps2
    signals = cache(lambda: [_signals(time_s, accel) for accel in (accel_mps2, *alike_mps2)])

    def of_each(measure: Callable[[_Signal, FloatArray], float]) -> tuple[float, float]:
        first, *alike = (measure(one[0], one[2]) if one else 0.0 for one in signals())
        return first, float(np.median(alike)) if alike else first

    def is_odd(fault: SensorFault) -> bool:
        within = (fault.start_s - _BEYOND_S <= time_s) & (time_s <= fault.end_s + _BEYOND_S)
        if not within.any() or (within.all() and fault.kind != "noise"):
            return False
        if fault.kind == "noise":
            loud, usual = of_each(lambda _, hidden: float(np.std(hidden[within])))
            calm = of_each(lambda raw, _: _ripple(raw))
            is_noise = calm[0] > _RIPPLE * max(calm[1], _QUIET) or (fault.start_s < _CALM_S and loud > _NOISE * usual)
            # what rings from the first on may be as sound as a single other record, which was filtered
            return is_noise and (len(alike_mps2) > 1 or fault.strength > LIKELY)
        if fault.kind == "saturated" and np.abs(expected_mps2[within]).max() < _CUT * abs(fault.size_mps2):
            return False
        inside, elsewhere = (float(np.sqrt(np.mean(off[part] ** 2))) for part in (within, ~within))
        return inside > _ODD * elsewhere

    def is_shared(fault: SensorFault) -> bool:
        near = np.abs(time_s - fault.start_s) <= _EDGE_S
        if fault.kind != "spike" or not (len(alike_mps2) and near.any()):
            return False
        sign = np.sign(fault.size_mps2)
        high, usual = of_each(lambda raw, _: float((sign * raw.above_median(_NEAR_S))[near].max()))
        return usual > _SHARED * high

    certain = [fault for fault in faults if not is_shared(fault) and (fault.strength >= 1 or is_odd(fault))]
    return tuple(replace(fault, strength=max(fault.strength, 1.0)) for fault in certain)


def _signals(time_s: FloatArray, accel_mps2: FloatArray) -> tuple[_Signal, _Signal, FloatArray, FloatArray] | None:
    step_s = float((time_s[-1] - time_s[0]) / (time_s.size - 1))
    smooth = cfc_filter(accel_mps2, cfc=_CFC, dt_s=step_s)
    peak = float(np.abs(smooth).max())
    if not peak > G:
        return None
    crash = np.flatnonzero(np.abs(smooth) > _IN_CRASH * peak)
    raw = _Signal(time_s, accel_mps2, step_s, int(crash[0]), int(crash[-1]), peak)
    return raw, *_band(raw), accel_mps2 - smooth


def _band(raw: _Signal) -> tuple[_Signal, FloatArray]:
    """The record in a band without ringing, with finer steps merged, and what lies above CFC 60 in it."""
    step_s, n = raw.step_s, raw.accel.size
    padding = min(raw.samples(_PADDING_S), n - 1)
    padded = np.pad(raw.accel, padding, mode="reflect", reflect_type="odd").astype(np.float64)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(padding) / padding)
    padded[:padding] *= rise
    padded[-padding:] *= rise[::-1]
    hertz, spectrum = np.fft.rfftfreq(padded.size, step_s), np.fft.rfft(padded)

    def amplitude(of: npt.NDArray[np.complex128], low: float, high: float) -> float:
        return float(np.sqrt(np.mean(np.abs(of[(hertz >= low) & (hertz < high)]) ** 2)))

    width = 0.2 * _BAND_HZ
    fast = 1 / step_s > _SLOWEST_HZ
    undone = bool(fast and np.sqrt(2) * amplitude(spectrum, 250, 500) < _FILTERED * amplitude(spectrum, 125, 250))
    rises = False
    if undone:
        spectrum = spectrum / cfc_gain(hertz, cfc=_CFC, dt_s=step_s)
        usual, width = amplitude(spectrum, 125, 250), 160.0
        rises = amplitude(spectrum, 250, 400) > _FLAT_BAND * usual  # as no impulse does: another filter was undone
        for low, high in ((400, 630), (630, _BAND_HZ)):
            if 4 * high > 1 / step_s or amplitude(spectrum, low, high) > _RISE * usual:
                break
            width = 0.4 * high
    gain = np.exp(-0.5 * (hertz / width) ** 2)
    spectrum = np.where(gain > 1e-3, spectrum * gain, 0.0)
    accel = np.fft.irfft(spectrum, padded.size)[padding:-padding]
    every = max(round(_FINE / step_s), 1)
    hidden = accel - cfc_filter(raw.accel, cfc=_CFC, dt_s=step_s)
    if not undone:
        hidden = raw.accel - (cfc_filter(raw.accel, cfc=3 * _CFC, dt_s=step_s) if fast else raw.accel)
    first, last = raw.first // every, raw.last // every
    peak = float(np.abs(accel).max())
    impulse_s = np.nan if rises else 1 / (2 * np.pi * width)
    return _Signal(raw.time_s[::every], accel[::every], step_s * every, first, last, peak, impulse_s), hidden


def _equal_samples(raw: _Signal) -> Iterator[SensorFault]:
    accel, same = raw.accel, _SAME * raw.peak
    ends = np.flatnonzero(np.diff(np.r_[False, np.abs(np.diff(accel)) <= same, False])).reshape(-1, 2)
    ends = ends[(ends[:, 0] > 0) & (ends[:, 1] < accel.size - 1)]
    around_mps2 = np.minimum(np.abs(accel[ends[:, 0] - 1]), np.abs(accel[ends[:, 1] + 1]))
    is_in_crash = (ends[:, 1] > raw.first) & (ends[:, 0] < raw.last)
    ends = ends[is_in_crash | (around_mps2 > 0.4 * _JUMP * raw.peak)]  # what is lost at its edge cuts it short
    lengths = np.diff(ends)[:, 0]
    runs: list[tuple[int, int]] = [*map(tuple, ends[lengths >= max(raw.samples(_RUN_S), _RUN)].tolist())]

    def longest_elsewhere(level: float) -> int:
        return int(lengths[np.abs(accel[ends[:, 0]] - level) > same].max(initial=1))

    def leaves_at_once(first: int, last: int) -> bool:
        start, end = abs(accel[first - 1] - accel[first]), abs(accel[last + 1] - accel[last])
        return bool(end > max(_JUMP * raw.peak, 2 * start))

    crash = accel[raw.first : raw.last + 1]
    resolution = max(float(np.diff(np.unique(crash)).min(initial=np.inf)), same)
    for sign in (-1, 1):
        below = (sign * crash).max() - sign * crash
        top = raw.first + np.flatnonzero(below < resolution / 2)
        ratio = top.size / (1 + np.count_nonzero(below < 3.5 * resolution) - top.size)
        level = float(accel[top[0]])
        single = [run for run in runs if run[0] <= top[0] and top[-1] <= run[1]]
        held = bool(single) and leaves_at_once(*single[0])
        repeats = np.count_nonzero(np.diff(top) == 1)
        stays = top.size >= _TOP and repeats >= max(_RUN, _LONGER * longest_elsewhere(level))
        if stays and ratio >= _AT_TOP and sign * level > 3 * _IN_CRASH * raw.peak and not held:
            yield raw.fault("saturated", top[0], top[-1], level, ratio)
    for first, last in runs:
        sides = accel[max(first - 2, 0)], accel[min(last + 2, accel.size - 1)]
        level, around = float(accel[first]), float(max(sides, key=lambda value: abs(value - accel[first])))
        leaps = abs(around - level) > max(0.4 * _JUMP * raw.peak, 6 * resolution)
        lost = leaps and abs(level) < _JUMP * abs(around)
        is_long = abs(level) > _IN_CRASH * raw.peak and last - first >= _LONGEST * longest_elsewhere(level)
        is_smooth = max(abs(accel[first - 1] - level), abs(accel[last + 1] - level)) < 3 * resolution
        is_top = np.sign(level) * level > _RINGS * (np.sign(level) * crash).max()
        if is_long and is_smooth and is_top and not leaps:
            yield _saturated(raw, level, np.inf)  # and filtered after that
        elif leaps or is_long:
            yield raw.fault("lost" if lost else "held", first, last, around if lost else level, np.inf)


def _saturated(signal: _Signal, level: float, strength: float) -> SensorFault:
    flat = np.flatnonzero(np.abs(signal.accel - level) < 0.02 * abs(level))
    return signal.fault("saturated", flat[0], flat[-1], level, strength)


class _Flat(NamedTuple):
    """The flattest stretch for what is around it: its score, samples and level, and the mean distance to both sides."""

    score: float = 0.0
    first: int = 0
    length: int = 0
    level: float = 0.0
    around: float = 0.0


def _flattest(band: _Signal, lasts_ms: Sequence[float], gap_ms: float, floor: float, fall: _Fall) -> _Flat:
    """The stretch within the crash whose fall to what lies so far off on both sides is largest beside its range."""
    best = _Flat()
    for lasts in lasts_ms:
        length = band.samples(lasts * MS)
        gap = max(length // 2, band.samples(gap_ms * MS))
        first = np.arange(max(gap, band.first + 1), min(band.accel.size - length - gap, band.last - length))
        if length < _FEWEST or not first.size:
            continue
        views = sliding_window_view(band.accel, length + 1)[first]
        mean = views.mean(axis=1)
        before, after = band.accel[first - gap] - mean, band.accel[first + length + gap] - mean
        score = fall(mean, before, after) / np.maximum(np.ptp(views, axis=1), floor * band.peak)
        at = int(score.argmax())
        around = float(before[at] + after[at]) / 2
        best = max(best, _Flat(float(score[at]), int(first[at]), length, float(mean[at]), around))
    return best


def _flat_top(band: _Signal) -> Iterator[SensorFault]:
    extremes = float(band.accel.min()), float(band.accel.max())

    def fall(mean: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        sign = np.sign(mean)
        at_top = np.abs(mean) > 0.97 * np.where(sign < 0, -extremes[0], extremes[1])
        high = at_top & (np.abs(mean) > 3 * _IN_CRASH * band.peak)
        return np.asarray(high * np.minimum(-sign * before, -sign * after))

    best = _flattest(band, (3, 4, 6, 9, 14, 20, 30), 2, _FLOOR, fall)  # sound: 0.5 of the limit
    if best.score:
        level = float(band.accel[best.first : best.first + best.length + 1].mean())
        yield _saturated(band, level, best.score / _FLAT)


def _lost(band: _Signal) -> Iterator[SensorFault]:
    def fall(mean: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        around = np.minimum(np.abs(before), np.abs(after))
        gap = (np.abs(mean) < _ZERO * around) & (before * after > 0) & (around > 0.2 * band.peak)
        return np.asarray(gap * around)

    best = _flattest(band, (1.6, 2, 2.5, 3, 4), 2, 2 * _FLOOR, fall)  # sound: 0.5 of the limit
    away, end = np.abs(band.accel) > abs(best.around) / 2, best.first + best.length
    start = best.first - int(np.argmax(away[best.first :: -1]))
    yield band.fault("lost", start, end + int(np.argmax(away[end:])), best.around, best.score / _LOST)


def _held(band: _Signal) -> Iterator[SensorFault]:
    def leap(mean: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        size = np.maximum(np.abs(before), np.abs(after))
        return np.asarray(size * (size > _JUMP * band.peak) * (np.abs(mean) > _IN_CRASH * band.peak))

    best = _flattest(band, (3,), 1.5, _HELD_FLOOR, leap)  # sound: 0.8 of the limit
    yield band.fault("held", best.first, best.first + best.length, best.level, best.score / _HELD)


def _left_at_once(raw: _Signal) -> Iterator[SensorFault]:
    """The best nearly flat 3 ms that the signal leaves within two samples, as a raw one does; sound: 0.5."""
    length, leap = raw.samples(3 * MS), max(raw.samples(0.3 * MS), 2)
    first = np.arange(raw.first + 1, min(raw.last - length, raw.accel.size - length - leap))
    if not first.size or length < _FEWEST:
        return
    views = sliding_window_view(raw.accel, length + 1)[first]
    mean, ends = views.mean(axis=1), raw.accel[first + length + leap]
    jump = np.abs(ends - raw.accel[first + length])
    score = jump * (jump > _JUMP * raw.peak) / np.maximum(np.ptp(views, axis=1), _FLOOR * raw.peak)
    place = int(score.argmax())
    level, around, start = float(mean[place]), float(ends[place]), int(first[place])
    if abs(level) < _ZERO * abs(around):
        yield raw.fault("lost", start, start + length, around, score[place] / _LEAP)
    elif abs(level) > _IN_CRASH * raw.peak:
        top = abs(level) > 0.97 * float((np.sign(level) * raw.accel).max())
        yield raw.fault("saturated" if top else "held", start, start + length, level, score[place] / _LEAP)


def _spike(raw: _Signal, band: _Signal) -> Iterator[SensorFault]:
    """The highest peak above a running median, if it is an impulse and alone; sound: 0.2."""
    best = None
    for signal, half_s, lasts_s, limit, rest_s in (
        (raw, _NEAR_S, _SPIKE_S, _SPIKE, 2 * MS),
        (band, _BESIDE_S, _BUMP_S, _BUMP, 6 * MS),
    ):
        half, off = signal.samples(half_s), signal.above_median(half_s)
        crash = np.arange(off.size)
        in_crash = (crash >= signal.first - half) & (crash <= signal.last + half)
        top = int(np.argmax(np.abs(off) * in_crash))
        height = float(off[top])
        away = np.abs(crash - top)
        others = np.abs(off[(away > signal.samples(rest_s)) & (away < signal.samples(_AROUND_S))])
        score = (abs(height) / max(others.max(initial=0.0), 0.02 * raw.peak) - 1) / (limit - 1)
        is_best = best is None or score > best.strength
        if is_best and abs(height) > _SPIKE_MPS2 and _is_impulse(signal, off, top, lasts_s):
            best = signal.fault("spike", top, top, height, score)
    if best is not None:
        yield best


def _is_impulse(signal: _Signal, off: FloatArray, top: int, lasts_s: float) -> bool:
    impulse_s, smooth_s = float(np.hypot(lasts_s / _FWHM, signal.impulse_s)), 0.0 if signal.impulse_s else _SMOOTH_S
    smooth = gaussian_filter1d(signal.accel, smooth_s / signal.step_s, mode="nearest") if smooth_s else signal.accel
    bends = -np.sign(off[top]) * np.gradient(np.gradient(smooth))
    near = max(top - signal.samples(_SMOOTH_S), 0)
    sharpest = near + int(bends[near : top + signal.samples(_SMOOTH_S) + 1].argmax())
    widest_s, longest_s = _WIDER * _FWHM * impulse_s, _BENT * 2 * float(np.hypot(impulse_s, smooth_s))
    is_narrow = _run_s(np.abs(off) >= abs(off[top]) / 2, top, signal.step_s) <= widest_s
    return is_narrow and _run_s(bends > 0, sharpest, signal.step_s) <= longest_s


def _run_s(where: npt.NDArray[np.bool_], at: int, step_s: float) -> float:
    before, after = np.argmin(np.r_[where[at::-1], False]), np.argmin(np.r_[where[at:], False])
    return float(before + after - 1) * step_s


def _noise(raw: _Signal, hidden: FloatArray) -> Iterator[SensorFault]:
    """A moment in the crash from which on there is steadily more above CFC 60 than before; sound: 0.1."""
    block, half, least = raw.samples(_BLOCK_S), raw.samples(_BLOCK_S / 2), max(raw.samples(_LEAST_S), _FEWEST)
    power = np.concatenate([[0.0], np.cumsum(hidden**2)])
    rms = np.sqrt(np.maximum(power[block:] - power[:-block], 0.0) / block)
    best, starts = (0.0, 0, 0.0), range(raw.first + least, min(raw.last, rms.size - 2 * block), max(block // 16, 1))
    for start in (raw.first, *starts):  # from the first on it is but likely: records alike have to be quieter
        before, after = rms[raw.first : max(start - block + 1, 0) : half], rms[start::half]
        quiet = float(before.max()) if before.size else float(np.std(hidden[raw.first : start + 1]))
        if after.size and _NOISE_MPS2 < (loud := float(after.min())) > after.max() / _STEADY:
            score = (loud / max(quiet, _FLOOR * raw.peak) - 1) / (_NOISE - 1) if start > raw.first else LIKELY
            best = max(best, (score, start, float(np.sqrt(np.mean(after**2)))))
    yield raw.fault("noise", best[1], raw.accel.size - 1, best[2], best[0])


def _noisy_end(raw: _Signal) -> Iterator[SensorFault]:
    if (rms := _ripple(raw)) > _NOISE_MPS2:
        yield raw.fault("noise", int(np.searchsorted(raw.time_s, _CALM_S)), raw.accel.size - 1, rms, LIKELY)


def _ripple(raw: _Signal) -> float:
    """Root mean square of what is faster than some 40 Hz, from 80 to 90 or to 100 ms, the lesser."""
    off, ends = raw.accel - gaussian_filter1d(raw.accel, _RIPPLE_S / raw.step_s), _CALM_S + np.array([0, 10, 20]) * MS
    first, middle, last = np.searchsorted(raw.time_s, ends)
    return float(min(off[first:middle].std(), off[middle:last].std())) if first < middle < last else 0.0
