"""Reader of the binary time history of Radioss, ``<run>T01``.

A time history is a sequence of records, big-endian, framed by their length: a header that lists what is written, then
for each state its time, the global histories, those of parts and subsets, and those of each group of ``/TH``. Layout
and codes are those of the solver's own writer (``hist1.F``, ``hist2.F``, ``hm_read_thgrou.F``) and converter
(``th_to_csv``). Forces (of walls, sections, interfaces, rigid bodies) are written as impulses, since the start of the
run; they are not read.
"""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import numpy.typing as npt

from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.radioss.time_history import ACCELEROMETER, GLOBAL, MOST_VALUES, TimeHistory, Watched
from crashfuse.signals.pulse import FloatArray

KIND = "a time history of Radioss (T01, IEEE binary)"

_NODES, _ACCELEROMETERS = 0, 108
_CURVES: Mapping[int, Mapping[int, str]] = {
    _NODES: {1: "DX", 2: "DY", 3: "DZ", 4: "VX", 5: "VY", 6: "VZ", 7: "AX", 8: "AY", 9: "AZ"},
    _ACCELEROMETERS: {1: "AX", 2: "AY", 3: "AZ", 4: "WX", 5: "WY", 6: "WZ"},
}  # names of the variables that are read, by the kind of a group and their codes
_FORCES = {101: "interfaces", 102: "rigid walls", 103: "rigid bodies", 104: "sections", 105: "joints"}
_MOST_RECORDS, _MOST_COUNT, _MOST_CURVES = 2_000_000, 1_000_000, 100_000
_DEFAULT = "write the time history in Radioss's default form (/TFILE, or /TFILE/4) or convert it to CSV (th_to_csv)"


def read_binary(content: bytes, where: str) -> TimeHistory:
    """Read a time history from memory.

    Raises
    ------
    DataError
        If it is none, is in another of Radioss's forms, or is damaged.
    """
    if advice := _other_form(content):
        raise DataError(Problem(where, KIND, advice, _DEFAULT))
    return _File(content, where).time_history()


def _other_form(content: bytes) -> str:
    """Which of the forms of ``/TFILE/<form>`` it is, other than the default."""
    if content[:4] in (struct.pack("<i", 84), struct.pack("<i", 164)):
        return "Fortran's own binary (/TFILE/1)"
    if b" FORMAT" in content[:120] and b"ZZZZZEOR" in content[:300]:
        return "text (/TFILE/3)"
    return "a compressed file" if content[:2] == b"\x1f\x8b" else ""


@dataclass(frozen=True, slots=True)
class _Group:
    """A group of ``/TH``: number and title of each of its elements (only where they are read), and its variables."""

    kind: int
    elements: int
    names: tuple[tuple[int, str], ...]
    codes: tuple[int, ...]


class _File:
    """A time history in memory; a DataError if it is damaged or none."""

    def __init__(self, content: bytes, where: str) -> None:
        self._where = where
        records = self._records(content)
        first = self._next(records)
        if len(first) != 84 or not 1000 <= _ints(first[:4])[0] <= 9999:
            raise self._damaged("another kind of file")
        self.title = _text(first[4:])
        self._next(records)  # date
        counts = self._next(records)
        self._factors: tuple[float, ...] = ()
        if len(counts) == 4:  # newer forms: how many records follow here, the length of titles, factors of the units
            for _ in range(min(self._counts(counts, 1)[0], 10)):
                extra = self._next(records)
                self._factors = struct.unpack(">3f", extra) if len(extra) == 12 else self._factors
            counts = self._next(records)
        parts, materials, sections, subsets, groups, globals_ = self._counts(counts, 6)
        self._codes = _ints(self._next(records)) if globals_ else ()
        sizes = [1, globals_, self._parts(records, parts)]
        for _ in range(materials + sections):
            self._next(records)
        sizes.append(self._subsets(records, subsets))
        self._groups = [self._group(records) for _ in range(groups)]
        sizes += [group.elements * len(group.codes) for group in self._groups]
        self._blocks = [size for size in sizes if size]
        self._places = [0, *accumulate(size + 2 for size in self._blocks)]  # of each record in a state, in words
        self._states, self._left_over = self._data(content)

    def time_history(self) -> TimeHistory:
        """What is told of a crash."""
        time = self._block(0)[:, 0].astype(np.float64)
        notes = ("The last state is cut short and left out.",) if self._left_over else ()
        factors = self._factors if len(self._factors) == 3 and all(0 < each < 1e6 for each in self._factors) else None
        return TimeHistory(
            self.title,
            time,
            self._model(),
            self._watched(time),
            tuple(dict.fromkeys(f"impulses of {_FORCES[one.kind]}" for one in self._groups if one.kind in _FORCES)),
            (factors[0], factors[1], factors[2]) if factors else None,
            notes,
        )

    def _model(self) -> dict[str, FloatArray]:
        told = {name: code for code, name in enumerate(GLOBAL, start=1) if code in self._codes}
        return {name: self._block(1)[:, self._codes.index(code)].astype(np.float64) for name, code in told.items()}

    def _watched(self, time: FloatArray) -> tuple[Watched, ...]:
        """Nodes and accelerometers, each once, with what is read of it."""
        found: dict[str, dict[str, FloatArray]] = {}
        titles: dict[str, str] = {}
        groups, curves = [group for group in self._groups if group.elements and group.codes], 0
        for at, group in enumerate(groups, start=len(self._blocks) - len(groups)):
            read = {
                name: group.codes.index(code)
                for code, name in _CURVES.get(group.kind, {}).items()
                if code in group.codes
            }
            curves += len(read) * group.elements
            if curves > _MOST_CURVES or curves * len(time) > MOST_VALUES:
                expected = f"at most {_MOST_CURVES:,} variables of nodes, and {MOST_VALUES:,} values of them"
                raise DataError(Problem(self._where, expected, "more", "watch fewer nodes (/TH/NODE)"))
            values = self._block(at).reshape(len(time), group.elements, len(group.codes))
            for place, (number, title) in enumerate(group.names):
                name = f"{ACCELEROMETER}{number}" if group.kind == _ACCELEROMETERS else str(number)
                titles.setdefault(name, title)
                told = found.setdefault(name, {})
                for curve, column in read.items():
                    told.setdefault(curve, values[:, place, column].astype(np.float64))
        return tuple(Watched(name, titles[name], time, told) for name, told in found.items())

    def _block(self, number: int) -> npt.NDArray[np.float32]:
        """One record of every state, shape (n_states, size)."""
        start = self._places[number] + 1
        return self._states[:, start : start + self._blocks[number]]

    def _data(self, content: bytes) -> tuple[npt.NDArray[np.float32], bool]:
        """All whole states with the frames of their records, shape (n_states, words of a state); and is there more."""
        words = self._places[-1]
        states, left_over = divmod(len(content) - self._at, 4 * words)
        if not states:
            raise self._damaged("no state")
        raw = np.frombuffer(content, ">i4", count=states * words, offset=self._at).reshape(states, words)
        for place, size in zip(self._places[:-1], self._blocks, strict=True):
            if (raw[:, [place, place + size + 1]] != 4 * size).any():
                raise self._damaged("states that are not alike")
        return raw.view(">f4"), bool(left_over)

    def _parts(self, records: Iterator[bytes], count: int) -> int:
        total = 0
        for _ in range(count):
            variables = self._counts(self._next(records)[-4:], 1)[0]
            total += variables
            if variables:
                self._next(records)
        return total

    def _subsets(self, records: Iterator[bytes], count: int) -> int:
        total = 0
        for _ in range(count):
            _, _, children, parts, variables = self._counts(self._next(records), 5)
            total += variables
            for listed in (children, parts, variables):
                if listed:
                    self._next(records)
        return total

    def _group(self, records: Iterator[bytes]) -> _Group:
        head = self._next(records)
        _, kind, _, elements, variables = self._counts(head, 5)
        bodies = [self._next(records) for _ in range(elements)]
        if kind not in _CURVES:
            bodies = []
        names = tuple((_ints(body[:4])[0], _text(body[4:]) or _text(head[20:])) for body in bodies)
        return _Group(kind, elements, names, _ints(self._next(records)) if variables else ())

    def _records(self, content: bytes) -> Iterator[bytes]:
        """Yield the records of the header; ``_at`` is where the next one begins."""
        self._at = 0
        for _ in range(_MOST_RECORDS):
            if self._at + 8 > len(content):
                return
            size = struct.unpack_from(">i", content, self._at)[0]
            end = self._at + 4 + size
            if size < 0 or end + 4 > len(content) or struct.unpack_from(">i", content, end)[0] != size:
                return
            record = content[self._at + 4 : end]
            self._at = end + 4
            yield record

    def _next(self, records: Iterator[bytes]) -> bytes:
        record = next(records, b"")
        if len(record) < 4:
            raise self._damaged("one that was cut short, or another kind of file")
        return record

    def _counts(self, record: bytes, count: int) -> tuple[int, ...]:
        if len(record) < 4 * count:
            raise self._damaged("a header that makes no sense")
        found = _ints(record[: 4 * count])
        if any(not 0 <= each <= _MOST_COUNT for each in found[-2:]):
            raise self._damaged("a header that makes no sense")
        return found

    def _damaged(self, found: str) -> DataError:
        return DataError(Problem(self._where, KIND, found, "copy it again from the run"))


def _text(title: bytes) -> str:
    return printable(title.decode("latin-1").strip("\0 "))


def _ints(record: bytes) -> tuple[int, ...]:
    return struct.unpack(f">{len(record) // 4}i", record[: len(record) // 4 * 4])
