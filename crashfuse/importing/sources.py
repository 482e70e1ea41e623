"""Import sources: files, folders, archives and uploads; detection of their format, and reading of their records.

Tables of a source are joined by id, some with pulses and some with conditions; for choices they are grouped by header.
"""

import io
import re
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path, PurePath, PurePosixPath
from tempfile import TemporaryDirectory
from typing import get_args

import pandas as pd

from crashfuse import errors
from crashfuse.campaign_folder.condition_tables import listed, safe_id
from crashfuse.campaign_folder.load import check_uploads, members_of_zip
from crashfuse.errors import DataError, Problem, UsageError, collecting, printable, refusal, refuse_if
from crashfuse.files import archive
from crashfuse.files.archive import DEFAULT_LIMITS, ENDINGS, Budget, Limits, Member
from crashfuse.readers import table_mapping
from crashfuse.readers.formats import FORMATS, TABLES, all_formats, formats_of
from crashfuse.readers.members import files_below
from crashfuse.readers.radioss import is_time_history_csv
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.table_headers import ColumnRole, Heading
from crashfuse.readers.table_sheet import Sheet
from crashfuse.readers.tables import read_sheets
from crashfuse.readers.vocabulary import Travel

_ARCHIVE = re.compile(f"(.*)({'|'.join(map(re.escape, ('.zip', *ENDINGS)))})", re.IGNORECASE | re.DOTALL)
_MOST_FILES = 100_000  # examined in a folder
_LISTED = 12  # tables in a sentence
_HEAD = 3  # rows


def is_archive(name: str) -> bool:
    """Whether a file is a zip or a tar archive, by its name."""
    return _ARCHIVE.fullmatch(name) is not None


def members_of(name: str, content: bytes, limits: Limits = DEFAULT_LIMITS) -> list[Member]:
    """The files of an archive in memory."""
    if archive.is_tar(name):
        return archive.tar_members(io.BytesIO(content), name, limits)
    return members_of_zip(name, content, limits)


def lay_out_source(uploads: Sequence[tuple[str, bytes]], into: Path, limits: Limits = DEFAULT_LIMITS) -> Path:
    """Lay uploads out in an existing folder, archives unpacked; return the single thing in it, or a folder with all."""
    check_uploads(uploads, limits)
    home = into / "upload"
    home.mkdir()
    try:
        for name, content in uploads:
            budget = Budget(limits, len(content))
            if packed := _ARCHIVE.fullmatch(PurePosixPath(name).name):
                folder = home / (packed[1].strip(". ") or "archive")
                members = members_of(name, content, limits)
            else:
                folder, members = home, [archive.in_memory(name, content)]
            for member in members:
                try:
                    member.write_to(folder / member.path, budget)
                except (FileExistsError, NotADirectoryError):
                    raise refusal(member.where, "names that differ", "another file of this name", "rename") from None
    except BaseException:
        shutil.rmtree(home)
        raise
    single = list(home.iterdir())
    return single[0] if len(single) == 1 else home


@dataclass(frozen=True, slots=True)
class ColumnChoice:
    """A user's assignment of one column of a foreign table."""

    column: str
    role: ColumnRole
    unit: str | None = None

    def __post_init__(self) -> None:
        errors.require_a(str, self.column, "the name of a column")
        errors.require_a(str | None, self.unit, "a unit, or None")
        errors.one_of("role of a column", self.role, dict.fromkeys(get_args(ColumnRole)))

    @classmethod
    def parsed(cls, text: str) -> "ColumnChoice":
        """Read ``COLUMN=ROLE`` or ``COLUMN=ROLE:UNIT``, as in ``Zeit=time:ms``; a UsageError if it is neither."""
        column, _, use = text.rpartition("=")
        name, _, unit = use.partition(":")
        roles: dict[str, ColumnRole] = {role: role for role in get_args(ColumnRole)}
        if not column or name not in roles:
            raise UsageError(f"A column is mapped as COLUMN=ROLE[:UNIT], not {text!r}; roles are {', '.join(roles)}.")
        return cls(column, roles[name], unit or None)


@dataclass(frozen=True, slots=True)
class Reading:
    """Options for reading a source."""

    source: Path  # a file, a folder of one test or of several, a zip or tar archive of it, or a folder of archives
    fmt: str | None = None  # a key of FORMATS; by default the result of format_of
    columns: tuple[ColumnChoice, ...] = ()  # in every table with these columns; the rest are as proposed
    together: bool = False  # the columns of one table are channels of one record
    conditions: Path | None = None  # a table with the conditions of the records by id
    record_id: str | None = None  # for the one record in the source, also in the table of conditions
    travel: Travel | None = None  # in the file's own axes; by default found from the motion

    def __post_init__(self) -> None:
        if self.travel is not None:
            errors.one_of("direction of travel", self.travel, dict.fromkeys(get_args(Travel)))
        for column in self.columns:
            errors.require_a(ColumnChoice, column, "crashfuse.ColumnChoice(column, role)")
        if self.record_id is not None:
            errors.require_a(str, self.record_id, "the id of the one record")


def format_of(source: Path) -> str:
    """The format of a source, by the names of its files; a DataError for none, or several besides tables."""
    refuse_if(not source.exists(), str(source), "a file or folder to import", "nothing there", errors.CHECK_PATH)
    found = formats_of(_names(source)) or formats_of(name for inner in _archives(source) for name in _names(inner))
    if found == [TABLES] and any(map(is_time_history_csv, tables_of(source))):
        return "radioss"
    if not found:
        broken = "".join(f"; {why.rstrip('.')}" for name in FORMATS.declared if (why := FORMATS.broken(name)))
        raise refusal(source.name, all_formats(), "none of these", f"choose another source{broken}")
    are_several = len(set(found) - {TABLES}) > 1
    refuse_if(are_several, source.name, "records of one format", " and ".join(found), "choose one (--format)")
    return found[0]


def read_records(reading: Reading) -> tuple[Record, ...]:
    """Read all records of a source, or raise a DataError with every problem of every record."""
    problems: list[Problem] = []
    records = tuple(iter_records(reading, problems))
    errors.refuse_all(problems, reading.source.name)
    return records


def read_each(reading: Reading) -> tuple[tuple[Record, ...], tuple[Problem, ...]]:
    """Read every readable record of a source; return the records and the problems of the others."""
    problems, records = list[Problem](), list[Record]()
    # the user, seeing the records, decides whether they are of one crash
    with collecting(problems), suppress(OneCrashOrSeveral):
        records += iter_records(reading, problems)
    return tuple(records), tuple(problems)


def iter_records(reading: Reading, problems: list[Problem]) -> Iterator[Record]:
    """Yield the records of a source one by one; append problems to ``problems``."""
    source = reading.source
    fmt = reading.fmt or format_of(source)
    if reason := FORMATS.broken(fmt):
        raise UsageError(reason)
    errors.one_of("format", fmt, FORMATS)
    if fmt != TABLES and reading.columns and reading.conditions is None:
        raise UsageError("Only tables have columns to map.")
    if reading.travel is not None and not FORMATS[fmt].axes:
        raise UsageError(f"{FORMATS[fmt].label} says which channels are along X; remove --travel.")
    if archives := [source] if _has_to_be_unpacked(source, fmt) else _archives(source):
        if sum(packed.stat().st_size for packed in archives) > DEFAULT_LIMITS.total_bytes:
            raise archive.too_much(source.name, DEFAULT_LIMITS)
        with TemporaryDirectory() as scratch:  # the tables in it tell of which format they are
            unpacked = lay_out_source([(path.name, path.read_bytes()) for path in archives], Path(scratch))
            yield from iter_records(replace(reading, source=unpacked), problems)
        return
    extra = [] if reading.conditions is None else [reading.conditions]
    paths = tables_of(source) if fmt == TABLES else []
    travel = reading.travel if fmt == TABLES else None
    together = reading.together and fmt == TABLES
    tables = read_tables([*paths, *extra], reading.columns, problems, together=together, travel=travel)
    lacks = fmt == TABLES and not paths
    refuse_if(lacks, str(source), f"tables ({FORMATS[TABLES].files})", "none", errors.CHECK_PATH)
    lacks, found = fmt == TABLES and not tables.records, "; ".join(tables.neither) or "conditions alone"
    advice = "map the columns (--column COLUMN=ROLE:UNIT)"
    refuse_if(lacks and not problems, source.name, "time and acceleration", found, advice)
    whole, ids, notes = not problems, list[str](), list[str]()
    if fmt == TABLES and tables.neither:
        notes.append(f"Left out, as neither pulse nor conditions: {'; '.join(tables.neither[:_LISTED])}.")
    elif fmt != TABLES and source.is_dir():
        read = {path.resolve() for path in extra}
        others = (path for path in tables_of(source) if path.resolve() not in read and not is_time_history_csv(path))
        if unread := [path.name for path in others]:
            notes.append(f"Careful: tables in the source are left out, {listed(unread)}; import them by themselves.")
    for record in tables.records if fmt == TABLES else _of_homes(source, fmt, reading.travel, problems):
        if reading.record_id is not None and ids:
            raise UsageError(f"One id is not enough: {source.name} holds several records.")
        ids.append(reading.record_id or record.id)
        record = replace(record, id=ids[-1], steps=(*record.steps, *(notes if len(ids) == 1 else [])))
        record, name = tables.given_to(record), safe_id(record.id)
        if reading.record_id is None and name != record.id:
            note = f"Its id is {name}, because {printable(record.id, 60)!r} cannot name a file on every system."
            record = replace(record, id=name, steps=(*record.steps, note))
        yield record
    if whole:  # else ids of unreadable records may be missing
        tables.check_ids(ids)


def tables_of(source: Path) -> list[Path]:
    """The tables in a source."""
    return [source] if source.is_file() else _files(source, FORMATS[TABLES].has)


def _names(source: Path) -> Iterable[PurePath]:
    if source.is_dir():
        return islice(files_below(source), _MOST_FILES)
    if is_archive(source.name):
        with source.open("rb") as stream:
            members = archive.tar_members if archive.is_tar(source.name) else archive.zip_members
            return [member.path for member in members(stream, source.name, DEFAULT_LIMITS)]
    return [source]


def _has_to_be_unpacked(source: Path, fmt: str) -> bool:
    if not source.is_file() or not is_archive(source.name):
        return False
    has_several = FORMATS[fmt].one_a_file and sum(map(FORMATS[fmt].has, _names(source))) > 1
    return archive.is_tar(source.name) or fmt == TABLES or has_several


def _archives(folder: Path) -> list[Path]:
    files = _files(folder, lambda path: is_archive(path.name))
    return [] if files and formats_of(_names(folder)) else files


def _of_homes(source: Path, fmt: str, travel: Travel | None, problems: list[Problem]) -> Iterator[Record]:
    tests = _files(source, FORMATS[fmt].has) if FORMATS[fmt].one_a_file else []
    for home in tests if len(tests) > 1 else [source]:
        with collecting(problems):
            yield from FORMATS[fmt].read(home, travel)


def _files(folder: Path, wanted: Callable[[Path], bool]) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in islice(files_below(folder), _MOST_FILES) if wanted(path) and path.is_file())


class OneCrashOrSeveral(DataError):
    """Several accelerations in one table that may be sensors of one crash or separate crashes."""


@dataclass
class _TableSet:
    of_table: dict[tuple[Path, str], list[Record]] = field(default_factory=dict)
    with_ids: set[tuple[Path, str]] = field(default_factory=set)  # tables that identify their own records
    parted: set[tuple[Path, str]] = field(default_factory=set)  # tables that stood side by side and were split
    # by ids in lower case: ids as written, conditions, and how they were read
    conditions: dict[str, tuple[str, PartialCondition, tuple[str, ...]]] = field(default_factory=dict)
    neither: list[str] = field(default_factory=list)  # a sentence for each table with neither pulses nor conditions
    unread: list[Problem] = field(default_factory=list)  # problems of tables of conditions

    @property
    def records(self) -> list[Record]:
        return [record for records in self.of_table.values() for record in records]

    def add(
        self, sheet: Sheet, path: Path, columns: Sequence[ColumnChoice], *, together: bool, travel: Travel | None
    ) -> None:
        mapping = table_mapping.propose(sheet, travel)
        for choice in columns:
            if choice.column in sheet.columns:
                mapping = mapping.overruled(choice.column, choice.role, choice.unit)
        if mapping.kind == "pulses":
            record_id = path.stem if sheet.name == path.name else sheet.name.rpartition(": ")[2]
            table = path, sheet.part_of or sheet.name
            records = table_mapping.apply_mapping(sheet, mapping, record_id=record_id, together=together)
            self.of_table.setdefault(table, []).extend(records)
            if mapping.of("id"):
                self.with_ids.add(table)
            elif sheet.part_of:
                self.parted.add(table)
        elif mapping.kind == "conditions":
            with collecting(self.unread):
                conditions, steps = table_mapping.apply_conditions(sheet, mapping), table_mapping.mapping_steps(mapping)
                self.conditions |= {name.casefold(): (name, one, steps) for name, one in conditions.items()}
        else:
            reasons = [f"{printable(use.column, 40)}: {use.why}" for use in mapping.uses if use.role == "ignored"]
            because = f" ({'; '.join(reasons[:12])})" if reasons else ""
            self.neither.append(f"{sheet.name} with the columns {listed(sheet.columns)}{because}")

    def given_to(self, record: Record) -> Record:
        if record.id.casefold() not in self.conditions:
            there = {other.id.casefold() for other in self.records} or self.conditions.keys()
            if idle := [run_id for key, (run_id, *_) in self.conditions.items() if key not in there]:
                return replace(record, no_speed=f"conditions without a record, of {listed(idle)}")
            return record
        _, condition, how = self.conditions[record.id.casefold()]
        steps = (*record.steps, "Condition from the table of conditions.", *how)
        return replace(record, condition=record.condition.overruled(condition), steps=steps)

    def check_ids(self, ids: Sequence[str]) -> None:
        is_other = self.conditions and not self.conditions.keys() & set(map(str.casefold, ids))
        found = f"those of {listed([run_id for run_id, *_ in self.conditions.values()])}"
        refuse_if(is_other, "conditions", f"conditions for {listed(ids)}", found, "make the ids the same")
        unclear = [
            _unclear(name, alike, without, parted=(path, name) in self.parted)
            for (path, name), records in self.of_table.items()
            if (path, name) not in self.with_ids
            for is_simulated in (False, True)
            if len(alike := [record for record in records if record.is_simulated == is_simulated]) > 1
            if (without := [record.id for record in alike if record.id.casefold() not in self.conditions])
        ]
        if unclear:
            raise OneCrashOrSeveral(unclear)


def _unclear(table: str, records: Sequence[Record], without: Sequence[str], *, parted: bool) -> Problem:
    if len(without) < len(records):  # crashes, as the conditions of the others say
        found = f"those of {listed(record.id for record in records if record.id not in without)}"
        advice = "add rows, or leave it out (--column COLUMN=ignored)"
        return Problem(table, f"conditions for {listed(without)}", found, advice)
    best_first = sorted(records, key=lambda record: Heading(record.channels[0].name).likelihood)
    choose = f"average them (--id ID) or choose (--channel {shlex.quote(best_first[0].channels[0].name)})"
    one = "leave out the others (--column COLUMN=ignored)" if parted else choose
    advice = f"if they are sensors of one crash, {one}; if crashes, give conditions (--conditions TABLE)"
    found = f"{listed(record.id for record in best_first)}{', each with a time of its own' if parted else ''}"
    return Problem(table, "one acceleration, or conditions for each", found, advice)


def read_tables(
    paths: Sequence[Path],
    columns: Sequence[ColumnChoice],
    problems: list[Problem],
    *,
    together: bool,
    travel: Travel | None = None,
) -> _TableSet:
    """Read tables by their columns; a table of conditions must be readable, chosen columns there."""
    tables, there, faults = _TableSet(), set[str](), list[Problem]()
    for path in paths:
        with collecting(faults):
            for sheet in read_sheets(path):
                there.update(sheet.columns)
                tables.add(sheet, path, columns, together=together, travel=travel)
    if tables.unread:
        raise DataError([*faults, *tables.unread])
    if (absent := [choice.column for choice in columns if choice.column not in there]) and not faults:
        raise UsageError(f"There is no column {listed(absent)}; there are {listed(sorted(there))}.")
    problems += faults
    return tables


@dataclass(frozen=True, eq=False, slots=True)
class TableForm:
    """Tables with the same headers; the proposed mapping and first rows of the first."""

    names: tuple[str, ...]
    proposed: table_mapping.Mapping
    head: pd.DataFrame

    @property
    def columns(self) -> tuple[str, ...]:
        """The headers, in order."""
        return tuple(use.column for use in self.proposed.uses)

    def unit_of(self, columns: Sequence[str]) -> str | None:
        """The unit in the headers of these columns; None if they differ."""
        units = {use.unit for use in self.proposed.uses if use.column in columns}
        return units.pop() if len(units) == 1 else None

    def choices(
        self, picked: Mapping[ColumnRole, Sequence[str]], units: Mapping[ColumnRole, str | None]
    ) -> tuple[ColumnChoice, ...]:
        """Where columns picked for roles differ from the proposal; others are ignored."""
        role_of = {column: role for role in picked for column in picked[role]}
        choices = []
        for use in self.proposed.uses:
            role: ColumnRole = role_of.get(use.column, "ignored" if use.role in picked else use.role)
            unit = units.get(role)
            if role != use.role or (unit is not None and unit != use.unit):
                choices.append(ColumnChoice(use.column, role, unit))
        return tuple(choices)

    def nothing(self) -> tuple[ColumnChoice, ...]:
        """Choices that ignore every column."""
        return self.choices(dict.fromkeys(get_args(ColumnRole), ()), {})


def table_forms(paths: Sequence[Path]) -> tuple[TableForm, ...]:
    """Group tables by their headers; unreadable ones are skipped here, as reading them later reports why."""
    forms, names = dict[tuple[object, ...], TableForm](), dict[tuple[object, ...], list[str]]()
    for path in paths:
        with suppress(DataError):
            for sheet in read_sheets(path):
                key = (sheet.columns, sheet.units)
                names.setdefault(key, []).append(sheet.name)
                if key not in forms:
                    head = sheet.cells.head(_HEAD).set_axis(list(sheet.columns), axis="columns")
                    forms[key] = TableForm((), table_mapping.propose(sheet), head)
    return tuple(replace(form, names=tuple(names[key])) for key, form in forms.items())
