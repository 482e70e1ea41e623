"""Reader of LS-DYNA runs: ``binout`` (one file or shards) or ASCII ``nodout``; one run, or one folder per run.

LS-DYNA does not record which node is the accelerometer: titles (``*DATABASE_HISTORY_NODE_ID``) identify it; without
titles, nodes that travel as far as most others are proposed.
"""

import re
from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from io import BytesIO
from pathlib import Path, PurePath
from typing import IO

import numpy as np

from crashfuse.errors import DataError, Problem, collecting
from crashfuse.files.archive import Budget, Limits, Member, refuse
from crashfuse.readers.energies import quality_sentence
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.lsdyna.binout import read_binout
from crashfuse.readers.lsdyna.energies import States, glstat_text, kinetic_energy, matsum_text, quality_of
from crashfuse.readers.lsdyna.histories import Histories, History, channel_of, integral, is_aliased
from crashfuse.readers.lsdyna.nodout import read_nodout
from crashfuse.readers.lsdyna.unit_system import mass_kg, units_of
from crashfuse.readers.members import opened_members
from crashfuse.readers.record import ACCELERATION_UNITS, PartialCondition, Record
from crashfuse.units import MS

LSDYNA_LIMITS = Limits(total_bytes=1 << 40, member_bytes=64 << 30, members=500_000)
"""Size limits of a library; only the needed part of a binout is read, however long it is."""

_MOST_UNZIPPED = 256 << 20  # bytes of a zipped binout, which must be read in memory
_MOST_NODES, _FEWEST_NODES, _MOST_IN_ALL = 200, 20, 20_000  # kept for a single run, per run of many, for all runs
_BESIDE = ("glstat", "matsum")
_ENERGIES = re.compile(rf"({'|'.join(_BESIDE)})[^.]*(\.(txt|asc))?", re.IGNORECASE | re.DOTALL)
_ALIKE = 0.1  # of the median travel
_DUMMY = re.compile(r"\b(dummy|head|neck|chest|thorax|pelvis|femur|tibia|foot|spine)\b", re.I)
_PLACES = (
    (r"(?=.*\b(rear|rr|hinten)\b)(?=.*(cross|x-?member|floor|sill|seat|tunnel))", "at the rear, behind the crush"),
    (r"\b(c\.?o?\.?g|cent(er|re) of gravity|schwerpunkt)\b", "at the centre of gravity"),
    (r"tunnel", "on the tunnel"),
    (r"\b(sill|rocker)", "on the sills"),
    (r"\bb[- _]?pillar", "on the B-pillars"),
)


def read_lsdyna(path: Path, limits: Limits = LSDYNA_LIMITS) -> tuple[Record, ...]:
    """Read LS-DYNA runs: the X accelerations of their nodes, else of their rigid bodies.

    The path is a ``binout``, any of its shards, a ``nodout``, the folder of a run or of many, or a zip. Each run is a
    record with the folder's name as id, the initial speed of its nodes, and the mass that follows from the kinetic
    energy (``glstat``) at that speed.
    """
    kind = "binout or nodout of LS-DYNA"
    with opened_members(path, _belongs, kind, limits) as (members, budget):
        zipped = path.suffix.lower() == ".zip"
        runs = _runs(members, path)
        if not runs:
            raise DataError(Problem(path.name, kind, "none", "choose the folder of a run"))
        most = min(_MOST_NODES, max(_MOST_IN_ALL // len(runs), _FEWEST_NODES))
        records: list[Record] = []
        problems: list[Problem] = []
        for run_id, files in runs.items():
            with collecting(problems), np.errstate(all="ignore"):  # damaged data may hold any number
                histories = _histories(files, budget, most, zipped=zipped)
                records.append(_record(run_id, path.name if len(runs) == 1 else run_id, histories))
        refuse(problems, path.name)
    return tuple(records)


def _belongs(path: PurePath) -> bool:
    """Whether a file is of a run: its nodes, or the energies beside them."""
    return FORMATS["lsdyna"].has(path) or _ENERGIES.fullmatch(path.name) is not None


def _runs(members: Sequence[Member], path: Path) -> dict[str, list[Member]]:
    """Files by run: those of one folder, or only the shards of a file that was chosen and the energies beside it."""
    zipped = path.suffix.lower() == ".zip"
    single = path.is_file() and not zipped
    family = path.name[:6].lower()
    by_folder: defaultdict[tuple[str, ...], list[Member]] = defaultdict(list)
    for member in members:
        *folder, name = member.path.parts
        if not single or (not folder and name.lower().startswith((family, *_BESIDE))):
            by_folder[tuple(folder)].append(member)
    for place in [place for place, files in by_folder.items() if not any(FORMATS["lsdyna"].has(f.path) for f in files)]:
        del by_folder[place]  # energies alone are no run
    home = path.stem if zipped else (path.parent if single else path).resolve().name
    folders = sorted(by_folder)
    ids = _ids(folders, home)
    if len(set(ids)) < len(ids):
        raise DataError(Problem(path.name, "a folder of its own name for each run", "the same twice", "rename one"))
    return {run_id: by_folder[folder] for run_id, folder in zip(ids, folders, strict=True)}


def _ids(folders: Sequence[tuple[str, ...]], home: str) -> list[str]:
    """Ids of runs from their folders, without leading and trailing folders that all runs share."""
    if len(folders) == 1:
        return [folders[0][-1] if folders[0] else home]
    short = list(folders)
    for end, rest in ((0, slice(1, None)), (-1, slice(None, -1))):
        while all(len(folder) > 1 for folder in short) and len({folder[end] for folder in short}) == 1:
            short = [folder[rest] for folder in short]
    return ["-".join(folder) or home for folder in short]


def _histories(files: Sequence[Member], budget: Budget, most: int, *, zipped: bool) -> Histories:
    """Read the binout of a run, or its nodout if the binout has no nodes."""
    shards = sorted(_named(files, "binout"), key=lambda file: file.where)
    text = _named(files, "nodout")
    found, glstat, matsum = Histories("", (), 0), States(), States()
    if shards:
        with ExitStack() as opened:
            streams = [
                (_unzipped(file, budget) if zipped else opened.enter_context(file.opened()), file.where)
                for file in shards
            ]
            found, glstat, matsum = read_binout(streams, most)
    if text and not any(node.name.isdecimal() for node in found.nodes):
        found = read_nodout(text[0].chunks(budget), text[0].where, most)
    for file in _named(files, "glstat")[:1] if not glstat else ():
        glstat = glstat_text(file.chunks(budget), file.where)
    for file in _named(files, "matsum")[:1] if not matsum else ():
        matsum = matsum_text(file.chunks(budget), file.where)
    if not found.nodes:
        advice = "ask the solver for it (*DATABASE_NODOUT, *DATABASE_HISTORY_NODE)"
        raise DataError(Problem(files[0].where, "accelerations of nodes (nodout) or rigid bodies", "none", advice))
    return replace(found, kinetic_energy=kinetic_energy(glstat), quality=quality_of(glstat, matsum))


def _named(files: Sequence[Member], beginning: str) -> list[Member]:
    return [file for file in files if file.path.name.lower().startswith(beginning)]


def _unzipped(file: Member, budget: Budget) -> IO[bytes]:
    content = BytesIO()
    for chunk in file.chunks(budget):
        if content.tell() + len(chunk) > _MOST_UNZIPPED:
            expected = f"a binout of at most {_MOST_UNZIPPED >> 20} MiB in a zip"
            raise DataError(Problem(file.where, expected, "more", "unpack the zip and import the folder"))
        content.write(chunk)
    return content


def _record(run_id: str, source: str, run: Histories) -> Record:
    nodes = [node for node in run.nodes if node.name.isdecimal()] or list(run.nodes)
    proposed, why = _proposed(nodes)
    per_second, unit, units_told = units_of(proposed, source)
    speed = float(np.median([abs(node.velocity[0]) for node in proposed])) * ACCELERATION_UNITS[unit or "m/s²"]
    speed *= 1.0 if per_second == 1 else MS  # velocity unit = acceleration unit times time unit
    mass = None if unit is None else mass_kg(run.kinetic_energy, proposed)
    aliased = [node.name for node in run.nodes if is_aliased(node)]
    steps = [f"LS-DYNA run{f', {run.title}' if run.title else ''}.", *run.notes, units_told, why]
    if aliased and {node.name for node in proposed} & set(aliased):
        steps.append("Accelerations that do not add up to the nodes' velocities are taken from the velocities.")
    if run.total > len(run.nodes):
        steps.append(f"{len(run.nodes)} of {run.total} nodes are kept, those with a title first.")
    known = unit is not None and bool(np.isfinite(speed))
    if known:
        steps.append(f"Speed {speed:.4g} m/s, at which these nodes set out.")
    if mass is not None:
        steps.append(f"Mass {mass:.5g} kg, from the kinetic energy at that speed (glstat).")
    steps.append(quality_sentence(run.quality, "glstat, matsum"))
    channels = tuple(channel_of(node, per_second, unit) for node in run.nodes)
    names = tuple(node.name for node in proposed)
    condition = PartialCondition(speed if known else None, mass)
    no_speed = "" if known else f"a {units_told[0].lower()}{units_told[1:].rstrip('.')}"
    return Record(run_id, source, condition, channels, names, tuple(steps), no_speed=no_speed, quality=run.quality)


def _proposed(nodes: Sequence[History]) -> tuple[list[History], str]:
    """The nodes to average, and the reason."""
    for words, where in _PLACES:
        named = [n for n in nodes if re.search(words, n.title, re.I) and not _DUMMY.search(n.title)]
        if named:
            return named, f"Nodes {where}: {_listed(named)}; {_average(named)}."
    travels = np.array([np.abs(integral(node.velocity, node.time)).max() for node in nodes])
    if len(nodes) == 1 or not np.isfinite(travels).any():
        return list(nodes), f"No titles say which nodes are accelerometers; {_listed(nodes)}: {_average(nodes)}."
    middle = np.nanmedian(travels)
    alike = [n for n, travel in zip(nodes, travels, strict=True) if abs(travel - middle) <= _ALIKE * middle]
    chosen = alike or list(nodes)
    why = f"No titles say which nodes are accelerometers; {len(chosen)} of {len(nodes)} travel alike"
    return chosen, f"{why} ({_listed(chosen)}): {_average(chosen)}. Choose others if some lie in the crush."


def _listed(nodes: Sequence[History]) -> str:
    shown = ", ".join(f"{node.name}{f' ({node.title})' if node.title else ''}" for node in nodes[:6])
    return f"{shown} and {len(nodes) - 6} more" if len(nodes) > 6 else shown


def _average(nodes: Sequence[History]) -> str:
    return "their average is the pulse" if len(nodes) > 1 else "it is the pulse"
