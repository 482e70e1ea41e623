"""A draft of an import: what could be added and what could not, record by record, before anything is."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.importing.choices import Choices, Role
from crashfuse.importing.joined_tables import ColumnChoice, OneCrashOrSeveral
from crashfuse.importing.settle import Settled, settle
from crashfuse.importing.sources import Format, each_record
from crashfuse.readers.record import Record


@dataclass(frozen=True, slots=True)
class Reading:
    """How a source is to be read; see :func:`crashfuse.importing.read_records`."""

    source: Path
    fmt: Format | None = None
    columns: tuple[ColumnChoice, ...] = ()
    together: bool = False
    conditions: Path | None = None


def read_each(reading: Reading) -> tuple[tuple[Record, ...], tuple[Problem, ...]]:
    """Read every record of a source that can be read, and tell of the others."""
    problems: list[Problem] = []
    records: list[Record] = []
    try:
        records += each_record(
            reading.source,
            problems,
            reading.fmt,
            columns=reading.columns,
            together=reading.together,
            conditions=reading.conditions,
        )
    except OneCrashOrSeveral:
        pass  # a draft shows each, and its reader says whether to take them together
    except DataError as error:
        problems += error.problems
    return tuple(records), tuple(problems)


def settle_each(
    records: Sequence[Record], choices: Choices = Choices(), *, role: Role = "tests", raw: bool = False
) -> tuple[tuple[Settled, ...], tuple[Problem, ...]]:
    """Settle every record that can be settled, and tell of the others; see :func:`crashfuse.importing.settle`."""
    settled: list[Settled] = []
    problems: list[Problem] = []
    for record in records:
        try:
            settled.append(settle(record, choices, role=role, raw=raw))
        except DataError as error:
            problems += [named(record, problem) for problem in error.problems]
        except UsageError as error:
            problems.append(Problem(record.source, f"choices that fit {record.id}", str(error), "choose otherwise"))
    return tuple(settled), tuple(problems)


def named(record: Record, problem: Problem) -> Problem:
    """The problem with its record named: many records may have one source."""
    told = re.search(rf"(?<!\w){re.escape(record.id)}(?!\w)", f"{problem.where} {problem.expected}")
    return problem if told else replace(problem, where=f"{problem.where}, {record.id}")
