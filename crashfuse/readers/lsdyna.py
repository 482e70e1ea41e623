"""Reader of LS-DYNA runs: ``binout`` (one file or many) or ASCII ``nodout``; one run, or one folder or job a run.

A run is ``binout0000``, ``binout0007`` … (one file a processor), each with what continues it: ``binout0000%001`` when
the file has grown to a gigabyte, ``binout0000_`` after a restart of some versions. Continuations repeat no metadata.
"""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import chain
from pathlib import Path, PurePath, PurePosixPath
from typing import IO, Any, NamedTuple

import numpy as np

from crashfuse.errors import refuse_if
from crashfuse.files.archive import Budget, Limits, Member
from crashfuse.readers import solver_run
from crashfuse.readers.lsdyna_binout import read_binout
from crashfuse.readers.lsdyna_histories import Histories, States, energies_text, quality_of, read_nodout
from crashfuse.readers.members import ASK, COPY_ALL, opened_members, read_all
from crashfuse.readers.record import Record
from crashfuse.readers.vocabulary import AXES, Travel

_NAME = re.compile(
    r"(?:(?P<job>.+)\.)?(?P<kind>binout|nodouthf|nodout|glstat|matsum|d3hsp|messag|mes(?=\d))(?P<number>\d*)"
    r"(?P<label>[^.]*?)(?P<restarts>_*)(?:%(?P<part>\d+))?(?:\.(?:txt|asc))?",
    re.IGNORECASE | re.DOTALL,
)
_INPUT = re.compile(r"\.(key|k|dyn|dyna|inp)$", re.IGNORECASE)
_NODES = ("binout", "nodout", "nodouthf")
_LISTINGS = ("d3hsp", "messag", "mes")
_KIND = "binout or nodout of LS-DYNA"

LSDYNA_LIMITS = Limits(total_bytes=1 << 40, member_bytes=64 << 30, members=500_000)  # only what is needed is read
_MOST_UNZIPPED = 256 << 20  # bytes of a zipped binout, which must be read in memory
_ROUNDED = 1e-5  # a time in text
_MOST_NODES, _FEWEST_NODES, _MOST_IN_ALL = 200, 20, 20_000  # kept for a single run, per run of many, for all runs


class _FileName(NamedTuple):
    kind: str
    job: str
    family: str
    place: tuple[int, int]  # in its family: restarts before it, and part


def _named(path: PurePath) -> _FileName | None:
    if (match := _NAME.fullmatch(path.name)) is None:
        return None
    kind, family = match["kind"].lower(), match["number"]
    if kind == "mes" and int(family):  # one a processor; the first has all
        return None
    label = match["label"] if kind in ("binout", "mes") else f"{family}{match['label']}{match['restarts']}"
    job = "-".join(filter(None, (_INPUT.sub("", match["job"] or ""), label.strip("_- "))))
    return _FileName(kind, job, family, (len(match["restarts"]), int(match["part"] or 0)))


@dataclass
class _RunFiles:
    binout: defaultdict[str, dict[tuple[int, int], Member]] = field(default_factory=lambda: defaultdict(dict))
    text: dict[str, Member] = field(default_factory=dict)
    decks: Mapping[PurePosixPath, Member] = field(default_factory=dict)  # by path, of all runs
    zipped: bool = False

    def families(self) -> list[list[Member]]:
        families = [sorted(files.items()) for _, files in sorted(self.binout.items())]
        for files in families:
            followers = [(0, 0)]
            for (restarts, part), member in files:
                base, (before, lacking) = re.sub(r"_*(%\d+)?$", "", member.path.name), followers[0]
                expected = f"{base}{'_' * before}{f'%{lacking:03d}' if lacking else ''} before it"
                refuse_if((restarts, part) not in followers, member.where, expected, "none", COPY_ALL)
                followers = [(restarts, part + 1), (restarts + 1, 0)]
        return [[member for _, member in files] for files in families]

    def add(self, name: _FileName, member: Member) -> None:
        files: dict[Any, Member] = self.binout[name.family] if name.kind == "binout" else self.text
        first = files.setdefault(name.place if name.kind == "binout" else name.kind, member)
        found = f"{first.where} beside it"
        refuse_if(first is not member, member.where, f"one {name.kind} of a run", found, solver_run.KEEP_APART)

    @property
    def has_nodes(self) -> bool:
        return bool(self.binout) or any(kind in self.text for kind in _NODES)


def _runs_of(members: Sequence[Member], path: Path) -> dict[str, _RunFiles]:
    zipped = path.suffix.lower() == ".zip"
    chosen = _named(path) if path.is_file() and not zipped else None
    decks = {member.path: member for member in members if _named(member.path) is None}
    runs: defaultdict[tuple[str, ...], _RunFiles] = defaultdict(lambda: _RunFiles(decks=decks, zipped=zipped))
    for member in members:
        folder, name = member.path.parts[:-1], _named(member.path)
        if name is None or (chosen is not None and folder):
            continue
        of_its_run = chosen is None or (name.kind == chosen.kind == "binout" and name.job == chosen.job)
        if of_its_run or name.kind not in _NODES or member.path.name == path.name:
            runs[(*folder, name.job)].add(name, member)
    for place in [place for place, files in runs.items() if not files.has_nodes]:
        energies = runs.pop(place)  # alone they are no run; beside a single one they are its own
        neighbours = [files for other, files in runs.items() if other[:-1] == place[:-1] and files.has_nodes]
        if len(neighbours) == 1:
            neighbours[0].text = {**energies.text, **neighbours[0].text}
    home = path.stem if zipped else (path.parent if chosen else path).resolve().name
    places = sorted(runs)
    ids = _ids([place if place[-1] else place[:-1] for place in places], home)
    refuse_if(len(set(ids)) < len(ids), path.name, "a name for each run", "one twice", "rename one")
    return {run_id: runs[place] for run_id, place in zip(ids, places, strict=True)}


def _ids(folders: Sequence[tuple[str, ...]], home: str) -> list[str]:
    if len(folders) == 1:
        return [folders[0][-1] if folders[0] else home]
    short = list(folders)
    for end, others in ((0, slice(1, None)), (-1, slice(None, -1))):
        while all(len(folder) > 1 for folder in short) and len({folder[end] for folder in short}) == 1:
            short = [folder[others] for folder in short]
    return ["-".join(folder) or home for folder in short]


def read_lsdyna(path: Path, travel: Travel | None = None, limits: Limits = LSDYNA_LIMITS) -> tuple[Record, ...]:
    """Read LS-DYNA runs (a file, the folder of one or of many, a zip): nodes, else rigid bodies."""

    def wanted(file: PurePath) -> bool:
        return _named(file) is not None or (file != path and _INPUT.search(file.name) is not None)

    with opened_members(path, wanted, _KIND, limits) as (members, budget):
        runs = _runs_of(members, path)
        refuse_if(not runs, path.name, _KIND, "none", "choose the folder of a run")
        most = min(_MOST_NODES, max(_MOST_IN_ALL // len(runs), _FEWEST_NODES))

        def record(run_id: str) -> Record:
            return _record(run_id, path.name if len(runs) == 1 else run_id, runs[run_id], budget, most, travel)

        return read_all(runs, record, path.name)


def _record(run_id: str, source: str, files: _RunFiles, budget: Budget, most: int, travel: Travel | None) -> Record:
    run, glstat, matsum = _histories(files, budget, most, travel)
    nodes = [node for node in run.nodes if node.name.isdecimal()] or list(run.nodes)
    proposed, why = solver_run.proposed_nodes(nodes)
    force = f"{AXES[solver_run.axis_of_travel(run.start, travel)]}_force"
    forces = {time: state[force] for time, state in sorted(run.walls.items()) if force in state}
    wall = np.array([*forces]), np.array([*forces.values()])
    initial, energy = solver_run.initial_speed(proposed), glstat[min(glstat)].get("kinetic_energy") if glstat else None
    mass, mass_of = solver_run.impulse_mass(wall, proposed) or None, ""
    if energy is not None and energy > 0 and initial > 0:
        mass, mass_of = 2 * energy / initial**2, "from the kinetic energy at that speed (glstat)"
    units = solver_run.units_of(proposed, source, mass, imperial=True)
    speed_mps, no_speed, travels = solver_run.departure(proposed, units, (run.start, run.fastest), travel, source)
    steps = [f"LS-DYNA run{f', {run.title}' if run.title else ''}.", *run.notes, units[2], travels, why]
    steps += solver_run.note_of_kept(len(run.nodes), run.total)
    mass = mass if speed_mps is not None and mass_of else None  # a wall may stop a part of it
    quality, about = quality_of(glstat, matsum), _about(files, run, budget, steps)
    known = (speed_mps, no_speed), (mass, mass_of), quality, steps, about, wall
    return solver_run.run_record(run_id, source, run.nodes, proposed, units, *known)


def _about(files: _RunFiles, run: Histories, budget: Budget, steps: list[str]) -> dict[str, str]:
    about = {"solver": "LS-DYNA", "title": run.title, **run.about}
    for member in [files.text[kind] for kind in _LISTINGS if kind in files.text][:1]:
        listing = solver_run.read_listing(member.chunks(budget))
        if any(about.get(name) and listing.get(name, about[name]) != about[name] for name in ("title", "date")):
            steps.append(f"Careful: {member.where} is the listing of another run; left out.")
            break
        about |= listing
        if (deck := files.decks.get(member.path.with_name(about.get("deck", " ")))) is not None:
            about["deck_sha256"] = solver_run.sha256_of(deck.chunks(budget))
    return {name: text for name, text in about.items() if name != "title"}


def _histories(files: _RunFiles, budget: Budget, most: int, travel: Travel | None) -> tuple[Histories, States, States]:
    run, glstat, matsum = Histories("", (), 0), States(), States()
    with ExitStack() as opened:

        def stream(file: Member) -> IO[bytes]:
            if not files.zipped:
                return opened.enter_context(file.opened())
            content, expected = BytesIO(), f"at most {_MOST_UNZIPPED >> 20} MiB"
            for chunk in file.chunks(budget):
                content.write(chunk)
                refuse_if(content.tell() > _MOST_UNZIPPED, file.where, expected, "more", "unpack the zip")
            return content

        if families := [[(stream(file), file.where) for file in family] for family in files.families()]:
            run, glstat, matsum = read_binout(families, most, travel)
    if not any(node.name.isdecimal() for node in run.nodes):
        for text in (files.text[kind] for kind in ("nodouthf", "nodout") if kind in files.text):
            more = read_nodout(text.chunks(budget), text.where, most, travel)
            if run.nodes and run.nodes[0].name.isdecimal():  # a node that is in both is taken from nodouthf
                names = {node.name for node in run.nodes}
                nodes = (*run.nodes, *(node for node in more.nodes if node.name not in names))
                run = replace(run, nodes=nodes, total=max(len(nodes), more.total, run.total))
            else:
                run = more
    for kind, states in (("glstat", glstat), ("matsum", matsum)):
        if not states and (whole := files.text.get(kind)) is not None:
            states |= energies_text(whole.chunks(budget), whole.where)
    first = next(chain(*(members.values() for members in files.binout.values()), files.text.values()))
    refuse_if(not run.nodes, first.where, "accelerations of nodes or rigid bodies", "none", ASK)
    earliest = float(run.nodes[0].time[0]) * (1 - _ROUNDED)
    if run.is_cut:  # energies of what was before are not the crash's
        glstat, matsum = ({at: of for at, of in states.items() if at >= earliest} for states in (glstat, matsum))
    last, energies = max(float(node.time[-1]) for node in run.nodes), sorted(glstat)
    if len(energies) > 2 and energies[-1] - last > 2 * max(np.diff(energies)):
        note = f"Careful: nodes end at {last:.4g}, energies at {energies[-1]:.4g}; {COPY_ALL}."
        run = replace(run, notes=(*run.notes, note))
    return run, glstat, matsum
