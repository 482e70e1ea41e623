"""Even, common sampling for the channels of a record."""

import shlex
from collections.abc import Sequence

import numpy as np

from crashfuse.campaign_folder.recorded_pulse import UNEVEN
from crashfuse.errors import DataError, Problem
from crashfuse.readers.record import RecordedChannel
from crashfuse.signals.pulse import FloatArray
from crashfuse.wording import time_text

_LATEST_S = 1e9  # no clock counts farther
_STRONGEST = 1e12  # in any unit; squares of more overflow in the end
_GAP = 3.0  # steps
_FEWEST = 20


def even(channel: RecordedChannel, where: str) -> tuple[FloatArray, FloatArray, str]:
    """Return time and values of a channel at even sampling, and a sentence if that took more than rounding.

    Samples without a value are cut at either end; within the record they are rejected, as are gaps in time.
    """
    place = f"{where}, {channel.name}"
    time, values = np.asarray(channel.time_s, dtype=np.float64), np.asarray(channel.values, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(values))
    if time.shape != values.shape or known.size < _FEWEST:
        raise DataError(Problem(place, f"at least {_FEWEST} samples", f"{known.size}", "export the whole record"))
    inside = slice(known[0], known[-1] + 1)
    time, values = time[inside], values[inside]
    if not (np.isfinite(values).all() and np.isfinite(time).all()):
        raise DataError(Problem(place, "a number in each sample", "samples without one", "repair the record"))
    if (latest := float(np.abs(time).max())) > _LATEST_S:
        raise DataError(Problem(place, "times of a crash", f"{latest:.3g} s", "repair the record"))
    if (strongest := float(np.abs(values).max())) > _STRONGEST:
        raise DataError(Problem(place, "accelerations of a crash", f"{strongest:.3g}", "repair the record"))
    steps = np.diff(time)
    if steps.min() <= 0:
        raise DataError(_backwards(place, time, steps))
    step = float(np.median(steps))
    if steps.max() > _GAP * step:
        found = f"a step of {time_text(steps.max())} among steps of {time_text(step)}"
        raise DataError(Problem(place, "evenly sampled time", found, "export the record without gaps"))
    clock = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)
    if clock.size == time.size and np.abs(steps - step).max() <= UNEVEN * step:
        return clock, values, ""
    lost = np.rint(steps / step).astype(int) - 1
    told = f"{channel.name} was sampled unevenly and is interpolated to {1 / step:.0f} Hz."
    if lost.any() and np.abs(steps - (lost + 1) * step).max() <= UNEVEN * step:
        first_s = time[int(np.argmax(lost > 0))]
        lacking = f"{channel.name} lacks {lost.sum()} of {clock.size} samples, the first after {time_text(first_s, 6)}"
        told = f"Careful: {lacking}; they are interpolated."
    return clock, np.interp(clock, time, values), told


def _backwards(place: str, time: FloatArray, steps: FloatArray) -> Problem:
    """What is wrong with times that do not increase: they run back, or the same one is there twice."""
    expected = "time that increases from sample to sample"
    if steps.min() < 0:
        sample = int(np.argmax(steps < 0)) + 1
        found = f"{time_text(time[sample], 6)} after {time_text(time[sample - 1], 6)}"
        return Problem(place, expected, found, "sort the record by time")
    twice = int(np.argmax(steps == 0))
    found = f"duplicate times: {time_text(time[twice], 6)} in samples {twice + 1} and {twice + 2}"
    count = int((steps == 0).sum())
    found += f", and {count - 1} more" if count > 1 else ""
    return Problem(place, expected, found, "delete the duplicates, or export time with more digits")


def on_one_clock(channels: Sequence[RecordedChannel], where: str, steps: list[str]) -> tuple[FloatArray, FloatArray]:
    """Return the time that the channels have in common, and their values then, shape (n_channels, n).

    Channels whose samples lie between those of the first are interpolated. A DataError names a channel that is
    unusable, or of another rate or time than the first.
    """
    evens = [even(channel, where) for channel in channels]
    steps.extend(told for *_, told in evens if told)
    times = [time for time, *_ in evens]
    first, step = times[0], times[0][1] - times[0][0]
    tolerance = UNEVEN * step
    begin, end = max(time[0] for time in times) - tolerance, min(time[-1] for time in times) + tolerance
    clock = first[(first >= begin) & (first <= end)]
    for channel, time in zip(channels, times, strict=True):
        if abs(time[1] - time[0] - step) > tolerance or clock.size < _FEWEST:
            found = f"{channel.name} at {1 / (time[1] - time[0]):.6g} Hz from {time_text(time[0], 6)}"
            found += f", {channels[0].name} at {1 / step:.6g} Hz from {time_text(first[0], 6)}"
            advice = f"choose one (--channel {shlex.quote(channels[0].name)})"
            raise DataError(Problem(where, "channels sampled alike to average", found, advice))
    if any(abs(time[0] - first[0]) > tolerance for time in times):
        starts = ", ".join(
            f"{one.name} from {time_text(time[0], 6)}" for one, time in zip(channels, times, strict=True)
        )
        steps.append(f"Recorded over different times, {starts}; averaged where all were recorded.")
    steps.append(f"Recorded at {(clock.size - 1) / (clock[-1] - clock[0]):.6g} Hz from {time_text(clock[0], 6)}.")
    return clock, np.array([_at(clock, time, values, tolerance) for time, values, _ in evens])


def _at(clock: FloatArray, time: FloatArray, values: FloatArray, tolerance: float) -> FloatArray:
    """Values at the times of a clock: as they are if they were sampled then, else interpolated."""
    start = int(np.searchsorted(time, clock[0] - tolerance))
    same = time[start : start + clock.size]
    if same.size == clock.size and np.abs(same - clock).max() <= tolerance:
        return values[start : start + clock.size]
    return np.interp(clock, time, values)
