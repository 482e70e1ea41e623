"""Reader of LS-DYNA runs: ``binout`` (one file or many) or ASCII ``nodout``; one run, or one folder or job a run.

A run is ``binout0000``, ``binout0007`` … (one file a processor), each with what continues it: ``binout0000%001`` when
the file has grown to a gigabyte, ``binout0000_`` after a restart of some versions. Continuations repeat no metadata.
"""

import re
from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import chain
from pathlib import Path, PurePath
from typing import IO, Self

import numpy as np

from crashfuse.errors import DataError, Problem
from crashfuse.files.archive import Budget, Limits, Member
from crashfuse.readers.format import Travel
from crashfuse.readers.lsdyna_binout import read_binout
from crashfuse.readers.lsdyna_histories import Histories, States, glstat_text, matsum_text, quality_of, read_nodout
from crashfuse.readers.members import opened_members, read_all
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.solver_run import (
    channel_of,
    departure,
    initial_speed,
    is_aliased,
    proposed_nodes,
    quality_sentence,
    units_of,
    vehicle_mass_kg,
)
from crashfuse.readers.vocabulary import speed, weight
from crashfuse.wording import Sentence

_NAME = re.compile(
    r"(?:(?P<job>.+)\.)?(?P<kind>binout|nodouthf|nodout|glstat|matsum)(?P<number>\d*)"
    r"(?P<label>[^.]*?)(?P<restarts>_*)(?:%(?P<part>\d+))?(?:\.(?:txt|asc))?",
    re.IGNORECASE | re.DOTALL,
)
_INPUT = re.compile(r"\.(key|k|dyn|dyna|inp)$", re.IGNORECASE)
_NODES = ("binout", "nodout", "nodouthf")

LSDYNA_LIMITS = Limits(total_bytes=1 << 40, member_bytes=64 << 30, members=500_000)
"""Size limits of a library; only the needed part of a binout is read, however long it is."""

_MOST_UNZIPPED = 256 << 20  # bytes of a zipped binout, which must be read in memory
_MOST_NODES, _FEWEST_NODES, _MOST_IN_ALL = 200, 20, 20_000  # kept for a single run, per run of many, for all runs


@dataclass
class _RunFiles:
    """The files of one run: families of binout, with how many restarts and which part; texts by their kind."""

    binout: dict[str, list[tuple[int, int, Member]]] = field(default_factory=dict)
    text: dict[str, Member] = field(default_factory=dict)

    def families(self) -> list[list[Member]]:
        """The files of each family in the order in which they were written; a DataError if one is missing."""
        families = []
        for _, files in sorted(self.binout.items()):
            ordered = sorted(files, key=lambda file: file[:2])
            before = None
            for restarts, part, member in ordered:
                if (restarts, part) not in _followers(before):
                    raise _incomplete(member, before)
                before = restarts, part
            families.append([member for *_, member in ordered])
        return families

    def add(self, name: "_FileName", member: Member) -> None:
        if name.kind == "binout":
            self.binout.setdefault(name.family, []).append((*name.place, member))
        elif name.kind in self.text:
            expected, found = f"one {name.kind} of a run", f"{self.text[name.kind].where} beside it"
            advice = "choose one of them, or keep runs in folders of their own"
            raise DataError(Problem(member.where, expected, found, advice))
        else:
            self.text[name.kind] = member

    @property
    def has_nodes(self) -> bool:
        return bool(self.binout) or any(kind in self.text for kind in _NODES)

    @property
    def first(self) -> str:
        binout = (file for files in self.binout.values() for *_, file in files)
        return next(chain(binout, self.text.values())).where


def _belongs(path: PurePath) -> bool:
    return _NAME.fullmatch(path.name) is not None


def _runs_of(members: Sequence[Member], path: Path) -> dict[str, _RunFiles]:
    """The files of each run by its id.

    Files in one folder are of one run, unless names of jobs tell them apart (``run12.binout0000``). Of a file that was
    chosen, its own run alone is returned: its families, or that text; and the energies beside it.
    """
    zipped = path.suffix.lower() == ".zip"
    single = path.is_file() and not zipped
    runs: defaultdict[tuple[str, ...], _RunFiles] = defaultdict(_RunFiles)
    chosen = _FileName.of(path)
    for member in members:
        folder, name = member.path.parts[:-1], _FileName.of(member.path)
        if single and (folder or (name.kind in _NODES and not name.goes_with(chosen, member.path.name == path.name))):
            continue
        runs[(*folder, name.job)].add(name, member)
    for place in [place for place, files in runs.items() if not files.has_nodes]:
        energies = runs.pop(place)  # alone they are no run; beside a single one they are its own
        neighbours = [files for other, files in runs.items() if other[:-1] == place[:-1] and files.has_nodes]
        if len(neighbours) == 1:
            neighbours[0].text = {**energies.text, **neighbours[0].text}
    home = path.stem if zipped else (path.parent if single else path).resolve().name
    places = sorted(runs)
    ids = _ids([place if place[-1] else place[:-1] for place in places], home)
    if len(set(ids)) < len(ids):
        raise DataError(Problem(path.name, "a folder of its own name for each run", "the same twice", "rename one"))
    return {run_id: runs[place] for run_id, place in zip(ids, places, strict=True)}


@dataclass(frozen=True, slots=True)
class _FileName:
    kind: str
    job: str
    family: str
    place: tuple[int, int]

    @classmethod
    def of(cls, path: PurePath) -> Self:
        match = _NAME.fullmatch(path.name)
        if match is None:
            return cls("", "", "", (0, 0))
        kind, family = match["kind"].lower(), match["number"]
        label = match["label"] if kind == "binout" else f"{family}{match['label']}{match['restarts']}"
        job = "-".join(filter(None, (_INPUT.sub("", match["job"] or ""), label.strip("_- "))))
        return cls(kind, job, family, (len(match["restarts"]), int(match["part"] or 0)))

    def goes_with(self, chosen: Self, is_it: bool) -> bool:
        return is_it or (self.kind == chosen.kind == "binout" and self.job == chosen.job)


def _ids(folders: Sequence[tuple[str, ...]], home: str) -> list[str]:
    """Ids of runs from their folders and jobs, without leading and trailing ones that all runs share."""
    if len(folders) == 1:
        return [folders[0][-1] if folders[0] else home]
    short = list(folders)
    for end, others in ((0, slice(1, None)), (-1, slice(None, -1))):
        while all(len(folder) > 1 for folder in short) and len({folder[end] for folder in short}) == 1:
            short = [folder[others] for folder in short]
    return ["-".join(folder) or home for folder in short]


def _followers(place: tuple[int, int] | None) -> list[tuple[int, int]]:
    """The places in a family that may follow one; None is before the first."""
    return [(0, 0)] if place is None else [(place[0], place[1] + 1), (place[0] + 1, 0)]


def _incomplete(member: Member, before: tuple[int, int] | None) -> DataError:
    base = re.sub(r"_*(%\d+)?$", "", member.path.name)
    restarts, part = _followers(before)[0]
    expected = f"{base}{'_' * restarts}{f'%{part:03d}' if part else ''} before it"
    return DataError(Problem(member.where, expected, "none", "copy it from the run, too: it holds a part of the time"))


def read_lsdyna(path: Path, travel: Travel | None = None, limits: Limits = LSDYNA_LIMITS) -> tuple[Record, ...]:
    """Read LS-DYNA runs: the accelerations of their nodes along the axis of travel, else of their rigid bodies.

    The path is a ``binout``, any file of its family, a ``nodout``, the folder of a run or of many, or a zip. Each run
    is a record with the name of its job or folder as id, the initial speed of its nodes, and the mass that follows from
    the kinetic energy (``glstat``) at that speed. Travel is, by default, in the direction in which the nodes set out.
    """
    kind = "binout or nodout of LS-DYNA"
    with opened_members(path, _belongs, kind, limits) as (members, budget):
        zipped = path.suffix.lower() == ".zip"
        runs = _runs_of(members, path)
        if not runs:
            raise DataError(Problem(path.name, kind, "none", "choose the folder of a run"))
        most = min(_MOST_NODES, max(_MOST_IN_ALL // len(runs), _FEWEST_NODES))

        def record(run_id: str) -> Record:
            histories = _histories(runs[run_id], budget, most, travel, zipped=zipped)
            return _record(run_id, path.name if len(runs) == 1 else run_id, histories, travel)

        return read_all(runs, record, path.name)


def _histories(files: _RunFiles, budget: Budget, most: int, travel: Travel | None, *, zipped: bool) -> Histories:
    found, glstat, matsum = Histories("", (), 0), States(), States()
    with ExitStack() as opened:

        def stream(file: Member) -> IO[bytes]:
            return _unzipped(file, budget) if zipped else opened.enter_context(file.opened())

        families = [[(stream(file), file.where) for file in family] for family in files.families()]
        if families:
            found, glstat, matsum = read_binout(families, most, travel)
    if not any(node.name.isdecimal() for node in found.nodes):
        for text in (files.text[kind] for kind in ("nodouthf", "nodout") if kind in files.text):
            more = read_nodout(text.chunks(budget), text.where, most, travel)
            found = more.added_to(found) if found.nodes and found.nodes[0].name.isdecimal() else more
    if not glstat and (whole := files.text.get("glstat")) is not None:
        glstat = glstat_text(whole.chunks(budget), whole.where)
    if not matsum and (parts := files.text.get("matsum")) is not None:
        matsum = matsum_text(parts.chunks(budget), parts.where)
    if not found.nodes:
        advice = "ask the solver for it (*DATABASE_NODOUT, *DATABASE_HISTORY_NODE)"
        raise DataError(Problem(files.first, "accelerations of nodes (nodout) or rigid bodies", "none", advice))
    notes = (*found.notes, *_missing_end(found, glstat))
    energy = glstat[min(glstat)].get("kinetic_energy") if glstat else None
    return replace(found, notes=notes, kinetic_energy=energy, quality=quality_of(glstat, matsum))


def _missing_end(run: Histories, glstat: States) -> list[str]:
    """A warning if the energies go on after the nodes end: a part of their file is missing."""
    nodes, energies = max(float(node.time[-1]) for node in run.nodes), sorted(glstat)
    if len(energies) < 3 or energies[-1] - nodes <= 2 * max(np.diff(energies)):
        return []
    return [f"Careful: the nodes end at {nodes:.4g} but the energies at {energies[-1]:.4g}; copy all files of the run."]


def _unzipped(file: Member, budget: Budget) -> IO[bytes]:
    content = BytesIO()
    for chunk in file.chunks(budget):
        if content.tell() + len(chunk) > _MOST_UNZIPPED:
            expected = f"a binout of at most {_MOST_UNZIPPED >> 20} MiB in a zip"
            raise DataError(Problem(file.where, expected, "more", "unpack the zip and import the folder"))
        content.write(chunk)
    return content


def _record(run_id: str, source: str, run: Histories, travel: Travel | None) -> Record:
    nodes = [node for node in run.nodes if node.name.isdecimal()] or list(run.nodes)
    proposed, why = proposed_nodes(nodes)
    per_second, unit, units_sentence = units = units_of(proposed, source)
    speed_mps, no_speed, travels = departure(proposed, units, (run.start, run.fastest), travel, source)
    steps = [f"LS-DYNA run{f', {run.title}' if run.title else ''}.", *run.notes, units_sentence, travels, why]
    if any(map(is_aliased, proposed)):
        steps.append("Accelerations that do not add up to the nodes' velocities are taken from the velocities.")
    if run.total > len(run.nodes):
        steps.append(f"{len(run.nodes)} of {run.total} nodes are kept, those with a title first.")
    mass = None
    if speed_mps is not None:
        initial, energy = initial_speed(proposed), run.kinetic_energy
        mass = vehicle_mass_kg(2 * energy / initial**2) if energy is not None and energy > 0 and initial > 0 else None
        steps.append(Sentence("Speed {}, at which these nodes set out.", speed(speed_mps, form=".4g")))
    if mass is not None:
        steps.append(Sentence("Mass {}, from the kinetic energy at that speed (glstat).", weight(mass)))
    steps.append(quality_sentence(run.quality, "glstat, matsum"))
    channels = tuple(channel_of(node, per_second, unit) for node in run.nodes)
    names = tuple(node.name for node in proposed)
    condition = PartialCondition(speed_mps, mass)
    return Record(run_id, source, condition, channels, names, tuple(steps), no_speed=no_speed, quality=run.quality)
