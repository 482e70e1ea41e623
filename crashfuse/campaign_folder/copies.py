"""The same record twice: pulses that are copies of each other but for a shift in time, a scale and an offset.

A copied test predicts its original almost exactly, and every number that is judged on left-out tests is then wrong.
Measured is the share of one pulse that no line through the other explains, at the best shift, where both are recorded.

Of tests, what is left is averaged over 4 ms first, as noise and rounding tell no two crashes apart: below 0.4 % for
copies that were shifted, scaled, cropped, resampled at 1 kHz, given an offset, filtered again with CFC 60 or rounded to
0.1 g; at least 0.7 % between the closest of some 4000 pairs of measured repeats (a helmet on a headform, whose foam
repeats well), and 3.9 % between repeats of simulated cars with 2 % scatter.

CAE runs have no noise, and close to each other they are alike: those of one speed may differ in a weight that hardly
matters. Between speeds more than 2 % apart at least 1.7 % is left, above 3 m/s.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from crashfuse.campaign_folder.condition_tables import ConditionTable
from crashfuse.errors import Problem
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray

Pairs = list[tuple[int, int]]
ONE_RECORD = 0.005
"""Tests that differ by less are one record."""
_ALIKE_TESTS = 0.015  # tests that differ by less may be one record, or good repeats
_TESTS_SHIFT_S, _AVERAGED_S = 20e-3, 4e-3
_RUNS_DIFFER, _RUNS_SHIFT_S = 0.002, 6e-3
_COARSE, _COARSE_DIFFER = 5, 0.15  # samples averaged, and the residual, in the search for pairs worth a closer look
_ROWS_AT_ONCE = 500
_CFC = 60.0
_SLOWEST_MPS, _OTHER_SPEED = 3.0, 0.02  # slower pulses are elastic, and scale with the speed
_AROUND = np.arange(-20.0, 21.0, 2.0)  # samples of 0.8 ms around half the change of velocity
_ALIKE = 2e-3  # distance of two runs around there: copies 0.2e-3 in the median, 2e-3 at 90 %
_IDENTICAL = 1e-7
_LOOKED_AT = 2000  # pairs of runs
_NAMED = 5


def check_tests_differ(
    table: ConditionTable, accel: FloatArray, ends_s: Mapping[str, float], problems: list[Problem], warnings: list[str]
) -> None:
    """Reject tests that are copies of each other, and warn of those that might be.

    Pulses are on the study grid, shape (n_tests, 1250); ``ends_s`` is where shorter records end, by id.
    """
    ends = [ends_s.get(test_id, np.inf) for test_id in table.ids]
    records = [row[: np.searchsorted(GRID_S, end, "right")] for row, end in zip(accel, ends, strict=True)]
    doubtful = []
    for (one, other), share in similar_tests(records).items():
        if share < ONE_RECORD:
            expected = "a record of its own for each test"
            found = f"the same record for {table.ids[one]} and {table.ids[other]}, shifted, scaled or filtered at most"
            place, advice = f"id {table.ids[other]}", "remove one of them, or give it its own record"
            problems.append(Problem("tests.csv", expected, found, advice, place, table.rows[other]))
        else:
            doubtful.append(f"{table.ids[one]} and {table.ids[other]} ({100 * share:.1f} %)")
    if doubtful:
        warnings.append(
            f"tests.csv: shifted and scaled, the pulses of some tests hardly differ: {_pairs(doubtful)}. Good repeats "
            "can be as alike; check that none is a copy of another test."
        )


def check_runs_differ(table: ConditionTable, accel: npt.NDArray[np.float32], warnings: list[str]) -> None:
    """Warn of CAE runs at different conditions that have one pulse; ``accel`` is of shape (n_runs, 1250)."""
    speeds = np.array([condition.speed_mps for condition in table.conditions])
    pairs = [f"{table.ids[one]} and {table.ids[other]}" for one, other in copied_runs(speeds, accel)]
    if pairs:
        warnings.append(
            f"cae.csv: the same pulse, scaled or shifted at most, for {_pairs(pairs)}; check that none is a copy of "
            "another run."
        )


def _pairs(pairs: Sequence[str]) -> str:
    more = f" and {len(pairs) - _NAMED:,} more pairs" if len(pairs) > _NAMED else ""
    return f"{', '.join(pairs[:_NAMED])}{more}"


def similar_tests(records: Sequence[FloatArray]) -> dict[tuple[int, int], float]:
    """Places of tests that may be copies of each other, the lower first, with the share in which they differ.

    The records, in 12.5 kHz from contact on, may be of different lengths.
    """
    shares = {(one, other): _unlike_tests(records[one], records[other]) for one, other in _alike(records)}
    return {pair: share for pair, share in shares.items() if share < _ALIKE_TESTS}


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
        is_other_speed = speeds_mps[one] != speeds_mps[other]
        # the share (RMS) that no line through the other explains
        if np.array_equal(x, y) or (
            is_other_speed and np.sqrt(1.0 - _best_shift(x, y, _RUNS_SHIFT_S)[1]) < _RUNS_DIFFER
        ):
            copies.append((one, other))
    return sorted(copies)


def _unlike_tests(one: FloatArray, other: FloatArray) -> float:
    """One of them may have been filtered once more."""
    filtered = [cfc_filter(accel, cfc=_CFC, dt_s=DT_S) for accel in (one, other)]
    pairs = (one, other), (filtered[0], other), (one, filtered[1])
    return min(_smooth_difference(*pair) for pair in pairs)


def _smooth_difference(one: FloatArray, other: FloatArray) -> float:
    """The share (RMS) of a pulse that the other leaves unexplained, shifted, scaled and offset, averaged over 4 ms."""
    shift, explained = _best_shift(one, other, _TESTS_SHIFT_S)
    if not explained:
        return np.inf
    first, last = max(shift, 0), min(one.size, other.size + shift)
    here, there = one[first:last], other[first - shift : last - shift]
    line = np.column_stack([np.ones(there.size), there, np.gradient(there)])  # the slope: a part of a sample's shift
    left = here - line @ np.linalg.lstsq(line, here, rcond=None)[0]
    width = round(_AVERAGED_S / DT_S)
    smooth = np.convolve(left, np.full(width, 1 / width), "valid")
    return float(np.sqrt((smooth**2).mean()) / here.std())


def _best_shift(one: FloatArray, other: FloatArray, reach_s: float) -> tuple[int, float]:
    """The shift in samples at which a line through the other pulse explains the most of one, and the share of power.

    Correlations at all shifts come from one Fourier transform, sums over the overlaps from running sums.
    """
    size = 1 << int(one.size + other.size - 1).bit_length()
    shift = np.arange(-round(reach_s / DT_S), round(reach_s / DT_S) + 1)
    products = np.fft.irfft(np.fft.rfft(one, size) * np.conj(np.fft.rfft(other, size)), size)[shift]
    first, last = np.maximum(shift, 0), np.minimum(one.size, other.size + shift)
    count = last - first

    def moments(accel: FloatArray, start: npt.NDArray[np.int_], stop: npt.NDArray[np.int_]) -> tuple[FloatArray, ...]:
        sums = [np.concatenate([[0.0], np.cumsum(values)]) for values in (accel, accel**2)]
        total, squares = (running[stop] - running[start] for running in sums)
        return total, squares - total**2 / count

    total, variance = moments(one, first, last)
    others_total, others_variance = moments(other, first - shift, last - shift)
    if not (variance > 0).all() or not (others_variance > 0).all():
        return 0, 0.0
    explained = (products - total * others_total / count) ** 2 / (variance * others_variance)
    best = int(explained.argmax())
    return int(shift[best]), float(min(explained[best], 1.0))


def _alike(records: Sequence[FloatArray]) -> Pairs:
    """Pairs worth a closer look, by their correlation at 2.5 kHz as far as all are recorded."""
    if not records:
        return []
    n, length = len(records), min(record.size for record in records) // _COARSE
    coarse = np.array([record[: length * _COARSE] for record in records], dtype=np.float64)
    coarse = coarse.reshape(n, length, _COARSE).mean(axis=2)
    least = np.sqrt(1 - _COARSE_DIFFER**2)
    pairs: set[tuple[int, int]] = set()
    for shift in range(round(_TESTS_SHIFT_S / (_COARSE * DT_S)) + 1):
        late, early = _unit(coarse[:, shift:]), _unit(coarse[:, : coarse.shape[1] - shift])
        for start in range(0, n, _ROWS_AT_ONCE):
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
    centred = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-12))
