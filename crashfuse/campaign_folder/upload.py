"""Untrusted uploads, one zip or loose files, laid out as a campaign folder."""

import io
import shutil
from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.campaign_folder.condition_tables import TABLES, Role, read_what_can_be
from crashfuse.campaign_folder.folder import AT_THE_TOP, PULSES, read_folder
from crashfuse.campaign_folder.ids import folded
from crashfuse.errors import DataError, Problem, collecting, printable
from crashfuse.files.archive import (
    DEFAULT_LIMITS,
    Budget,
    Limits,
    Member,
    in_memory,
    left_by_the_system,
    name_trouble,
    refuse,
    too_many,
    too_much,
    zip_members,
)

_ROLES: tuple[Role, ...] = ("tests", "cae")
_NOTES = (".md", ".txt")
_ARCHIVES = (".zip", ".7z", ".rar", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".zst")
_ENTRY = b"PK\x01\x02"  # starts every entry of a zip's directory


def lay_out(uploads: Sequence[tuple[str, bytes]], into: Path, limits: Limits = DEFAULT_LIMITS) -> Path:
    """Lay uploads out as a campaign folder that :func:`crashfuse.campaign_folder.folder.read_folder` reads.

    Parameters
    ----------
    uploads : sequence of (str, bytes)
        Either one zip of a campaign folder, or the files of one: ``tests.csv``, ``cae.csv``, ``cae_pulses.parquet``,
        ``campaign.toml``, ``criteria.toml``, ``matrix.csv``, ``<id>.csv`` … A pulse file beside the tables belongs to
        the table that has its id; if both have it, to the one without a table of pulses. Notes (``.md``, ``.txt``) are
        ignored.
    into : Path
        An existing folder, which the caller must delete; a folder named after the campaign is created in it and
        returned. Its numbers are not checked here.

    Raises
    ------
    DataError
        If anything in the uploads is not part of a campaign or exceeds the limits; nothing is left in ``into``. In the
        first case, what is wrong with the rest is told along with it.
    """
    members, name = _opened(uploads, limits)
    root = _root(members, name)
    problems: list[Problem] = []
    targets = _targets(members, root, problems)
    folder = into / (root.name or PurePosixPath(name).stem.strip(". ") or "campaign")
    folder.mkdir()
    try:
        budget = Budget(limits, sum(len(content) for _, content in uploads))
        for member, target in targets.items():
            member.write_to(folder / target, budget)
        _place(folder, [target for target in targets.values() if len(target.parts) == 1], problems)
        _check_rows(folder, limits)
        if problems:
            _refuse_with_the_rest(problems, name, folder)
    except BaseException:
        shutil.rmtree(folder)
        raise
    return folder


def _refuse_with_the_rest(problems: list[Problem], name: str, folder: Path) -> None:
    """Raise a DataError with these problems and with those of what could be laid out."""
    told: list[Problem] = []
    with collecting(told):
        refuse(problems, name)
    with collecting(told):
        read_folder(folder)
    raise DataError(told)


def _opened(uploads: Sequence[tuple[str, bytes]], limits: Limits) -> tuple[list[Member], str]:
    """All files in the uploads, and the name for the whole upload in messages."""
    expected = "one zip of a campaign folder, or its files"
    if not uploads:
        raise DataError(Problem("upload", expected, "nothing", "choose the files"))
    check_uploads(uploads, limits)
    if not any(name.lower().endswith(".zip") for name, _ in uploads):
        return [in_memory(*upload) for upload in uploads if not left_by_the_system(upload[0])], "upload"
    if len(uploads) > 1:
        raise DataError(Problem("upload", expected, f"a zip among {len(uploads)} files", "zip all of it together"))
    name, content = uploads[0]
    return members_of_zip(name, content, limits), name


def check_uploads(uploads: Sequence[tuple[str, bytes]], limits: Limits) -> None:
    """Raise a DataError if uploads are too many or too large, or one has an unsafe name."""
    if len(uploads) > limits.members:
        raise too_many("upload", len(uploads), limits)
    if sum(len(content) for _, content in uploads) > limits.total_bytes:
        raise too_much("upload", limits)
    refuse([Problem(name, *trouble) for name, _ in uploads if (trouble := name_trouble(name))], "upload")


def members_of_zip(name: str, content: bytes, limits: Limits) -> list[Member]:
    """List the files of a zip in memory as :func:`zip_members` does."""
    if (found := content.count(_ENTRY)) > limits.members:  # checked before a directory of millions is read
        raise too_many(name, found, limits)
    return zip_members(io.BytesIO(content), name, limits)


def _root(members: Sequence[Member], name: str) -> PurePosixPath:
    """The folder that holds the campaign: the outermost one with a condition table."""
    homes = [member.path.parent for member in members if member.path.name in TABLES]
    if not homes:
        refuse([trouble for member in members if (trouble := _strange(member))], name)
        where = printable(members[0].where) if len(members) == 1 else name
        raise DataError(Problem(where, "tests.csv and cae.csv", "neither", "add the tables of tests and of CAE runs"))
    return min(homes, key=lambda home: len(home.parts))


def _targets(members: Sequence[Member], root: PurePosixPath, problems: list[Problem]) -> dict[Member, PurePosixPath]:
    """The target of each member in the campaign folder; notes are dropped, pulses beside the tables stay for now."""
    targets: dict[Member, PurePosixPath] = {}
    for member in members:
        ending = member.path.suffix.lower()
        if ending in _NOTES:
            continue
        if trouble := _strange(member):
            problems.append(trouble)
        elif root in member.path.parents and _in_a_campaign(member.path.relative_to(root).with_suffix(ending)):
            targets[member] = member.path.relative_to(root).with_suffix(ending)
        else:
            expected, advice = "a file of one campaign folder", "put pulses into tests/ or cae/ and leave out the rest"
            problems.append(Problem(member.where, expected, "a file elsewhere", advice))
    times = Counter(folded(str(target)) for target in targets.values())
    for member, target in [*targets.items()]:
        if (found_times := times[folded(str(target))]) > 1:
            expected = "names that differ by more than capitals"
            problems.append(Problem(member.where, expected, f"{found_times} of this name", "keep one"))
            del targets[member]
    return targets


def _strange(member: Member) -> Problem | None:
    """The problem of a file that is neither in a campaign format nor a note, if it is so."""
    ending = member.path.suffix.lower()
    if ending in _ARCHIVES:
        return Problem(member.where, "tables", "an archive in the upload", "unpack it first")
    if ending in (*PULSES, *_NOTES, ".toml"):
        return None
    found = f"a file {printable(ending)}" if ending else "a file without an ending"
    expected = "a file of a campaign (.csv, .parquet, campaign.toml) or of a format to be imported"
    return Problem(member.where, expected, found, "leave it out")


def _in_a_campaign(path: PurePosixPath) -> bool:
    match path.parts:
        case (name,):
            return name in AT_THE_TOP or path.suffix in PULSES
        case (role, _):
            return role in _ROLES and path.suffix in PULSES
    return False


def _place(folder: Path, at_the_top: Sequence[PurePosixPath], problems: list[Problem]) -> None:
    """Move each pulse beside the tables to the tests or the CAE runs, whichever has its id.

    What is wrong with the tables is told when they are read. A pulse that is of no other role is of one whose table
    cannot be read.
    """
    strays = [folder / path for path in at_the_top if path.name not in AT_THE_TOP]
    ids: dict[str, set[str]] = {}
    unread: list[str] = []
    for role in _ROLES if strays else ():
        table = read_what_can_be(folder / f"{role}.csv", role, [])
        has_pulses = any((folder / f"{role}_pulses{ending}").is_file() for ending in PULSES)
        ids[role] = set() if table is None or has_pulses else set(table.ids)
        if table is None and not has_pulses:
            unread.append(role)
    for path in strays:
        homes = [role for role in _ROLES if path.stem in ids[role]] or unread[:1]
        if len(homes) != 1:
            expected = "a pulse named after an id in tests.csv or in cae.csv"
            found = "an id of both" if homes else "a name that is no id there, or one whose pulse is in a table"
            problems.append(Problem(path.name, expected, found, "put it into tests/ or cae/, zipped, or leave it out"))
        elif (home := folder / homes[0] / path.name).exists():
            problems.append(Problem(path.name, "each pulse once", f"one in {homes[0]}/ too", "keep one"))
        else:
            home.parent.mkdir(exist_ok=True)
            path.rename(home)


def _check_rows(folder: Path, limits: Limits) -> None:
    """Reject a Parquet table that packs too many rows into few bytes."""
    for path in sorted(folder.rglob("*.parquet")):
        try:
            with pq.ParquetFile(path) as file:
                rows = file.metadata.num_rows
        except (pa.ArrowException, OSError):
            continue  # read_folder reports what is wrong with it
        if rows > limits.rows:
            raise DataError(Problem(path.name, f"at most {limits.rows} rows", f"{rows}", "upload fewer runs"))
