"""LabVIEW measurement files (.lvm): a header, then segments, each with a header, names of channels, and samples.

The rows of a segment's header say, in the column of each channel, its unit (``Y_Unit_Label``), its step (``Delta_X``)
and when it begins (``X0`` after ``Date`` and ``Time``). Times may also stand left of the samples: of all channels
(``X_Columns One``) or of each (``Multi``).

Source: NI, Specification for the LabVIEW Measurement File (.lvm).
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import chain, pairwise

import numpy as np
import pandas as pd

from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.tables.sheet import Header, Sheet, sheet_of, unique
from crashfuse.signals.pulse import FloatArray

_TIME = "X_Value"
_GAP = re.compile(r"[\t,;]")
_DELIMITERS = {"Comma": ",", "Semicolon": ";"}  # else tab
_MOST_COLUMNS, _MOST_COLUMNS_IN_ALL, _MOST_CELLS = 2000, 20_000, 20_000_000
_SAME_S = 1e-6  # times that differ by less are one
_APART = "save each segment as a file of its own"
_LONGEST_GAP = 1.5  # steps between segments that continue each other

Cells = Callable[[Sequence[str], str, int, str, int], pd.DataFrame]


@dataclass(frozen=True, eq=False, slots=True)
class _Segment:
    """The rows of a segment's header by their tags, the names of its columns, and the lines of its samples."""

    tags: Mapping[str, Sequence[str]]
    names: Sequence[str]
    first_row: int
    lines: list[str]


@dataclass(frozen=True, eq=False, slots=True)
class _Channel:
    """A channel with its samples as text, at their times."""

    name: str
    unit: str
    samples: pd.Series
    time_s: FloatArray


def is_labview(line: str) -> bool:
    """Whether the first line of a text is that of a LabVIEW measurement file."""
    return line.startswith("LabVIEW Measurement")


def labview_sheet(lines: Sequence[str], name: str, cells_of: Cells) -> Sheet:
    """Read the samples of all segments as one table; channels that begin at other times have their own to their left.

    Parameters
    ----------
    lines : sequence of str
        Of the file.
    name : str
        Of the file.
    cells_of : callable
        Splits lines: takes them, the delimiter, the number of columns, the name of the file and the first line's row.

    Raises
    ------
    DataError
        If there are no samples, their times are unknown, or segments do not continue each other.
    """
    said = {line[: match.start()]: line[match.end() :].strip() for line in lines[:100] if (match := _GAP.search(line))}
    delimiter = _DELIMITERS.get(said.get("Separator", ""), "\t")
    segments = list(_segments(lines, delimiter))
    if not segments:
        advice = "save the measurement again, with its headers"
        raise DataError(Problem(name, f"samples below a row of names that begins with {_TIME}", "none", advice))
    decimal = "," if "," in said.get("Decimal_Separator", said.get("Time", "")) else "."
    _check_alike(segments, name)
    lines = list(chain.from_iterable(segment.lines for segment in segments))
    cells = cells_of(lines, delimiter, len(segments[0].names), name, segments[0].first_row)
    columns: list[tuple[str, str, pd.Series]] = []
    clock_s: FloatArray | None = None
    for channel in _channels(segments, cells, decimal, name):
        if clock_s is None or not np.allclose(clock_s, channel.time_s, rtol=0, atol=_SAME_S, equal_nan=True):
            clock_s = channel.time_s
            _check_continues(clock_s, segments, name)
            columns.append((_TIME, "s", _text(clock_s)))
        columns.append((channel.name, channel.unit, channel.samples))
    names, units, series = zip(*columns, strict=True)
    header = Header(segments[0].first_row - 1, unique(names), units, ("",) * len(names))
    joined = [f"{len(segments)} segments that continue each other are joined."] if len(segments) > 1 else []
    cells = pd.concat(series, axis="columns", ignore_index=True)
    return sheet_of(name, header, cells, decimal, "A LabVIEW measurement.", *joined)


def _segments(lines: Sequence[str], delimiter: str) -> Iterator[_Segment]:
    """The segments of a file that have samples."""
    tags: dict[str, Sequence[str]] = {}
    segment: _Segment | None = None
    special = False
    for row, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in line.split(delimiter)]
        if cells[0].startswith("***"):
            special = cells[0] == "***Start_Special***"
        elif special or not any(cells):
            continue
        elif cells[0] == "Channels":
            if segment is not None and segment.lines:
                yield segment
            tags, segment = {}, None
        elif cells[0] == _TIME:
            if segment is not None and segment.lines:
                yield segment
            segment = _Segment(tags, cells, row + 1, [])
        elif segment is None:
            tags[cells[0]] = cells
        else:
            segment.lines.append(line)
    if segment is not None and segment.lines:
        yield segment


def _channels(segments: Sequence[_Segment], cells: pd.DataFrame, decimal: str, name: str) -> Iterator[_Channel]:
    """The channels of all segments, their times by the clock of the first."""
    names = segments[0].names
    times = [number for number, text in enumerate(names) if text == _TIME]
    channels = [number for number, text in enumerate(names) if text != _TIME]
    if names[-1].casefold() == "comment":
        channels.remove(len(names) - 1)
    ends = np.cumsum([len(segment.lines) for segment in segments])[:-1]
    for number in channels:
        beside = cells.iloc[:, max(time for time in times if time < number)].str.replace(decimal, ".", regex=False)
        stated = np.split(pd.to_numeric(beside, errors="coerce").to_numpy(np.float64), ends)
        parts = [
            _times(segment, number, channels[0], decimal, time_s, is_shared=len(times) == 1)
            for segment, time_s in zip(segments, stated, strict=True)
        ]
        time_s = np.concatenate(parts)
        if not np.isfinite(time_s).any():
            expected, advice = (
                f"times, or X0 and Delta_X, of {printable(names[number], 60)}",
                "save them with the samples",
            )
            raise DataError(Problem(name, expected, "none", advice))
        unit = _cell(segments[0], "Y_Unit_Label", number)
        yield _Channel(names[number], unit, cells.iloc[:, number].reset_index(drop=True), time_s)


def _times(
    segment: _Segment, number: int, first: int, decimal: str, stated_s: FloatArray, *, is_shared: bool
) -> FloatArray:
    """The times of a channel: those stated left of it, if they are its own or of a channel that has the same clock."""
    start_s, step_s = (_number(segment, tag, number, decimal) for tag in ("X0", "Delta_X"))
    clock_s = [_number(segment, tag, first, decimal) for tag in ("X0", "Delta_X")]
    applies = not is_shared or np.allclose((start_s, step_s), clock_s, rtol=_SAME_S, atol=0, equal_nan=True)
    stamps = _stamp(segment, number), _stamp(segment, first)
    late_s = (stamps[0] - stamps[1]).total_seconds() if stamps[0] and stamps[1] else 0.0
    if applies and np.isfinite(stated_s).any():
        return stated_s + late_s
    return start_s + late_s + step_s * np.arange(stated_s.size)


def _check_alike(segments: Sequence[_Segment], name: str) -> None:
    """Raise a DataError if segments have other channels than the first, or all together are too large."""
    columns, n = len(segments[0].names), len(segments)
    if columns > _MOST_COLUMNS or columns * n > _MOST_COLUMNS_IN_ALL:
        expected = f"at most {_MOST_COLUMNS} columns, and {_MOST_COLUMNS_IN_ALL} in all segments"
        raise DataError(Problem(name, expected, f"{columns} in {n} segments", "save fewer channels"))
    if columns * sum(len(segment.lines) for segment in segments) > _MOST_CELLS:
        raise DataError(Problem(name, f"at most {_MOST_CELLS} cells", "more", "save fewer channels"))
    for segment in segments:
        if segment.names != segments[0].names:
            expected, found = "the same channels in all segments", "others"
            raise DataError(Problem(name, expected, found, _APART, row=segment.first_row - 1))


def _check_continues(time_s: FloatArray, segments: Sequence[_Segment], name: str) -> None:
    """Raise a DataError unless each segment goes on where the one before it ends."""
    begin = 0
    for one, other in pairwise(segments):
        begin += len(one.lines)
        gap_s, step_s = time_s[begin] - time_s[begin - 1], np.diff(time_s[max(begin - 2, 0) : begin])
        if not 0 < gap_s <= _LONGEST_GAP * (step_s[0] if step_s.size else np.inf):
            found = f"one that begins at {time_s[begin]:.6g} s, after one that ends at {time_s[begin - 1]:.6g} s"
            raise DataError(Problem(name, "segments that continue each other", found, _APART, row=other.first_row))


def _stamp(segment: _Segment, number: int) -> datetime | None:
    """The date and time of a channel; None if the header does not say it."""
    day, clock = (_cell(segment, tag, number) for tag in ("Date", "Time"))
    try:
        return datetime.fromisoformat(f"{day.replace('/', '-')}T{clock}")
    except ValueError:
        return None


def _number(segment: _Segment, tag: str, number: int, decimal: str) -> float:
    try:
        return float(_cell(segment, tag, number).replace(decimal, "."))
    except ValueError:
        return np.nan


def _cell(segment: _Segment, tag: str, number: int) -> str:
    cells = segment.tags.get(tag, ())
    return cells[number] if number < len(cells) else ""


def _text(values: FloatArray) -> pd.Series:
    return pd.Series(["" if np.isnan(value) else repr(value) for value in values.tolist()], dtype=str)
