"""Rating of the match between two pulses: the objective rating metric of ISO/TS 18571, edition 2024.

Four scores from 0 to 1, each on two curves sampled at 10 kHz, the reference T (the test) and the comparison C:

corridor
    how much of C lies in a tube around T;
phase
    how little C has to be shifted in time to correlate best with T;
magnitude
    how close C is to T once both are shifted and warped in time;
slope
    how close their derivatives are once shifted.

The overall rating is 0.4 corridor + 0.2 phase + 0.2 magnitude + 0.2 slope. No intermediate result is rounded. What a
rating lost where is told by :mod:`crashfuse.signals.rating_explanation`.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from crashfuse.errors import DataError, Problem, UsageError, printable, require_number
from crashfuse.signals.pulse import FloatArray, Pulse, numbers, require_step
from crashfuse.signals.rating_scores import (
    MAX_SHIFT,
    WARP_BAND,
    best_shifts,
    corridor_score,
    magnitude_score,
    overlap,
    slope_score,
)

STANDARD = "ISO/TS 18571:2024"
"""The edition: weights, corridors and grades as in 2014, and the window of the warping fixed at 10 %."""
RATING_DT_S = 1e-4
SHORTEST_WINDOW_S = 0.01
USUAL_WINDOW_MS = 60.0
GRADES = ((0.94, "Excellent"), (0.80, "Good"), (0.58, "Fair"))
"""Grades with the overall rating that each must exceed; anything lower is Poor."""
WEIGHTS = {"corridor": 0.4, "phase": 0.2, "magnitude": 0.2, "slope": 0.2}
"""Weight of each of the four scores in the overall rating."""

_LARGEST = 1e100  # squares of larger values may overflow; a diverged simulation gets there
_BAND_BYTES = 64 * 2**20  # memory for the warping of one block of curves


@dataclass(frozen=True, slots=True)
class Rating:
    """The scores of ISO/TS 18571, 0 (no match) to 1 (identical), unrounded, and the grade of the overall one."""

    overall: float
    corridor: float
    phase: float
    magnitude: float
    slope: float
    grade: str

    def __repr__(self) -> str:
        parts = ", ".join(f"{part} {getattr(self, part):.3f}" for part in WEIGHTS)
        return f"<Rating {self.overall:.3f}, {self.grade}: {parts}>"


def filter_class_text(cfc: float | None) -> str:
    """A channel filter class in words, such as ``CFC 60``."""
    return "filtered as supplied" if cfc is None else f"CFC {cfc:g}"


def rating_basis(filter_class: str) -> str:
    """What a rating rests on beside its window: the standard with its edition, the rate, the channel filter class."""
    return f"{STANDARD}, {1e-3 / RATING_DT_S:g} kHz, {filter_class}"


def grade(overall: float) -> str:
    """Grade of an overall rating: Excellent > 0.94, Good > 0.80, Fair > 0.58, else Poor."""
    return next((name for limit, name in GRADES if overall > limit), "Poor")


def graded(overall: float) -> str:
    """An overall rating with its grade: ``0.871 Good``; with a digit more beside a limit, ``0.8004 Good``."""
    digits = 3 if grade(round(overall, 3)) == grade(overall) else 4
    return f"{overall:.{digits}f} {grade(overall)}"


def rate_iso18571(
    reference: FloatArray | Pulse,
    comparison: FloatArray | Pulse,
    *,
    dt_s: float | None = None,
    window_ms: float | None = None,
) -> Rating:
    """Rate a comparison curve against a reference curve.

    Parameters
    ----------
    reference, comparison : Pulse, or ndarray, shape (n,)
        Two pulses on any time grids, or two curves in the same unit, sampled at the same times from contact on.
    dt_s : float, optional
        Time step of arrays in s. Steps other than 0.1 ms are interpolated linearly to 0.1 ms.
    window_ms : float, optional
        The rating is over [0, window_ms); by default 60 ms of pulses, and the whole of arrays.

    Raises
    ------
    DataError
        If the reference is flat, a value is NaN or beyond 1e100, the lengths differ, the window is under 10 ms or
        reaches beyond a record, or the step can only be in ms.
    UsageError
        If a pulse is to be rated against an array, arrays have no step, or a pulse is given one.

    Notes
    -----
    A flat comparison has no correlation, so no shift is better than none: phase is 1, and the other scores show the
    mismatch. If several shifts correlate equally well the smallest wins, left before right; "equally" means to
    the last bit of NumPy's ``corrcoef``, as in other public implementations.
    """
    t, c = curves_at_10_khz(reference, comparison, dt_s, window_ms)
    return rate_many(t, c[None], dt_s=RATING_DT_S)[0]


def curves_at_10_khz(
    reference: FloatArray | Pulse, comparison: FloatArray | Pulse, dt_s: float | None, window_ms: float | None
) -> tuple[FloatArray, FloatArray]:
    """The two curves as :func:`rate_iso18571` rates them, which says what they may be."""
    if isinstance(reference, Pulse) and isinstance(comparison, Pulse):
        if dt_s is not None:
            raise UsageError("A pulse has its times: leave out dt_s, which is the step of arrays.")
        return rated_curves(reference, comparison, USUAL_WINDOW_MS if window_ms is None else window_ms)
    if isinstance(reference, Pulse) or isinstance(comparison, Pulse):
        raise UsageError("A pulse is rated against a pulse, and an array against an array with its step, dt_s.")
    if dt_s is None:
        raise UsageError("Arrays are rated with their time step in s, such as dt_s=8e-5.")
    reference, comparison = numbers("reference", reference), numbers("comparison", comparison)
    _check(reference, comparison[None], dt_s)
    if window_ms is None:
        return _at_10_khz(reference, dt_s), _at_10_khz(comparison, dt_s)
    time_s = np.arange(reference.size) * dt_s
    return rated_curves(Pulse(time_s, reference), Pulse(time_s, comparison), window_ms)


def rate_many(reference: FloatArray, comparisons: FloatArray, *, dt_s: float) -> list[Rating]:
    """Rate many comparison curves, shape (n_curves, n), as :func:`rate_iso18571` does each, but a few times as fast."""
    reference, comparisons = np.asarray(reference, dtype=np.float64), np.asarray(comparisons, dtype=np.float64)
    _check(reference, comparisons, dt_s)
    reference, comparisons = _at_10_khz(reference, dt_s), _at_10_khz(comparisons, dt_s)
    if np.ptp(reference) == 0:
        found = f"{reference[0]:g} throughout"
        raise DataError(Problem("reference", "a curve that varies", found, "choose another signal"))
    return _rate(reference, comparisons)


class Ratings(dict[float, Rating]):
    """Ratings of two pulses by the end of their window in ms, in the order in which they were asked for."""

    def __missing__(self, window_ms: object) -> Rating:
        """Raise a UsageError that says which windows were rated, in ms."""
        rated, asked = ", ".join(f"{window:g}" for window in self), printable(repr(window_ms), 20)
        raise UsageError(f"Ratings are by the end of their window in ms: {rated}, not {asked}.")


def rate_windows(reference: Pulse, comparison: Pulse, windows_ms: Iterable[float]) -> Ratings:
    """Rate two pulses, on any time grids, over the windows [0, w).

    Raises
    ------
    DataError
        As :func:`rate_iso18571`, or if a window reaches beyond a record.
    """
    return Ratings(
        {float(window_ms): rate_iso18571(reference, comparison, window_ms=window_ms) for window_ms in windows_ms}
    )


def rated_curves(reference: Pulse, comparison: Pulse, window_ms: float) -> tuple[FloatArray, FloatArray]:
    """The two curves that are rated over [0, window_ms), in m/s² at 10 kHz; raises as :func:`rate_windows`."""
    require_number("window_ms", window_ms)
    curves = []
    for name, pulse in (("reference", reference), ("comparison", comparison)):
        begin, end = pulse.time_s[0], pulse.time_s[-1] + pulse.dt_s
        if not (begin <= 1e-9 and window_ms / 1e3 - 1e-9 <= end):  # written so that NaN is rejected too
            found, advice = f"{begin * 1e3:g}–{end * 1e3:g} ms", "choose a window inside the record"
            raise DataError(Problem(name, f"a record over 0–{window_ms:g} ms", found, advice))
        time_s = np.arange(max(round(window_ms / 1e3 / RATING_DT_S), 0)) * RATING_DT_S
        curves.append(np.interp(time_s, pulse.time_s, pulse.accel_mps2))
    return curves[0], curves[1]


def _check(reference: FloatArray, comparisons: FloatArray, dt_s: float) -> None:
    if reference.ndim != 1 or comparisons.ndim != 2 or comparisons.shape[-1] != reference.size:
        expected = f"one value for each of the reference's {' × '.join(map(str, reference.shape))} samples"
        found = " × ".join(map(str, comparisons.shape[1:])) or "a single number"
        raise DataError(Problem("comparison", expected, found, "cut both curves to the same window"))
    for name, values in (("reference", reference), ("comparison", comparisons)):
        unfit = np.argwhere(~(np.abs(values) < _LARGEST))
        if unfit.size:
            found = f"{values[tuple(unfit[0])]:g} at sample {unfit[0, -1]}"
            raise DataError(Problem(name, "finite numbers", found, "mend the record"))
    require_step(dt_s, reference.size)
    if not reference.size * dt_s > SHORTEST_WINDOW_S - 1e-9:
        found = f"{reference.size * dt_s * 1e3:g} ms"
        raise DataError(Problem("window", "at least 10 ms", found, "rate a longer window"))


def _at_10_khz(curves: FloatArray, dt_s: float) -> FloatArray:
    """Interpolate along the last axis to 0.1 ms over [0, n dt_s)."""
    n = curves.shape[-1]
    if math.isclose(dt_s, RATING_DT_S, rel_tol=1e-9):
        return curves
    source = np.arange(n) * dt_s
    target = np.arange(math.ceil(n * dt_s / RATING_DT_S - 1e-6)) * RATING_DT_S
    rows = [np.interp(target, source, row) for row in curves.reshape(-1, n)]
    return np.array(rows).reshape(*curves.shape[:-1], target.size)


def _rate(reference: FloatArray, comparisons: FloatArray) -> list[Rating]:
    corridor = corridor_score(reference, comparisons)
    shifts = best_shifts(reference, comparisons)
    limit = MAX_SHIFT * reference.size
    phase = np.maximum((limit - np.abs(shifts)) / limit, 0.0)
    magnitude, slope = np.empty_like(corridor), np.empty_like(corridor)
    block = max(1, int(_BAND_BYTES / (8 * 2 * WARP_BAND * reference.size**2)))
    for shift in np.unique(shifts):
        alike = np.flatnonzero(shifts == shift)
        for curves in np.array_split(alike, math.ceil(alike.size / block)):
            t, c = overlap(reference, comparisons[curves], shift)
            magnitude[curves] = magnitude_score(t, c)
            slope[curves] = slope_score(t, c)
    parts = (corridor, phase, magnitude, slope)
    overall = sum(weight * part for weight, part in zip(WEIGHTS.values(), parts, strict=True))
    scores = np.column_stack([overall, *parts]).tolist()
    return [Rating(o, c, p, m, s, grade(o)) for o, c, p, m, s in scores]
