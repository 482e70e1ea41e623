"""A record as stored in a file (time, acceleration and their rows), and checks of its time axis."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from crashfuse.errors import Problem
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.units import MS
from crashfuse.wording import number, time_text

UNEVEN = 0.02
"""Allowed unevenness as a share of a time step: what rounding the times to a few digits can cause."""
SLOWEST_S = 1e-3 * (1 + UNEVEN)
"""Longest time step of a record."""
SHORTEST_S = 60e-3
"""Shortest record from contact: the longest rated window by default."""
_NO_CRASH_S, _AN_INSTANT_S = 10.0, 1e-3  # 60 ms and more taken for seconds; a second and less taken for ms


@dataclass(frozen=True, eq=False, slots=True)
class RecordedPulse:
    """The samples of a record as stored in a file, and the file's row of each; all of shape (n,).

    ``time_column`` is the name of the column of the times.
    """

    time_s: FloatArray
    accel_mps2: FloatArray
    rows: npt.NDArray[np.integer[Any]]
    time_column: str

    def __getitem__(self, part: slice) -> "RecordedPulse":
        return RecordedPulse(self.time_s[part], self.accel_mps2[part], self.rows[part], self.time_column)


def joined(parts: Sequence[RecordedPulse]) -> RecordedPulse:
    """Concatenate the parts of a record."""
    if len(parts) == 1:
        return parts[0]
    return RecordedPulse(
        np.concatenate([part.time_s for part in parts]),
        np.concatenate([part.accel_mps2 for part in parts]),
        np.concatenate([part.rows for part in parts]),
        parts[0].time_column,
    )


def time_trouble(record: RecordedPulse, where: str) -> Problem | None:
    """The problem that makes the time axis of a record unusable, if any."""
    time, rows, column = record.time_s, record.rows, record.time_column
    if time.size < 2:
        return Problem(where, "at least two samples", f"{time.size}", "export the whole record", column)
    steps = np.diff(time)
    if steps.min() <= 0:
        at = int(np.argmax(steps <= 0))
        found = f"{time_text(time[at + 1], 6)} after {time_text(time[at], 6)}"
        advice = "sort the rows by time" if steps[at] else "delete the duplicates, or export time with more digits"
        return Problem(where, "time that increases from row to row", found, advice, column, int(rows[at + 1]))
    step = float(np.median(steps))
    off = np.abs(steps - step)
    if off.max() > UNEVEN * step:
        at = int(off.argmax())
        found = f"a step of {time_text(steps[at])} among steps of {time_text(step)}"
        return Problem(where, "evenly sampled time", found, "resample the record", column, int(rows[at + 1]))
    if slow := rate_trouble(step, float(time[-1] - time[0])):
        return Problem(where, *slow, column)
    return None


def rate_trouble(step_s: float, lasts_s: float) -> tuple[str, str, str] | None:
    """What was expected, what was found and what to do, if a record is sampled too slowly."""
    if step_s <= SLOWEST_S:
        return None
    if lasts_s > _NO_CRASH_S:
        advice = "check the unit of time: if it is ms, name it time_ms"
        return "the record of a crash, of about 100 ms", f"one of {lasts_s:.4g} s", advice
    return "at least 1000 samples a second", f"{1 / step_s:.0f} Hz", "export at a higher rate"


def advice_if_short(lasts_s: float, otherwise: str) -> str:
    """What to do about a record that is too short."""
    return "check the unit of time: if it is s, name it time_s" if lasts_s < _AN_INSTANT_S else otherwise


def ends_early(time_s: FloatArray) -> bool:
    """Whether an evenly sampled record ends before the study grid does."""
    return bool(time_s[-1] < GRID_S[-1] - (time_s[-1] - time_s[0]) / (time_s.size - 1))


def cover_trouble(record: RecordedPulse, where: str) -> Problem | None:
    """The problem of a record that misses too much of the study grid, if it does."""
    time_s = record.time_s
    step = time_s[1] - time_s[0]
    if time_s[0] <= step and time_s[-1] >= SHORTEST_S - step:
        return None
    found = f"{number(time_s[0] / MS, '.4g')} to {time_text(time_s[-1])}"
    advice = advice_if_short(time_s[-1] - time_s[0], "export the whole record, with time zero at first contact")
    return Problem(where, "a record from 0 to at least 60 ms (100 ms is best)", found, advice, record.time_column)
