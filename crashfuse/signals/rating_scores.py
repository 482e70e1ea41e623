"""The scores of ISO/TS 18571 for many comparison curves against one reference, all at 10 kHz."""

import math

import numpy as np
import numpy.typing as npt

from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.warping import warping_paths

INNER_CORRIDOR, OUTER_CORRIDOR = 0.05, 0.5
"""Half widths of the corridors, as shares of the largest |T|."""

MAX_SHIFT = 0.2
"""Largest shift tried, as a share of the samples."""

WARP_BAND = 0.1
"""Half width of the band of the time warping, as a share of the overlap."""

_MAGNITUDE_LIMIT, _SLOPE_LIMIT = 0.5, 2.0  # relative errors from which the score is 0


def corridor_score(reference: FloatArray, comparisons: FloatArray) -> FloatArray:
    """Mean of the :func:`corridor_values` over time, shape (n_curves,)."""
    mean: FloatArray = corridor_values(reference, comparisons).mean(axis=-1)
    return mean


def corridor_values(reference: FloatArray, comparisons: FloatArray) -> FloatArray:
    """At each time 1 inside the inner corridor, 0 outside the outer one, and a parabola in between."""
    norm = np.abs(reference).max()
    inner, outer = INNER_CORRIDOR * norm, OUTER_CORRIDOR * norm
    distance = np.abs(comparisons - reference)
    values: FloatArray = np.clip((outer - distance) / (outer - inner), 0.0, 1.0) ** 2
    return values


def overlap(reference: FloatArray, comparisons: FloatArray, shift: int) -> tuple[FloatArray, FloatArray]:
    """The overlap of both when the comparison moves left by ``shift`` samples (right if negative)."""
    if shift >= 0:
        return reference[: reference.size - shift], comparisons[..., shift:]
    return reference[-shift:], comparisons[..., :shift]


def best_shifts(reference: FloatArray, comparisons: FloatArray) -> npt.NDArray[np.int_]:
    """Find each curve's shift of best correlation, the first of equals in the order 0, 1, −1, 2, −2 and so on.

    All correlations come from one Fourier transform, with a bound of their rounding errors; the few shifts that these
    errors leave undecided are recomputed one by one by the formula of the standard. Shape (n_curves,).
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
    """Sum ``values[..., start:stop]`` for all pairs of bounds at once."""
    running = np.zeros((*values.shape[:-1], values.shape[-1] + 1))
    np.cumsum(values, axis=-1, out=running[..., 1:])
    difference: FloatArray = running.take(stop, axis=-1) - running.take(start, axis=-1)
    return difference


def _correlation(t: FloatArray, c: FloatArray) -> float:
    if np.ptp(t) == 0 or np.ptp(c) == 0:
        return -math.inf  # undefined: never better than another
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.nan_to_num(np.corrcoef(t, c)[0, 1], nan=-math.inf))


def magnitude_score(reference: FloatArray, comparisons: FloatArray) -> FloatArray:
    """Score of the relative difference along the dynamic time warping path, shape (n_curves,)."""
    error = np.empty(len(comparisons))
    for curve, (i, j) in enumerate(warping_paths(comparisons, reference, band=WARP_BAND)):
        comparison = comparisons[curve]
        error[curve] = np.abs(comparison[i] - reference[j]).sum() / np.abs(reference[j]).sum()
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
    smooth: FloatArray = _sums(np.gradient(curves, axis=-1), middle - reach, middle + reach + 1) / (2 * reach + 1)
    return smooth
