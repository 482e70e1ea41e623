"""LS-DYNA's ``binout``: histories of nodes, rigid bodies and energies, of several processors, continuations, restarts.

The binary container is LSDA, treated as untrusted: a header of eight bytes, then records (length, command, data).
Folders and variables are listed in symbol tables, each of which ends with the offset of the next; a killed run can be
read up to the last. Layout as published with the solver's own library (LSTC I/O Library, file format, 1.1).
"""

import struct
from array import array
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import IO, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from crashfuse.errors import printable, refuse_if
from crashfuse.readers import lsdyna_histories
from crashfuse.readers.lsdyna_histories import GLSTAT, MATSUM, MOST_NODES, Histories, States
from crashfuse.readers.members import ASK, COPY_AGAIN, COPY_ALL, CUT_SHORT, OTHER_KIND
from crashfuse.readers.solver_run import KEEP_APART, History, axis_of_travel
from crashfuse.readers.vocabulary import AXES, Travel, iso_date
from crashfuse.signals.pulse import FloatArray

_CD, _DATA, _VARIABLE, _BEGIN_TABLE, _END_TABLE, _TABLE_OFFSET = 2, 3, 4, 5, 6, 7
_TYPES = dict(enumerate(("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8"), start=1))
_INTEGERS = {1: "B", 2: "H", 4: "I", 8: "Q"}
_HEADER_BYTES = 8
_MOST_WANTED, _MOST_FOLDERS = 2_000_000, 300_000
_MOST_BYTES = 64 << 20  # per variable
_LONGEST_RECORD = 4096  # bytes, for a path or a name
_BLOCK = 1 << 20  # bytes of a symbol table in memory

_Folder = tuple[str, ...]  # a folder's path: ("nodout", "d000001")

_Shards = Sequence[tuple[IO[bytes], str]]  # seekable files, and their names in messages

_DATABASES = dict.fromkeys(("nodouthf", "nodout"), ("{}_acceleration", "{}_velocity"))
_DATABASES |= {"rbdout": ("global_a{}", "global_v{}")}  # names of variables by axis
_BY_AXIS = {name: {form.format(axis) for form in forms for axis in AXES} for name, forms in _DATABASES.items()}
_VARIABLES = {name: frozenset({"time", *names}) for name, names in _BY_AXIS.items()}
_VARIABLES |= {"glstat": GLSTAT, "matsum": MATSUM}
_METADATA = frozenset({"ids", "legend", "legend_ids", "title", "version", "revision", "date"})
_FORCES = frozenset({"time", *(f"{axis}_force" for axis in AXES)})
_TITLE_BYTES = 80
_PREFIX = {"rbdout": "body "}
_SAMPLED = 20  # states


class _LsdaFile:
    """Symbol tables are read at once, data on demand; ``wanted`` has the names to keep of a folder."""

    def __init__(self, stream: IO[bytes], where: str, wanted: Callable[[_Folder], frozenset[str] | None]) -> None:
        self._stream, self._where = stream, where
        self._size = stream.seek(0, 2)
        header = self._exactly(_HEADER_BYTES, 0)
        is_known = header[0] >= _HEADER_BYTES and set(header[1:5]) <= _INTEGERS.keys() and header[5] <= 1
        self._refuse_if(not is_known or header[6], OTHER_KIND)
        length, offset, command, kind = (_INTEGERS[size] for size in header[1:5])
        self._order = "<" if header[5] else ">"
        self._record = struct.Struct(f"{self._order}{length}{command}")
        self._offset = struct.Struct(f"{self._order}{offset}")
        self._symbol = struct.Struct(f"{self._order}{kind}{offset}{length}")
        self._kind = struct.Struct(f"{self._order}{kind}B")
        self.folders: dict[_Folder, dict[str, int]] = {}  # the wanted variables that exist, and where they are listed
        self._listed = array("Q")  # type, count and offset of each variable
        self._read_tables(header[0], wanted)

    def read(self, folder: _Folder, name: str) -> npt.NDArray[Any] | None:
        place = self.folders.get(folder, {}).get(name)
        if place is None:
            return None
        kind, count, offset = self._listed[place : place + 3]
        numbers = np.dtype(f"{self._order}{_TYPES[kind]}")
        label = name.encode("latin-1")
        ahead = self._record.size + self._kind.size + len(label)
        self._refuse_if(count * numbers.itemsize > _MOST_BYTES, f"no data of {name}")
        content = self._exactly(ahead + count * numbers.itemsize, offset)
        head = self._record.unpack_from(content)[1], self._kind.unpack_from(content, self._record.size)[0]
        is_data = head == (_DATA, kind) and content[ahead - len(label) : ahead] == label
        self._refuse_if(not is_data, f"no data of {name}")
        return np.frombuffer(content, numbers, offset=ahead)

    def _read_tables(self, at: int, wanted: Callable[[_Folder], frozenset[str] | None]) -> None:
        self._refuse_if(self._record.unpack(self._exactly(self._record.size, at))[1] != _TABLE_OFFSET, OTHER_KIND)
        folder: _Folder = ()
        names = wanted(folder)
        offset = self._offset.unpack(self._exactly(self._offset.size))[0]
        left = self._size  # tables do not overlap, so all of them together are no longer than the file
        while offset:
            for command, body in self._table(offset):
                left -= self._record.size + len(body)
                self._refuse_if(left < 0, "symbol tables in a circle")
                if command == _CD:
                    folder = _changed(folder, body.decode("latin-1"))
                    names = wanted(folder)
                elif command == _VARIABLE and names:
                    self._list(folder, names, body)
                elif command == _END_TABLE:
                    offset = self._offset.unpack(body)[0]

    def _table(self, offset: int) -> Iterator[tuple[int, bytes]]:
        length, command = self._record.unpack(self._exactly(self._record.size, offset))
        self._refuse_if(command != _BEGIN_TABLE, "no symbol table")
        ahead, at = self._record.size, 0
        block = self._stream.read(min(length, _BLOCK))
        while command != _END_TABLE:
            block, at = self._with_more(block, at, ahead)
            length, command = self._record.unpack_from(block, at)
            length = ahead + self._offset.size if command == _END_TABLE else length
            is_known = command in (_CD, _VARIABLE, _END_TABLE) and ahead <= length <= ahead + _LONGEST_RECORD
            self._refuse_if(not is_known, "a senseless symbol table")
            block, at = self._with_more(block, at, length)
            yield command, block[at + ahead : at + length]
            at += length

    def _with_more(self, block: bytes, at: int, count: int) -> tuple[bytes, int]:
        if at + count <= len(block):
            return block, at
        block = block[at:] + self._stream.read(_BLOCK if at else _LONGEST_RECORD)
        self._refuse_if(count > len(block), CUT_SHORT)
        return block, 0

    def _list(self, folder: _Folder, names: frozenset[str], body: bytes) -> None:
        name, symbol = body[: -self._symbol.size].decode("latin-1"), body[-self._symbol.size :]
        if name not in names:
            return
        kind, offset, count = self._symbol.unpack(symbol)
        if kind in _TYPES:
            self.folders.setdefault(folder, {})[name] = len(self._listed)
            self._listed.extend((kind, count, offset))
        are_many = len(self._listed) > 3 * _MOST_WANTED or len(self.folders) > _MOST_FOLDERS
        expected = f"at most {_MOST_FOLDERS:,} states with {_MOST_WANTED:,} variables"
        refuse_if(are_many, self._where, expected, "more", "write fewer states")

    def _exactly(self, count: int, offset: int | None = None) -> bytes:
        if offset is not None:
            self._stream.seek(min(offset, self._size))
        content = self._stream.read(count)
        self._refuse_if(len(content) < count, CUT_SHORT)
        return content

    def _refuse_if(self, wrong: object, found: str) -> None:
        refuse_if(wrong, self._where, "a sound binout", found, COPY_AGAIN)


def _changed(folder: _Folder, path: str) -> _Folder:
    parts = [] if path.startswith("/") else list(folder)
    for part in path.split("/"):
        if part == "..":
            del parts[-1:]
        elif part not in ("", "."):
            parts.append(part)
    return tuple(parts[:8])


class _Metadata(NamedTuple):  # of the nodes of a database; a continuation file leaves it to the first of its family
    title: str
    ids: npt.NDArray[np.integer[Any]]
    titles: dict[str, str]
    about: dict[str, str]  # version and date


@dataclass
class _Part:
    """A database in one file; its last state may go on in the file ``after``."""

    database: str
    file: _LsdaFile
    after: _LsdaFile | None
    where: str
    of: _Metadata
    states: list[_Folder]
    time: FloatArray

    def value(self, state: _Folder, name: str) -> npt.NDArray[Any] | None:
        values = self.file.read(state, name)
        if values is None and self.after is not None and name in self._torn(state):
            values = self.after.read(state, name)
        n, size = self.of.ids.size, self.of.ids.size if values is None else values.size
        refuse_if(size != n, self.where, f"{name} of {n} nodes in each state", f"{size} in {state[1]}", COPY_AGAIN)
        return values

    def names(self, state: _Folder) -> set[str]:
        return {*self.file.folders[state], *self._torn(state)}

    def _torn(self, state: _Folder) -> Collection[str]:
        variables = () if self.after is None else self.after.folders.get(state, ())
        return () if "time" in variables else variables

    def velocities(self, state: _Folder) -> FloatArray:
        rows = (self.value(state, _DATABASES[self.database][1].format(axis)) for axis in AXES)
        return np.array([np.full(self.of.ids.size, np.nan) if row is None else row for row in rows])


def read_binout(families: Sequence[_Shards], most: int, travel: Travel | None) -> tuple[Histories, States, States]:
    """A run's nodes, ``glstat`` and ``matsum`` from the files of each processor, in order of writing."""
    glstat, matsum, walls = States(), States(), States()
    parts: list[_Part] = []
    for shards in families:
        files = [_LsdaFile(stream, where, _wanted) for stream, where in shards]
        for file in files:
            for states, database in ((glstat, "glstat"), (matsum, "matsum"), (walls, "rwforc")):
                _add_states(states, file, database)
        family = list(_parts(files, [where for _, where in shards]))
        for part, other in product(parts, family):
            at_once = part.time[0] <= other.time[-1] and other.time[0] <= part.time[-1]
            alike = part.database == other.database and at_once and np.intersect1d(part.of.ids, other.of.ids).size
            expected, found = f"{part.database} of one run in a folder", f"the same nodes as in {part.where}"
            refuse_if(alike, other.where, expected, found, KEEP_APART)
        parts += family
    title = next((part.of.title for part in parts if part.of.title), "")
    if not parts:
        return Histories(title, (), 0), glstat, matsum
    lsdyna_histories.check_count(sum(len(own.states) * min(own.of.ids.size, most) for own in parts), parts[0].where)
    start, fastest = _motion(parts)
    axis = AXES[axis_of_travel(start, travel, fastest)]
    pieces: dict[tuple[str, str], list[History]] = {}
    for part in parts:
        for piece in _histories(part, axis, most):
            pieces.setdefault((part.database, piece.name), []).append(piece)
    frequent = {name for database, name in pieces if database == "nodouthf"}
    merged = [_joined(of) for (database, name), of in pieces.items() if database != "nodout" or name not in frequent]
    titles = {node.name: node.title for node in merged}
    names = lsdyna_histories.nodes_to_keep([*titles], titles, most)
    nodes = tuple(node for node in merged if node.name in names)
    total = max(len(merged), *(part.of.ids.size for part in parts))
    count = sum(map(len, families))
    notes = (f"Nodes from {len({part.where for part in parts})} of {count} files of binout, joined.",) * (count > 1)
    run = Histories(title, nodes, total, start, fastest, notes, about=parts[0].of.about, walls=walls)

    def velocities(begin: float) -> FloatArray:
        lasting = [(part, int(np.searchsorted(part.time, begin))) for part in parts if part.time[-1] >= begin]
        return np.concatenate([part.velocities(part.states[place]) for part, place in lasting], axis=1)

    return run.since_departure(travel, velocities), glstat, matsum


def _add_states(states: States, file: _LsdaFile, database: str) -> None:
    for folder, names in _in_order(file, database):
        if (time := file.read(folder, "time")) is not None and time.size:
            values = [(name, file.read(folder, name)) for name in names if name != "time"]
            sums = {name: float(value.sum(dtype=np.float64)) for name, value in values if value is not None}
            lsdyna_histories.add_state(states, float(time[0]), sums)


def _in_order(file: _LsdaFile, database: str) -> list[tuple[_Folder, dict[str, int]]]:
    states = [(folder, names) for folder, names in file.folders.items() if folder[0] == database and "time" in names]
    return sorted(states, key=lambda state: (len(state[0][-1]), state[0][-1]))  # numbered as they are written


def _wanted(folder: _Folder) -> frozenset[str] | None:
    match folder:
        case (database, "metadata") if database in _DATABASES:
            return _METADATA
        case (database, _):
            return _VARIABLES.get(database)
        case ("rwforc", "forces", _):
            return _FORCES
    return None


def _parts(files: Sequence[_LsdaFile], names: Sequence[str]) -> Iterator[_Part]:
    metadata: dict[str, _Metadata] = {}
    for file, after, where in zip(files, [*files[1:], None], names, strict=True):
        states = {name: [folder for folder, _ in _in_order(file, name)] for name in _DATABASES}
        for database in _DATABASES:
            if (ids := file.read((database, "metadata"), "ids")) is not None and ids.dtype.kind in "iu":
                stated = ("title", "version", "revision", "date")
                title, version, revision, date = (_text(file, (database, "metadata"), of).strip() for of in stated)
                versions = " ".join(dict.fromkeys(filter(None, (version, revision))))
                about = {"version": versions, "date": iso_date(date, "%m/%d/%Y")}
                metadata[database] = _Metadata(printable(title), ids, _titles(file, database), about)
            if not states[database]:
                continue
            refuse_if(database not in metadata, where, f"the numbers of nodes of {database}", "none", COPY_ALL)
            times = (file.read(state, "time") for state in states[database])
            time = np.array([np.nan if values is None or values.size != 1 else float(values[0]) for values in times])
            order = lsdyna_histories.latest(time.tolist())
            in_order = [states[database][place] for place in order]
            part = _Part(database, file, after, where, metadata[database], in_order, time[order])
            if order and part.names(in_order[-1]) < part.names(in_order[0]):  # killed while it was written
                part = replace(part, states=in_order[:-1], time=part.time[:-1])
            if part.states:
                yield part


def _motion(parts: Sequence[_Part]) -> tuple[FloatArray, FloatArray]:
    """Velocities at the start, shape (3, n_nodes), and the largest speeds along each axis."""
    first, fastest = dict[tuple[str, bytes], _Part](), np.zeros(3)
    for part in sorted(parts, key=lambda part: float(part.time[0])):
        first.setdefault((part.database, part.of.ids.tobytes()), part)
        for place in np.unique(np.linspace(0, len(part.states) - 1, _SAMPLED, dtype=int)).tolist():
            speeds = np.nan_to_num(np.abs(part.velocities(part.states[place])), nan=0.0)
            fastest = np.maximum(fastest, speeds.max(axis=1, initial=0.0))
    return np.concatenate([part.velocities(part.states[0]) for part in first.values()], axis=1), fastest


def _histories(part: _Part, axis: str, most: int) -> list[History]:
    labels = [f"{_PREFIX.get(part.database, '')}{int(number)}" for number in part.of.ids[:MOST_NODES]]
    chosen = lsdyna_histories.nodes_to_keep(labels, part.of.titles, most)
    places = [place for place, label in enumerate(labels) if label in chosen]
    values = np.full((2, len(places), len(part.states)), np.nan)
    with np.errstate(invalid="ignore"):  # damaged data may hold any number
        forms = _DATABASES[part.database]
        there = part.names(part.states[0])
        lacks = forms[1].format(axis) not in there
        refuse_if(lacks, part.where, "velocities of nodes, and accelerations", f"none in {part.database}", ASK)
        for of, name in zip(values, (form.format(axis) for form in forms), strict=True):
            for place, state in enumerate(part.states if name in there else ()):  # else the velocities tell
                row, is_last = part.value(state, name), place + 1 == len(part.states)
                is_lost = row is None and not is_last
                refuse_if(is_lost, part.where, f"{name} in each state", f"none in {state[1]}", COPY_AGAIN)
                of[:, place] = np.nan if row is None else row[places]
    rows = zip((labels[place] for place in places), *values, strict=True)
    return [History(name, part.of.titles.get(name, ""), part.time, *curves) for name, *curves in rows]


def _titles(file: _LsdaFile, database: str) -> dict[str, str]:
    folder = (database, "metadata")
    ids, text = file.read(folder, "legend_ids"), _text(file, folder, "legend")
    if ids is None or ids.dtype.kind not in "iu":
        return {}
    titles = (printable(text[at : at + _TITLE_BYTES].strip()) for at in range(0, len(text), _TITLE_BYTES))
    prefix = _PREFIX.get(database, "")
    return {f"{prefix}{int(number)}": title for number, title in zip(ids, titles, strict=False)}


def _text(file: _LsdaFile, folder: _Folder, name: str) -> str:
    values = file.read(folder, name)
    return "" if values is None or values.itemsize != 1 else values.tobytes().decode("latin-1").replace("\0", " ")


def _joined(pieces: Sequence[History]) -> History:
    ordered = sorted(pieces, key=lambda piece: float(piece.time[0]))
    ends = [float(piece.time[0]) for piece in ordered[1:]] + [np.inf]
    kept = [piece.time < end for piece, end in zip(ordered, ends, strict=True)]
    parts = [(p.time[keep], p.acceleration[keep], p.velocity[keep]) for p, keep in zip(ordered, kept, strict=True)]
    columns = map(np.concatenate, zip(*parts, strict=True))
    return History(ordered[0].name, next((p.title for p in ordered if p.title), ""), *columns)
