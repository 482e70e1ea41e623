"""Histories of nodes and rigid bodies in LS-DYNA's ``binout``: files of several processors, continuations, restarts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.axes import AXES, Travel
from crashfuse.readers.lsdyna.energies import GLSTAT, MATSUM, States, states_of
from crashfuse.readers.lsdyna.histories import MOST_NODES, MOST_VALUES, Histories, History, kept_of, too_much
from crashfuse.readers.lsdyna.lsda import Folder, LsdaFile
from crashfuse.readers.travel import axis_of_travel
from crashfuse.signals.pulse import FloatArray

Shards = Sequence[tuple[IO[bytes], str]]
"""Seekable files, and their names in messages."""

_DATABASES = {
    "nodouthf": ("{}_acceleration", "{}_velocity"),
    "nodout": ("{}_acceleration", "{}_velocity"),
    "rbdout": ("global_a{}", "global_v{}"),
}
_VARIABLES = {
    name: frozenset({"time", *(form.format(axis) for form in forms for axis in AXES)})
    for name, forms in _DATABASES.items()
}
_METADATA = frozenset({"ids", "legend", "legend_ids", "title"})
_TITLE_BYTES = 80
_PREFIX = {"rbdout": "body "}
_SAMPLED = 20  # states


@dataclass
class _Metadata:
    """What a database says of its nodes; a continuation file leaves it to the first of its family."""

    title: str
    ids: npt.NDArray[np.integer[Any]]
    titles: dict[str, str]

    def labels(self, database: str) -> list[str]:
        """The names of the nodes."""
        return [f"{_PREFIX.get(database, '')}{int(number)}" for number in self.ids[:MOST_NODES]]


@dataclass
class _Part:
    """A database in one file: its states in order of time, and the file in which the last may go on."""

    database: str
    file: LsdaFile
    after: LsdaFile | None
    where: str
    of: _Metadata
    states: list[Folder]
    time: FloatArray

    def value(self, state: Folder, name: str) -> npt.NDArray[Any] | None:
        """A variable of all nodes in a state; None if it was not written."""
        found = self.file.read(state, name)
        if found is None and self.after is not None and "time" not in self.after.folders.get(state, ()):
            found = self.after.read(state, name)
        if found is not None and found.size != self.of.ids.size:
            expected, text = f"{name} of {self.of.ids.size} nodes in each state", f"{found.size} in {state[1]}"
            raise DataError(Problem(self.where, expected, text, "copy it again from the run"))
        return found

    def names(self, state: Folder) -> set[str]:
        """Names of the variables of a state."""
        torn = () if self.after is None else self.after.folders.get(state, ())
        return {*self.file.folders[state], *(() if "time" in torn else torn)}

    def velocities(self, state: Folder) -> FloatArray:
        """Velocities of all nodes along each axis, shape (3, n_nodes)."""
        velocities = np.full((3, self.of.ids.size), np.nan)
        for row, axis in zip(velocities, AXES, strict=True):
            if (value := self.value(state, _DATABASES[self.database][1].format(axis))) is not None:
                row[:] = value
        return velocities


def read_binout(families: Sequence[Shards], most: int, travel: Travel | None) -> tuple[Histories, States, States]:
    """Read a run's ``binout`` from the families of files that its processors wrote, each in order of writing.

    If there are more than ``most`` nodes, those with a title are kept first. Returned beside the nodes are the states
    of ``glstat`` and ``matsum``.
    """
    glstat: States = {}
    matsum: States = {}
    parts: list[_Part] = []
    for shards in families:
        files = [LsdaFile(stream, where, _wanted) for stream, where in shards]
        for file in files:
            glstat |= states_of(file, "glstat")
            matsum |= states_of(file, "matsum")
        own = list(_parts(files, [where for _, where in shards]))
        _check_apart(parts, own)
        parts += own
    title = next((part.of.title for part in parts if part.of.title), "")
    if not parts:
        return Histories(title, (), 0), glstat, matsum
    if sum(len(part.states) * min(part.of.ids.size, most) for part in parts) > MOST_VALUES:
        raise too_much(parts[0].where)
    start, fastest = _motion(parts)
    axis = AXES[axis_of_travel(start, travel)]
    pieces: dict[tuple[str, str], list[History]] = {}
    for part in parts:
        for piece in _histories(part, axis, most):
            pieces.setdefault((part.database, piece.name), []).append(piece)
    frequent = {name for database, name in pieces if database == "nodouthf"}
    merged = [_joined(own) for (database, name), own in pieces.items() if database != "nodout" or name not in frequent]
    kept = kept_of([node.name for node in merged], {node.name: node.title for node in merged}, most)
    nodes = tuple(node for node in merged if node.name in kept)
    total = max(len(merged), *(part.of.ids.size for part in parts))
    count = sum(map(len, families))
    holding = len({part.where for part in parts})
    notes = (f"Nodes from {holding} of {count} files of binout, joined.",) if count > 1 else ()
    return Histories(title, nodes, total, start, fastest, notes=notes), glstat, matsum


def _wanted(folder: Folder) -> frozenset[str] | None:
    """Names of the variables to read from a folder of a binout."""
    match folder:
        case (database, "metadata") if database in _DATABASES:
            return _METADATA
        case (database, _) if database in _DATABASES:
            return _VARIABLES[database]
        case ("glstat", _):
            return GLSTAT
        case ("matsum", _):
            return MATSUM
    return None


def _parts(files: Sequence[LsdaFile], names: Sequence[str]) -> Iterator[_Part]:
    """Yield what each file of a family holds of each database."""
    known: dict[str, _Metadata] = {}
    for file, after, where in zip(files, [*files[1:], None], names, strict=True):
        states: dict[str, list[Folder]] = {}
        for folder, variables in file.folders.items():
            if folder[0] in _DATABASES and folder[1] != "metadata" and "time" in variables:
                states.setdefault(folder[0], []).append(folder)
        for database in _DATABASES:
            if (ids := file.read((database, "metadata"), "ids")) is not None and ids.dtype.kind in "iu":
                known[database] = _Metadata(_title(file, database), ids, _titles(file, database))
            if states.get(database):
                if database not in known:
                    expected, advice = f"the numbers of the nodes of {database} (metadata)", "copy all files of the run"
                    raise DataError(Problem(where, expected, "none", advice))
                own = states[database]
                time = np.array([_number(file.read(state, "time")) for state in own])
                order = [place for place in np.argsort(time, kind="stable").tolist() if np.isfinite(time[place])]
                in_order = [own[place] for place in order]
                part = _Part(database, file, after, where, known[database], in_order, time[order])
                if order and part.names(in_order[-1]) < part.names(in_order[0]):  # killed while it was written
                    part = replace(part, states=in_order[:-1], time=part.time[:-1])
                if part.states:
                    yield part


def _check_apart(parts: Sequence[_Part], others: Sequence[_Part]) -> None:
    """Raise a DataError if two families hold the same nodes at the same time: they are of two runs."""
    for part in parts:
        for other in others:
            at_once = part.time[0] <= other.time[-1] and other.time[0] <= part.time[-1]
            if part.database == other.database and at_once and np.intersect1d(part.of.ids, other.of.ids).size:
                expected, found = f"{part.database} of one run in a folder", f"the same nodes as in {part.where}"
                advice = "put each run into a folder of its own, or name its job (run1.binout0000)"
                raise DataError(Problem(other.where, expected, found, advice))


def _motion(parts: Sequence[_Part]) -> tuple[FloatArray, FloatArray]:
    """How the nodes set out, shape (3, n_nodes), and the largest speed along each axis in some of the states."""
    first: dict[tuple[str, bytes], _Part] = {}
    fastest = np.zeros(3)
    for part in sorted(parts, key=lambda part: float(part.time[0])):
        first.setdefault((part.database, part.of.ids.tobytes()), part)
        for place in np.unique(np.linspace(0, len(part.states) - 1, _SAMPLED, dtype=int)).tolist():
            speeds = np.nan_to_num(np.abs(part.velocities(part.states[place])), nan=0.0)
            fastest = np.maximum(fastest, speeds.max(axis=1, initial=0.0))
    return np.concatenate([part.velocities(part.states[0]) for part in first.values()], axis=1), fastest


def _histories(part: _Part, axis: str, most: int) -> list[History]:
    """Histories of the nodes of a part along an axis."""
    labels = part.of.labels(part.database)
    chosen = kept_of(labels, part.of.titles, most)
    places = [place for place, label in enumerate(labels) if label in chosen]
    values = np.full((2, len(places), len(part.states)), np.nan)
    with np.errstate(invalid="ignore"):  # damaged data may hold any number
        for of, name in zip(values, _DATABASES[part.database], strict=True):
            for place, state in enumerate(part.states):
                row = part.value(state, name.format(axis))
                if row is not None:
                    of[:, place] = row[places]
                elif place + 1 < len(part.states):
                    found, advice = f"none in {state[1]}", "copy it again from the run"
                    raise DataError(Problem(part.where, f"{name.format(axis)} in each state", found, advice))
    return [
        History(labels[place], part.of.titles.get(labels[place], ""), part.time, accel, velocity)
        for place, accel, velocity in zip(places, *values, strict=True)
    ]


def _number(values: npt.NDArray[Any] | None) -> float:
    return float("nan") if values is None or values.size != 1 else float(values[0])


def _title(file: LsdaFile, database: str) -> str:
    return printable(_text(file, (database, "metadata"), "title").strip())


def _titles(file: LsdaFile, database: str) -> dict[str, str]:
    folder = (database, "metadata")
    ids, text = file.read(folder, "legend_ids"), _text(file, folder, "legend")
    if ids is None or ids.dtype.kind not in "iu":
        return {}
    prefix = _PREFIX.get(database, "")
    cut = range(0, min(len(text), _TITLE_BYTES * ids.size), _TITLE_BYTES)
    return {
        f"{prefix}{int(number)}": printable(text[at : at + _TITLE_BYTES].strip())
        for number, at in zip(ids, cut, strict=False)
    }


def _text(file: LsdaFile, folder: Folder, name: str) -> str:
    values = file.read(folder, name)
    return "" if values is None or values.itemsize != 1 else values.tobytes().decode("latin-1").replace("\0", " ")


def _joined(pieces: Sequence[History]) -> History:
    """Join one node's data from several files; if a restart repeats a time, the later file takes precedence."""
    ordered = sorted(pieces, key=lambda piece: float(piece.time[0]))
    ends = [float(piece.time[0]) for piece in ordered[1:]] + [np.inf]
    kept = [piece.time < end for piece, end in zip(ordered, ends, strict=True)]
    parts = {
        name: np.concatenate([getattr(piece, name)[keep] for piece, keep in zip(ordered, kept, strict=True)])
        for name in ("time", "acceleration", "velocity")
    }
    return History(ordered[0].name, next((p.title for p in ordered if p.title), ""), **parts)
