"""Condition tables: ``tests.csv`` and ``cae.csv``, one row per test or run."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import pandas as pd

from crashfuse.campaign_folder.columns import MOST_PROBLEMS, count_rest, find_column, listed, not_a_number
from crashfuse.campaign_folder.ids import folded, id_trouble, same_name
from crashfuse.campaign_folder.quality_columns import read_quality
from crashfuse.condition import FILE_UNITS, Condition
from crashfuse.errors import DataError, Problem, printable, shortened
from crashfuse.files.csv_text import MOST_ROWS, read_rows
from crashfuse.run_quality import QUANTITIES as QUALITIES
from crashfuse.run_quality import RunQuality
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MASS, SPEED
from crashfuse.wording import KPH_KG, MPH_LB, UnitSystem

_QUANTITIES: dict[str, Mapping[str, float]] = {"speed": SPEED, "front_weight": MASS, "rear_weight": MASS}
_SMALLEST = {"speed": 0.1, "front_weight": 1.0, "rear_weight": 1.0}  # m/s, kg: less is not a crash, not a vehicle
_LARGEST = {"speed": 500.0, "front_weight": 1e5, "rear_weight": 1e5}  # m/s, kg: more must be in another unit
_MOST_CANDIDATES = 1000  # each costs a prediction
_LONGEST_FACTOR = 200
_MOST_ROWS = {"tests": 20_000, "cae": MOST_ROWS}

T = TypeVar("T")

Role = Literal["tests", "cae"]
"""Either of the two condition tables of a campaign, with its pulses."""

TABLES = ("tests.csv", "cae.csv")


def has_table(folder: Path) -> bool:
    """Whether there is a condition table in a folder, which makes it a campaign's."""
    return any((folder / name).is_file() for name in TABLES)


@dataclass(frozen=True, slots=True)
class ConditionTable:
    """The rows of a condition table, each with its row number in the file (the header is row 1).

    ``quality`` is what the solver says of each, empty if the table says nothing; ``units`` are those of the columns.
    """

    ids: tuple[str, ...]
    conditions: tuple[Condition, ...]
    rows: tuple[int, ...]
    quality: tuple[RunQuality, ...] = ()
    units: UnitSystem = MPH_LB

    def without(self, places: Sequence[int]) -> "ConditionTable":
        """The table without the rows at these places."""
        gone = set(places)

        def kept(cells: tuple[T, ...]) -> tuple[T, ...]:
            return tuple(cell for place, cell in enumerate(cells) if place not in gone)

        return replace(
            self,
            ids=kept(self.ids),
            conditions=kept(self.conditions),
            rows=kept(self.rows),
            quality=kept(self.quality),
        )


def read_conditions(path: Path, role: Role = "tests", *, by_hand: bool = False) -> ConditionTable:
    """Read a condition table, converting units by the endings of the column names.

    A CAE run may start at rest, a test may not. A list that is made ``by_hand`` may be as a spreadsheet writes it
    elsewhere.

    Raises
    ------
    DataError
        With every problem of the table.
    """
    problems: list[Problem] = []
    table = read_what_can_be(path, role, problems, by_hand=by_hand)
    if table is None or problems:
        raise DataError(shortened(problems))
    return table


def read_what_can_be(
    path: Path, role: Role, problems: list[Problem], *, by_hand: bool = False
) -> ConditionTable | None:
    """Read a condition table that may have problems, so that pulses can be checked against what is sound in it.

    As :func:`read_conditions`, but with every row that has an id of its own; NaN stands for a speed or weight that is
    not there. None if there are no such rows. Problems are appended to ``problems``.
    """
    frame, where = _read_text(path, role, problems, by_hand=by_hand), path.name
    if frame is None:
        return None
    names = list(map(str, frame.columns))
    columns = {
        name: pair
        for name, units in _QUANTITIES.items()
        if (pair := find_column(names, name, units, where, problems)) is not None
    }
    if "id" in names:
        frame["id"] = frame["id"].str.strip()
        sound = _check_ids(frame["id"], where, problems)
    else:
        found, advice = f"the columns {listed(names)}", "name each row in a column id"
        problems.append(Problem(where, "a column id", found, advice))
        sound = []
    values = {name: np.full(len(frame), np.nan) for name in _QUANTITIES}
    rows_of = frame.index.to_numpy()
    for name, (column, factor) in columns.items():
        numbers = not_a_number(frame[column], column, where, rows_of, problems, _LARGEST[name] / factor)
        smallest = 0.0 if role == "cae" and name == "speed" else _SMALLEST[name] / factor
        _check_low(numbers, smallest, frame[column], where, problems)
        values[name] = factor * numbers
    quality = read_quality(frame, where, problems)
    found_columns = [column for column, _ in columns.values()]
    extra = [name for name in names if name not in {"id", *QUALITIES, *found_columns}]
    _check_factors(frame[extra], where, problems)
    if not sound:
        return None
    factors = [tuple(zip(extra, row, strict=True)) for row in frame[extra].to_numpy(dtype=object).tolist()]
    rows = zip(values["speed"], values["front_weight"], values["rear_weight"], factors, strict=True)
    found_units = [column.rpartition("_")[2] for column in found_columns]
    given = (found_units[0], found_units[1], found_units[2]) if len(found_units) == len(FILE_UNITS) else FILE_UNITS
    conditions = tuple(Condition.of_vector([v, front, rear], fac, given) for v, front, rear, fac in rows)
    units = MPH_LB if "speed_mph" in names else KPH_KG
    table = ConditionTable(tuple(frame["id"]), conditions, tuple(frame.index), quality, units)
    return table if len(sound) == len(frame) else table.without(sorted({*range(len(frame))} - {*sound}))


def read_candidates(path: Path) -> tuple[Condition, ...]:
    """Read candidate test conditions from a table like ``tests.csv``; raise a DataError with every problem."""
    conditions = read_conditions(path, by_hand=True).conditions
    if (count := len(conditions)) > _MOST_CANDIDATES:
        expected, advice = f"at most {_MOST_CANDIDATES} candidates", "leave out those that are like others"
        raise DataError(Problem(path.name, expected, f"{count}", advice))
    return conditions


def _read_text(path: Path, role: Role, problems: list[Problem], *, by_hand: bool) -> pd.DataFrame | None:
    """All cells as text, indexed by their row in the file; None, and a problem, if it is not such a table."""
    if not path.exists():
        problems.append(Problem(path.name, "this file", "no such file", "add it"))
        return None
    try:
        names, rows, numbers = read_rows(path, path.name, by_hand=by_hand, most_rows=_MOST_ROWS[role])
    except DataError as error:
        problems.extend(error.problems)
        return None
    if not rows:
        problems.append(Problem(path.name, "a header and at least one row", "an empty table", "add the rows"))
        return None
    twice = [name for name, count in Counter(names).items() if name and count > 1]
    if twice:
        problems.append(Problem(path.name, "each column once", f"{listed(twice)} twice", "keep one of them"))
        return None
    kept = [at for at, name in enumerate(names) if name]
    cells = pd.DataFrame([[row[at] for at in kept] for row in rows], columns=[names[at] for at in kept], index=numbers)
    return cells.astype(str)


def _check_ids(ids: pd.Series, where: str, problems: list[Problem]) -> list[int]:
    """The places of the rows with a valid id that no row before has."""
    seen: dict[str, str] = {}
    sound: list[int] = []
    count = 0
    for place, (row, run_id) in enumerate(ids.items()):
        trouble = id_trouble(run_id)
        name = folded(run_id)
        if trouble is None and name in seen:
            trouble = same_name(run_id, seen[name])
        if trouble is not None:
            count += 1
            if count <= MOST_PROBLEMS:
                problems.append(Problem(where, *trouble, "id", row))
        else:
            sound.append(place)
        seen.setdefault(name, run_id)
    count_rest(count, MOST_PROBLEMS, "ids that are not fit", where, "id", problems)
    return sound


def _check_factors(cells: pd.DataFrame, where: str, problems: list[Problem]) -> None:
    """Reject text that cannot be displayed verbatim: control characters, overlong text."""
    expected = f"plain text of at most {_LONGEST_FACTOR} characters"
    for column in cells.columns:
        texts = {column, *cells[column].unique()}
        odd = {text for text in texts if len(text) > _LONGEST_FACTOR or printable(text) != text}
        bad = [(row, text) for row, text in [(1, column), *cells[column].items()] if text in odd] if odd else []
        shown = printable(column, 60)
        for row, text in bad[:MOST_PROBLEMS]:
            problems.append(Problem(where, expected, repr(printable(text, 60)), "correct the cell", shown, row))
        count_rest(len(bad), MOST_PROBLEMS, "cells that are no such text", where, shown, problems)


def _check_low(numbers: FloatArray, smallest: float, cells: pd.Series, where: str, problems: list[Problem]) -> None:
    low = np.flatnonzero(numbers < smallest)
    for index in low[:MOST_PROBLEMS]:
        expected = f"a number of at least {smallest:.3g}"
        found, row = cells.iloc[index], int(cells.index[index])
        problems.append(Problem(where, expected, found, "correct the cell", str(cells.name), row))
    count_rest(low.size, MOST_PROBLEMS, "numbers that are too low", where, str(cells.name), problems)
