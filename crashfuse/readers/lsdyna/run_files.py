"""Which files are of one run: by folder, by the name of the job before theirs, and by the numbers after it.

A run is ``binout0000``, ``binout0007`` … (one file a processor), each with what continues it: ``binout0000%001`` when
the file has grown to a gigabyte, ``binout0000_`` after a restart of some versions. Continuations repeat no metadata.
"""

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Self

from crashfuse.errors import DataError, Problem
from crashfuse.files.archive import Member

_NAME = re.compile(
    r"(?:(?P<job>.+)\.)?(?P<kind>binout|nodouthf|nodout|glstat|matsum)(?P<number>\d*)"
    r"(?P<label>[^.]*?)(?P<restarts>_*)(?:%(?P<part>\d+))?(?:\.(?:txt|asc))?",
    re.IGNORECASE | re.DOTALL,
)
_INPUT = re.compile(r"\.(key|k|dyn|dyna|inp)$", re.IGNORECASE)
_NODES = ("binout", "nodout", "nodouthf")


@dataclass
class RunFiles:
    """The files of one run.

    Parameters
    ----------
    binout : dict of str to list of (int, int, Member)
        Members of each family by its number: how many restarts, and which part.
    text : dict of str to Member
        ``nodout``, ``nodouthf``, ``glstat`` and ``matsum``.
    """

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
        """Add a file; a DataError if there is another text of its kind."""
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
        """Whether there is more than energies."""
        return bool(self.binout) or any(kind in self.text for kind in _NODES)

    @property
    def first(self) -> str:
        """The name of one of the files, for messages."""
        return next((file.where for files in self.binout.values() for *_, file in files), "") or next(
            file.where for file in self.text.values()
        )


def belongs(path: PurePath) -> bool:
    """Whether a file is of a run: its nodes, or the energies beside them."""
    return _NAME.fullmatch(path.name) is not None


def runs_of(members: Sequence[Member], path: Path) -> dict[str, RunFiles]:
    """The files of each run by its id.

    Files in one folder are of one run, unless names of jobs tell them apart (``run12.binout0000``). Of a file that was
    chosen, its own run alone is returned: its families, or that text; and the energies beside it.
    """
    zipped = path.suffix.lower() == ".zip"
    single = path.is_file() and not zipped
    runs: defaultdict[tuple[str, ...], RunFiles] = defaultdict(RunFiles)
    chosen = _FileName.of(path)
    for member in members:
        folder, name = member.path.parts[:-1], _FileName.of(member.path)
        if single and (folder or (name.kind in _NODES and not name.goes_with(chosen, member.path.name == path.name))):
            continue
        runs[(*folder, name.job)].add(name, member)
    for place in [place for place, files in runs.items() if not files.has_nodes]:
        energies = runs.pop(place)  # alone they are no run; beside a single one they are its own
        own = [files for other, files in runs.items() if other[:-1] == place[:-1] and files.has_nodes]
        if len(own) == 1:
            own[0].text = {**energies.text, **own[0].text}
    home = path.stem if zipped else (path.parent if single else path).resolve().name
    places = sorted(runs)
    ids = _ids([place if place[-1] else place[:-1] for place in places], home)
    if len(set(ids)) < len(ids):
        raise DataError(Problem(path.name, "a folder of its own name for each run", "the same twice", "rename one"))
    return {run_id: runs[place] for run_id, place in zip(ids, places, strict=True)}


@dataclass(frozen=True, slots=True)
class _FileName:
    """What the name of a file says: its kind, the job, and for a binout the family and the place in it."""

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
        """Whether the file is of the run of a chosen one: itself, or a binout like it."""
        return is_it or (self.kind == chosen.kind == "binout" and self.job == chosen.job)


def _ids(folders: Sequence[tuple[str, ...]], home: str) -> list[str]:
    """Ids of runs from their folders and jobs, without leading and trailing ones that all runs share."""
    if len(folders) == 1:
        return [folders[0][-1] if folders[0] else home]
    short = list(folders)
    for end, rest in ((0, slice(1, None)), (-1, slice(None, -1))):
        while all(len(folder) > 1 for folder in short) and len({folder[end] for folder in short}) == 1:
            short = [folder[rest] for folder in short]
    return ["-".join(folder) or home for folder in short]


def _followers(place: tuple[int, int] | None) -> list[tuple[int, int]]:
    """The places in a family that may follow one; None is before the first."""
    return [(0, 0)] if place is None else [(place[0], place[1] + 1), (place[0] + 1, 0)]


def _incomplete(member: Member, before: tuple[int, int] | None) -> DataError:
    """The error for a family with a missing member."""
    base = re.sub(r"_*(%\d+)?$", "", member.path.name)
    restarts, part = _followers(before)[0]
    missing = f"{base}{'_' * restarts}{f'%{part:03d}' if part else ''}"
    expected, advice = f"{missing} before it", "copy it from the run, too: it holds a part of the time"
    return DataError(Problem(member.where, expected, "none", advice))
