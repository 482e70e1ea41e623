"""The same record twice: pulses that are copies of each other but for a shift in time, a scale and an offset.

A copied test predicts its original almost exactly, and what is judged on left-out tests is then wrong. Measured is the
share of one pulse that no line through the other explains, at the best shift, averaged over 4 ms: below 0.4 % for
copies however they were made; at least 0.7 % for 4000 pairs of measured repeats (a helmet on a headform), and 3.9 %
for simulated cars with 2 % scatter.

Sensors of one crash differ by 5 to 15 %, measured repeats by 1 % and more. So likeness alone does not tell them apart.
Names do that differ by a place alone, and a condition equal to the digit where few are.
"""

import re
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from crashfuse.campaign_folder.condition_tables import ConditionTable
from crashfuse.condition import About, Condition
from crashfuse.errors import Problem
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray

Pairs = list[tuple[int, int]]
ONE_RECORD = 0.005  # tests that differ by less are one record
_ALIKE_TESTS = 0.015  # tests that differ by less may be one record, or good repeats
_TESTS_SHIFT_S, _AVERAGED_S = 20e-3, 4e-3
_RUNS_DIFFER, _IDENTICAL = 5e-4, 1e-7  # distances of pulses of norm 1; sampled at 10 kHz: 5e-5
_COARSE, _COARSE_DIFFER = 5, 0.15  # samples averaged, and the residual, in the search for pairs worth a closer look
_ROWS_AT_ONCE = 500
_CFC = 60.0
_SLOWEST_MPS, _OTHER_SPEED = 3.0, 0.02  # slower pulses are elastic, and scale with the speed
_NAMED = 5
_ONE_CRASH, _ONE_CRASH_BY_NAME = 0.1, 0.3  # differences (RMS at CFC 60) of two sensors
_OF_SENSORS = {"about_sensor", "about_prefilter"}
_PILLAR = r"[abc][ _-]?(?:pillar|s(?:ä|ae)ule)"
_TOKEN = re.compile(rf"(?i:{_PILLAR})|[A-ZÄÖÜ]+(?![a-zäöü])|[A-ZÄÖÜ]?[a-zäöüß]+|\d+")
_PLACE = re.compile(
    rf"({_PILLAR}|left|right|links|rechts|gauche|droite|rear|front|vorne?|hinten|upper|lower|oben|unten|driver|"
    r"passenger|(bei)?fahrer|sill|schweller|seat|sitz|cross|member|tunnel|rocker|floor|boden|primary|redundan[tz]|"
    r"main|backup|sensor|acc(el)?|channel|kanal)+|[lr](h|hs|e|i)?|li|ch|cg"
)
_NUMBERED = {"sensor", "acc", "accel", "channel", "kanal", "ch"}  # places by a number


def check_tests_differ(table: ConditionTable, problems: list[Problem], warnings: list[str]) -> None:
    """Reject tests that are copies of each other, and warn of those that might be."""
    ends = [table.ends_s.get(test_id, np.inf) for test_id in table.ids]
    records = [row[: np.searchsorted(GRID_S, end, "right")] for row, end in zip(table.accel_mps2, ends, strict=True)]
    doubtful = []
    for (one, other), share in similar_tests(records).items():
        if share < ONE_RECORD:
            found = f"the same record for {table.ids[one]} and {table.ids[other]}, shifted, scaled or filtered at most"
            place = f"id {table.ids[other]}", table.rows[other]
            problems.append(Problem("tests.csv", "a record of its own for each test", found, "remove one", *place))
        else:
            doubtful.append(f"{table.ids[one]} and {table.ids[other]} ({100 * share:.1f} %)")
    if doubtful:
        finding = f"tests.csv: shifted and scaled, some tests hardly differ: {_pairs(doubtful)}"
        warnings.append(f"{finding}. They may be good repeats; check that none is a copy.")
    for one, other, share in sensors_of_one_crash(table.ids, table.conditions, table.accel_mps2, table.about):
        finding = f"{table.ids[one]} and {table.ids[other]}: one condition to the digit, alike to {100 * share:.0f} %"
        warnings.append(f"tests.csv, {finding}; if they are sensors of one crash, leave one out of use.")


def sensors_of_one_crash(
    ids: Sequence[str],
    conditions: Sequence[Condition],
    accel: FloatArray,
    about: Sequence[About] = (),
    *,
    given_once: bool = False,  # one condition for all, by the user
) -> Iterator[tuple[int, int, float]]:
    """Places of tests that may be sensors of one crash, and the share in which their pulses differ."""
    places: dict[Condition, list[int]] = {}
    for place, condition in enumerate(conditions):
        places.setdefault(condition, []).append(place)
    together = [group for group in places.values() if len(group) > 1]
    is_telling = given_once or 2 * sum(map(len, together)) <= len(ids)
    names, smooth = [*map(_without_place, ids)], dict[int, FloatArray]()
    for one, other in (pair for group in together for pair in combinations(group, 2)):
        by_name = names[one] == names[other]
        here, there = (dict(about[place]) if about else {} for place in (one, other))
        alike = (there.get(key, value) == value for key, value in here.items() if key not in _OF_SENSORS)
        if (by_name or is_telling) and all(alike):
            for place in {one, other} - smooth.keys():
                smooth[place] = cfc_filter(accel[place], cfc=_CFC, dt_s=DT_S)
            size = max(float(np.linalg.norm(smooth[place])) for place in (one, other))
            share = float(np.linalg.norm(smooth[one] - smooth[other])) / max(size, 1e-12)
            if share < (_ONE_CRASH_BY_NAME if by_name else _ONE_CRASH):
                yield one, other, share


def _without_place(name: str) -> list[str]:
    """``V7_SillLeft`` and ``V7 tunnel`` are both of V7."""
    words = [word.casefold() for word in _TOKEN.findall(name)]
    pairs = zip(["", *words], words, strict=False)
    return [word for before, word in pairs if not (_PLACE.fullmatch(word) or (word.isdigit() and before in _NUMBERED))]


def check_runs_differ(table: ConditionTable, warnings: list[str]) -> None:
    """Warn of CAE runs at different conditions that have one pulse."""
    copies = copied_runs(table.speeds_mps, table.accel_mps2)
    if pairs := [f"{table.ids[one]} and {table.ids[other]}" for one, other in copies]:
        warnings.append(f"cae.csv: the same pulse, scaled at most, for {_pairs(pairs)}; check that none is a copy.")


def _pairs(pairs: Sequence[str]) -> str:
    more = f" and {len(pairs) - _NAMED:,} more pairs" if len(pairs) > _NAMED else ""
    return f"{', '.join(pairs[:_NAMED])}{more}"


def similar_tests(records: Sequence[FloatArray]) -> dict[tuple[int, int], float]:
    """Places of tests that may be copies of each other, the lower first, with the share in which they differ."""
    shares = {(one, other): _unlike_tests(records[one], records[other]) for one, other in _alike(records)}
    return {pair: share for pair, share in shares.items() if share < _ALIKE_TESTS}


def copied_runs(speeds_mps: FloatArray, accel: npt.NDArray[np.float32]) -> Pairs:
    """Pairs of runs with the same pulse; at another speed (2 % apart, 1.7 % of a pulse differs) also a scaled one."""
    fast = np.flatnonzero(speeds_mps > _SLOWEST_MPS)
    if fast.size < 2:
        return []
    parts = (accel[fast[at : at + 4000]] for at in range(0, fast.size, 4000))
    coarse = np.concatenate([part.reshape(len(part), -1, 10).mean(axis=2, dtype=np.float64) for part in parts])
    shapes = coarse / np.maximum(np.linalg.norm(coarse, axis=1, keepdims=True), 1e-12)
    centred = shapes - shapes.mean(axis=0)  # its eight main axes hold nearly all, and bring no two rows further apart
    axes = centred @ np.linalg.eigh(centred.T @ centred)[1][:, -8:]
    pairs = cKDTree(axes).query_pairs(_RUNS_DIFFER, output_type="ndarray")
    is_apart = np.abs(np.log(speeds_mps[fast[pairs[:, 0]]] / speeds_mps[fast[pairs[:, 1]]])) > _OTHER_SPEED
    limits = np.where(is_apart, _RUNS_DIFFER, _IDENTICAL)
    for rows in (axes, shapes):  # the few axes first: nearly all pairs fail there
        close = np.linalg.norm(rows[pairs[:, 0]] - rows[pairs[:, 1]], axis=1) < limits
        pairs, limits = pairs[close], limits[close]
    return sorted((one, other) for one, other in np.sort(fast[pairs], axis=1).tolist())


def _unlike_tests(one: FloatArray, other: FloatArray) -> float:
    filtered = [cfc_filter(accel, cfc=_CFC, dt_s=DT_S) for accel in (one, other)]
    pairs = (one, other), (filtered[0], other), (one, filtered[1])
    return min(_smooth_difference(*pair) for pair in pairs)


def _smooth_difference(one: FloatArray, other: FloatArray) -> float:
    """The share (RMS) of a pulse that the other leaves unexplained, averaged over 4 ms."""
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
    """In samples, and the share of power that a line then explains."""
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
    """By their correlation at 2.5 kHz as far as all are recorded."""
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


def _unit(rows: FloatArray) -> FloatArray:
    centred = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-12))
