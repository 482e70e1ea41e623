"""Reader of the CSV that Radioss's converter (``th_to_csv``) makes of a time history.

Three things in it mislead. The labels of the global histories are those of one version of the solver, whatever was
written: where their number is another, all labels after them stand over the wrong columns, so labels are counted from
the right. Of the variables of a node it says only ``var 33``, unless the run wrote its titles (``/TH/TITLE``); they are
told apart in :mod:`~crashfuse.readers.radioss.unnamed`. And forces are impulses, unless it had those titles. Labels may
hold stray control characters, and the last row may be cut.
"""

import csv
import io
import re
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.radioss.time_history import ACCELEROMETER, GLOBAL, MOST_VALUES, TimeHistory, Watched
from crashfuse.signals.pulse import FloatArray

KIND = "the CSV of a time history of Radioss (th_to_csv)"

_BEGINS = re.compile(rb'\s*"?time"?\s*,\s*"?INTERNAL ENERGY"?\s*,\s*"?KINETIC ENERGY', re.IGNORECASE)
_UNNAMED = re.compile(r"(.*\S)\s+var\s+(\d{1,9})")
_NAMED = re.compile(r"(.*\S)\s+(\S+)")
_STRAY = re.compile(r"[^ -~\xa1-\xff]+")
_WIDTHS = (100, 80, 40)  # of titles
_CURVES = re.compile(r"[DVA][XYZ]|W[XYZ]")
_LONGEST_LABELS, _LONGEST_LABEL, _MOST_COLUMNS = 16 << 20, 1000, 20_000
_IMPORT = "import the time history itself (T01)"


def is_converted(path: PurePath, head: bytes) -> bool:
    """Whether a table is such a CSV, from its name and first bytes."""
    return path.suffix.lower() == ".csv" and _BEGINS.match(head) is not None


@dataclass(frozen=True, slots=True)
class _Column:
    """A column of a node or anything else of ``/TH``: the object's label, and the variable if it is named."""

    object: str
    variable: str | None
    place: int


def read_converted(content: bytes, where: str) -> TimeHistory:
    """Read the CSV from memory.

    Raises
    ------
    DataError
        If it is none, or is damaged.
    """
    labels, start = _labels(content, where)
    table, cut = _numbers(content[start:], where)
    known = {name.casefold() for name in GLOBAL} | {"no name"}
    first = 1 + next((i for i, label in enumerate(labels[1:]) if label.casefold() not in known), len(labels) - 1)
    rest = labels[first:]
    count = table.shape[1] - 1 - len(rest)  # global histories that were written
    if count < 0:
        expected = f"at least {1 + len(rest)} columns, as the header has"
        raise DataError(Problem(where, expected, f"{table.shape[1]}", _IMPORT))
    time = table[:, 0]
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        row = int(np.argmin(np.diff(time) > 0)) if np.isfinite(time).all() else 0
        found = f"{time[row + 1]:g} after {time[row]:g}" if time.size > row + 1 else "no number"
        raise DataError(Problem(where, "a time that increases from row to row", found, _IMPORT, "time", row + 3))
    model = {name: table[:, 1 + i] for i, name in enumerate(GLOBAL[:count])}
    columns = [_column(label, 1 + count + i, where) for i, label in enumerate(rest)]
    notes = ["The last row is cut short and left out."] if cut else []
    if count != first - 1:
        told = f"{first - 1} labels of global histories stand over {count} columns"
        notes.insert(0, f"{told}, so labels are counted from the right.")
    watched, unread = _watched(table, columns)
    return TimeHistory("", time, model, watched, unread, notes=tuple(notes))


def _watched(table: FloatArray, columns: list[_Column]) -> tuple[tuple[Watched, ...], tuple[str, ...]]:
    """Nodes and accelerometers, and what else there is."""
    objects: dict[str, list[_Column]] = {}
    for column in columns:
        objects.setdefault(column.object, []).append(column)
    watched: dict[str, Watched] = {}
    unread: list[str] = []
    for label, own in objects.items():
        if (split := _split(label)) is None:
            continue  # a part or subset
        group, number, title = split
        named = {column.variable: table[:, column.place] for column in own if column.variable is not None}
        curves = {name: values for name, values in named.items() if _CURVES.fullmatch(name)}
        if not named:
            curves = {f"var {column.place}": table[:, column.place] for column in own}
        if not curves:
            unread.append(f"{group} {number}".strip())
            continue
        name = number if any(curve[0] in "DVv" for curve in curves) else f"{ACCELEROMETER}{number}"
        others = watched[name].curves if name in watched else {}
        watched[name] = Watched(name, title or group, table[:, 0], {**curves, **others})
    return tuple(watched.values()), tuple(unread)


def _labels(content: bytes, where: str) -> tuple[list[str], int]:
    """The labels, without stray characters, and where the numbers begin; a label may hold a line break."""
    if _BEGINS.match(content[:200]) is None:
        raise DataError(Problem(where, KIND, "another kind of file", _IMPORT))
    end, quotes, breaks = 0, 0, 0
    while not end or quotes % 2:  # to the first line break outside quotes
        begin, end, breaks = end, content.find(b"\n", end, _LONGEST_LABELS) + 1, breaks + 1
        if not end or breaks > _MOST_COLUMNS:
            raise DataError(Problem(where, KIND, "no numbers", _IMPORT))
        quotes += content.count(b'"', begin, end)
    text = _STRAY.sub("", content[:end].decode("latin-1"))
    try:
        labels = next(csv.reader(io.StringIO(text)), [])
    except csv.Error as error:
        raise DataError(Problem(where, KIND, str(error), _IMPORT)) from error
    while labels and not labels[-1].strip():
        labels.pop()
    if max(len(labels), content[end : end + _LONGEST_LABELS].partition(b"\n")[0].count(b",")) > _MOST_COLUMNS:
        raise DataError(Problem(where, f"at most {_MOST_COLUMNS:,} columns", "more", _IMPORT))
    return [label[:_LONGEST_LABEL].strip() for label in labels], end


def _numbers(content: bytes, where: str) -> tuple[FloatArray, bool]:
    """The rows, shape (n_states, n_columns), and whether the last one is cut short."""
    cut = not content.endswith(b"\n") and b"\n" in content
    whole = content[: content.rfind(b"\n") + 1] if cut else content
    first = whole.partition(b"\n")[0]
    width = first.rstrip(b"\r,").count(b",") + 1
    if width * whole.count(b"\n") > MOST_VALUES:
        raise DataError(Problem(where, "the values of a run", "more than any has", "convert fewer of them"))
    try:
        frame = pd.read_csv(io.BytesIO(whole), header=None, dtype=np.float64, engine="c", index_col=False)
        table = frame.to_numpy(np.float64)[:, :width]
    except (ValueError, OverflowError, pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise DataError(Problem(where, "rows of numbers", printable(str(error)), _IMPORT)) from error
    if len(table) < 2:
        raise DataError(Problem(where, "at least two rows of numbers", f"{len(table)}", _IMPORT))
    short = np.isnan(table).any(axis=1)
    if short[:-1].any():
        row = int(short.argmax())
        found = f"{int((~np.isnan(table[row])).sum())}"
        raise DataError(Problem(where, f"{width} numbers", found, _IMPORT, row=row + 2))
    return (table[:-1], True) if short[-1] else (table, cut)


def _column(label: str, place: int, where: str) -> _Column:
    if found := _UNNAMED.fullmatch(label):
        if int(found[2]) != place:
            expected = f"the label of column {found[2]} over that column"
            raise DataError(Problem(where, expected, f"it over column {place}", _IMPORT, label))
        return _Column(found[1], None, place)
    found = _NAMED.fullmatch(label)
    return _Column(found[1], found[2], place) if found else _Column(label, None, place)


def _split(label: str) -> tuple[str, str, str] | None:
    """Group, number and title of an object; None of a part or subset, which has no number."""
    for width in _WIDTHS:
        if found := re.fullmatch(rf"(.{{{width}}}) (\d{{1,10}})(?: (.*))?", label):
            return found[1].strip(), found[2], (found[3] or "").strip()
    if found := re.fullmatch(r"(.*?)\s+(\d{1,10})(?:\s+(.*))?", label):
        return found[1].strip(), found[2], (found[3] or "").strip()
    return None
