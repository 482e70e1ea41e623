"""Reader of Radioss runs: the binary time history ``<run>T01``, or the CSV that ``th_to_csv`` makes of it.

A time history is a sequence of records, big-endian, framed by their length: a header that lists what is written, then
for each state its time, the global histories, those of parts and subsets, and those of each group of ``/TH``. Layout
and codes are those of the solver's own writer (``hist1.F``, ``hist2.F``, ``hm_read_thgrou.F``) and converter. Forces
are written as impulses since the start of the run.

The CSV misleads: its labels of global histories are those of one version of the solver, so labels are counted from the
right. Variables of a node are called ``var 33``, unless the run wrote its titles.
"""

import csv
import io
import re
import struct
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, dropwhile
from pathlib import Path, PurePath, PurePosixPath

import numpy as np
import numpy.typing as npt
import pandas as pd

from crashfuse.errors import CHECK_PATH, printable, refusal, refuse_if
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits, Member
from crashfuse.readers import radioss_history
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.members import COPY_AGAIN, CUT_SHORT, OTHER_KIND, opened_members, read_all
from crashfuse.readers.radioss_history import ACCELEROMETER, GLOBAL, MOST_VALUES, TimeHistory, Watched
from crashfuse.readers.record import Record
from crashfuse.readers.solver_run import CUT, read_listing, sha256_of
from crashfuse.readers.vocabulary import RADIOSS, Travel, iso_date
from crashfuse.signals.pulse import FloatArray

_KIND = "a Radioss time history (T01, CSV)"
_NODES, _WALLS, _ACCELEROMETERS = 0, 102, 108
_VARIABLES = {_NODES: RADIOSS["node"], _ACCELEROMETERS: RADIOSS["accelerometer"]}  # read, by the kind of a group
_UNREAD = {101: "interfaces", 103: "rigid bodies", 104: "sections", 105: "joints"}
_MOST_RECORDS, _MOST_COUNT, _MOST_CURVES = 2_000_000, 1_000_000, 100_000
_AGAIN = f"{COPY_AGAIN}, or write it in the default form (/TFILE/4)"
_BEGINS = re.compile(rb'\s*"?time"?\s*,\s*"?INTERNAL ENERGY"?\s*,\s*"?KINETIC ENERGY', re.IGNORECASE)
_UNNAMED = re.compile(r"(.*\S)\s+var\s+(\d{1,9})")
_NAMED = re.compile(r"(.*\S)\s+(\S+)")
_STRAY = re.compile(r"[^ -~\xa1-\xff]+")
_WIDTHS = (100, 80, 40)  # of titles
_CURVE_NAME = re.compile(r"[DVA][XYZ]|W[XYZ]")
_LONGEST_LABELS, _LONGEST_LABEL, _MOST_COLUMNS = 16 << 20, 1000, 20_000
_IMPORT = "import the T01 itself"
_NAME = re.compile(
    r"(?P<run>.*[^.])T(?P<part>\d\d)(?P<more>[a-i]?)|(?P<new_run>.+)_(?P<new_part>\d{4})(_(?P<new_more>[a-i]))?\.thy",
    re.IGNORECASE | re.DOTALL,
)
_BESIDE = re.compile(r".+_(?:(?!0000)\d{4}\.out|0000\.(?:rad|k|key))", re.IGNORECASE | re.DOTALL)
_HEAD = 200  # bytes
_Members = Mapping[PurePosixPath, Member]


def read_binary(content: bytes, where: str) -> TimeHistory:
    """Read a binary time history; a DataError if it is in another of Radioss's forms, or damaged."""
    return _BinaryFile(content, where).time_history()


@dataclass(frozen=True, slots=True)
class _Group:
    kind: int
    elements: int
    names: tuple[tuple[int, str], ...]
    codes: tuple[int, ...]


class _BinaryFile:
    def __init__(self, content: bytes, where: str) -> None:
        self._where = where
        self._records = self._framed(content)
        first = self._next()
        self._refuse_if(len(first) != 84 or not 1000 <= _ints(first[:4])[0] <= 9999, OTHER_KIND)
        self.title, self._about = _text(first[4:]), _about(_text(self._next()))
        counts = self._next()
        self._factors: tuple[float, ...] = ()
        if len(counts) == 4:  # newer forms: how many records follow here, the length of titles, factors of the units
            extras = [self._next() for _ in range(min(self._counts(counts, 1)[0], 10))]
            self._factors = next((struct.unpack(">3f", extra) for extra in extras[::-1] if len(extra) == 12), ())
            counts = self._next()
        parts, materials, sections, subsets, groups, globals_ = self._counts(counts, 6)
        self._codes = _ints(self._next()) if globals_ else ()
        sizes = [1, globals_, sum(self._variables() for _ in range(parts))]
        self._skip(materials + sections)
        sizes.append(sum(self._variables(lists=2) for _ in range(subsets)))
        self._groups = [self._group() for _ in range(groups)]
        sizes += [group.elements * len(group.codes) for group in self._groups]
        self._blocks = [size for size in sizes if size]
        written = [group for group in self._groups if group.elements and group.codes]
        self._written = list(enumerate(written, start=len(self._blocks) - len(written)))  # groups and their blocks
        self._places = [0, *accumulate(size + 2 for size in self._blocks)]  # of each record in a state, in words
        self._states, self._is_cut = self._data(content)

    def time_history(self) -> TimeHistory:
        time = self._block(0)[:, 0].astype(np.float64)
        codes = {name: code for code, name in enumerate(GLOBAL, start=1) if code in self._codes}
        unread = dict.fromkeys(f"impulses of {_UNREAD[one.kind]}" for one in self._groups if one.kind in _UNREAD)
        return TimeHistory(
            title=self.title,
            time=time,
            model={name: self._block(1)[:, self._codes.index(code)].astype(np.float64) for name, code in codes.items()},
            watched=self._watched(time),
            unread=tuple(unread),
            unit_factors=self._factors if all(0 < factor < 1e6 for factor in self._factors) else (),
            notes=(CUT,) * self._is_cut,
            about=self._about,
            walls=self._walls(),
        )

    def _walls(self) -> dict[str, FloatArray]:
        """Impulses by axis, normal (codes 1 to 3) and tangential (4 to 6)."""
        found: dict[str, FloatArray] = {}
        for at, group in self._written:
            codes = enumerate(group.codes if group.kind == _WALLS else ())
            for column, axis in ((column, "XYZ"[(code - 1) % 3]) for column, code in codes if 1 <= code <= 6):
                values = self._block(at)[:, column :: len(group.codes)].sum(axis=1, dtype=np.float64)
                found[axis] = found.get(axis, 0.0) + values
        return found

    def _watched(self, time: FloatArray) -> tuple[Watched, ...]:
        found, titles, curves = dict[str, dict[str, FloatArray]](), dict[str, str](), 0
        for at, group in self._written:
            names = enumerate(_VARIABLES.get(group.kind, ()), start=1)
            columns = {name: group.codes.index(code) for code, name in names if code in group.codes}
            curves += len(columns) * group.elements
            are_many = curves > _MOST_CURVES or curves * len(time) > MOST_VALUES
            expected = f"at most {_MOST_CURVES:,} variables with {MOST_VALUES:,} values"
            refuse_if(are_many, self._where, expected, "more", "watch fewer nodes (/TH/NODE)")
            values = self._block(at).reshape(len(time), group.elements, len(group.codes))
            for place, (number, title) in enumerate(group.names):
                name = f"{ACCELEROMETER}{number}" if group.kind == _ACCELEROMETERS else str(number)
                titles.setdefault(name, title)
                series = found.setdefault(name, {})
                for curve, column in columns.items():
                    series.setdefault(curve, values[:, place, column].astype(np.float64))
        return tuple(Watched(name, titles[name], time, series) for name, series in found.items())

    def _block(self, number: int) -> npt.NDArray[np.float32]:
        start = self._places[number] + 1
        return self._states[:, start : start + self._blocks[number]]

    def _data(self, content: bytes) -> tuple[npt.NDArray[np.float32], bool]:
        words = self._places[-1]
        states, left_over = divmod(len(content) - self._at, 4 * words)
        self._refuse_if(not states, "no state")
        raw = np.frombuffer(content, ">i4", count=states * words, offset=self._at).reshape(states, words)
        places = zip(self._places[:-1], self._blocks, strict=True)
        unlike = any((raw[:, [place, place + size + 1]] != 4 * size).any() for place, size in places)
        self._refuse_if(unlike, "states that are not alike")
        return raw.view(">f4"), bool(left_over)

    def _skip(self, count: int) -> None:
        for _ in range(count):
            self._next()

    def _variables(self, *, lists: int = 0) -> int:
        """Of a part, or of a subset, before which stand the lists of its children and parts."""
        record = self._next()
        counts = self._counts(record, 5)[-1 - lists :] if lists else self._counts(record[-4:], 1)
        self._skip(sum(map(bool, counts)))
        return counts[-1]

    def _group(self) -> _Group:
        head = self._next()
        _, kind, _, elements, variables = self._counts(head, 5)
        bodies = (self._next() for _ in range(elements))
        names = [(_ints(body[:4])[0], _text(body[4:]) or _text(head[20:])) for body in bodies if kind in _VARIABLES]
        return _Group(kind, elements, tuple(names), _ints(self._next()) if variables else ())

    def _framed(self, content: bytes) -> Iterator[bytes]:
        self._at = 0
        for _ in range(_MOST_RECORDS):
            if self._at + 8 > len(content):
                return
            size = struct.unpack_from(">i", content, self._at)[0]
            begin, end = self._at + 4, self._at + 4 + size
            if size < 0 or end + 4 > len(content) or struct.unpack_from(">i", content, end)[0] != size:
                return
            self._at = end + 4
            yield content[begin:end]

    def _next(self) -> bytes:
        record = next(self._records, b"")
        self._refuse_if(len(record) < 4, f"{CUT_SHORT}, or {OTHER_KIND}")
        return record

    def _counts(self, record: bytes, count: int) -> tuple[int, ...]:
        found = _ints(record[: 4 * count])
        is_short = len(record) < 4 * count
        self._refuse_if(is_short or not all(0 <= n <= _MOST_COUNT for n in found[-2:]), "a senseless header")
        return found

    def _refuse_if(self, wrong: object, found: str) -> None:
        refuse_if(wrong, self._where, _KIND, found, _AGAIN)


def _about(text: str) -> dict[str, str]:
    date, is_there, solver = text.partition(" RADIOSS ")
    words = solver.split(",", 1)
    name = words[0].strip() if is_there else ""
    return {"solver": name or "Radioss", "version": words[-1].strip(), "date": iso_date(date, "%a %b %d %H:%M:%S %Y")}


def _text(title: bytes) -> str:
    return printable(title.decode("latin-1").strip("\0 "))


def _ints(record: bytes) -> tuple[int, ...]:
    return struct.unpack(f">{len(record) // 4}i", record[: len(record) // 4 * 4])


def read_converted(content: bytes, where: str) -> TimeHistory:
    """Read a converted time history; a DataError if it is none, or damaged."""
    labels, start = _labels(content, where)
    table, cut = _numbers(content[start:], where)
    names = {name.casefold() for name in GLOBAL} | {"no name"}
    others = [*dropwhile(lambda label: label.casefold() in names, labels[1:])]
    count = table.shape[1] - 1 - len(others)  # global histories that were written
    refuse_if(count < 0, where, f"at least {1 + len(others)} columns", f"{table.shape[1]}", _IMPORT)
    time = table[:, 0]
    row, is_finite = int(np.argmin(np.diff(time, prepend=-np.inf) > 0)), np.isfinite(time).all()
    refuse_if(row or not is_finite, where, "a time that increases", f"{time[row]:g}", _IMPORT, "time", row + 2)
    model = {name: table[:, 1 + i] for i, name in enumerate(GLOBAL[:count])}
    watched, unread = _watched_of_csv(table, others, 1 + count, where)
    return TimeHistory("", time, model, tuple(watched), tuple(unread), notes=(CUT,) if cut else ())


def _watched_of_csv(table: FloatArray, labels: list[str], start: int, where: str) -> tuple[list[Watched], list[str]]:
    objects = defaultdict[str, dict[str, FloatArray]](dict)
    for place, label in enumerate(labels, start):
        name, variable = _object_and_variable(label, place, where)
        objects[name][variable] = table[:, place]
    watched, unread = dict[str, Watched](), list[str]()
    for label, variables in objects.items():
        forms = (*(rf"(.{{{width}}}) (\d{{1,10}})(?: (.*))?" for width in _WIDTHS), r"(.*?)\s+(\d{1,10})(?:\s+(.*))?")
        match = next(filter(None, (re.fullmatch(form, label) for form in forms)), None)
        if match is None:
            continue  # a part or subset, which has no number
        group, number, title = ((text or "").strip() for text in match.groups())
        named = {name: values for name, values in variables.items() if not name.startswith("var ")}
        curves = {name: values for name, values in named.items() if _CURVE_NAME.fullmatch(name)} if named else variables
        if not curves:
            unread.append(f"{group} {number}".strip())
            continue
        name = number if any(curve[0] in "DVv" for curve in curves) else f"{ACCELEROMETER}{number}"
        others = watched[name].curves if name in watched else {}
        watched[name] = Watched(name, title or group, table[:, 0], {**curves, **others})
    return [*watched.values()], unread


def _labels(content: bytes, where: str) -> tuple[list[str], int]:
    refuse_if(_BEGINS.match(content[:_HEAD]) is None, where, _KIND, OTHER_KIND, _IMPORT)
    end, quotes, breaks = 0, 0, 0
    while not end or quotes % 2:  # to the first line break outside quotes
        begin, end, breaks = end, content.find(b"\n", end, _LONGEST_LABELS) + 1, breaks + 1
        refuse_if(not end or breaks > _MOST_COLUMNS, where, _KIND, "no numbers", _IMPORT)
        quotes += content.count(b'"', begin, end)
    text = _STRAY.sub("", content[:end].decode("latin-1"))
    try:
        labels = next(csv.reader(io.StringIO(text)), [])
    except csv.Error as error:
        raise refusal(where, _KIND, str(error), _IMPORT) from error
    width = max(len(labels), content[end : end + _LONGEST_LABELS].partition(b"\n")[0].count(b","))
    refuse_if(width > _MOST_COLUMNS, where, f"at most {_MOST_COLUMNS:,} columns", "more", _IMPORT)
    labels = [label[:_LONGEST_LABEL].strip() for label in labels]
    while labels and not labels[-1]:
        labels.pop()
    return labels, end


def _numbers(content: bytes, where: str) -> tuple[FloatArray, bool]:
    cut = not content.endswith(b"\n") and b"\n" in content
    whole = content[: content.rfind(b"\n") + 1] if cut else content
    width = whole.partition(b"\n")[0].rstrip(b"\r,").count(b",") + 1
    are_many = width * whole.count(b"\n") > MOST_VALUES
    refuse_if(are_many, where, f"at most {MOST_VALUES:,} values", "more", "convert fewer of them")
    try:
        frame = pd.read_csv(io.BytesIO(whole), header=None, dtype=np.float64, engine="c", index_col=False)
        table = frame.to_numpy(np.float64)[:, :width]
    except (ValueError, OverflowError, pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise refusal(where, "rows of numbers", printable(str(error)), _IMPORT) from error
    refuse_if(len(table) < 2, where, "at least two rows of numbers", f"{len(table)}", _IMPORT)
    short = np.isnan(table).any(axis=1)
    refuse_if(short[:-1].any(), where, f"{width} numbers", "fewer", _IMPORT, row=int(short.argmax()) + 2)
    return (table[:-1], True) if short[-1] else (table, cut)


def _object_and_variable(label: str, place: int, where: str) -> tuple[str, str]:
    if unnamed := _UNNAMED.fullmatch(label):
        is_elsewhere, expected = int(unnamed[2]) != place, f"this label over column {unnamed[2]}"
        refuse_if(is_elsewhere, where, expected, f"it over column {place}", _IMPORT, label)
        return unnamed[1], f"var {place}"
    named = _NAMED.fullmatch(label)
    return (named[1], named[2]) if named else (label, f"var {place}")


def read_radioss(path: Path, travel: Travel | None = None, limits: Limits = DEFAULT_LIMITS) -> tuple[Record, ...]:
    """Read Radioss runs (a time history, its CSV, a folder of one or of many, a zip), their parts joined."""

    def wanted(file: PurePath) -> bool:
        is_beside = file != path and _BESIDE.fullmatch(file.name) is not None
        return is_beside or FORMATS["radioss"].has(file) or (isinstance(file, Path) and is_time_history_csv(file))

    with opened_members(path, wanted, _KIND, limits) as (members, budget):
        others = {member.path: member for member in members if _BESIDE.fullmatch(member.path.name)}
        runs = _runs([member for member in members if member.path not in others], path)
        refuse_if(not runs, path.name, _KIND, "none", CHECK_PATH)

        def record(run_id: str) -> Record:
            first = runs[run_id][0].path
            history = _with_listing(_read(runs[run_id], budget), first, others, budget)
            return radioss_history.record_of(history, run_id, first.name, travel)

        return read_all(runs, record, path.name)


def _with_listing(history: TimeHistory, first: PurePosixPath, others: _Members, budget: Budget) -> TimeHistory:
    run, about = _parts_of_name(first.name)[0], dict(history.about)
    mine = [path for path in sorted(others) if path.parent == first.parent and path.name.startswith(f"{run}_")]
    for path in [path for path in mine if path.suffix.lower() == ".out"][-1:]:
        about |= read_listing(others[path].chunks(budget))
    for path in (path for path in mine if path.suffix.lower() != ".out"):
        about |= {"deck": path.name, "deck_sha256": sha256_of(others[path].chunks(budget))}
    return replace(history, about=about)


def is_time_history_csv(path: Path) -> bool:
    """Whether a file is the CSV of a time history, which any name may have."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    with path.open("rb") as stream:
        return _BEGINS.match(stream.read(_HEAD)) is not None


def _parts_of_name(name: str) -> tuple[str, int, str]:
    found = _NAME.fullmatch(name[:-4] if name.lower().endswith(".csv") else name)
    if found is None:
        return PurePath(name).stem, 1, ""
    run, part = found["run"] or found["new_run"], int(found["part"] or found["new_part"])
    return run, part, (found["more"] or found["new_more"] or "").lower()


def _runs(members: Sequence[Member], path: Path) -> dict[str, list[Member]]:
    has, is_one = FORMATS["radioss"].has, path.is_file() and path.suffix.lower() != ".zip"
    chosen = (True, not has(path), _parts_of_name(path.name)[0])
    original = {member.path for member in members if has(member.path)}
    found = defaultdict[tuple[str, str], list[Member]](list)
    for member in members:
        run, copied = _parts_of_name(member.path.name)[0], member.path not in original
        is_copy = copied and member.path.with_suffix("") in original
        if (len(member.path.parts) == 1, copied, run) == chosen if is_one else not is_copy:
            found["-".join(member.path.parts[:-1]), run].append(member)
    alone = len({run for _, run in found}) == len(found)
    return {run if alone or not folder else f"{folder}-{run}": files for (folder, run), files in found.items()}


def _read(files: Sequence[Member], budget: Budget) -> TimeHistory:
    by_file = defaultdict[str, list[tuple[int, str, Member]]](list)
    for file in files:
        _, part, more = _parts_of_name(file.path.name)
        by_file[more].append((part, file.where, file))
    histories = []
    for _, parts in sorted(by_file.items()):
        numbers, _, members = zip(*sorted(parts, key=lambda part: part[:2]), strict=True)
        names = [file.path.name for file in members]
        lacks, expected = numbers != (*range(1, len(parts) + 1),), "every part once, from T01 on"
        refuse_if(lacks, names[0], expected, " and ".join(names), "add those that are missing")
        histories.append(radioss_history.join_parts([_read_part(file, budget) for file in members], names))
    return radioss_history.with_names(radioss_history.join_files(histories))


def _read_part(file: Member, budget: Budget) -> TimeHistory:
    content = file.content(budget)
    is_converted = file.path.suffix.lower() == ".csv" and _BEGINS.match(content[:_HEAD])
    return (read_converted if is_converted else read_binary)(content, file.path.name)
