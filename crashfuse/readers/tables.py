"""The tables of a text file or workbook: CSV, TSV, LabVIEW or Excel, with any delimiter, decimal sign and header.

The delimiter and the decimal sign are those for which the most cells are numbers.

A LabVIEW measurement file (.lvm) has a header, then segments: unit, step and begin of each channel in its column, its
name, samples; times may stand left of these, of all channels or of each (NI, LabVIEW Measurement File).
"""

import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import accumulate, chain, islice, pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from crashfuse.errors import CHECK_PATH, NO_FILE, printable, refusal, refuse_if
from crashfuse.files.archive import Limits
from crashfuse.readers import table_sheet
from crashfuse.readers.members import as_text
from crashfuse.readers.table_headers import Heading
from crashfuse.readers.table_mapping import propose
from crashfuse.readers.table_sheet import SAMPLE, SHEET_LIMITS, Header, Sheet
from crashfuse.readers.vocabulary import HEADERS, UNITS, plain, unit_named, words
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import time_text

_TIME = "X_Value"
_GAP = re.compile(r"[\t,;]")
_ENCODINGS, _HEAD_BYTES = ("cp1252", "cp932", "gb18030", "cp949", "cp1251", "cp1250", "cp1254"), 4096
_KNOWN = words("acceleration", "time", "body", "dummy", "vehicle", "ahead", "direction")
_DELIMITERS = {"Comma": ",", "Semicolon": ";"}  # else tab
_MOST_COLUMNS, _MOST_COLUMNS_IN_ALL = 2000, 20_000  # of a LabVIEW file
_SAME_S = 1e-6  # times that differ by less are one
_APART = "save each segment by itself"
_LONGEST_CELL = 10  # lines
_LONGEST_GAP = 1.5  # steps between segments that continue each other
_MOST_CELLS, _LONGEST_LINE = 20_000_000, 1 << 18
_LARGEST_SAMPLE = 1 << 20  # characters
_AGAIN, _SHORTER = "export it again as CSV", "export a shorter record"
_GROUPED_CELLS = re.compile(r"(?<![\w.])[-+]?[1-9]\d{0,2},\d{3}(?!\d)(\.\d+)?")
_DECIMALS = re.compile(r"-0,\d+|[-+]?\d+,(0\d+|\d+[eE][-+]?\d+)")
_BETWEEN_NAMES = (r"\s{2,}|\t", r"(?<=[)\]])\s+", r"\s+(?![\[(])", r"\s+")  # the likeliest first
_CLOCK = re.compile(
    r"\s*(?:[\w./-]+(?: days?)?[ T]+)?(-?)(?=\d+:\d+[:.,])(?:(\d+):)?(\d+):(\d+(?:[.,:]\d+)?)"
    r"(?: ?[AaPp][Mm]|Z|[+-]\d\d:?\d\d)?\s*"
)
_FEWEST_TIMES, _LONGEST_STEP_S, _DAY_S = 20, 0.1, 86400.0
_DIALECTS = (",.", ";,", ";.", "\t,", "\t.", "|.", " .", " ,", ",,")  # delimiter, decimal; the last of quoted cells


def _with_clock_in_seconds(sheet: Sheet) -> Sheet:
    def is_clock(cells: pd.Series) -> bool:
        return len(cells) >= _FEWEST_TIMES and all(all(some.str.fullmatch(_CLOCK)) for some in (cells[:SAMPLE], cells))

    column = next((name for name in sheet.columns if is_clock(sheet.column(name))), None)
    if column is None:
        return sheet
    signs, *parts = sheet.column(column).str.extract(_CLOCK).fillna("0").replace("[,:]", ".", regex=True).to_numpy().T
    time_s = np.array((3600.0, 60.0, 1.0)) @ np.array(parts, dtype=float) * np.where(signs == "-", -1.0, 1.0)
    time_s += _DAY_S * np.cumsum(np.diff(time_s, prepend=time_s[0]) < -_DAY_S / 2)
    used = [column]
    for name, cell in zip(sheet.columns, sheet.units, strict=True):
        unit = Heading(name, cell).use.unit or unit_named(name, "time")
        values = sheet.parsed(name) * UNITS["time"].get(unit or "", np.nan)
        if (np.diff(values) >= 0).all():
            return sheet  # a time that goes on
        if values.min() >= 0 and values.max() < 1:  # within the second
            time_s = np.floor(time_s) + values
            used.append(name)
    if not 0 < np.median(np.diff(time_s)) <= _LONGEST_STEP_S:
        return sheet
    first_s = max(time_s[0], 0.0)
    place, cells = sheet.columns.index(column), sheet.cells.copy()
    cells.isetitem(place, pd.Series(map(repr, (time_s - first_s).tolist()), dtype=str))
    units = (*sheet.units[:place], "s", *sheet.units[place + 1 :])
    names = " and ".join(printable(name, 40) for name in used)
    note = f"Time by the clock of {names}, from {time_text(time_s[0] - first_s)} on."
    sheet = replace(sheet, cells=cells, units=units, steps=(*sheet.steps, note))
    return sheet.of_columns([number for number, name in enumerate(sheet.columns) if name not in used[1:]])


def _split_by_clock(sheet: Sheet) -> tuple[Sheet, ...]:
    """Columns left of the first time are in all sheets."""
    sheet = _with_clock_in_seconds(sheet)
    mapping = propose(sheet)
    roles = [use.role for use in mapping.uses]
    times = [number for number, role in enumerate(roles) if role == "time"]
    if mapping.kind != "pulses" or len(times) < 2 or roles.index("acceleration") < times[0]:
        return (sheet,)
    blocks = [(*range(times[0]), *range(*ends)) for ends in pairwise([*times, len(roles)])]
    cells = [[row[number] for row in sheet.titles for number in block if row[number]] for block in blocks]
    titles = [next((cell for cell in of if HEADERS["test"].fullmatch(plain(cell))), "") for of in cells]
    tests = len(set(titles)) == len(titles) and all(titles)
    parts = []
    for block, title in zip(blocks, titles, strict=True):
        first = next(number for number in block if roles[number] == "acceleration")
        columns = sheet.of_columns(block)
        note = f"One of several times side by side: {', '.join(printable(name, 40) for name in columns.columns)}."
        name = f"{sheet.name}: {printable(title if tests else Heading(sheet.columns[first]).name, 60)}"
        parts.append(replace(columns, name=name, part_of="" if tests else sheet.name, steps=(*sheet.steps, note)))
    return tuple(parts)


_Column = tuple[str, str, pd.Series]  # name, unit and cells


@dataclass(frozen=True, eq=False, slots=True)
class _Segment:
    tags: Mapping[str, Sequence[str]]
    names: Sequence[str]
    first_row: int
    decimal: str
    lines: list[str] = field(default_factory=list)

    def cell(self, tag: str, channel: int) -> str:
        cells = self.tags.get(tag, ())
        return cells[channel] if channel < len(cells) else ""

    def number(self, tag: str, channel: int) -> float:
        with suppress(ValueError):
            return float(self.cell(tag, channel).replace(self.decimal, "."))
        return np.nan

    def begin(self, channel: int) -> datetime | None:
        with suppress(ValueError):
            day = self.cell("Date", channel).replace("/", "-")
            return datetime.fromisoformat(f"{day}T{self.cell('Time', channel)}")
        return None

    def times(self, stated_s: FloatArray, channel: int, first: int, *, is_shared: bool) -> FloatArray:
        clock_s, clocks_s = ([self.number(tag, one) for tag in ("X0", "Delta_X")] for one in (channel, first))
        applies = not is_shared or np.allclose(clock_s, clocks_s, rtol=_SAME_S, atol=0, equal_nan=True)
        begin, first_begin = self.begin(channel), self.begin(first)
        late_s = (begin - first_begin).total_seconds() if begin and first_begin else 0.0
        counted_s = clock_s[0] + clock_s[1] * np.arange(stated_s.size)
        return late_s + (stated_s if applies and np.isfinite(stated_s).any() else counted_s)


def _labview_sheet(lines: Sequence[str], name: str) -> Sheet:
    pairs = (_GAP.split(line, maxsplit=1) for line in lines[:100] if _GAP.search(line))
    entries = {name: value.strip() for name, value in pairs}
    delimiter = _DELIMITERS.get(entries.get("Separator", ""), "\t")
    decimal = "," if "," in entries.get("Decimal_Separator", entries.get("Time", "")) else "."
    segments = _segments(lines, delimiter, decimal)
    expected = f"samples below names that begin with {_TIME}"
    refuse_if(not segments, name, expected, "none", "save it with its headers")
    first, n = segments[0], len(segments)
    lines, width = list(chain.from_iterable(segment.lines for segment in segments)), len(first.names)
    are_many = width > _MOST_COLUMNS or width * n > _MOST_COLUMNS_IN_ALL or width * len(lines) > _MOST_CELLS
    expected = f"at most {_MOST_COLUMNS} columns ({_MOST_COLUMNS_IN_ALL} in all segments) and {_MOST_CELLS} cells"
    refuse_if(are_many, name, expected, f"{width} columns in {n} segments", "save fewer channels")
    for other in segments:
        is_other, row = other.names != first.names, other.first_row - 1
        refuse_if(is_other, name, "the same channels in all segments", "others", _APART, row=row)
    cells = _cells(lines, delimiter, width, name, first.first_row)
    columns: list[_Column] = []
    clock_s = np.full(len(lines), np.inf)
    for channel, time_s in _channels(segments, cells, decimal, name):
        if not np.allclose(clock_s, time_s, rtol=0, atol=_SAME_S, equal_nan=True):
            clock_s = time_s
            _check_continues(clock_s, segments, name)
            texts = ["" if np.isnan(value) else repr(value) for value in clock_s.tolist()]
            columns.append((_TIME, "s", pd.Series(texts, dtype=str)))
        columns.append(channel)
    names, units, series = zip(*columns, strict=True)
    header = Header(first.first_row - 1, table_sheet.unique(names), units)
    form = ["A LabVIEW measurement.", *[f"{n} segments are joined."] * (n > 1)]
    return table_sheet.sheet_of(name, header, pd.concat(series, axis=1, ignore_index=True), decimal, *form)


def _segments(lines: Sequence[str], delimiter: str, decimal: str) -> list[_Segment]:
    segments, tags, special = list[_Segment](), dict[str, Sequence[str]](), False
    segment: _Segment | None = None
    for row, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in line.split(delimiter)]
        if cells[0].startswith("***"):
            special = cells[0] == "***Start_Special***"
        elif special or not any(cells):
            continue
        elif cells[0] == "Channels":
            tags, segment = {}, None
        elif cells[0] == _TIME:
            segment = _Segment(tags, cells, row + 1, decimal)
            segments.append(segment)
        elif segment is None:
            tags[cells[0]] = cells
        else:
            segment.lines.append(line)
    return [segment for segment in segments if segment.lines]


def _channels(
    segments: list[_Segment], cells: pd.DataFrame, decimal: str, name: str
) -> Iterator[tuple[_Column, FloatArray]]:
    names = segments[0].names
    times = [number for number, text in enumerate(names) if text == _TIME]
    channels = [number for number, text in enumerate(names) if text != _TIME]
    if names[-1].casefold() == "comment":
        channels.remove(len(names) - 1)
    ends = np.cumsum([len(segment.lines) for segment in segments])[:-1]
    for number in channels:
        clock = cells.iloc[:, max(time for time in times if time < number)].str.replace(decimal, ".", regex=False)
        stated = np.split(pd.to_numeric(clock, errors="coerce").to_numpy(np.float64), ends)
        pairs, shared = zip(segments, stated, strict=True), len(times) == 1
        time_s = np.concatenate([one.times(of, number, channels[0], is_shared=shared) for one, of in pairs])
        expected = f"times, or X0 and Delta_X, of {printable(names[number], 60)}"
        refuse_if(not np.isfinite(time_s).any(), name, expected, "none", "save them too")
        unit = segments[0].cell("Y_Unit_Label", number)
        yield (names[number], unit, cells.iloc[:, number].reset_index(drop=True)), time_s


def _check_continues(time_s: FloatArray, segments: Sequence[_Segment], name: str) -> None:
    begin = 0
    for one, other in pairwise(segments):
        begin += len(one.lines)
        last_s, first_s, step_s = time_s[begin - 1], time_s[begin], np.diff(time_s[max(begin - 2, 0) : begin])
        is_apart = not 0 < first_s - last_s <= _LONGEST_GAP * (step_s[0] if step_s.size else np.inf)
        found = f"one from {first_s:.6g} s on after one to {last_s:.6g} s"
        refuse_if(is_apart, name, "segments that continue each other", found, _APART, row=other.first_row)


def read_sheets(path: Path, limits: Limits = SHEET_LIMITS) -> tuple[Sheet, ...]:
    """The tables of a file: one per sheet, or one per time column in it."""
    name, suffix = path.name, path.suffix.lower()
    refuse_if(not path.is_file(), str(path), "a table", NO_FILE, CHECK_PATH)
    is_larger = path.stat().st_size > limits.member_bytes
    refuse_if(is_larger, name, f"at most {limits.member_bytes >> 20} MiB a table", "more", _SHORTER)
    refuse_if(suffix == ".xls", name, "an .xlsx workbook", "an .xls file", "save it as .xlsx")
    is_book = suffix in (".xlsx", ".xlsm")
    sheets = table_sheet.read_workbook(path, limits) if is_book else (_text_sheet(path, limits),)
    return tuple(part for sheet in sheets for part in _split_by_clock(sheet))


def _text_sheet(path: Path, limits: Limits) -> Sheet:
    content = path.read_bytes()
    are_many = content.count(b"\n") + content.count(b"\r") > 2 * limits.rows
    refuse_if(are_many, path.name, f"at most {limits.rows} rows", "more", _SHORTER)
    text = _decoded(content, path.name)
    lines = _with_quoted_breaks_joined(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"))
    del content, text
    is_longer = max(map(len, lines)) > _LONGEST_LINE
    refuse_if(is_longer, path.name, f"lines of at most {_LONGEST_LINE} characters", "a longer one", _AGAIN)
    sample = lines[: max(1, min(SAMPLE, _LARGEST_SAMPLE // (1 + max(map(len, lines[:SAMPLE])))))]
    if lines[0].startswith("LabVIEW Measurement"):
        return _labview_sheet(lines, path.name)
    is_plot = lines[0].strip() == "Curveplot"
    refuse_if(is_plot, path.name, "a table", "a curve file of LS-PrePost", "save the curves as CSV")
    delimiter, decimal = _dialect([line for line in sample if line.strip()], path.name)
    grid = [_split(line, delimiter) for line in sample]
    if delimiter == " ":
        grid = _with_whole_names(sample, grid, decimal)
    if delimiter == "," and decimal == ".":
        _check_commas(grid, path.name)
    names = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}
    form = f"Columns separated by {names[delimiter]}, decimal {names.get(decimal, 'point')}."
    header = table_sheet.header_of(grid, decimal, path.name, sample)
    rest = lines[header.begin :]
    while rest and not rest[-1].strip(f" {delimiter}"):
        rest.pop()
    are_many = len(rest) * len(header.columns) > _MOST_CELLS
    refuse_if(are_many, path.name, f"at most {_MOST_CELLS} cells", "more", "export fewer columns")
    cells = _cells(rest, delimiter, len(header.columns), path.name, header.begin + 1)
    return table_sheet.sheet_of(path.name, header, cells, decimal, form)


def _with_quoted_breaks_joined(lines: list[str]) -> list[str]:
    for first, line in enumerate(lines[:SAMPLE]):
        if line.count('"') % 2:
            quotes = accumulate(line.count('"') for line in lines[first : first + _LONGEST_CELL])
            last = next((first + n for n, count in enumerate(quotes) if count % 2 == 0), first)
            cell = " ".join(lines[first : last + 1])
            if last > first and re.search(r"[^\W\d_]", cell):
                return _with_quoted_breaks_joined([*lines[:first], cell, *lines[last + 1 :]])
    return lines


def _cells(lines: Sequence[str], delimiter: str, width: int, name: str, first_row: int) -> pd.DataFrame:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # cells beyond the width would be dropped
            text, between = io.StringIO("\n".join(lines)), r"\s+" if delimiter == " " else delimiter
            form = {"header": None, "names": range(width), "index_col": False, "dtype": str, "na_filter": False}
            return pd.read_csv(text, sep=between, skip_blank_lines=False, skipinitialspace=True, **form)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, pd.errors.ParserWarning, ValueError) as error:
        rows = ((at, _split(line, delimiter)) for at, line in enumerate(lines, start=first_row))
        longer = list(islice((row for row in rows if len(row[1]) > width), SAMPLE))
        if delimiter == ",":
            _refuse_commas_in_numbers(longer, name, is_ragged=True)
        found, advice = " ".join(str(error).split())[:160], f"export it again (data begin in row {first_row})"
        raise refusal(name, f"{width} cells in each row", found, advice) from None


def _check_commas(grid: Sequence[Sequence[str]], name: str) -> None:
    filled = ((at, row) for at, row in enumerate(grid) if len(row) > 1)
    rows = [(at, row) for at, row in filled if all(table_sheet.is_number(cell, ".") for cell in row if cell)]
    first = rows[0][0] if rows else 0
    names = max((sum(map(bool, row)) for row in grid[max(first - 2, 0) : first]), default=0)
    longer = [(at + 1, row) for at, row in rows if not names or len(row) > names]
    _refuse_commas_in_numbers(longer, name, is_ragged=bool(names) and len(longer) < len(rows))


def _refuse_commas_in_numbers(rows: Sequence[tuple[int, Sequence[str]]], name: str, *, is_ragged: bool) -> None:
    """Decimal commas: -0,063 is no -0 and 063. Thousands separators: -1,234.5 is no -1 and 234.5."""
    broken = [(at, match[0]) for at, row in rows if (match := _GROUPED_CELLS.search(",".join(row)))]
    if not is_ragged or len(broken) < len(rows):
        pairs = ((at, ",".join(pair)) for at, row in rows for pair in pairwise(row))
        has_points = any("." in cell for _, row in rows for cell in row)
        broken = [] if has_points else [(at, pair) for at, pair in pairs if _DECIMALS.fullmatch(pair)]
    for at, number in broken:
        expected, advice = "commas between columns or in numbers", "export it with semicolons"
        raise refusal(name, expected, f"both, as in {number}", advice, row=at)


def _decoded(content: bytes, name: str) -> str:
    encoding, text = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig", ""
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        text = "\0" if encoding == "utf-16" else _in_likeliest_encoding(content)
    refuse_if("\0" in text, name, "a table as text", "bytes that are no text", f"{_AGAIN} in UTF-8")
    return text


def _in_likeliest_encoding(content: bytes) -> str:
    known = {}  # the words that we know in the first lines
    for encoding in _ENCODINGS:
        with suppress(UnicodeDecodeError):
            head = content[: content.rfind(b"\n", 0, _HEAD_BYTES) + 1 or None].decode(encoding)
            known[encoding] = len(_KNOWN.findall(plain(head)))
    best = max(known, key=known.__getitem__, default="")
    return content.decode(best, errors="replace") if known.get(best) else as_text(content)


def _dialect(lines: Sequence[str], name: str) -> tuple[str, str]:
    best, best_score, best_width = "", 0.0, 0
    for delimiter, decimal in map(tuple, _DIALECTS):
        rows = [_split(line, delimiter) for line in lines]
        width = max(widths := Counter(len(row) for row in rows if len(row) > 1), key=widths.__getitem__, default=0)
        numbers = [sum(table_sheet.is_number(cell, decimal) for cell in row) for row in rows if len(row) == width]
        score = sum(count**2 for count in numbers) / max(width, 1)
        are_same = delimiter == " " and best.startswith("\t") and width == best_width  # names may hold blanks
        if score > best_score and not are_same:
            best, best_score, best_width = delimiter + decimal, score, width
    refuse_if(not best, name, "two columns of numbers", "none", _AGAIN)
    return best[0], best[1]


def _with_whole_names(lines: Sequence[str], grid: Sequence[list[str]], decimal: str) -> list[list[str]]:
    data = [2 * sum(table_sheet.is_number(cell, decimal) for cell in row) >= len(row) for row in grid]
    widths = Counter(len(row) for row, numeric in zip(grid, data, strict=True) if numeric and len(row) > 1)
    width = widths.most_common(1)[0][0] if widths else 0
    unnamed = [f"column {number}" for number in range(1, width + 1)]
    first = [row[0] for row, numeric in zip(grid, data, strict=True) if numeric]
    has_row_names = table_sheet.numbers_rows(pd.Series(first, dtype=str))

    def names(line: str) -> list[str]:
        text = line.strip().lstrip("#%!*").strip()
        words = _split(text, " ")
        if len(words) == width or (len(words) == width - 1 and ('"' in text or has_row_names)):
            return words
        splits = (re.split(between, text) for between in _BETWEEN_NAMES)
        return next((cells for cells in splits if len(cells) == width), unnamed)

    rows = zip(lines, grid, data, strict=True)
    return [row if numeric or not line.strip() else names(line) for line, row, numeric in rows]


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " " and '"' in line:
        return [cell.strip('"') for cell in re.findall(r'(?:"[^"]*"|[^\s"])+', line)]
    if delimiter == " ":
        return re.split(r"\s+(?![\[(])", line.strip())
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    with suppress(csv.Error):
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    return [line]
