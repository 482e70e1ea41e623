"""Which format a source has, and the records in it."""

import importlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Literal, get_args

from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.files.archive import DEFAULT_LIMITS, refuse, too_much, zip_members
from crashfuse.importing.joined_tables import ColumnChoice, read_tables
from crashfuse.importing.unpacking import lay_out_source
from crashfuse.readers.isomme_record import isomme_record
from crashfuse.readers.members import files_below
from crashfuse.readers.nhtsa import read_nhtsa
from crashfuse.readers.record import Record
from crashfuse.readers.tables.sheets import EXCEL_ENDINGS, TEXT_ENDINGS

Format = Literal["csv", "nhtsa", "isomme", "lsdyna", "tdms"]

_MOST_FILES = 100_000  # looked at in a folder
_ONE_A_FILE = ("nhtsa", "isomme")  # a header file each
_TABLES = (*TEXT_ENDINGS, *EXCEL_ENDINGS, ".xls")


def _lazily(module: str, function: str) -> Callable[[Path], tuple[Record, ...]]:
    """A reader whose package is an extra, imported when it is asked for."""

    def read(path: Path) -> tuple[Record, ...]:
        found = getattr(importlib.import_module(module), function)(path)
        return (found,) if isinstance(found, Record) else tuple(found)

    return read


_READERS: Mapping[str, Callable[[Path], tuple[Record, ...]]] = {
    "nhtsa": lambda path: (read_nhtsa(path),),
    "isomme": lambda path: (isomme_record(path),),
    "lsdyna": _lazily("crashfuse.readers.lsdyna.runs", "read_lsdyna"),
    "tdms": _lazily("crashfuse.readers.tdms", "read_tdms"),
}


def format_of(source: Path) -> Format:
    """Tell the format of a file, folder or zip by the names in it.

    Raises
    ------
    DataError
        If there is nothing there, or nothing of a known format.
    """
    if not source.exists():
        raise DataError(Problem(str(source), "a file or folder to import", "nothing there", "check the path"))
    found = _formats_of(_names(source))
    if not found:
        expected = "NHTSA (.EV5), ISO-MME (.mme), LS-DYNA (binout, nodout), TDMS or tables (.csv, .xlsx …)"
        raise DataError(Problem(source.name, expected, "none of these", "choose another source"))
    if len(set(found) - {"csv"}) > 1:
        advice = "import one after the other (--format), or keep them in folders of their own"
        raise DataError(Problem(source.name, "records of one format", " and ".join(found), advice))
    return found[0]


def format_named(paths: Iterable[PurePath]) -> Format | None:
    """Tell the format of files by their names; None if there is none of a known one."""
    return next(iter(_formats_of(paths)), None)


def read_records(
    source: Path,
    fmt: Format | None = None,
    *,
    columns: Sequence[ColumnChoice] = (),
    together: bool = False,
    conditions: Path | None = None,
) -> tuple[Record, ...]:
    """Read all records of a source.

    Parameters
    ----------
    source : Path
        A file, a folder (of one test or run, or of several), or a zip.
    fmt : Format, optional
        By default what :func:`format_of` finds.
    columns : sequence of ColumnChoice
        For tables: what columns are, in every table that has them; the rest is as proposed.
    together : bool
        For tables: columns of one file are channels of one record.
    conditions : Path, optional
        A table with the conditions of the records by id; its headers may be foreign, too.

    Raises
    ------
    DataError
        With every problem of every test.
    UsageError
        If a column is mapped that is not there.
    """
    problems: list[Problem] = []
    each = each_record(source, problems, fmt, columns=columns, together=together, conditions=conditions)
    records = tuple(each)
    refuse(problems, source.name)
    return records


def each_record(
    source: Path,
    problems: list[Problem],
    fmt: Format | None = None,
    *,
    columns: Sequence[ColumnChoice] = (),
    together: bool = False,
    conditions: Path | None = None,
    record_id: str | None = None,
) -> Iterator[Record]:
    """Read the records of a source one after the other, as :func:`read_records` does; what is wrong is appended.

    A ``record_id`` is what the one record in the source is called, in the table of conditions, too.
    """
    fmt = fmt or format_of(source)
    if source.suffix.lower() == ".zip" and source.is_file() and _holds_several(source, fmt):
        with TemporaryDirectory() as scratch:
            home = _unpacked(source, Path(scratch))
            yield from each_record(
                home, problems, fmt, columns=columns, together=together, conditions=conditions, record_id=record_id
            )
        return
    if fmt not in get_args(Format):
        raise UsageError(f"There is no format {fmt!r}; there are {', '.join(get_args(Format))}.")
    if fmt != "csv" and columns and conditions is None:
        raise UsageError("Only tables have columns to map.")
    extra = [] if conditions is None else [conditions]
    if fmt == "csv":
        paths = tables_of(source)
        if not paths:
            raise DataError(Problem(str(source), f"tables ({', '.join(_TABLES)})", "none", "check the path"))
        tables = read_tables([*paths, *extra], columns, problems, together=together)
        if not tables.records and not problems:
            found = "; ".join(tables.neither) or "conditions alone"
            expected = "a column of time and one of acceleration"
            raise DataError(Problem(source.name, expected, found, "map the columns (COLUMN=ROLE:UNIT)"))
    else:
        tables = read_tables(extra, columns, problems, together=False)
    whole, ids = not problems, list[str]()
    for record in tables.records if fmt == "csv" else _of_homes(source, fmt, problems):
        if record_id is not None:
            if ids:
                raise UsageError(f"One id is not enough: {source.name} holds several records.")
            record = replace(record, id=record_id)
        ids.append(record.id)
        yield tables.given_to(record)
    if whole:  # else ids of what could not be read may lack
        tables.check_ids(ids)


def tables_of(source: Path) -> list[Path]:
    """The tables in a source."""
    return [source] if source.is_file() else _files(source, _is_table)


def _names(source: Path) -> Iterable[PurePath]:
    if source.is_dir():
        return islice(files_below(source), _MOST_FILES)
    if source.suffix.lower() == ".zip":
        with source.open("rb") as stream:
            return [member.path for member in zip_members(stream, source.name)]
    return [source]


def _holds_several(source: Path, fmt: str) -> bool:
    """Whether a zip has to be unpacked: it holds tables, or several tests of a format whose reader takes one."""
    tests = sum(_format_of_name(path) == fmt for path in _names(source))
    return fmt == "csv" or (fmt in _ONE_A_FILE and tests > 1)


def _unpacked(source: Path, into: Path) -> Path:
    if source.stat().st_size > DEFAULT_LIMITS.total_bytes:
        raise too_much(source.name, DEFAULT_LIMITS)
    return lay_out_source([(source.name, source.read_bytes())], into)


def _of_homes(source: Path, fmt: str, problems: list[Problem]) -> Iterator[Record]:
    for home in _homes(source, fmt):
        try:
            yield from _READERS[fmt](home)
        except DataError as error:
            problems.extend(error.problems)


def _homes(source: Path, fmt: str) -> list[Path]:
    """What to read, one path a test; the readers of the other formats take folders of many by themselves."""
    tests = _files(source, lambda path: _format_of_name(path) == fmt) if fmt in _ONE_A_FILE else []
    return tests if len(tests) > 1 else [source]


def _files(folder: Path, wanted: Callable[[Path], bool]) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in islice(files_below(folder), _MOST_FILES) if wanted(path) and path.is_file())


def _is_table(path: Path) -> bool:
    return path.suffix.lower() in _TABLES


def _formats_of(paths: Iterable[PurePath]) -> list[Format]:
    """The formats of files by their names; tables, which lie beside those of every other, come last."""
    found = {_format_of_name(path) for path in paths}
    formats: tuple[Format, ...] = ("nhtsa", "isomme", "lsdyna", "tdms", "csv")
    return [fmt for fmt in formats if fmt in found]


def _format_of_name(path: PurePath) -> str | None:
    name, ending = path.name.lower(), path.suffix.lower()
    by_ending = {".ev5": "nhtsa", ".mme": "isomme", ".tdms": "tdms"}
    if ending in by_ending:
        return by_ending[ending]
    if name.startswith(("binout", "nodout")):
        return "lsdyna"
    return "csv" if ending in _TABLES else None
