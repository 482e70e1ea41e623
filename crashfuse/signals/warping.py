"""Dynamic time warping of many curves onto one, within a band around the diagonal (ISO/TS 18571, magnitude score)."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from crashfuse.signals.pulse import FloatArray

Path = tuple[npt.NDArray[np.int_], npt.NDArray[np.int_]]
"""Indices into the comparison and into the reference, step by step from (0, 0) to the last samples."""


def warping_paths(comparisons: FloatArray, reference: FloatArray, *, band: float) -> Iterator[Path]:
    """Warp each curve, shape (n_curves, L), onto the reference along the path of least squared differences.

    The path stays within |i − j| ≤ ceil(band · L) − 1. Steps are (1, 0), (0, 1) and (1, 1) of equal weight; ties
    are broken in this order.
    """
    costs = _costs(reference, comparisons, band)
    for curve in range(len(comparisons)):
        yield _path(costs, curve)


def _costs(reference: FloatArray, comparisons: FloatArray, band: float) -> FloatArray:
    """Least sum of squared differences from (0, 0) to each cell (i, j) of the band |i − j| ≤ r, i counting C, j T.

    The cells of one anti-diagonal depend only on the two before it, so each is one step for all cells and curves.
    Row i + j + 1 holds a diagonal, column k of it the cell i − j = 2 (k − h), one less where i + j is odd; what lies
    outside the band or the curves is infinite, and so is row 0. Shape (2 L, 2 h + 2, n_curves).
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


def _path(cost: FloatArray, curve: int) -> Path:
    """Trace the cheapest path back from the last cell; ties go to (i−1, j), then (i, j−1), then (i−1, j−1)."""
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
