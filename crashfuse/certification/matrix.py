"""The matrix of conditions that verdicts are wanted for: from a table, or as a grid."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Self, TypeAlias

import numpy as np
import pandas as pd

from crashfuse.campaign_folder.condition_tables import read_conditions
from crashfuse.campaign_folder.writer import in_memory
from crashfuse.condition import FILE_UNITS, Condition
from crashfuse.errors import DataError, Problem, UsageError, require_a, several, shortened
from crashfuse.files.csv_text import csv_bytes
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.estimate import BOUNDS, is_beyond
from crashfuse.units import KPH, Sentence

_MOST = 10_000  # each costs a prediction
SAME_SPEED_MPS, SAME_WEIGHT = 1 * KPH, 0.02
"""A test is made for a planned condition up to so much from it: what protocols of barrier tests allow in speed, and the
relative difference in weight of a repeat."""


@dataclass(frozen=True, slots=True)
class Matrix:
    """Conditions with unique ids, none of them twice; a UsageError if there is none, or more than 10,000."""

    ids: tuple[str, ...]
    conditions: tuple[Condition, ...]

    def __post_init__(self) -> None:
        for i in several(self.ids):
            require_a(str, i, "the id of a condition")
        for condition in several(self.conditions):
            require_a(Condition, condition, "crashfuse.Condition.of(speed_mph=…, …)")
        if not 0 < len(self.ids) <= _MOST:
            raise UsageError(f"A matrix has 1 to {_MOST:,} conditions, not {len(self.ids):,}.")

    def __repr__(self) -> str:
        return f"<Matrix of {len(self.ids)} condition{'s' * (len(self.ids) > 1)}>"

    @property
    def items(self) -> tuple[tuple[str, Condition], ...]:
        """Each condition with its id."""
        return tuple(zip(self.ids, self.conditions, strict=True))

    def made_for(self, tests: Iterable[tuple[str, Condition]]) -> dict[str, str]:
        """The condition that each test was made for: the nearest up to 1 km/h and 2 % of each weight away, by id."""
        return {test: self.ids[near[0]] for test, _, near in self._near(tests) if near}

    def run(self, tests: Iterable[tuple[str, Condition]]) -> tuple[tuple[str, ...], ...]:
        """By condition the ids of the tests that were made for it, or are at it although another one is nearer."""
        found: list[list[str]] = [[] for _ in self.ids]
        for test, there, near in self._near(tests):
            for place in near:
                if place == near[0] or there.is_at(self.conditions[place]):
                    found[place].append(test)
        return tuple(map(tuple, found))

    def _near(self, tests: Iterable[tuple[str, Condition]]) -> Iterator[tuple[str, Condition, list[int]]]:
        planned = self._vectors
        for test, there in tests:
            away = _away(there, planned)
            near = sorted(np.flatnonzero(away <= 1).tolist(), key=away.__getitem__)
            yield test, there, [place for place in near if self.conditions[place].may_be(there)]

    def alike(self, *groups: Sequence[str]) -> dict[str, str]:
        """Conditions that are another one up to 1 km/h and 2 % of each weight, with that one's id.

        Those of the groups stand for others, in their order, then the first of the matrix; never for another group's.
        """
        conditions, planned = dict(self.items), self._vectors
        group = {i: place for place, ids in enumerate(groups) for i in ids}
        found: dict[str, str] = {}
        for i in (*group, *self.ids):
            if i not in found:
                near = (self.ids[place] for place in np.flatnonzero(_away(conditions[i], planned) <= 1))
                own = [other for other in near if group.get(other, group.get(i)) == group.get(i)]
                found |= {other: i for other in own if other not in found and conditions[other].may_be(conditions[i])}
        return {i: other for i, other in found.items() if i != other}

    @property
    def _vectors(self) -> FloatArray:
        return np.array([own.vector for own in self.conditions])

    @classmethod
    def read(cls, path: Path, factors: Mapping[str, Sequence[str]]) -> Self:
        """Read ``matrix.csv``, a table like ``tests.csv``, by the campaign's factors; a DataError has every problem."""
        table, file = read_conditions(path, by_hand=True), path.name
        if len(table.ids) > _MOST:
            found = f"{len(table.ids):,}"
            raise DataError(Problem(file, f"at most {_MOST:,} conditions", found, "split the table"))
        problems: list[Problem] = []
        if unknown := [name for name, _ in table.conditions[0].factors if name not in factors]:
            known = f"no further columns than those of tests.csv ({', '.join(factors) or 'none'})"
            problems.append(Problem(file, known, ", ".join(unknown), "rename or remove the column"))
        first: dict[Condition, str] = {}
        for i, condition, row in zip(table.ids, table.conditions, table.rows, strict=True):
            if first.setdefault(condition, i) != i:
                again = f"that of {first[condition]} again"
                problems.append(Problem(file, "each condition once", again, "remove one", "id", row))
            elif is_beyond(condition):
                problems.append(Problem(file, BOUNDS, str(condition), "correct the cell", "id", row))
        if problems:
            raise DataError(shortened(problems))
        return cls(table.ids, table.conditions)

    @classmethod
    def of(cls, frame: pd.DataFrame, factors: Mapping[str, Sequence[str]]) -> Self:
        """Create from a table with the columns of ``matrix.csv``; raises as :meth:`read`, rows count from 0."""
        with in_memory() as folder:
            path = folder / "matrix.csv"
            path.write_bytes(csv_bytes(frame, float_format=None))
            return cls.read(path, factors)

    @classmethod
    def grid(
        cls,
        speeds_mps: Sequence[float],
        front_weights_kg: Sequence[float],
        rear_weights_kg: Sequence[float],
        factors: Mapping[str, Sequence[str]],
        units: tuple[str, str, str] = FILE_UNITS,
    ) -> Self:
        """Every combination of these values, numbered from ``M001``; a UsageError for one given twice, or too many."""
        given = {"speed": speeds_mps, "front weight": front_weights_kg, "rear weight": rear_weights_kg}
        for name, values in given.items():
            if len(set(values)) < len(values) or not all(0 < value < float("inf") for value in values):
                raise UsageError(f"A grid takes each {name} once, as a number above 0.")
        kinds = [tuple(zip(factors, values, strict=True)) for values in product(*factors.values())]
        axes = list(product(speeds_mps, front_weights_kg, rear_weights_kg, kinds))
        if len(axes) > _MOST:
            raise UsageError(f"A matrix has at most {_MOST:,} conditions; this grid has {len(axes):,}.")
        ids = tuple(f"M{number:03d}" for number in range(1, len(axes) + 1))
        conditions = tuple(Condition.of_vector([v, front, rear], kind, units) for v, front, rear, kind in axes)
        if beyond := next(filter(is_beyond, conditions), None):
            raise UsageError(Sentence("No barrier test is made at {}: a grid has {}.", beyond, BOUNDS))
        return cls(ids, conditions)


MatrixGiven: TypeAlias = str | Path | pd.DataFrame | Matrix
"""``matrix.csv``, its columns, or conditions as they are judged."""


def matrix_given(given: MatrixGiven, factors: Mapping[str, Sequence[str]]) -> Matrix:
    """Conditions in any form in which the library takes them; raises as :meth:`Matrix.read`."""
    if isinstance(given, Matrix):
        return given
    if isinstance(given, pd.DataFrame):
        return Matrix.of(given, factors)
    require_a(str | Path, given, "the path of matrix.csv, or a DataFrame with its columns")
    return Matrix.read(Path(given), factors)


def _away(test: Condition, planned: FloatArray) -> FloatArray:
    """How far a test is from conditions, shape (n, 3): made for one at 1 or less."""
    allowed = np.column_stack([np.full(len(planned), SAME_SPEED_MPS), SAME_WEIGHT * planned[:, 1:]])
    off = np.abs(test.vector - planned) / allowed
    return np.asarray(off.max(axis=1) - 1e-9)  # to the last digit of units
