"""Import sources: files, folders, archives and uploads; detection of their format, and reading of their records."""

import io
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path, PurePath, PurePosixPath
from tempfile import TemporaryDirectory
from typing import get_args

from crashfuse import errors
from crashfuse.campaign_folder.condition_tables import listed, safe_id
from crashfuse.campaign_folder.load import check_uploads, members_of_zip
from crashfuse.errors import Problem, UsageError, collecting, one_of, printable, refusal, refuse_all, require_a
from crashfuse.files import archive
from crashfuse.files.archive import DEFAULT_LIMITS, ENDINGS, Budget, Limits, Member
from crashfuse.importing.tables import ColumnChoice, OneCrashOrSeveral, read_tables
from crashfuse.readers.formats import FORMATS, TABLES, all_formats, formats_of
from crashfuse.readers.members import files_below
from crashfuse.readers.radioss import is_time_history_csv
from crashfuse.readers.record import Record
from crashfuse.readers.vocabulary import Travel

_ARCHIVE = re.compile(f"(.*)({'|'.join(map(re.escape, ('.zip', *ENDINGS)))})", re.IGNORECASE | re.DOTALL)
_MOST_FILES = 100_000  # examined in a folder
_LISTED = 12  # tables in a sentence


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
                    found = "another file of this name"
                    raise refusal(member.where, "names that differ", found, "rename one") from None
    except BaseException:
        shutil.rmtree(home)
        raise
    single = list(home.iterdir())
    return single[0] if len(single) == 1 else home


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
            one_of("direction of travel", self.travel, dict.fromkeys(get_args(Travel)))
        for column in self.columns:
            require_a(ColumnChoice, column, "crashfuse.ColumnChoice(column, role)")
        if self.record_id is not None:
            require_a(str, self.record_id, "the id of the one record")


def format_of(source: Path) -> str:
    """The format of a source, by the names of its files; a DataError for none, or several besides tables."""
    if not source.exists():
        raise refusal(str(source), "a file or folder to import", "nothing there", errors.CHECK_PATH)
    found = formats_of(_names(source)) or formats_of(name for inner in _archives(source) for name in _names(inner))
    if found == [TABLES] and any(map(is_time_history_csv, tables_of(source))):
        return "radioss"
    if not found:
        broken = "".join(f"; {why.rstrip('.')}" for name in FORMATS.declared if (why := FORMATS.broken(name)))
        raise refusal(source.name, all_formats(), "none of these", f"choose another source{broken}")
    if len(set(found) - {TABLES}) > 1:
        several = " and ".join(found)
        raise refusal(source.name, "records of one format", several, "import one after the other (--format)")
    return found[0]


def read_records(reading: Reading) -> tuple[Record, ...]:
    """Read all records of a source, or raise a DataError with every problem of every record."""
    problems: list[Problem] = []
    records = tuple(iter_records(reading, problems))
    refuse_all(problems, reading.source.name)
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
    one_of("format", fmt, FORMATS)
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
    if fmt == TABLES and not paths:
        raise refusal(str(source), f"tables ({FORMATS[TABLES].files})", "none", errors.CHECK_PATH)
    if fmt == TABLES and not tables.records and not problems:
        found = "; ".join(tables.neither) or "conditions alone"
        expected = "a column of time and one of acceleration"
        raise refusal(source.name, expected, found, "map the columns (--column COLUMN=ROLE:UNIT)")
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
    """As laboratories offer tests for download, in a folder with nothing else to import."""
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
