"""Even, common sampling for the channels of a record."""

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
    """Return the common time of the channels, as long as the shortest, and their values, shape (n_channels, n).

    A DataError names a channel that is unusable or not sampled like the others.
    """
    evens = [even(channel, where) for channel in channels]
    steps.extend(told for *_, told in evens if told)
    first = evens[0][0]
    tolerance = UNEVEN * (first[1] - first[0])
    size = min(time.size for time, *_ in evens)
    for channel, (time, *_) in zip(channels, evens, strict=True):
        if abs(time[0] - first[0]) > tolerance or abs(time[size - 1] - first[size - 1]) > tolerance:
            found = f"{channel.name} on a clock of its own"
            raise DataError(Problem(where, "channels sampled alike to average", found, "choose some of them"))
    steps.append(f"Recorded at {(first.size - 1) / (first[-1] - first[0]):.6g} Hz from {time_text(first[0], 6)}.")
    return first[:size], np.array([values[:size] for _, values, _ in evens])
