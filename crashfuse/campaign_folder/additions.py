"""Adding pulses to a campaign folder: all of them or none, to be undone at will.

A pulse belongs to a campaign once its row is in the condition table; the tables take their places last.
"""

import csv
import io
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from crashfuse.campaign_folder.added import WHAT, Added, named
from crashfuse.campaign_folder.columns import listed
from crashfuse.campaign_folder.condition_tables import TABLES, ConditionTable, Role, read_conditions
from crashfuse.campaign_folder.copies import check_tests_differ
from crashfuse.campaign_folder.history import changing, is_vacant, taking_turns
from crashfuse.campaign_folder.ids import folded
from crashfuse.campaign_folder.pulse_files import PulseFiles
from crashfuse.campaign_folder.settings import read_settings
from crashfuse.campaign_folder.tidy_tables import append_to_table
from crashfuse.campaign_folder.writer import check_ids, pulse_csv, quality_columns, table_row
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, collecting
from crashfuse.files.csv_output import csv_text
from crashfuse.files.toml_text import toml_text
from crashfuse.run_quality import RunQuality
from crashfuse.signals.pulse import Pulse

Told = Mapping[str, str | float | Sequence[str]]
_SAME = 1e-5  # relative: a table may keep float32
_MARKS = (*TABLES, "campaign.toml")  # any of these marks a campaign folder


@dataclass(frozen=True, eq=False, slots=True)
class Addition:
    """A pulse to be added to a campaign folder, what the solver says of it, and provenance for ``campaign.toml``."""

    id: str
    condition: Condition
    pulse: Pulse
    told: Told = field(default_factory=dict)
    quality: RunQuality = field(default_factory=RunQuality)


def add_to_campaign(folder: Path, role: Role, additions: Sequence[Addition]) -> Added:
    """Add tests or CAE runs to a campaign folder, see :func:`add_each`."""
    [added] = add_each(folder, {role: additions})
    return added


def add_each(folder: Path, additions: Mapping[Role, Sequence[Addition]]) -> tuple[Added, ...]:
    """Add tests, CAE runs or both to a campaign folder, or start a new one with them, as one change.

    Rows go into the existing table, in its units; pulses go where the others are, by default
    ``<role>/<id>.csv``; ``campaign.toml`` gets an ``[[imported]]`` table for each. What is there already, with the same
    id, condition and pulse, stays as it is. :func:`crashfuse.campaign_folder.history.undo` takes it all back.

    Parameters
    ----------
    folder : Path
        A campaign folder, or a folder that is empty or does not exist yet.

    Raises
    ------
    DataError
        If an id is already in the campaign with another condition or pulse, or all are there already; if a test is a
        copy of another; if an id occurs twice in the additions or is not a valid file name; if the campaign's own table
        is invalid, or it is the sample;
        nothing is changed.
    OSError
        If writing fails; the campaign is unchanged.
    """
    for role, own in additions.items():
        ids = [addition.id for addition in own]
        check_ids(ids, role)
        names = Counter(map(folded, ids))
        if twice := [run_id for run_id in ids if names[folded(run_id)] > 1]:
            raise DataError(Problem(role, "each id once", listed(twice[:2]), "give one of them another id"))
    if not is_vacant(folder) and not any((folder / name).is_file() for name in _MARKS):
        found, advice = "other files", "name a campaign, or a folder that does not exist yet"
        raise DataError(Problem(str(folder), "a campaign folder, or an empty one", found, advice))
    with taking_turns(folder):
        return _add(folder, additions)


def _add(folder: Path, additions: Mapping[Role, Sequence[Addition]]) -> tuple[Added, ...]:
    tables = {role: _known(folder / f"{role}.csv", role) for role in additions}
    new: dict[Role, list[Addition]] = {}
    added = []
    for role, own in additions.items():
        there = tuple(_already_there(folder, role, tables[role], own))
        new[role] = [addition for addition in own if addition.id not in there]
        added.append(Added(role, tuple(addition.id for addition in new[role]), there))
    contents = _contents(folder, tables, new)
    check = partial(_check_differ, folder) if "tests" in new else lambda: None
    with changing(folder, ". ".join(map(str, added)), check) as new_file:
        for role, fresh in new.items():
            _write_pulses(folder, role, fresh, new_file)
        for path, text in contents.items():
            new_file(path).write_bytes(text.encode())
    return tuple(added)


def _contents(
    folder: Path, tables: Mapping[Role, ConditionTable | None], additions: Mapping[Role, Sequence[Addition]]
) -> dict[Path, str]:
    """What campaign.toml, which records the additions at its end, and the condition tables become, in this order."""
    path = folder / "campaign.toml"
    settings = path.read_bytes().decode(errors="surrogateescape") if path.is_file() else ""
    contents = {}
    for role, own in additions.items():
        table = folder / f"{role}.csv"
        text, header = _table_to_extend(table, tables[role], own)
        rows = [table_row(header, addition.id, addition.condition, addition.quality) for addition in own]
        contents[table] = text + csv_text(rows)
        for addition in own:
            told = {"id": addition.id, "as": role, **addition.told}
            lines = [f"{key} = {toml_text(value)}" for key, value in told.items()]
            settings += ("\n" if settings else "") + "\n".join(["[[imported]]", *lines]) + "\n"
        _check_readable({table.name: contents[table], path.name: settings}, role)
    return {path: settings, **contents}


def _write_pulses(folder: Path, role: Role, additions: Sequence[Addition], new_file: Callable[[Path], Path]) -> None:
    tables = [path for ending in ("parquet", "csv") if (path := folder / f"{role}_pulses.{ending}").is_file()]
    if tables:
        append_to_table(tables[0], new_file(tables[0]), [(addition.id, addition.pulse) for addition in additions])
        return
    for addition in additions:
        path = folder / role / f"{addition.id}.csv"
        pulse = pulse_csv(addition.pulse).encode()
        if path.exists() and path.read_bytes() != pulse:
            found, advice = "another pulse there, without a row in the table", "rename or remove the file"
            raise DataError(Problem(f"{role}/{path.name}", "no such file yet", found, advice))
        new_file(path).write_bytes(pulse)


def _known(table: Path, role: Role) -> ConditionTable | None:
    """The rows of the condition table; None if there is no table yet."""
    return read_conditions(table, role) if table.is_file() else None


def _already_there(
    folder: Path, role: Role, known: ConditionTable | None, additions: Sequence[Addition]
) -> Iterator[str]:
    """The ids of additions that the campaign has already; a DataError if one has another condition or pulse there."""
    own = {} if known is None else dict(zip(known.ids, known.conditions, strict=True))
    there = set(map(folded, own))
    again = {addition.id: addition for addition in additions if folded(addition.id) in there}
    if not again:
        return
    pulses = PulseFiles(folder, role, None)
    same = set()
    for run_id, _, record in pulses.records([run_id for run_id in again if run_id in own]):
        if record is not None and run_id in again:
            pulse, condition = again[run_id].pulse, again[run_id].condition
            if (
                record.time_s.shape == pulse.time_s.shape
                and np.allclose(record.time_s, pulse.time_s, rtol=_SAME, atol=1e-9)
                and np.allclose(record.accel_mps2, pulse.accel_mps2, atol=_SAME * float(np.abs(pulse.accel_mps2).max()))
                and np.allclose(own[run_id].vector, condition.vector, rtol=_SAME)
            ):
                same.add(run_id)
    if other := [run_id for run_id in again if run_id not in same]:
        expected, advice = "an id that is not there yet", "give it another id, or remove the one that is there"
        raise DataError([Problem(f"{role}.csv", expected, repr(i), advice, "id") for i in other[:20]])
    if len(same) == len(additions):
        found = f"{named([*again])}, there already with the same condition and pulse"
        raise DataError(
            Problem(f"{role}.csv", f"a {WHAT[role][0]} that is not there yet", found, "nothing has to be added")
        )
    yield from again


def _table_to_extend(table: Path, known: ConditionTable | None, additions: Sequence[Addition]) -> tuple[str, list[str]]:
    """The text of the condition table, ready for rows to be appended, and its columns.

    Columns of run quality that it lacks are added to its header; its rows are then short, which counts as empty cells.
    """
    quality = quality_columns([addition.quality for addition in additions])
    if known is None:
        factors = list(dict.fromkeys(name for addition in additions for name, _ in addition.condition.factors))
        header = ["id", "speed_kph", "front_weight_kg", "rear_weight_kg", *factors, *quality]
        return csv_text([header]), header
    text = table.read_bytes().decode("utf-8-sig")
    header = [cell.strip() for cell in next(csv.reader(io.StringIO(text), skipinitialspace=True))]
    text = text if text.endswith("\n") else f"{text}\n"
    if new := [name for name in quality if name not in header]:
        first, _, rest = text.partition("\n")
        text, header = f"{first.rstrip()},{','.join(new)}\n{rest}", [*header, *new]
    return text, header


def _check_readable(files: Mapping[str, str], role: Role) -> None:
    """Raise a DataError if a file could not be read back: the whole campaign could no longer be opened."""
    problems: list[Problem] = []
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in files.items():
            (Path(scratch) / name).write_bytes(text.encode(errors="surrogateescape"))
        with collecting(problems):
            read_conditions(Path(scratch) / f"{role}.csv", role)
        read_settings(Path(scratch), problems, [])
    _refuse(problems)


def _check_differ(folder: Path) -> None:
    """Raise a DataError if a test in use has become a copy of another: the campaign could no longer be opened."""
    settings, tests = read_settings(folder, [], []), _known(folder / "tests.csv", "tests")
    if tests is not None:
        tests = tests.without([place for place, test_id in enumerate(tests.ids) if test_id in settings.unused])
        reader = PulseFiles(folder, "tests", settings.channel_filter_class)
        accel = reader.read(tests.ids, list(settings.unused))
        problems: list[Problem] = []
        accel = np.delete(accel, reader.unread, axis=0)
        check_tests_differ(tests.without(reader.unread), accel, reader.ends_s, problems, [])
        _refuse(problems)


def _refuse(problems: Sequence[Problem]) -> None:
    """Raise the problems of files as they would become, if there are any."""
    if problems:
        raise DataError([replace(problem, where=f"{problem.where} as it would become") for problem in problems])
