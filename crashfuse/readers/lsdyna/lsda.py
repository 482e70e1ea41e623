"""Reader of LSDA, the binary container of LS-DYNA's ``binout`` files, which are treated as untrusted.

A file is a header of eight bytes followed by records: length, command, and the command's data. Folders and variables
are listed in symbol tables, each of which ends with the offset of the next; the solver adds a table from time to time,
so that a killed run can be read up to the last table. Layout as published with the solver's own library (LSTC I/O
Library, file format, 1.1).
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from crashfuse.errors import DataError, Problem

_CD, _DATA, _VARIABLE, _BEGIN_TABLE, _END_TABLE, _TABLE_OFFSET = 2, 3, 4, 5, 6, 7
_TYPES = dict(enumerate(("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8"), start=1))
_INTEGERS = {1: "B", 2: "H", 4: "I", 8: "Q"}
_HEADER_BYTES = 8
_MOST_RECORDS = 3_000_000  # symbol table records per file: 5000 states with 600 variables
_MOST_WANTED = 300_000
_MOST_BYTES = 64 << 20  # per variable
_LONGEST_RECORD = 4096  # bytes, for a path or a name


@dataclass(frozen=True, slots=True)
class _Variable:
    """Location of a variable: the type and count of its numbers, and the offset of its record."""

    kind: int
    count: int
    offset: int


class LsdaFile:
    """An LSDA file with its symbol tables read and its data read on demand; a DataError if damaged or not LSDA.

    Parameters
    ----------
    stream : binary file
        Seekable; must stay open.
    wanted : callable
        Maps a folder's path (``("nodout", "d000001")``) to the wanted names in it; the rest is skipped.
    """

    def __init__(
        self, stream: IO[bytes], where: str, wanted: Callable[[tuple[str, ...]], frozenset[str] | None]
    ) -> None:
        self._stream, self._where = stream, where
        self._size = stream.seek(0, 2)
        stream.seek(0)
        header = self._exactly(_HEADER_BYTES)
        if header[0] < _HEADER_BYTES or not set(header[1:5]) <= _INTEGERS.keys() or header[5] > 1 or header[6]:
            raise self._damaged("another kind of file")
        length, offset, command, kind = (_INTEGERS[size] for size in header[1:5])
        self._order = "<" if header[5] else ">"
        self._record = struct.Struct(f"{self._order}{length}{command}")
        self._offset = struct.Struct(f"{self._order}{offset}")
        self._symbol = struct.Struct(f"{self._order}{kind}{offset}{length}")
        self._kind = struct.Struct(f"{self._order}{kind}B")
        self._folders: dict[tuple[str, ...], dict[str, _Variable]] = {}
        self._listed = 0
        self._read_tables(header[0], wanted)

    @property
    def folders(self) -> Mapping[tuple[str, ...], Mapping[str, object]]:
        """Names of the wanted variables that exist, by folder path."""
        return self._folders

    def read(self, folder: tuple[str, ...], name: str) -> npt.NDArray[Any] | None:
        """Return the numbers of a variable; None if there is none with that name."""
        variable = self._folders.get(folder, {}).get(name)
        if variable is None:
            return None
        numbers = np.dtype(f"{self._order}{_TYPES[variable.kind]}")
        label = name.encode("latin-1")
        ahead = self._record.size + self._kind.size + len(label)
        if variable.count * numbers.itemsize > _MOST_BYTES:
            raise self._damaged(f"no data of {name} where they should be")
        self._go(variable.offset)
        content = self._exactly(ahead + variable.count * numbers.itemsize)
        command = self._record.unpack_from(content)[1]
        kind, _ = self._kind.unpack_from(content, self._record.size)
        if (command, kind) != (_DATA, variable.kind) or content[ahead - len(label) : ahead] != label:
            raise self._damaged(f"no data of {name} where they should be")
        return np.frombuffer(content, numbers, offset=ahead)

    def _read_tables(self, at: int, wanted: Callable[[tuple[str, ...]], frozenset[str] | None]) -> None:
        self._go(at)
        if self._record.unpack(self._exactly(self._record.size))[1] != _TABLE_OFFSET:
            raise self._damaged("another kind of file")
        folder: tuple[str, ...] = ()
        names = wanted(folder)
        seen: set[int] = set()
        records = 0
        while offset := self._offset.unpack(self._exactly(self._offset.size))[0]:
            if offset in seen:
                raise self._damaged("symbol tables in a circle")
            seen.add(offset)
            self._go(offset)
            command = self._record.unpack(self._exactly(self._record.size))[1]
            if command != _BEGIN_TABLE:
                raise self._damaged("no symbol table where it should be")
            while command != _END_TABLE:
                records += 1
                length, command = self._record.unpack(self._exactly(self._record.size))
                content = length - self._record.size
                if command == _END_TABLE:
                    break
                if command not in (_CD, _VARIABLE) or not 0 <= content <= _LONGEST_RECORD or records > _MOST_RECORDS:
                    raise self._damaged("a symbol table that makes no sense")
                body = self._exactly(content)
                if command == _CD:
                    folder = _changed(folder, body.decode("latin-1"))
                    names = wanted(folder)
                elif names:
                    self._list(folder, names, body)

    def _list(self, folder: tuple[str, ...], names: frozenset[str], body: bytes) -> None:
        at = len(body) - self._symbol.size
        name = body[: max(at, 0)].decode("latin-1")
        if name not in names:
            return
        kind, offset, count = self._symbol.unpack_from(body, at)
        self._listed += 1
        if self._listed > _MOST_WANTED:
            raise self._damaged(f"more than {_MOST_WANTED} variables of a kind")
        if kind in _TYPES:
            self._folders.setdefault(folder, {})[name] = _Variable(kind, count, offset)

    def _go(self, offset: int) -> None:
        if offset > self._size:
            raise self._damaged("one that was cut short")
        self._stream.seek(offset)

    def _exactly(self, count: int) -> bytes:
        content = self._stream.read(count)
        if len(content) < count:
            raise self._damaged("one that was cut short")
        return content

    def _damaged(self, found: str) -> DataError:
        return DataError(Problem(self._where, "a sound binout file of LS-DYNA", found, "copy it again from the run"))


def _changed(folder: tuple[str, ...], path: str) -> tuple[str, ...]:
    """The folder reached by an absolute or relative path."""
    parts = [] if path.startswith("/") else list(folder)
    for part in path.split("/"):
        if part == "..":
            del parts[-1:]
        elif part not in ("", "."):
            parts.append(part)
    return tuple(parts[:8])
