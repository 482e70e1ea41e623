"""The same record twice: pulses that are copies of each other but for a shift in time, a scale and an offset.

A copied test predicts its original almost exactly, and every number that is judged on left-out tests is then wrong.
Two crashes never give one pulse. Measured is the share of one pulse that no line through the other explains, at the
best shift: at least 4 % between repeats of simulated cars with 2 % scatter and 0.6 g of noise (8 % in the median), and
10 % between repeats in finite elements; below 1 % for copies that were shifted by 5 ms, scaled, resampled, given an
offset, filtered again with CFC 60, or rounded to 0.1 g.

CAE runs have no noise, and close to each other they are alike: those of one speed may differ in a weight that hardly
matters. Between speeds more than 2 % apart at least 1.7 % is left, above 3 m/s.
"""

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from crashfuse.campaign_folder.condition_tables import ConditionTable
from crashfuse.errors import Problem
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray

Pairs = list[tuple[int, int]]

_TESTS_DIFFER = 0.015
_RUNS_DIFFER = 0.002
_SHIFT_S = 6e-3
_COARSE, _COARSE_DIFFER = 5, 0.15  # samples averaged, and the residual, in the search for pairs worth a closer look
_ROWS_AT_ONCE = 500
_CFC = 60.0
_SLOWEST_MPS, _OTHER_SPEED = 3.0, 0.02  # slower pulses are elastic, and scale with the speed
_AROUND = np.arange(-20.0, 21.0, 2.0)  # samples of 0.8 ms around half the change of velocity
_ALIKE = 2e-3  # distance of two runs around there: copies 0.2e-3 in the median, 2e-3 at 90 %
_IDENTICAL = 1e-7
_LOOKED_AT = 2000  # pairs of runs
_NAMED = 5


def check_tests_differ(table: ConditionTable, accel: FloatArray, problems: list[Problem]) -> None:
    """Reject tests that are copies of each other.

    Parameters
    ----------
    accel : ndarray, shape (n_tests, 1250)
        On the study grid.
    """
    for one, other in copied_tests(accel):
        expected = "a record of its own for each test"
        found = f"the same record for {table.ids[one]} and {table.ids[other]}, shifted, scaled or filtered at most"
        place, advice = f"id {table.ids[other]}", "remove one of them, or give it its own record"
        problems.append(Problem("tests.csv", expected, found, advice, place, table.rows[other]))


def check_runs_differ(table: ConditionTable, accel: npt.NDArray[np.float32], warnings: list[str]) -> None:
    """Warn of CAE runs at different conditions that have one pulse; ``accel`` is of shape (n_runs, 1250)."""
    speeds = np.array([condition.speed_mps for condition in table.conditions])
    pairs = [f"{table.ids[one]} and {table.ids[other]}" for one, other in copied_runs(speeds, accel)]
    if pairs:
        more = f" and {len(pairs) - _NAMED:,} more pairs" if len(pairs) > _NAMED else ""
        warnings.append(
            f"cae.csv: the same pulse, scaled or shifted at most, for {', '.join(pairs[:_NAMED])}{more}; check that "
            "none is a copy of another run."
        )


def copied_tests(accel: FloatArray) -> Pairs:
    """Pairs of rows that are copies of each other, the lower row first."""
    return [(one, other) for one, other in _alike(accel) if _unlike_tests(accel[one], accel[other]) < _TESTS_DIFFER]


def copied_runs(speeds_mps: FloatArray, accel: npt.NDArray[np.float32]) -> Pairs:
    """Pairs of runs with the same pulse, at any condition, or with copies of it at another speed.

    A tree finds the pairs whose pulses are alike around the time at which half of the velocity is gone, so that
    100,000 runs take a second or two.
    """
    fast = np.flatnonzero(speeds_mps > _SLOWEST_MPS)
    if fast.size < 2:
        return []
    shapes = np.concatenate([_shapes(accel[fast[at : at + 4000]]) for at in range(0, fast.size, 4000)])
    found = cKDTree(_main_axes(shapes)).query_pairs(_ALIKE, output_type="ndarray")
    distances = np.linalg.norm(shapes[found[:, 0]] - shapes[found[:, 1]], axis=1)
    pairs = fast[found]
    ratio = speeds_mps[pairs[:, 0]] / speeds_mps[pairs[:, 1]]
    candidates = np.flatnonzero((np.abs(np.log(ratio)) > _OTHER_SPEED) | (distances < _IDENTICAL))
    candidates = candidates[np.argsort(distances[candidates], kind="stable")][:_LOOKED_AT]
    copies = []
    for one, other in np.sort(pairs[candidates], axis=1).tolist():
        x, y = (accel[row].astype(np.float64) for row in (one, other))
        if np.array_equal(x, y) or (speeds_mps[one] != speeds_mps[other] and _unlike(x, y) < _RUNS_DIFFER):
            copies.append((one, other))
    return sorted(copies)


def _unlike_tests(one: FloatArray, other: FloatArray) -> float:
    """How unlike two tests are; one of them may have been filtered once more."""
    filtered = [cfc_filter(accel, cfc=_CFC, dt_s=DT_S) for accel in (one, other)]
    return min(_unlike(one, other), _unlike(filtered[0], other), _unlike(one, filtered[1]))


def _unlike(one: FloatArray, other: FloatArray) -> float:
    """The share (RMS) of a pulse that no line through the other, at any shift up to 6 ms, explains where both are.

    Correlations at all shifts come from one Fourier transform, sums over the overlaps from running sums.
    """
    n, size = one.size, 1 << int(2 * one.size - 1).bit_length()
    shift = np.arange(-round(_SHIFT_S / DT_S), round(_SHIFT_S / DT_S) + 1)
    products = np.fft.irfft(np.fft.rfft(one, size) * np.conj(np.fft.rfft(other, size)), size)[shift]
    first, last = np.maximum(shift, 0), n + np.minimum(shift, 0)
    count = last - first

    def moments(accel: FloatArray, start: npt.NDArray[np.int_], stop: npt.NDArray[np.int_]) -> tuple[FloatArray, ...]:
        sums = [np.concatenate([[0.0], np.cumsum(values)]) for values in (accel, accel**2)]
        total, squares = (running[stop] - running[start] for running in sums)
        return total, squares - total**2 / count

    (total, variance), (others_total, others_variance) = (
        moments(one, first, last),
        moments(other, first - shift, last - shift),
    )
    if not (variance > 0).all() or not (others_variance > 0).all():
        return np.inf
    explained = (products - total * others_total / count) ** 2 / (variance * others_variance)
    return float(np.sqrt(max(1.0 - explained.max(), 0.0)))


def _alike(accel: FloatArray) -> Pairs:
    """Pairs of rows worth a closer look, by their correlation at 2.5 kHz."""
    coarse = np.asarray(accel, dtype=np.float64).reshape(len(accel), N_SAMPLES // _COARSE, _COARSE).mean(axis=2)
    least = np.sqrt(1 - _COARSE_DIFFER**2)
    pairs: set[tuple[int, int]] = set()
    for shift in range(round(_SHIFT_S / (_COARSE * DT_S)) + 1):
        late, early = _unit(coarse[:, shift:]), _unit(coarse[:, : coarse.shape[1] - shift])
        for start in range(0, len(accel), _ROWS_AT_ONCE):
            rows, columns = np.nonzero(np.abs(late[start : start + _ROWS_AT_ONCE] @ early.T) > least)
            pairs |= {(min(i, j), max(i, j)) for i, j in zip((rows + start).tolist(), columns.tolist(), strict=True)}
    return sorted((one, other) for one, other in pairs if one != other)


def _shapes(accel: npt.NDArray[np.float32]) -> FloatArray:
    """Each pulse around the time at which half of its change of velocity is done, to a norm of 1: shape (n, 21)."""
    coarse = accel.astype(np.float64).reshape(len(accel), N_SAMPLES // 10, 10).mean(axis=2)
    velocity, row = np.cumsum(coarse, axis=1), np.arange(len(accel))
    change = velocity[row, np.abs(velocity).argmax(axis=1)]
    share = velocity / np.where(change == 0, 1.0, change)[:, None]
    after = np.maximum((share >= 0.5).argmax(axis=1), 1)
    before, rise = share[row, after - 1], share[row, after] - share[row, after - 1]
    half = after - 1 + (0.5 - before) / np.where(rise > 0, rise, 1.0)
    at = np.clip(half[:, None] + _AROUND, 0, coarse.shape[1] - 1.001)
    low = at.astype(np.intp)
    values = np.take_along_axis(coarse, low, 1) * (low + 1 - at) + np.take_along_axis(coarse, low + 1, 1) * (at - low)
    return np.asarray(values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-12))


def _main_axes(rows: FloatArray) -> FloatArray:
    """Rows in their eight main axes: they hold nearly all, and bring no two rows further apart; shape (n, 8)."""
    centred = rows - rows.mean(axis=0)
    return np.asarray(centred @ np.linalg.eigh(centred.T @ centred)[1][:, -8:])


def _unit(rows: FloatArray) -> FloatArray:
    """Rows without their mean, to a norm of 1."""
    centred = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-12))
