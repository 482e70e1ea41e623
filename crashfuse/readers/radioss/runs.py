"""Reader of Radioss runs: one file or the files of several, in either form."""

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path, PurePath

import numpy as np

from crashfuse.errors import DataError, Problem, collecting
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits, Member, refuse
from crashfuse.readers.axes import Travel
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.members import opened_members
from crashfuse.readers.radioss.binary import read_binary
from crashfuse.readers.radioss.converted import is_converted, read_converted
from crashfuse.readers.radioss.pulse_record import record_of
from crashfuse.readers.radioss.time_history import TimeHistory, joined, together
from crashfuse.readers.radioss.unnamed import with_names
from crashfuse.readers.record import Record

_KIND = "a time history of Radioss (T01), or the CSV of it"
_NAME = re.compile(
    r"(?P<run>.*[^.])T(?P<part>\d\d)(?P<more>[a-i]?)|(?P<new_run>.+)_(?P<new_part>\d{4})(_(?P<new_more>[a-i]))?\.thy",
    re.IGNORECASE | re.DOTALL,
)
_HEAD = 200  # bytes


def read_radioss(path: Path, travel: Travel | None = None, limits: Limits = DEFAULT_LIMITS) -> tuple[Record, ...]:
    """Read Radioss runs: the accelerations of their nodes and accelerometers along the axis of travel.

    The path is a time history, its CSV, a folder of one run or of many, or a zip. The parts of a run that was
    restarted (``T01``, ``T02`` …) and its additional files (``T01a`` …) are one record.

    Raises
    ------
    DataError
        If there is no time history, one is damaged, or it holds nothing that tells a pulse.
    """
    with opened_members(path, _belongs, _KIND, limits) as (members, budget):
        runs = _runs(members, path)
        if not runs:
            raise DataError(Problem(path.name, _KIND, "none", "check the path"))
        records: list[Record] = []
        problems: list[Problem] = []
        for run_id, files in runs.items():
            with collecting(problems), np.errstate(all="ignore"):  # damaged data may hold any number
                records.append(record_of(_read(files, budget), run_id, files[0].path.name, travel))
        refuse(problems, path.name)
    return tuple(records)


def is_time_history_csv(path: Path) -> bool:
    """Whether a file is the CSV of a time history, which any name may have."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    with path.open("rb") as stream:
        return is_converted(path, stream.read(_HEAD))


def _belongs(path: PurePath) -> bool:
    return FORMATS["radioss"].has(path) or (isinstance(path, Path) and is_time_history_csv(path))


def _told(name: str) -> tuple[str, int, str]:
    """The run, its part and its additional file, from the name of a file."""
    found = _NAME.fullmatch(name[:-4] if name.lower().endswith(".csv") else name)
    if found is None:
        return PurePath(name).stem, 1, ""
    return (
        found["run"] or found["new_run"],
        int(found["part"] or found["new_part"]),
        (found["more"] or found["new_more"] or "").lower(),
    )


def _runs(members: Sequence[Member], path: Path) -> dict[str, list[Member]]:
    """Files by run; of a file that was chosen, only its run. A CSV beside its original is left out."""
    chosen = path.is_file() and path.suffix.lower() != ".zip"
    original = {member.path for member in members if FORMATS["radioss"].has(member.path)}
    found: defaultdict[tuple[str, str], list[Member]] = defaultdict(list)
    for member in members:
        run, copied = _told(member.path.name)[0], member.path not in original
        if chosen:
            if len(member.path.parts) > 1 or copied == FORMATS["radioss"].has(path) or run != _told(path.name)[0]:
                continue
        elif copied and member.path.with_suffix("") in original:
            continue
        found["-".join(member.path.parts[:-1]), run].append(member)
    alone = len({run for _, run in found}) == len(found)
    return {run if alone or not folder else f"{folder}-{run}": files for (folder, run), files in found.items()}


def _read(files: Sequence[Member], budget: Budget) -> TimeHistory:
    """One run from all of its files."""
    by_file: defaultdict[str, list[tuple[int, Member]]] = defaultdict(list)
    for file in files:
        _, part, more = _told(file.path.name)
        by_file[more].append((part, file))
    histories = []
    for more in sorted(by_file):
        parts = sorted(by_file[more], key=lambda each: (each[0], each[1].where))
        numbers, names = [number for number, _ in parts], [file.path.name for _, file in parts]
        if numbers != list(range(1, len(parts) + 1)):
            expected = "every part of the run once, from the first (T01) on"
            advice = "add those that are missing, or import each run on its own"
            raise DataError(Problem(names[0], expected, " and ".join(names), advice))
        histories.append(joined([_parsed(file, budget) for _, file in parts], names))
    return with_names(together(histories))


def _parsed(file: Member, budget: Budget) -> TimeHistory:
    content, name = file.content(budget), file.path.name
    if is_converted(file.path, content[:_HEAD]):
        return read_converted(content, name)
    return read_binary(content, name)
