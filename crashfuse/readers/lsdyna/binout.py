"""Histories of nodes and rigid bodies in LS-DYNA's ``binout``, one file or many shards."""

from collections.abc import Sequence
from typing import IO

import numpy as np

from crashfuse.errors import printable
from crashfuse.readers.lsdyna.energies import GLSTAT, MATSUM, States, states_of
from crashfuse.readers.lsdyna.histories import MOST_NODES, MOST_VALUES, Histories, History, kept_of, too_much
from crashfuse.readers.lsdyna.lsda import LsdaFile

_DATABASES = {"nodout": ("x_acceleration", "x_velocity"), "rbdout": ("global_ax", "global_vx")}
_METADATA = frozenset({"ids", "legend", "legend_ids", "title"})
_TITLE_BYTES = 80


def read_binout(shards: Sequence[tuple[IO[bytes], str]], most: int) -> tuple[Histories, States, States]:
    """Read a run's ``binout``, merging the shards of its processors and restarts.

    Each shard is a seekable file and its name in messages. If there are more than ``most`` nodes, those with a title
    are kept first. Returned beside the nodes are the states of ``glstat`` and ``matsum``.
    """
    pieces: dict[str, list[History]] = {}
    title, listed = "", 0
    glstat: States = {}
    matsum: States = {}
    for stream, where in shards:
        file = LsdaFile(stream, where, _wanted)
        glstat |= states_of(file, "glstat")
        matsum |= states_of(file, "matsum")
        for database, names in _DATABASES.items():
            title = title or printable(_text(file, (database, "metadata"), "title").strip())
            found, count = _histories(file, where, database, names, most)
            listed = max(listed, count)
            for piece in found:
                pieces.setdefault(piece.name, []).append(piece)
    merged = [_joined(parts) for parts in pieces.values()]
    kept = kept_of([node.name for node in merged], {node.name: node.title for node in merged}, most)
    notes = (f"{len(shards)} shards of binout merged.",) if len(shards) > 1 else ()
    nodes = tuple(node for node in merged if node.name in kept)
    return Histories(title, nodes, max(listed, len(merged)), notes=notes), glstat, matsum


def _wanted(folder: tuple[str, ...]) -> frozenset[str] | None:
    """Names of the variables to read from a folder of a binout."""
    match folder:
        case (database, "metadata") if database in _DATABASES:
            return _METADATA
        case (database, _) if database in _DATABASES:
            return frozenset({"time", *_DATABASES[database]})
        case ("glstat", _):
            return GLSTAT
        case ("matsum", _):
            return MATSUM
    return None


def _histories(
    file: LsdaFile, where: str, database: str, names: tuple[str, str], most: int
) -> tuple[list[History], int]:
    """Histories of one database of a shard, and the number that it lists."""
    ids = file.read((database, "metadata"), "ids")
    if ids is None or ids.dtype.kind not in "iu":
        return [], 0
    prefix = "body " if database == "rbdout" else ""
    labels = [f"{prefix}{int(number)}" for number in ids[:MOST_NODES]]
    titles = _titles(file, database, prefix)
    states = sorted(f for f in file.folders if f[0] == database and f[1] != "metadata" and names[0] in file.folders[f])
    chosen = kept_of(labels, titles, most)
    places = [place for place, label in enumerate(labels) if label in chosen]
    if len(states) * len(places) > MOST_VALUES:
        raise too_much(where)
    time = np.full(len(states), np.nan)
    values = np.full((2, len(places), len(states)), np.nan)
    with np.errstate(invalid="ignore"):  # damaged data may hold any number
        for state, folder in enumerate(states):
            when = file.read(folder, "time")
            time[state] = np.nan if when is None or when.size != 1 else when[0]
            for of, name in zip(values, names, strict=True):
                row = file.read(folder, name)
                if row is not None and row.size == ids.size:
                    of[:, state] = row[places]
    order = np.argsort(time, kind="stable")
    order = order[np.isfinite(time[order])]
    return [
        History(labels[place], titles.get(labels[place], ""), time[order], accel[order], velocity[order])
        for place, accel, velocity in zip(places, *values, strict=True)
        if order.size
    ], ids.size


def _titles(file: LsdaFile, database: str, prefix: str) -> dict[str, str]:
    folder = (database, "metadata")
    ids, text = file.read(folder, "legend_ids"), _text(file, folder, "legend")
    if ids is None or ids.dtype.kind not in "iu":
        return {}
    cut = range(0, min(len(text), _TITLE_BYTES * ids.size), _TITLE_BYTES)
    return {
        f"{prefix}{int(number)}": printable(text[at : at + _TITLE_BYTES].strip())
        for number, at in zip(ids, cut, strict=False)
    }


def _text(file: LsdaFile, folder: tuple[str, ...], name: str) -> str:
    values = file.read(folder, name)
    return "" if values is None or values.itemsize != 1 else values.tobytes().decode("latin-1").replace("\0", " ")


def _joined(pieces: Sequence[History]) -> History:
    """Join one node's data from several shards; if a restart repeats a time, the later shard takes precedence."""
    ordered = sorted(pieces, key=lambda piece: float(piece.time[0]))
    ends = [float(piece.time[0]) for piece in ordered[1:]] + [np.inf]
    kept = [piece.time < end for piece, end in zip(ordered, ends, strict=True)]
    parts = {
        name: np.concatenate([getattr(piece, name)[keep] for piece, keep in zip(ordered, kept, strict=True)])
        for name in ("time", "acceleration", "velocity")
    }
    return History(ordered[0].name, next((p.title for p in ordered if p.title), ""), **parts)
