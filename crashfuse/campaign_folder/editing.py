"""Editing a campaign folder: pulses added, tests left out of use or taken out, and copies to edit.

Each edit is all or nothing, and :func:`crashfuse.campaign_folder.history.undo` takes it back.
"""

import csv
import io
import re
import shutil
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice, zip_longest
from pathlib import Path

import numpy as np

from crashfuse.cae_library import RunQuality
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder import condition_tables, writer
from crashfuse.campaign_folder.condition_tables import TABLES, ConditionTable, Role
from crashfuse.campaign_folder.copies import check_tests_differ
from crashfuse.campaign_folder.history import changing, is_vacant, settle, taking_turns
from crashfuse.campaign_folder.load import ARCHIVE, FILES, WALLS, read_archive
from crashfuse.campaign_folder.pulse_files import PulseFiles, RecordedPulse
from crashfuse.campaign_folder.settings import read_settings, reason, sound_settings
from crashfuse.condition import ABOUT, About, Condition
from crashfuse.crash_test import TUNED
from crashfuse.errors import DataError, Problem, UsageError, collecting, printable, refusal, shortened
from crashfuse.files.atomic import new_folder
from crashfuse.files.csv_text import csv_text, original
from crashfuse.files.toml_text import toml_text
from crashfuse.signals.pulse import Pulse
from crashfuse.signals.wall import Wall
from crashfuse.units import counted

WHAT: Mapping[Role, tuple[str, str]] = {"tests": ("test", "tests"), "cae": ("CAE run", "CAE runs")}  # one, several
_NAMED = 5  # ids
_SAME = 1e-5  # relative: a table may keep float32
_SETTINGS = "campaign.toml"
_MARKS = (*TABLES, _SETTINGS)  # any of these marks a campaign folder
_ENDINGS = ("parquet", "csv")
_START = re.compile(r"unused[ \t]*=")
_MOST_TRIES = 5  # lines that look like the start of the list, and like its end


@dataclass(frozen=True, eq=False, slots=True)
class Addition:
    """A pulse to be added to a campaign folder, what is known of it, and provenance for ``campaign.toml``."""

    id: str
    condition: Condition
    pulse: Pulse
    provenance: Mapping[str, str | float | Sequence[str]] = field(default_factory=dict)
    quality: RunQuality = field(default_factory=RunQuality)
    about: About = ()
    wall: Wall | None = None

    @property
    def further(self) -> dict[str, object]:
        """The cells of its row beyond id and condition."""
        return writer.further_cells(self.quality, self.about)


@dataclass(frozen=True, slots=True)
class Added:
    """The ids that were added, and those that the campaign had already, with the same pulse."""

    role: Role
    ids: tuple[str, ...]
    there: tuple[str, ...] = ()

    def __str__(self) -> str:
        there = f"; there already: {len(self.there)}" if self.there else ""
        return f"Added: {counted(len(self.ids), WHAT[self.role][0])} ({_named(self.ids)}){there}"


def add_to_campaign(folder: Path, additions: Mapping[Role, Sequence[Addition]]) -> tuple[Added, ...]:
    """Add tests, CAE runs or both to a campaign folder, or start a new one with them, as one change.

    Rows go into the table in its units, pulses where the others are, by default ``<role>/<id>.csv``, provenance into
    ``[[imported]]`` tables of ``campaign.toml``. A DataError leaves the campaign unchanged.
    """
    for role, of_role in additions.items():
        ids = [addition.id for addition in of_role]
        writer.check_ids(ids, role)
        names = Counter(map(condition_tables.folded, ids))
        if twice := [run_id for run_id in ids if names[condition_tables.folded(run_id)] > 1]:
            raise refusal(role, "each id once", condition_tables.listed(twice[:2]), "rename one of them")
    if not is_vacant(folder) and not any((folder / name).is_file() for name in _MARKS):
        raise refusal(str(folder), "a campaign folder, or an empty one", "other files", "name another")
    with taking_turns(folder):
        return _add(folder, additions)


def leave_out(folder: Path, ids: Sequence[str], why: str = "") -> str:
    """Leave tests of a campaign out of use, by ``unused`` in ``campaign.toml``; returns what was done.

    Raises a UsageError if there is no such test in use or none would stay in use, a DataError from the files.
    """
    with _editing_tests(folder) as (test_ids, unused):
        _require(ids, [test_id for test_id in test_ids if test_id not in unused], "in use")
        _require_one_in_use(test_ids, {*unused, *ids})
        return _set_why(folder, test_ids, unused, ids, why)


def say_why(folder: Path, test_id: str, why: str) -> str:
    """Give a test that is left out of use another reason, or none; otherwise as :func:`leave_out`."""
    with _editing_tests(folder) as (test_ids, unused):
        _require([test_id], unused, "left out of use")
        return _set_why(folder, test_ids, unused, [test_id], why)


def use_again(folder: Path, ids: Sequence[str]) -> str:
    """Use tests again that were left out of use; otherwise as :func:`leave_out`."""
    with _editing_tests(folder) as (test_ids, unused):
        _require(ids, unused, "left out of use")
        return _set_unused(folder, test_ids, _without(unused, ids), f"In use again: {_named(ids)}")


def say_tuned(folder: Path, ids: Sequence[str], tuned: bool | None) -> str:
    """Say whether the CAE model was tuned to tests, in the column ``cae_tuned``; otherwise as :func:`leave_out`."""
    what = f"CAE model {'' if tuned else 'not '}tuned to: {_named(ids)}"
    return _set_cells(folder, ids, {"cae_tuned": TUNED[tuned]}, what)


def set_about(folder: Path, test_id: str, about: Mapping[str, str]) -> str:
    """Say where a test comes from, in its ``about_`` columns; otherwise as :func:`leave_out`."""
    what = f"About {_named([test_id])}: {', '.join(f'{name} {value}' for name, value in about.items())}"
    return _set_cells(folder, [test_id], {f"{ABOUT}{name}": value for name, value in about.items()}, what)


def remove_tests(folder: Path, ids: Sequence[str]) -> str:
    """Take tests out of a campaign folder, rows and pulses; otherwise as :func:`leave_out`."""
    with _editing_tests(folder) as (test_ids, unused):
        _require(ids, test_ids, "there")
        _require_one_in_use(test_ids, {*unused, *ids})
        table, settings = folder / "tests.csv", folder / _SETTINGS
        what = f"Taken out: {_named(ids)}"
        with changing(folder, what) as new:
            if {*ids} & {*unused}:
                _write_unused(settings, _without(unused, ids), new(settings))
            new(table).write_bytes(_with_rows(table.read_bytes().decode("utf-8-sig"), ids).encode())
            for path in _pulse_tables(folder, "tests"):
                writer.append_to_table(path, new(path), [], without=ids)
            if (walls := folder / WALLS["tests"]).is_file():
                writer.write_walls(walls, new(walls), dict.fromkeys(ids))
            for path in (folder / "tests" / f"{test_id}.{ending}" for test_id in ids for ending in _ENDINGS):
                if path.is_file():
                    new(path)  # without a content
        return what


def set_archive(folder: Path, campaign: Campaign, content: bytes | None) -> str:
    """Put the file of an archive into the folder of a campaign, or take it out; otherwise as :func:`leave_out`."""
    what = f"Archive of past vehicles {'taken out' if content is None else 'put in'}"
    with taking_turns(folder), changing(folder, what) as new:
        target = new(folder / ARCHIVE)
        if content is not None:
            target.write_bytes(content)
            campaign.with_archive(read_archive(target))  # or the folder could not be opened any more
    return what


def _set_cells(folder: Path, ids: Sequence[str], values: Mapping[str, str], what: str) -> str:
    with _editing_tests(folder) as (test_ids, _):
        _require(ids, test_ids, "there")
        path = folder / "tests.csv"
        before = path.read_bytes().decode("utf-8-sig")
        ending = "\r\n" if "\r\n" in before else "\n"
        text, header = _with_columns(before, [*values])

        def row(cells: Sequence[str]) -> str:
            pairs = zip_longest(header, map(original, cells), fillvalue="")
            return csv_text([[values.get(name, cell) for name, cell in pairs]]).removesuffix("\n") + ending

        text = _with_rows(text, ids, row)
        _check_readable({path.name: text})
        if text != before:  # or there is nothing that could be undone
            with changing(folder, what) as new:
                new(path).write_bytes(text.encode())
        return what


def copy_campaign(folder: Path, to: Path) -> None:
    """Copy the files of a campaign folder, byte for byte, into a new one; nothing is left behind if that fails."""
    settle(folder)
    pulses = [name for role in WHAT for end in _ENDINGS for name in (f"{role}_pulses.{end}", f"{role}/*.{end}")]
    with new_folder(to) as home:
        for path in chain.from_iterable(map(folder.glob, (*FILES, *pulses))):
            if path.is_file():
                target = home / path.relative_to(folder)
                target.parent.mkdir(exist_ok=True)
                shutil.copyfile(path, target)


def _named(ids: Sequence[str]) -> str:
    few = len(ids) <= _NAMED
    return (", " if few else " to ").join(printable(run_id, 60) for run_id in (ids if few else (ids[0], ids[-1])))


def _pulse_tables(folder: Path, role: Role) -> list[Path]:
    return [path for ending in _ENDINGS if (path := folder / f"{role}_pulses.{ending}").is_file()]


def _add(folder: Path, additions: Mapping[Role, Sequence[Addition]]) -> tuple[Added, ...]:
    path = folder / _SETTINGS
    settings = path.read_bytes().decode(errors="surrogateescape") if path.is_file() else ""
    tables: dict[str, str] = {}
    new: dict[Role, list[Addition]] = {}
    added = []
    for role, of_role in additions.items():
        table = _table(folder, role)
        there = _already_there(folder, role, table, of_role)
        new[role] = [one for one in of_role if one.id not in there]
        added.append(Added(role, tuple(one.id for one in new[role]), there))
        text, header = _table_to_extend(folder / f"{role}.csv", table, new[role])
        rows = [writer.table_row(header, one.id, one.condition, one.further) for one in new[role]]
        tables[f"{role}.csv"] = text + csv_text(rows)
        for one in new[role]:
            values = {"id": one.id, "as": role, **one.provenance}
            lines = ["[[imported]]", *(f"{key} = {toml_text(value)}" for key, value in values.items())]
            settings += ("\n" if settings else "") + "\n".join(lines) + "\n"
    _check_readable({**tables, _SETTINGS: settings})
    check: Callable[[], None] = partial(_check_differ, folder) if "tests" in new else lambda: None
    with changing(folder, ". ".join(map(str, added)), check) as new_file:
        for role, of_role in new.items():
            _write_pulses(folder, role, of_role, new_file)
            walls, path_of_walls = {one.id: one.wall for one in of_role}, folder / WALLS[role]
            if any(walls.values()) or path_of_walls.is_file():
                writer.write_walls(path_of_walls, new_file(path_of_walls), walls)
        for name, text in {_SETTINGS: settings, **tables}.items():
            new_file(folder / name).write_bytes(text.encode())
    return tuple(added)


def _write_pulses(folder: Path, role: Role, additions: Sequence[Addition], new_file: Callable[[Path], Path]) -> None:
    for table in _pulse_tables(folder, role)[:1]:
        writer.append_to_table(table, new_file(table), [(one.id, one.pulse) for one in additions])
        return
    for one in additions:
        path, pulse = folder / role / f"{one.id}.csv", writer.pulse_csv(one.pulse).encode()
        if path.exists() and path.read_bytes() != pulse:
            raise refusal(f"{role}/{path.name}", "no such file yet", "one without a row", "remove the file")
        new_file(path).write_bytes(pulse)


def _table(folder: Path, role: Role) -> ConditionTable | None:
    path = folder / f"{role}.csv"
    return condition_tables.read_conditions(path, role) if path.is_file() else None


def _already_there(folder: Path, role: Role, table: ConditionTable | None, new: Sequence[Addition]) -> tuple[str, ...]:
    conditions = {} if table is None else dict(zip(table.ids, table.conditions, strict=True))
    names = set(map(condition_tables.folded, conditions))
    again = {addition.id: addition for addition in new if condition_tables.folded(addition.id) in names}
    if not again:
        return ()
    wanted = [run_id for run_id in again if run_id in conditions]
    same = set()
    for run_id, _, record in PulseFiles(folder, role).records(wanted):
        if record is not None and run_id in wanted:
            close = np.allclose(conditions[run_id].vector, again[run_id].condition.vector, rtol=_SAME)
            same |= {run_id} if close and _is_same(record, again[run_id].pulse) else set()
    if other := [run_id for run_id in again if run_id not in same]:
        file, wanted_id = f"{role}.csv", "an id that is not there yet"
        raise DataError([Problem(file, wanted_id, repr(i), "rename it, or remove the other", "id") for i in other[:20]])
    if len(same) == len(new):
        expected, found = f"a {WHAT[role][0]} that is not there yet", f"{_named([*again])}, there already all the same"
        raise refusal(f"{role}.csv", expected, found, "nothing has to be added")
    return tuple(again)


def _is_same(one: RecordedPulse, other: Pulse) -> bool:
    if one.time_s.shape != other.time_s.shape or not np.allclose(one.time_s, other.time_s, rtol=_SAME, atol=1e-9):
        return False
    return np.allclose(one.accel_mps2, other.accel_mps2, atol=_SAME * float(np.abs(other.accel_mps2).max()))


def _table_to_extend(path: Path, table: ConditionTable | None, additions: Sequence[Addition]) -> tuple[str, list[str]]:
    further = writer.further_columns([addition.further for addition in additions])
    if table is None:
        factors = list(dict.fromkeys(name for addition in additions for name, _ in addition.condition.factors))
        header = ["id", "speed_kph", "front_weight_kg", "rear_weight_kg", *factors, *further]
        return csv_text([header]), header
    return _with_columns(path.read_bytes().decode("utf-8-sig"), further)


def _with_columns(text: str, further: Sequence[str]) -> tuple[str, list[str]]:
    header = [cell.strip() for cell in next(csv.reader(io.StringIO(text), skipinitialspace=True))]
    text = text if text.endswith("\n") else f"{text}\n"
    if new := [name for name in further if name not in header]:
        first, _, others = text.partition("\n")
        text, header = f"{first.rstrip()},{csv_text([new])}{others}", [*header, *new]
    return text, header


def _check_readable(files: Mapping[str, str]) -> None:
    problems: list[Problem] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name, text in files.items():
            (folder / name).write_bytes(text.encode(errors="surrogateescape"))
        for role in WHAT:
            with collecting(problems):
                _table(folder, role)
        read_settings(folder, problems, [])
    _refuse(problems)


def _check_differ(folder: Path) -> None:
    settings, tests = read_settings(folder, [], []), _table(folder, "tests")
    if tests is not None:
        tests = tests.without({place for place, test_id in enumerate(tests.ids) if test_id in settings.unused})
        reader, problems = PulseFiles(folder, "tests", settings.channel_filter_class), list[Problem]()
        check_tests_differ(reader.read(tests, settings.unused).without(reader.unread), problems, [])
        _refuse(problems)


def _refuse(problems: Sequence[Problem]) -> None:
    if problems:
        raise DataError([replace(problem, where=f"{problem.where} as it would become") for problem in problems])


@contextmanager
def _editing_tests(folder: Path) -> Iterator[tuple[tuple[str, ...], Mapping[str, str]]]:
    """The ids of all tests, whatever is wrong with their data, and why some are out of use."""
    with taking_turns(folder):
        problems: list[Problem] = []
        settings = sound_settings(folder)
        if (table := condition_tables.read_lenient(folder / "tests.csv", "tests", problems)) is None:
            raise DataError(shortened(problems))
        yield table.ids, settings.unused


def _require(ids: Sequence[str], allowed: Collection[str], what: str) -> None:
    for test_id in ids:
        if test_id not in allowed:
            names = ", ".join(printable(other, 60) for other in allowed) or "none"
            raise UsageError(f"There is no test {printable(test_id, 60)!r} that is {what}; there is {names}.")


def _require_one_in_use(test_ids: Sequence[str], unused: set[str]) -> None:
    if {*test_ids} <= unused:
        raise UsageError("At least one test has to stay in use.")


def _without(unused: Mapping[str, str], ids: Sequence[str]) -> dict[str, str]:
    return {test_id: why for test_id, why in unused.items() if test_id not in ids}


def _set_why(folder: Path, test_ids: Sequence[str], unused: Mapping[str, str], ids: Sequence[str], why: str) -> str:
    why = reason(why)
    what = f"Left out of use: {_named(ids)}{f' ({why})' if why else ''}"
    if all(unused.get(test_id) == why for test_id in ids):
        return what  # nothing that could be undone
    return _set_unused(folder, test_ids, {**unused, **dict.fromkeys(ids, why)}, what)


def _set_unused(folder: Path, test_ids: Sequence[str], unused: Mapping[str, str], what: str) -> str:
    path = folder / _SETTINGS
    with changing(folder, what) as new:
        _write_unused(path, {test_id: unused[test_id] for test_id in test_ids if test_id in unused}, new(path))
    return what


def _write_unused(path: Path, unused: Mapping[str, str], to: Path) -> None:
    """Every other byte stays."""
    value = unused if any(unused.values()) else list(unused)
    text = path.read_bytes().decode("utf-8-sig") if path.is_file() else ""
    line = f"unused = {toml_text(value)}\n" if value else ""
    wanted = {key: setting for key, setting in tomllib.loads(text).items() if key != "unused"}
    if value:
        wanted["unused"] = value
    # the setting is the first line: before any table, whose setting it would be
    new = next((line + others for others in _without_list(text) if _values(line + others) == wanted), None)
    if new is None:
        by_hand = f"set it by hand: unused = {toml_text(value)}"
        raise refusal(path.name, "unused = [...] or {...} at the start of a line", "another form", by_hand)
    if new:
        to.write_bytes(new.encode())


def _without_list(text: str) -> Iterator[str]:
    """The text, then without each of what looks like the list."""
    yield text
    lines = text.splitlines(keepends=True)
    for start in islice((at for at, line in enumerate(lines) if _START.match(line)), _MOST_TRIES):
        closing = (at + 1 for at in range(start, len(lines)) if "]" in lines[at] or "}" in lines[at])
        ends = (end for end in islice(closing, _MOST_TRIES) if _values("".join(lines[start:end])) is not None)
        end = next(ends, start)
        yield "".join(lines[:start] + lines[end:])


def _values(text: str) -> dict[str, object] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def _with_rows(text: str, ids: Sequence[str], new: Callable[[list[str]], str] = lambda _: "") -> str:
    """The other lines stay to the byte."""
    lines = io.StringIO(text, newline="").readlines()
    reader = csv.reader(lines, skipinitialspace=True)
    at = [cell.strip() for cell in next(reader)].index("id")
    kept, start = lines[: reader.line_num], reader.line_num
    for cells in reader:
        is_asked = len(cells) > at and cells[at].strip() in ids
        kept += [new(cells)] if is_asked else lines[start : reader.line_num]
        start = reader.line_num
    return "".join(kept)
