"""Reader of LSDA, the binary container of LS-DYNA's ``binout`` files, which are treated as untrusted.

A file is a header of eight bytes followed by records: length, command, and the command's data. Folders and variables
are listed in symbol tables, each of which ends with the offset of the next; the solver adds a table from time to time,
so that a killed run can be read up to the last table. Layout as published with the solver's own library (LSTC I/O
Library, file format, 1.1).
"""

import struct
from array import array
from collections.abc import Callable, Iterator, Mapping
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from crashfuse.errors import DataError, Problem

_CD, _DATA, _VARIABLE, _BEGIN_TABLE, _END_TABLE, _TABLE_OFFSET = 2, 3, 4, 5, 6, 7
_TYPES = dict(enumerate(("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8"), start=1))
_INTEGERS = {1: "B", 2: "H", 4: "I", 8: "Q"}
_HEADER_BYTES = 8
_MOST_WANTED, _MOST_FOLDERS = 2_000_000, 300_000
_MOST_BYTES = 64 << 20  # per variable
_LONGEST_RECORD = 4096  # bytes, for a path or a name
_BLOCK = 1 << 20  # bytes of a symbol table in memory

Folder = tuple[str, ...]
"""A folder's path: ``("nodout", "d000001")``."""


class LsdaFile:
    """An LSDA file with its symbol tables read and its data read on demand; a DataError if damaged or not LSDA.

    However many symbols a file lists, only the wanted ones are kept: a long list costs time, not memory.

    Parameters
    ----------
    stream : binary file
        Seekable; must stay open.
    wanted : callable
        Maps a folder's path to the wanted names in it; the rest is skipped.
    """

    def __init__(self, stream: IO[bytes], where: str, wanted: Callable[[Folder], frozenset[str] | None]) -> None:
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
        self._folders: dict[Folder, dict[str, int]] = {}
        self._listed = array("Q")  # type, count and offset of each variable
        self._read_tables(header[0], wanted)

    @property
    def folders(self) -> Mapping[Folder, Mapping[str, int]]:
        """Names of the wanted variables that exist, by folder path."""
        return self._folders

    def read(self, folder: Folder, name: str) -> npt.NDArray[Any] | None:
        """Return the numbers of a variable; None if there is none with that name."""
        place = self._folders.get(folder, {}).get(name)
        if place is None:
            return None
        kind, count, offset = self._listed[place : place + 3]
        numbers = np.dtype(f"{self._order}{_TYPES[kind]}")
        label = name.encode("latin-1")
        ahead = self._record.size + self._kind.size + len(label)
        if count * numbers.itemsize > _MOST_BYTES:
            raise self._damaged(f"no data of {name} where they should be")
        self._go(offset)
        content = self._exactly(ahead + count * numbers.itemsize)
        command = self._record.unpack_from(content)[1]
        found, _ = self._kind.unpack_from(content, self._record.size)
        if (command, found) != (_DATA, kind) or content[ahead - len(label) : ahead] != label:
            raise self._damaged(f"no data of {name} where they should be")
        return np.frombuffer(content, numbers, offset=ahead)

    def _read_tables(self, at: int, wanted: Callable[[Folder], frozenset[str] | None]) -> None:
        self._go(at)
        if self._record.unpack(self._exactly(self._record.size))[1] != _TABLE_OFFSET:
            raise self._damaged("another kind of file")
        folder: Folder = ()
        names = wanted(folder)
        offset = self._offset.unpack(self._exactly(self._offset.size))[0]
        seen: set[int] = set()
        left = self._size  # tables do not overlap, so all of them together are no longer than the file
        while offset:
            if offset in seen:
                raise self._damaged("symbol tables in a circle")
            seen.add(offset)
            for command, body in self._table(offset):
                left -= self._record.size + len(body)
                if command == _CD:
                    folder = _changed(folder, body.decode("latin-1"))
                    names = wanted(folder)
                elif command == _VARIABLE:
                    if names:
                        self._list(folder, names, body)
                elif command == _END_TABLE and len(body) == self._offset.size:
                    offset = self._offset.unpack(body)[0]
                if left < 0:
                    raise self._damaged("symbol tables that overlap")

    def _table(self, offset: int) -> Iterator[tuple[int, bytes]]:
        """Yield the commands of a symbol table with what they say, the last one with the offset of the next table."""
        self._go(offset)
        length, command = self._record.unpack(self._exactly(self._record.size))
        if command != _BEGIN_TABLE:
            raise self._damaged("no symbol table where it should be")
        ahead, at = self._record.size, 0
        block = self._stream.read(min(length, _BLOCK))
        while command != _END_TABLE:
            block, at = self._with_more(block, at, ahead)
            length, command = self._record.unpack_from(block, at)
            length = ahead + self._offset.size if command == _END_TABLE else length
            if command not in (_CD, _VARIABLE, _END_TABLE) or not ahead <= length <= ahead + _LONGEST_RECORD:
                raise self._damaged("a symbol table that makes no sense")
            block, at = self._with_more(block, at, length)
            yield command, block[at + ahead : at + length]
            at += length

    def _with_more(self, block: bytes, at: int, count: int) -> tuple[bytes, int]:
        """The block, and the place in it, with at least so many bytes from there on."""
        if at + count <= len(block):
            return block, at
        block = block[at:] + self._stream.read(_BLOCK if at else _LONGEST_RECORD)
        if count > len(block):
            raise self._damaged("one that was cut short")
        return block, 0

    def _list(self, folder: Folder, names: frozenset[str], body: bytes) -> None:
        at = len(body) - self._symbol.size
        name = body[: max(at, 0)].decode("latin-1")
        if name not in names:
            return
        kind, offset, count = self._symbol.unpack_from(body, at)
        if kind not in _TYPES:
            return
        self._folders.setdefault(folder, {})[name] = len(self._listed)
        self._listed.extend((kind, count, offset))
        if len(self._listed) > 3 * _MOST_WANTED or len(self._folders) > _MOST_FOLDERS:
            expected = f"at most {_MOST_FOLDERS:,} states with {_MOST_WANTED:,} variables of nodes and energies"
            raise DataError(Problem(self._where, expected, "more", "write fewer states (DT in *DATABASE_NODOUT)"))

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


def _changed(folder: Folder, path: str) -> Folder:
    """The folder reached by an absolute or relative path."""
    parts = [] if path.startswith("/") else list(folder)
    for part in path.split("/"):
        if part == "..":
            del parts[-1:]
        elif part not in ("", "."):
            parts.append(part)
    return tuple(parts[:8])
