"""Rating of the match between two pulses: the objective rating metric of ISO/TS 18571, edition 2024.

Four scores from 0 to 1 on two curves at 10 kHz, the reference T (the test) and the comparison C. Corridor: how much of
C lies in a tube around T. Phase: how little C has to be shifted in time to correlate best with T. Magnitude: how close
C is to T once both are shifted and warped in time. Slope: how close their derivatives are once shifted.

The overall rating is 0.4 corridor + 0.2 phase + 0.2 magnitude + 0.2 slope. No intermediate result is rounded.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from crashfuse.errors import UsageError, printable, refuse_if, require_number, several
from crashfuse.signals.pulse import FloatArray, Pulse, numbers, require_step

STANDARD = "ISO/TS 18571:2024"
"""The edition: weights, corridors and grades as in 2014, and the window of the warping fixed at 10 %."""
RATING_DT_S = 1e-4
SHORTEST_WINDOW_S = 0.01
USUAL_WINDOW_MS = 60.0
GRADES = ((0.94, "Excellent"), (0.80, "Good"), (0.58, "Fair"))
"""Grades with the overall rating that each must exceed; anything lower is Poor."""
WEIGHTS = {"corridor": 0.4, "phase": 0.2, "magnitude": 0.2, "slope": 0.2}
"""Weight of each of the four scores in the overall rating."""
INNER_CORRIDOR, OUTER_CORRIDOR = 0.05, 0.5
"""Half widths of the corridors, as shares of the largest |T|."""
MAX_SHIFT = 0.2
"""Largest shift tried, as a share of the samples."""
WARP_BAND = 0.1
"""Half width of the band of the time warping, as a share of the overlap."""

_MAGNITUDE_LIMIT, _SLOPE_LIMIT = 0.5, 2.0  # relative errors from which the score is 0
WarpingPath = tuple[npt.NDArray[np.int_], npt.NDArray[np.int_]]
"""Indices into the comparison and into the reference, step by step from (0, 0) to the last samples."""

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
    """What a rating rests on beside its window: standard, rate, channel filter class."""
    return f"{STANDARD}, {1e-3 / RATING_DT_S:g} kHz, {filter_class}"


def grade(overall: float) -> str:
    """Excellent > 0.94, Good > 0.80, Fair > 0.58, else Poor."""
    return next((name for limit, name in GRADES if overall > limit), "Poor")


def graded(overall: float) -> str:
    """Rating and grade: ``0.871 Good``."""
    return f"{rating_text(overall)} {grade(overall)}"


def rating_text(overall: float) -> str:
    """A rating to three digits, or four beside a limit of its grade."""
    return f"{overall:.{3 if grade(round(overall, 3)) == grade(overall) else 4}f}"


def rate_iso18571(
    reference: FloatArray | Pulse,
    comparison: FloatArray | Pulse,
    window_ms: float | None = None,
    *,
    dt_s: float | None = None,
) -> Rating:
    """Rate a comparison curve against a reference curve.

    Parameters
    ----------
    reference, comparison : Pulse, or ndarray, shape (n,)
        Two pulses on any time grids, or two curves in the same unit, sampled at the same times from contact on.
    window_ms : float, optional
        The rating is over [0, window_ms); by default 60 ms of pulses, and the whole of arrays.
    dt_s : float, optional
        Time step of arrays in s. Steps other than 0.1 ms are interpolated linearly to 0.1 ms.

    Raises
    ------
    DataError, UsageError
        If the reference is flat, a value is NaN or beyond 1e100, lengths differ, the window is under 10 ms or beyond a
        record, the step can only be in ms, or a pulse is to be rated against an array.

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
    """The two curves that :func:`rate_iso18571` rates."""
    if isinstance(reference, Pulse) and isinstance(comparison, Pulse):
        if dt_s is not None:
            raise UsageError("A pulse has its times: leave out dt_s.")
        return rated_curves(reference, comparison, USUAL_WINDOW_MS if window_ms is None else window_ms)
    if isinstance(reference, Pulse) or isinstance(comparison, Pulse):
        raise UsageError("A pulse is rated against a pulse, an array against an array with a step, dt_s.")
    if dt_s is None:
        raise UsageError("Arrays take their time step in s, such as dt_s=8e-5.")
    reference, comparison = numbers("reference", reference), numbers("comparison", comparison)
    _check(reference, comparison[None], dt_s)
    if window_ms is None:
        return _at_10_khz(reference, dt_s), _at_10_khz(comparison, dt_s)
    time_s = np.arange(reference.size) * dt_s
    return rated_curves(Pulse(time_s, reference), Pulse(time_s, comparison), window_ms)


def rate_many(reference: FloatArray, comparisons: FloatArray, *, dt_s: float) -> list[Rating]:
    """Rate many comparison curves, shape (n_curves, n), a few times as fast as :func:`rate_iso18571`."""
    reference, comparisons = np.asarray(reference, dtype=np.float64), np.asarray(comparisons, dtype=np.float64)
    _check(reference, comparisons, dt_s)
    reference, comparisons = _at_10_khz(reference, dt_s), _at_10_khz(comparisons, dt_s)
    found = f"{reference[0]:g} throughout"
    refuse_if(np.ptp(reference) == 0, "reference", "a curve that varies", found, "choose another signal")
    return _rate(reference, comparisons)


class Ratings(dict[float, Rating]):
    """Ratings of two pulses by the end of their window in ms."""

    def __missing__(self, window_ms: object) -> Rating:
        rated, asked = ", ".join(f"{window:g}" for window in self), printable(repr(window_ms), 20)
        raise UsageError(f"Ratings are by the end of their window in ms: {rated}, not {asked}.")


def rate_windows(reference: Pulse, comparison: Pulse, windows_ms: Iterable[float]) -> Ratings:
    """Rate two pulses, on any time grids, over the windows [0, w); raises as :func:`rate_iso18571`."""
    windows = cast(tuple[float, ...], several(windows_ms))
    for end_ms in windows:
        require_number("A window in ms", end_ms)
    return Ratings({float(end_ms): rate_iso18571(reference, comparison, window_ms=end_ms) for end_ms in windows})


def rated_curves(reference: Pulse, comparison: Pulse, window_ms: float) -> tuple[FloatArray, FloatArray]:
    """The two curves that are rated over [0, window_ms), at 10 kHz; raises as :func:`rate_windows`."""
    require_number("window_ms", window_ms)
    curves = []
    for name, pulse in (("reference", reference), ("comparison", comparison)):
        begin, end = pulse.time_s[0], pulse.time_s[-1] + pulse.dt_s
        fits = begin <= 1e-9 and window_ms / 1e3 - 1e-9 <= end  # written so that NaN is rejected too
        expected, found = f"a record over 0–{window_ms:g} ms", f"{begin * 1e3:g}–{end * 1e3:g} ms"
        refuse_if(not fits, name, expected, found, "choose a window inside the record")
        time_s = np.arange(max(round(window_ms / 1e3 / RATING_DT_S), 0)) * RATING_DT_S
        curves.append(np.interp(time_s, pulse.time_s, pulse.accel_mps2))
    return curves[0], curves[1]


def _check(reference: FloatArray, comparisons: FloatArray, dt_s: float) -> None:
    shape, expected = " × ".join(map(str, reference.shape)), "a curve, an array of one dimension"
    found = f"one of {shape} numbers" if shape else "a single number"
    refuse_if(reference.ndim != 1, "reference", expected, found, "choose one channel")
    differ = comparisons.ndim != 2 or comparisons.shape[-1] != reference.size
    found = " × ".join(map(str, comparisons.shape[1:])) or "a single number"
    refuse_if(differ, "comparison", f"the reference's {shape} samples", found, "cut both curves to the same window")
    for name, values in (("reference", reference), ("comparison", comparisons)):
        unfit = np.argwhere(~(np.abs(values) < _LARGEST))
        found = f"{values[tuple(unfit[0])]:g} at sample {unfit[0, -1]}" if unfit.size else ""
        refuse_if(found, name, "finite numbers", found, "mend the record")
    require_step(dt_s, reference.size)
    length_s = reference.size * dt_s
    is_short = not length_s > SHORTEST_WINDOW_S - 1e-9
    refuse_if(is_short, "window", "at least 10 ms", f"{length_s * 1e3:g} ms", "rate a longer window")


def _at_10_khz(curves: FloatArray, dt_s: float) -> FloatArray:
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
    return [Rating(o, c, p, m, s, grade(o)) for o, c, p, m, s in np.column_stack([overall, *parts]).tolist()]


def corridor_score(reference: FloatArray, comparisons: FloatArray) -> FloatArray:
    """Mean of the :func:`corridor_values` over time, shape (n_curves,)."""
    return np.asarray(corridor_values(reference, comparisons).mean(axis=-1))


def corridor_values(reference: FloatArray, comparisons: FloatArray) -> FloatArray:
    """1 inside the inner corridor, 0 outside the outer one, a parabola in between."""
    norm = np.abs(reference).max()
    inner, outer = INNER_CORRIDOR * norm, OUTER_CORRIDOR * norm
    return np.asarray(np.clip((outer - np.abs(comparisons - reference)) / (outer - inner), 0.0, 1.0) ** 2)


def overlap(reference: FloatArray, comparisons: FloatArray, shift: int) -> tuple[FloatArray, FloatArray]:
    """The overlap when the comparison moves left by ``shift`` samples."""
    if shift >= 0:
        return reference[: reference.size - shift], comparisons[..., shift:]
    return reference[-shift:], comparisons[..., :shift]


def best_shifts(reference: FloatArray, comparisons: FloatArray) -> npt.NDArray[np.int_]:
    """Each curve's shift of best correlation, shape (n_curves,): the first of equals, 0 first, then 1, −1, 2, −2, ….

    All come from one Fourier transform; the few that its rounding errors leave undecided, from the standard's formula.
    """
    largest = math.floor(MAX_SHIFT * reference.size)
    shifts = np.array([0, *(side * m for m in range(1, largest + 1) for side in (1, -1))])
    rho, error = _correlations(reference, comparisons, shifts)
    possible = rho + error >= (rho - error).max(axis=1, keepdims=True)
    best: npt.NDArray[np.int_] = shifts[possible.argmax(axis=1)]
    for curve in np.flatnonzero(possible.sum(axis=1) > 1):
        candidates = shifts[possible[curve]]
        exact = [_correlation(*overlap(reference, comparisons[curve], shift)) for shift in candidates]
        best[curve] = candidates[np.argmax(exact)]
    best[(comparisons == reference).all(axis=1)] = 0  # a correlation of 1, which rounding might hide
    return best


def _correlations(
    reference: FloatArray, comparisons: FloatArray, shifts: npt.NDArray[np.int_]
) -> tuple[FloatArray, FloatArray]:
    """Pearson correlation on every overlap, and a bound on its rounding error, both shape (n_curves, n_shifts)."""
    n = reference.size
    t = reference - reference.mean()
    c = comparisons - comparisons.mean(axis=1, keepdims=True)
    n_fft = 2 ** (n + int(shifts.max())).bit_length()
    cross = np.fft.irfft(np.fft.rfft(t, n_fft).conj() * np.fft.rfft(c, n_fft), n_fft)[:, shifts % n_fft]

    left, right = np.maximum(shifts, 0), np.maximum(-shifts, 0)
    length = n - left - right
    sum_t, sum_c = _sums(t, right, n - left), _sums(c, left, n - right)
    square_t = _sums(t**2, right, n - left) - sum_t**2 / length
    square_c = _sums(c**2, left, n - right) - sum_c**2 / length
    with np.errstate(divide="ignore", invalid="ignore"):
        rho = (cross - sum_t * sum_c / length) / np.sqrt(square_t * square_c)
        error = 1e-12 * ((t**2).sum() / square_t + (c**2).sum(axis=1, keepdims=True) / square_c)
    undefined = ~((square_t > 0) & (square_c > 0))
    rho[undefined], error[undefined] = 0.0, np.inf
    return rho, error


def _sums(values: FloatArray, start: npt.NDArray[np.int_], stop: npt.NDArray[np.int_]) -> FloatArray:
    running = np.zeros((*values.shape[:-1], values.shape[-1] + 1))
    np.cumsum(values, axis=-1, out=running[..., 1:])
    return np.asarray(running.take(stop, axis=-1) - running.take(start, axis=-1))


def _correlation(t: FloatArray, c: FloatArray) -> float:
    if np.ptp(t) == 0 or np.ptp(c) == 0:
        return -math.inf  # undefined: never better than another
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.nan_to_num(np.corrcoef(t, c)[0, 1], nan=-math.inf))


def magnitude_score(reference: FloatArray, comparisons: FloatArray) -> FloatArray:
    """Score of the relative difference along the dynamic time warping path, shape (n_curves,)."""
    error = np.empty(len(comparisons))
    for curve, (i, j) in enumerate(warping_paths(comparisons, reference, band=WARP_BAND)):
        error[curve] = np.abs(comparisons[curve][i] - reference[j]).sum() / np.abs(reference[j]).sum()
    return np.maximum((_MAGNITUDE_LIMIT - error) / _MAGNITUDE_LIMIT, 0.0)


def slope_score(reference: FloatArray, comparisons: FloatArray) -> FloatArray:
    """Score of the relative difference of the smoothed derivatives, shape (n_curves,)."""
    t, c = smooth_slope(reference), smooth_slope(comparisons)
    difference, norm = np.abs(c - t).sum(axis=-1), np.abs(t).sum()
    error = difference / norm if norm > 0 else np.where(difference > 0, np.inf, 0.0)
    return np.maximum((_SLOPE_LIMIT - error) / _SLOPE_LIMIT, 0.0)


def smooth_slope(curves: FloatArray) -> FloatArray:
    """Central differences per sample, then a mean of 9 points; near the ends, of as many as fit: 1, 3, 5, 7."""
    middle = np.arange(curves.shape[-1])
    reach = np.minimum(np.minimum(middle, middle[::-1]), 4)
    return np.asarray(_sums(np.gradient(curves, axis=-1), middle - reach, middle + reach + 1) / (2 * reach + 1))


def warping_paths(comparisons: FloatArray, reference: FloatArray, *, band: float) -> Iterator[WarpingPath]:
    """Warp each curve, shape (n_curves, L), onto the reference along the path of least squared differences.

    The path stays within |i − j| ≤ ceil(band · L) − 1; ties go to (1, 0), then (0, 1), then (1, 1).
    """
    costs = _costs(reference, comparisons, band)
    for curve in range(len(comparisons)):
        yield _path(costs, curve)


def _costs(reference: FloatArray, comparisons: FloatArray, band: float) -> FloatArray:
    """Least sum of squared differences from (0, 0) to each cell (i, j) of the band |i − j| ≤ r, i counting C, j T.

    The cells of one anti-diagonal depend only on the two before it. Row i + j + 1 holds a diagonal, column k of it the
    cell i − j = 2 (k − h), one less where i + j is odd; what lies outside, and row 0, is infinite. Shape (2 L, 2 h + 2,
    n_curves).
    """
    length, n_curves = reference.size, len(comparisons)
    r = math.ceil(band * length) - 1
    h = (r + 1) // 2
    width = 2 * h + 2
    cost = np.empty((2 * length, width, n_curves))
    odd, even = cost[0::2], cost[1::2]
    c = np.pad(comparisons.T, ((h, h + 1), (0, 0)), constant_values=np.inf)
    t = np.pad(reference, (h + 1, h), constant_values=-np.inf)
    c_rows = np.lib.stride_tricks.sliding_window_view(c, width, axis=0).transpose(0, 2, 1)
    t_rows = np.lib.stride_tricks.sliding_window_view(t, width)[:, ::-1, None]
    np.subtract(c_rows, t_rows, out=even)
    np.subtract(c_rows[:-1], t_rows[1:], out=odd[1:])
    np.square(cost[1:], out=cost[1:])
    odd[0] = even[:, -1] = odd[:, [0, -1]] = np.inf
    if r % 2:
        even[:, [0, -2]] = np.inf

    odd, even = odd.reshape(length, -1), even.reshape(length, -1)  # views: the next column is n_curves further on
    head, tail = slice(None, -n_curves), slice(n_curves, None)
    least = np.empty_like(odd[0, tail])
    minimum, add = np.minimum, np.add  # the overhead of each call dominates here
    for before, even_head, even_tail, odd_head, odd_tail, next_even in zip(
        odd[:-1, tail], even[:-1, head], even[:-1, tail], odd[1:, head], odd[1:, tail], even[1:, head], strict=True
    ):
        minimum(even_head, even_tail, out=least)
        minimum(least, before, out=least)
        add(odd_tail, least, out=odd_tail)
        minimum(odd_head, odd_tail, out=least)
        minimum(least, even_head, out=least)
        add(next_even, least, out=next_even)
    return cost


def _path(cost: FloatArray, curve: int) -> WarpingPath:
    n_rows, width, n_curves = cost.shape
    row = width * n_curves
    flat: Any = memoryview(cost.reshape(-1))  # type: ignore[arg-type]
    start = row + (width // 2 - 1) * n_curves + curve
    cell = start + (n_rows - 2) * row
    is_odd = False
    path = [cell]
    while cell != start:
        up = cell - row - (n_curves if is_odd else 0)
        left, both = up + n_curves, cell - 2 * row
        cost_up, cost_left, cost_both = flat[up], flat[left], flat[both]
        if cost_up <= cost_left and cost_up <= cost_both:
            cell, is_odd = up, not is_odd
        elif cost_left <= cost_both:
            cell, is_odd = left, not is_odd
        else:
            cell = both
        path.append(cell)
    diagonal, column = np.divmod(np.array(path) // n_curves - width, width)
    i = diagonal // 2 + column - (width // 2 - 1)
    return i, diagonal - i
