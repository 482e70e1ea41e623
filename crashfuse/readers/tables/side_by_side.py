"""Splitting of side-by-side tables in one sheet, so that each acceleration keeps its own time."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from crashfuse.errors import printable
from crashfuse.readers.tables.headers import bare_name, names_a_test
from crashfuse.readers.tables.mapping import propose
from crashfuse.readers.tables.sheet import Sheet


def parted(sheet: Sheet) -> tuple[Sheet, ...]:
    """Split a sheet in which several accelerations have their own times: one sheet per time.

    Each has the columns from its time to the next; columns left of the first time are in all of them. A sheet with one
    time, or with an acceleration left of all times, is returned unchanged.
    """
    mapping = propose(sheet)
    roles = [use.role for use in mapping.uses]
    times = [number for number, role in enumerate(roles) if role == "time"]
    if mapping.kind != "pulses" or len(times) < 2 or roles.index("acceleration") < times[0]:
        return (sheet,)
    blocks = [(*range(times[0]), *range(*ends)) for ends in pairwise([*times, len(roles)])]
    titles = [next(filter(None, (sheet.titles[number] for number in block)), "") for block in blocks]
    tests = len(set(titles)) == len(titles) and all(map(names_a_test, titles))
    first = [next(number for number in block if roles[number] == "acceleration") for block in blocks]
    names = titles if tests else [bare_name(sheet.columns[number]) for number in first]
    return tuple(
        _part(sheet, block, name, "" if tests else sheet.name) for block, name in zip(blocks, names, strict=True)
    )


def _part(sheet: Sheet, block: Sequence[int], name: str, part_of: str) -> Sheet:
    columns = tuple(sheet.columns[number] for number in block)
    names = ", ".join(printable(column, 40) for column in columns)
    told = f"One of several times side by side, with the columns right of it: {names}."
    return replace(
        sheet,
        name=f"{sheet.name}: {printable(name, 60)}",
        columns=columns,
        units=tuple(sheet.units[number] for number in block),
        cells=sheet.cells.iloc[:, list(block)],
        titles=tuple(sheet.titles[number] for number in block),
        steps=(*sheet.steps, told),
        part_of=part_of,
    )
