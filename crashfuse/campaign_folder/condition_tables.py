"""Condition tables, ``tests.csv`` and ``cae.csv``: their columns, one row per test or run, and its id."""

import re
import unicodedata
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd

from crashfuse import errors
from crashfuse.cae_library import QUALITIES, RunQuality
from crashfuse.condition import ABOUT, FILE_UNITS, QUANTITIES, About, Condition
from crashfuse.crash_test import TUNED
from crashfuse.errors import CORRECT_CELL, KEEP_ONE, DataError, Problem, collecting, printable, refuse_if, shortened
from crashfuse.files.archive import name_trouble
from crashfuse.files.csv_text import MOST_ROWS, read_rows
from crashfuse.files.parquet import EMPTY
from crashfuse.signals.pulse import N_SAMPLES, FloatArray
from crashfuse.signals.sensor_faults import SensorFault
from crashfuse.units import KPH_KG, MPH_LB, UnitSystem

Role = Literal["tests", "cae"]  # either of the two condition tables of a campaign, with its pulses
ROLES: tuple[Role, ...] = ("tests", "cae")
TABLES = ("tests.csv", "cae.csv")
PULSES = (".csv", ".parquet")  # endings of tables of pulses
NAMELESS = "an id in each row", "an empty cell", "name the row"
_MOST_PROBLEMS = 20  # of cells of one column of pulses; the rest are only counted
RowNumbers = npt.NDArray[np.integer[Any]]

_SMALLEST = {"speed": 0.1, "front_weight": 1.0, "rear_weight": 1.0}  # m/s, kg: less is not a crash, not a vehicle
_LARGEST = {"speed": 500.0, "front_weight": 1e5, "rear_weight": 1e5}  # m/s, kg: more must be in another unit
_MOST_CANDIDATES = 1000  # each costs a prediction
_LONGEST_FACTOR = 200
_MOST_ROWS = {"tests": 20_000, "cae": MOST_ROWS}
_UNSAFE = re.compile(r'[/\\:*?|<>"]')
_FORMULA = ("=", "+", "-", "@")
_LONGEST_ID = 180  # bytes of one made of a foreign name


def has_table(folder: Path) -> bool:
    """Whether there is a condition table in a folder."""
    return any((folder / name).is_file() for name in TABLES)


@dataclass(frozen=True, eq=False, slots=True)
class ConditionTable:
    """The rows of a condition table, each with its row number in the file (the header is row 1), and their pulses."""

    role: Role
    ids: tuple[str, ...]
    conditions: tuple[Condition, ...]
    rows: tuple[int, ...]
    quality: tuple[RunQuality, ...] = ()  # what the solver says of each; empty if the table says nothing
    about: tuple[About, ...] = ()  # likewise
    units: UnitSystem = MPH_LB  # of the columns
    tuned: tuple[bool | None, ...] = ()  # whether the CAE model was tuned to each test
    # once its pulses are read
    accel_mps2: npt.NDArray[np.float32] = field(default_factory=lambda: np.empty((0, N_SAMPLES), np.float32))
    ends_s: Mapping[str, float] = field(default_factory=dict)  # of records shorter than the study grid, by id
    faults: Mapping[str, tuple[SensorFault, ...]] = field(default_factory=dict)  # what looks like one, by id

    @property
    def file(self) -> str:
        """Its name in the folder."""
        return f"{self.role}.csv"

    @property
    def speeds_mps(self) -> FloatArray:
        """Impact speeds, shape (n,); NaN where one is not there."""
        return np.array([condition.speed_mps for condition in self.conditions])

    def without(self, places: Collection[int]) -> "ConditionTable":
        """The table without the rows at these places."""
        if not places:
            return self
        keep = [place not in places for place in range(len(self.ids))]
        by_row = ("ids", "conditions", "rows", "quality", "about", "tuned")
        lists: dict[str, Any] = {name: tuple(compress(getattr(self, name), keep)) for name in by_row}
        return replace(self, **lists, accel_mps2=self.accel_mps2[keep] if self.accel_mps2.size else self.accel_mps2)


def read_conditions(path: Path, role: Role = "tests", *, by_hand: bool = False) -> ConditionTable:
    """Read a condition table; a DataError has every problem. One made ``by_hand`` may have decimal commas."""
    problems: list[Problem] = []
    table = read_lenient(path, role, problems, by_hand=by_hand)
    if table is None or problems:
        raise DataError(shortened(problems))
    return table


def read_lenient(path: Path, role: Role, problems: list[Problem], *, by_hand: bool = False) -> ConditionTable | None:
    """As :func:`read_conditions`, with every row that has an id of its own, so that pulses can be checked against it.

    NaN stands for a speed or weight that is not there; None if there are no such rows. Problems go to ``problems``.
    """
    frame, where = _read_text(path, role, problems, by_hand=by_hand), path.name
    if frame is None:
        return None
    names = list(map(str, frame.columns))
    matches = {name: find_column(names, name, units, where, problems) for name, units in QUANTITIES.items()}
    columns = {name: match for name, match in matches.items() if match is not None}
    if "id" in names:
        frame["id"] = frame["id"].str.strip()
        sound = _check_ids(frame["id"], where, problems)
    else:
        problems.append(Problem(where, "a column id", f"the columns {listed(names)}", "name each row in one"))
        sound = []
    values = {name: np.full(len(frame), np.nan) for name in QUANTITIES}
    for name, (column, factor) in columns.items():
        numbers = numbers_in(frame[column], column, where, frame.index.to_numpy(), problems, _LARGEST[name] / factor)
        smallest = 0.0 if role == "cae" and name == "speed" else _SMALLEST[name] / factor
        expected, low = f"a number of at least {smallest:.3g}", frame[column][numbers < smallest]
        problems += [Problem(where, expected, text, CORRECT_CELL, column, row) for row, text in low.items()]
        values[name] = factor * numbers
    quality = _read_quality(frame, where, problems)
    quantities = [column for column, _ in columns.values()]
    sources = [name for name in names if name.startswith(ABOUT)]
    extra = [name for name in names if name not in {"id", "cae_tuned", *sources, *QUALITIES, *quantities}]
    _check_factors(frame[[*extra, *sources]], where, problems)
    tuned = _read_tuned(frame, where, problems) if role == "tests" else ()
    if not sound:
        return None
    cells = frame[sources].to_numpy(dtype=object).tolist()
    about = tuple(tuple((name, cell) for name, cell in zip(sources, row, strict=True) if cell) for row in cells)
    factors = [tuple(zip(extra, row, strict=True)) for row in frame[extra].to_numpy(dtype=object).tolist()]
    endings = [*(column.rpartition("_")[2] for column in quantities), *FILE_UNITS]
    given = endings[0], endings[1], endings[2]
    vectors = zip(*values.values(), strict=True)
    conditions = tuple(Condition.of_cells(vector, of, given) for vector, of in zip(vectors, factors, strict=True))
    units = MPH_LB if "speed_mph" in names else KPH_KG
    table = ConditionTable(role, tuple(frame["id"]), conditions, tuple(frame.index), quality, about, units, tuned)
    return table.without({*range(len(frame))} - {*sound})


def read_candidates(path: Path) -> tuple[Condition, ...]:
    """Read candidate test conditions from a table like ``tests.csv``; raise a DataError with every problem."""
    conditions = read_conditions(path, by_hand=True).conditions
    expected, count = f"at most {_MOST_CANDIDATES} candidates", len(conditions)
    refuse_if(count > _MOST_CANDIDATES, path.name, expected, f"{count}", "leave some out")
    return conditions


def find_column(
    columns: Sequence[str], quantity: str, units: Mapping[str, float], where: str, problems: list[Problem]
) -> tuple[str, float] | None:
    """The one column of a quantity and, by its name's ending, its factor to SI; else a problem."""
    wanted = {f"{quantity}_{unit}": factor for unit, factor in units.items()}
    matches = [column for column in columns if column in wanted]
    if len(matches) == 1:
        return matches[0], wanted[matches[0]]
    found, advice = f"the columns {listed(columns)}", "add the column"
    if matches:
        found, advice = listed(matches), KEEP_ONE
    elif alike := [column for column in columns if column.startswith(quantity)]:
        found, advice = listed(alike), "let the column's name end in its unit"
    problems.append(Problem(where, f"one column {' or '.join(wanted)}", found, advice))
    return None


def numbers_in(
    cells: pd.Series, column: str, where: str, rows: RowNumbers, problems: list[Problem], largest: float
) -> FloatArray:
    """Cells as float64; one that is no number, or beyond ``largest``, is a problem and NaN, empty ones in a row one."""
    numbers = _as_numbers(cells)
    bad = np.flatnonzero(~(np.abs(numbers) <= largest))
    wrong, rows_of = cells.iloc[bad], rows[bad]
    empty = _are_empty(wrong)
    starts = np.flatnonzero(np.r_[True, (np.diff(rows_of) > 1) | ~empty[1:] | ~empty[:-1]][: bad.size])
    stops = np.r_[starts[1:], bad.size][:_MOST_PROBLEMS]
    for start, stop in zip(starts, stops, strict=False):
        row, last = int(rows_of[start]), int(rows_of[stop - 1])
        expected = f"a number up to {largest:.3g}" if np.isfinite(numbers[bad[start]]) else "a number"
        found, advice = repr(printable(str(wrong.iloc[start]).strip(), 60)), CORRECT_CELL
        if empty[start]:
            found, advice = f"rows {row}–{last}, empty" if last > row else "an empty cell", "fill it in"
        problems.append(Problem(where, expected, found, advice, column, row))
    if bad.size and (more := bad.size - int(stops[-1])):
        problems.append(Problem(where, "numbers", f"{more} more cells that are none", "correct them too", column))
    numbers[bad] = np.nan
    return numbers


def listed(names: Iterable[str]) -> str:
    """A dozen names at most, as text."""
    texts = [printable(name, 40) for name in names]
    return ", ".join(texts[:12]) + (f" and {len(texts) - 12} more" if len(texts) > 12 else "")


def id_trouble(run_id: str) -> tuple[str, str, str] | None:
    """Expected, found and advice for an id that is no file name on every platform, or a formula."""
    if not run_id:
        return NAMELESS
    found = repr(printable(run_id, 60))
    unsafe, trouble = _UNSAFE.search(run_id), name_trouble(run_id)
    if wrong := f"with {unsafe[0]}" if unsafe else trouble and trouble[1]:
        return "an id that can name a file", f"{found}, {wrong}", "rename it"
    if run_id.startswith(_FORMULA):
        return "an id that no spreadsheet takes for a formula", found, "let it begin with a letter or a digit"
    return None


def folded(name: str) -> str:
    """A name as a file system sees it that ignores case and Unicode normalisation."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def safe_id(name: str) -> str:
    """An id as near as can be to a foreign name, such as that of a file."""
    plain = "".join(char if char.isprintable() else "_" for char in unicodedata.normalize("NFC", name))
    plain = _UNSAFE.sub("_", plain).encode("utf-8", "replace")[:_LONGEST_ID].decode("utf-8", "ignore")
    plain = plain.strip(" ").rstrip(". ")
    if plain.startswith(_FORMULA):
        plain = f"_{plain[1:]}"
    plain = plain or "record"
    return plain if id_trouble(plain) is None else f"_{plain}"  # the name of a device


def _read_text(path: Path, role: Role, problems: list[Problem], *, by_hand: bool) -> pd.DataFrame | None:
    with collecting(problems):
        refuse_if(not path.exists(), path.name, "this file", errors.NO_FILE, "add it")
        names, rows, numbers = read_rows(path, path.name, by_hand=by_hand, most_rows=_MOST_ROWS[role])
        refuse_if(not rows, path.name, "a header and at least one row", *EMPTY)
        kept = [at for at, name in enumerate(names) if name]
        cells = [[row[at] for at in kept] for row in rows]
        return pd.DataFrame(cells, columns=[names[at] for at in kept], index=numbers).astype(str)
    return None


def _check_ids(ids: pd.Series, where: str, problems: list[Problem]) -> list[int]:
    seen, sound = dict[str, str](), list[int]()
    for place, (row, run_id) in enumerate(ids.items()):
        trouble, name = id_trouble(run_id), folded(run_id)
        if trouble is None and name in seen:
            alike = "" if seen[name] == run_id else f", as {printable(seen[name], 60)!r}, to some systems"
            trouble = "each id once", f"{printable(run_id, 60)!r} a second time{alike}", "rename or remove one"
        if trouble is None:
            sound.append(place)
        else:
            problems.append(Problem(where, *trouble, "id", row))
        seen.setdefault(name, run_id)
    return sound


def _check_factors(cells: pd.DataFrame, where: str, problems: list[Problem]) -> None:
    expected = f"text of at most {_LONGEST_FACTOR} characters without control characters"
    for column in cells.columns:
        odd = {text for text in {column, *cells[column]} if len(text) > _LONGEST_FACTOR or printable(text) != text}
        bad = [(row, text) for row, text in [(1, column), *cells[column].items()] if text in odd] if odd else []
        _refuse_cells(bad, expected, printable(column, 60), where, problems)


def _read_quality(frame: pd.DataFrame, where: str, problems: list[Problem]) -> tuple[RunQuality, ...]:
    columns = [name for name in QUALITIES if name in frame]
    if not (frame[columns] != "").to_numpy().any():
        return ()
    values: dict[str, list[float | None]] = {}
    for name in columns:
        least, shares = -1 if name == "energy_change" else 0, _as_numbers(frame[name])
        expected, is_given = f"a share from {least} to 1 (5 % is 0.05), or nothing", frame[name].str.strip() != ""
        wrong = frame[name][is_given & ~((shares >= least) & (shares <= 1))]
        _refuse_cells(wrong.items(), expected, name, where, problems)
        values[name] = [float(v) if given else None for v, given in zip(shares, is_given, strict=True)]
    return tuple(RunQuality(**dict(zip(columns, row, strict=True))) for row in zip(*values.values(), strict=True))


def _read_tuned(frame: pd.DataFrame, where: str, problems: list[Problem]) -> tuple[bool | None, ...]:
    if "cae_tuned" not in frame:
        return (None,) * len(frame)
    meanings = {text: meaning for meaning, text in TUNED.items()} | {"true": True, "false": False}
    cells = frame["cae_tuned"].str.strip().str.lower()
    wrong = frame["cae_tuned"][~cells.isin(meanings)]
    _refuse_cells(wrong.items(), "yes, no or nothing", "cae_tuned", where, problems)
    return tuple(map(meanings.get, cells))


def _refuse_cells(
    cells: Iterable[tuple[Any, str]], expected: str, column: str, where: str, problems: list[Problem]
) -> None:
    problems += [Problem(where, expected, repr(printable(text, 60)), CORRECT_CELL, column, row) for row, text in cells]


def _are_empty(cells: pd.Series) -> npt.NDArray[np.bool_]:
    if isinstance(cells.dtype, pd.CategoricalDtype):  # each text once: a million cells may share a text of a megabyte
        of_texts = _are_empty(pd.Series(cells.cat.categories, dtype=cells.cat.categories.dtype))
        return np.asarray(np.append(of_texts, True)[cells.cat.codes])
    return np.array([pd.isna(cell) or (isinstance(cell, str) and not cell.strip()) for cell in cells], dtype=bool)


def _as_numbers(cells: pd.Series) -> FloatArray:
    if isinstance(cells.dtype, pd.CategoricalDtype):  # text in Parquet
        return np.asarray(np.append(_as_numbers(pd.Series(cells.cat.categories)), np.nan)[cells.cat.codes])
    if pd.api.types.is_bool_dtype(cells.dtype):
        return np.full(len(cells), np.nan)
    return np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
