"""A campaign from wherever it lies, checked as a whole: its folder, a zip of it, or untrusted uploads."""

import io
import math
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePath, PurePosixPath

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse import errors
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder import condition_tables, plausibility
from crashfuse.campaign_folder.condition_tables import PULSES, ROLES, TABLES, ConditionTable, listed, read_lenient
from crashfuse.campaign_folder.copies import check_runs_differ, check_tests_differ
from crashfuse.campaign_folder.history import settle
from crashfuse.campaign_folder.pulse_files import PulseFiles
from crashfuse.campaign_folder.settings import read_settings
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem, UsageError, as_path, collecting, printable, refusal, refuse_all
from crashfuse.files import archive
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits, Member
from crashfuse.files.parquet import ParquetTable
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.wall import Wall
from crashfuse.units import KN, MS
from crashfuse.vehicle_archive import VehicleArchive, load_archive

_FEWEST_RUNS = 10
WALLS: Mapping[str, str] = {"tests": "tests_wall.parquet", "cae": "cae_wall.parquet"}  # forces of the barrier
WALL_COLUMNS = ("id", "time_ms", "force_kn")
ARCHIVE = "archive.cfa"  # of past vehicles that teach the campaign
FILES = (*TABLES, "campaign.toml", "criteria.toml", "matrix.csv", "notes.csv", ARCHIVE, *WALLS.values())
AT_THE_TOP = {*FILES, *(f"{role}_pulses{ending}" for role in WALLS for ending in PULSES)}  # in no folder
_ABOUT = re.compile(r"(?i)(readme|licen[cs]e)(\..*)?|.*\.md")
_NOTES = (".md", ".txt")
_ENTRY = b"PK\x01\x02"  # starts every entry of a zip's directory


def load_campaign(path: str | Path, archive: str | Path | None = None) -> Campaign:
    """Read and check a campaign folder, or a zip of one; a DataError has every problem, not only the first.

    It contains ``tests.csv`` and ``cae.csv``, the pulses of each as ``<role>/<id>.csv`` (or ``.parquet``) or
    ``<role>_pulses.parquet`` (or ``.csv``), and optionally ``campaign.toml``. All pulses are then on the study grid.
    An ``archive`` of past vehicles (``.cfa``) teaches it, else the folder's ``archive.cfa``, if it has one:
    :meth:`crashfuse.campaign.Campaign.with_archive`.
    """
    path = as_path(path, "a campaign folder")
    known = None if archive is None else load_archive(archive)  # before the campaign, which takes longer
    if not (path.is_file() and path.suffix.lower() == ".zip"):
        return read_folder(path, known)
    with tempfile.TemporaryDirectory(prefix="crashfuse-") as scratch:
        return read_folder(lay_out([(path.name, path.read_bytes())], Path(scratch)), known)


def read_folder(folder: str | Path, archive: VehicleArchive | None = None) -> Campaign:
    """:func:`load_campaign` of a folder alone, with an archive that has been read."""
    folder = as_path(folder, "a campaign folder")
    if not folder.is_dir():
        found = "a file" if folder.exists() else "no such folder"
        raise refusal(str(folder), "a campaign folder, or a zip of one", found, errors.CHECK_PATH)
    settle(folder)
    problems, warnings = list[Problem](), list[str]()
    settings = read_settings(folder, problems, warnings)
    tables, unused, gap = dict[str, ConditionTable](), tuple[tuple[str, Condition], ...](), None
    for role in ROLES:
        gap_m = settings.cae_gap_m if role == "cae" else 0.0
        reader = PulseFiles(folder, role, settings.channel_filter_class, gap_m)
        table = read_lenient(folder / f"{role}.csv", role, problems)
        if table is None:
            reader.check()
        else:
            if role == "tests":
                table, unused = _without_unused(table, settings.unused, problems)
            tables[role] = reader.read(table, settings.unused if role == "tests" else ())
            gap = _check_pulses(tables[role].without(reader.unread), reader, tables.get("tests"))
        problems.extend(reader.problems)
        warnings.extend(_shortened(reader.warnings))
    failing = settings.quality.failing(tables["cae"].quality) if "cae" in tables else []
    failed = tuple((tables["cae"].ids[place], tables["cae"].quality[place]) for place in failing)
    if failing:
        tables["cae"] = tables["cae"].without({*failing})
    _check_counts(tables, len(failing), problems, warnings)
    walls_of = {role: _read_walls(folder / name, problems) for role, name in WALLS.items()}
    kept: VehicleArchive | None = None
    if archive is None and (folder / ARCHIVE).is_file():
        with collecting(problems):
            kept = read_archive(folder / ARCHIVE)
    if problems:
        raise DataError(errors.shortened(problems))
    tests, runs = tables["tests"], tables["cae"]
    is_comparable = gap is None or not gap.hides_tests
    faults = plausibility.confirmed_faults(tests, runs, is_comparable=is_comparable)
    warnings += _shortened([f"tests.csv, {i}: {plausibility.fault_advice(i, of_i)}." for i, of_i in faults.items()])
    checks = [plausibility.check_units, plausibility.unlike_weights, plausibility.unlike_others]
    # of tests against CAE runs that have a gap nothing can be seen
    for findings in checks if is_comparable else [plausibility.unlike_weights]:
        explained = {warning.partition(":")[0] for warning in warnings}  # by a failed sensor, a wrong speed or unit
        warnings += _shortened([line for line in findings(tests, runs) if line.partition(":")[0] not in explained])
    _check_factors(tests, warnings)
    check_runs_differ(runs, warnings)
    runs.accel_mps2.flags.writeable = False
    for table in (tests, runs):
        warnings += _shortened(_wall_findings(table, walls_of[table.role]))
    ends_s, walls = tests.ends_s, walls_of["tests"]
    rows = zip(tests.ids, tests.conditions, tests.accel_mps2, tests.tuned, tests.about, strict=True)
    crash_tests = tuple(
        CrashTest(i, at, Pulse(GRID_S, accel), ends_s.get(i, math.inf), faults.get(i, ()), tuned, about, walls.get(i))
        for i, at, accel, tuned, about in rows
    )
    import_cfcs = {settings.tests_imported_with.get(test.id) for test in crash_tests}
    campaign = Campaign(
        name=settings.name,
        cae=CaeLibrary(runs.ids, runs.conditions, runs.accel_mps2, runs.quality, failed, runs.about),
        tests=crash_tests,
        notice=settings.notice,
        warnings=tuple(warnings),
        channel_filter_class=settings.channel_filter_class or settings.filtered_with,
        quality_limits=settings.quality.limits,
        occupant=settings.occupant,
        tests_filtered_with=import_cfcs.pop() if len(import_cfcs) == 1 else None,
        units=tests.units,
        unused=unused,
        why_unused=settings.unused,
    )
    if archive is not None:
        return campaign.with_archive(archive)
    try:
        return campaign if kept is None else campaign.with_archive(kept)
    except UsageError as error:
        expected, advice = "past vehicles, at most one of them this one", "take it out of the folder"
        raise refusal(ARCHIVE, expected, str(error), advice) from error


def _wall_findings(table: ConditionTable, walls: Mapping[str, Wall]) -> list[str]:
    return [
        f"{table.file}, {run_id}: {text}."
        for run_id, at, accel in zip(table.ids, table.conditions, table.accel_mps2, strict=True)
        if run_id in walls and at.speed_mps
        for text in walls[run_id].beside(accel.astype(np.float64)).findings(at.mass_kg, at.speed_mps)
    ]


def read_archive(path: Path) -> VehicleArchive:
    """The archive of past vehicles that lies in a campaign folder; a DataError if it is none."""
    try:
        return load_archive(path)
    except DataError as error:
        advice = f"take it out of the folder, or {error.problems[0].advice}"
        raise DataError([replace(problem, where=path.name, advice=advice) for problem in error.problems]) from error


def _read_walls(path: Path, problems: list[Problem]) -> dict[str, Wall]:
    walls = dict[str, Wall]()
    if path.is_file():
        with collecting(problems), ParquetTable.opened(path, path.name) as table:
            if not {*WALL_COLUMNS} <= {*table.names}:
                expected = f"the columns {', '.join(WALL_COLUMNS)}"
                raise refusal(path.name, expected, listed(table.names), "import the tests again")
            rows = pd.concat([frame for frame, _ in table.blocks(WALL_COLUMNS)])
            for test_id, of_test in rows.groupby("id", observed=True, sort=False):
                cells = (of_test[name].astype(object) for name in WALL_COLUMNS[1:])  # texts or numbers
                time_ms, force_kn = (pd.to_numeric(of, errors="coerce").to_numpy(np.float64) for of in cells)
                walls[str(test_id)] = Wall(time_ms * MS, force_kn * KN)
                walls[str(test_id)].require_force(f"{path.name}, {printable(str(test_id), 60)}")
    return walls


def unread_files(campaign: Path) -> str:
    """A sentence on the files of a campaign folder, or a zip of one, that nothing reads; empty if there are none."""
    if not campaign.exists():
        return ""
    if campaign.is_file():
        with tempfile.TemporaryDirectory(prefix="crashfuse-") as scratch:
            return unread_files(lay_out([(campaign.name, campaign.read_bytes())], Path(scratch)))
    folders = [campaign, *(campaign / role for role in ROLES if (campaign / role).is_dir())]
    inside = [path for folder in folders for path in folder.iterdir() if path not in folders]
    others = (path for path in inside if path.is_dir() or not is_read(path.relative_to(campaign)))
    names = [f"{path.relative_to(campaign).as_posix()}{'/' * path.is_dir()}" for path in others]
    unread = [name for name in names if not (archive.left_by_the_system(name.rstrip("/")) or _ABOUT.fullmatch(name))]
    return f"Not read, as no file of a campaign is called so: {listed(sorted(unread))}." if unread else ""


def is_read(path: PurePath) -> bool:
    """Whether a file of a campaign folder has this path in it."""
    return path.as_posix() in AT_THE_TOP or (path.parent.as_posix() in ROLES and path.suffix in PULSES)


def _without_unused(
    table: ConditionTable, ids: Collection[str], problems: list[Problem]
) -> tuple[ConditionTable, tuple[tuple[str, Condition], ...]]:
    places = {place: table.conditions[place] for place, test_id in enumerate(table.ids) if test_id in ids}
    wrong = [repr(printable(test_id, 60)) for test_id in ids if test_id not in table.ids]
    wrong += ["all of them"] if len(places) == len(table.ids) else []
    expected = "campaign.toml", "ids of tests.csv, not all of them"
    problems += [Problem(*expected, found, "correct the list", "unused") for found in wrong]
    return table.without(places), tuple((table.ids[place], condition) for place, condition in places.items())


def _check_pulses(table: ConditionTable, reader: PulseFiles, tests: ConditionTable | None) -> plausibility.Gap | None:
    """Returns the gap of CAE runs, if any."""
    gap = None
    if table.role == "cae" and tests is not None:
        gap = plausibility.find_gap(table, tests, reader.gap_m if reader.through_gap else 0.0)
        reader.warnings += [gap.warning] if gap else []
    plausibility.check_physics(table, reader.problems, gap.advice if gap else "")
    plausibility.check_ends(table, reader.problems)
    plausibility.check_band(table, reader.warnings)
    if table.role == "tests":
        check_tests_differ(table, reader.problems, reader.warnings)
    return gap


def _check_counts(tables: dict[str, ConditionTable], failed: int, problems: list[Problem], warnings: list[str]) -> None:
    if "tests" in tables and len(tables["tests"].ids) == 1:
        warnings.append("Only one test: nothing can be left out, so nothing is checked; the scatter is assumed.")
    if "cae" in tables and len(tables["cae"].ids) < _FEWEST_RUNS:
        found = f"{len(tables['cae'].ids)}" + f", and {failed} left out for their quality" * bool(failed)
        problems.append(Problem("cae.csv", f"at least {_FEWEST_RUNS} CAE runs", found, "add runs"))


def _check_factors(tests: ConditionTable, warnings: list[str]) -> None:
    factors_of = {test: dict(condition.factors) for test, condition in zip(tests.ids, tests.conditions, strict=True)}
    for name in dict.fromkeys(name for factors in factors_of.values() for name, value in factors.items() if value):
        lacking = [test for test, factors in factors_of.items() if not factors.get(name)]
        if lacking:
            warnings += [f"tests.csv, {name}: not given for {listed(lacking)}; fill it in, for tests may differ by it."]


def _shortened(warnings: list[str], most: int = 5) -> list[str]:
    if len(warnings) <= most:
        return warnings
    return [*warnings[:most], f"{warnings[0].partition(':')[0].split(',')[0]}: {len(warnings) - most} more like these."]


def lay_out(uploads: Sequence[tuple[str, bytes]], into: Path, limits: Limits = DEFAULT_LIMITS) -> Path:
    """Lay uploads, one zip of a campaign folder or its files, out as a folder in ``into``; numbers are not checked.

    A pulse beside the tables belongs to the one that has its id. What is no file of a campaign is not read, as in a
    folder: it lies there without its content, to be named. A DataError leaves nothing in ``into``.
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
        for path in (member.path.relative_to(root) for member in members if root in member.path.parents):
            if not (_in_a_campaign(path.with_suffix(path.suffix.lower())) or _ABOUT.fullmatch(path.name)):
                with suppress(OSError):  # a folder of that name, say
                    (folder / path).parent.mkdir(parents=True, exist_ok=True)
                    (folder / path).touch()
        if problems:
            every: list[Problem] = []
            with collecting(every):
                refuse_all(problems, name)
            with collecting(every):
                read_folder(folder)
            raise DataError(every)
    except BaseException:
        shutil.rmtree(folder)
        raise
    return folder


def _opened(uploads: Sequence[tuple[str, bytes]], limits: Limits) -> tuple[list[Member], str]:
    check_uploads(uploads, limits)
    if uploads and not any(name.lower().endswith(".zip") for name, _ in uploads):
        return [archive.in_memory(*upload) for upload in uploads if not archive.left_by_the_system(upload[0])], "upload"
    if len(uploads) != 1:
        expected, found = "one zip of a campaign folder, or its files", "a zip among files" if uploads else "nothing"
        raise refusal("upload", expected, found, "zip all of it together")
    name, content = uploads[0]
    return members_of_zip(name, content, limits), name


def check_uploads(uploads: Sequence[tuple[str, bytes]], limits: Limits) -> None:
    """Raise a DataError if uploads are too many or too large, or one has an unsafe name."""
    if len(uploads) > limits.members:
        raise archive.too_many("upload", len(uploads), limits)
    if sum(len(content) for _, content in uploads) > limits.total_bytes:
        raise archive.too_much("upload", limits)
    problems = [Problem(name, *trouble) for name, _ in uploads if (trouble := archive.name_trouble(name))]
    refuse_all(problems, "upload")


def members_of_zip(name: str, content: bytes, limits: Limits) -> list[Member]:
    """The files of a zip in memory."""
    if (found := content.count(_ENTRY)) > limits.members:  # checked before a directory of millions is read
        raise archive.too_many(name, found, limits)
    return archive.zip_members(io.BytesIO(content), name, limits)


def _root(members: Sequence[Member], name: str) -> PurePosixPath:
    homes = [member.path.parent for member in members if member.path.name in TABLES]
    if not homes:
        refuse_all([trouble for member in members if (trouble := _strange(member))], name)
        where = printable(members[0].where) if len(members) == 1 else name
        raise refusal(where, "tests.csv and cae.csv", "neither", "add the tables of tests and of CAE runs")
    return min(homes, key=lambda home: len(home.parts))


def _targets(members: Sequence[Member], root: PurePosixPath, problems: list[Problem]) -> dict[Member, PurePosixPath]:
    targets: dict[Member, PurePosixPath] = {}
    for member in members:
        ending = member.path.suffix.lower()
        inside = member.path.relative_to(root) if root in member.path.parents else None
        if inside is not None and _in_a_campaign(inside.with_suffix(ending)):
            targets[member] = inside.with_suffix(ending)
        elif inside is None and ending not in _NOTES:
            wrong = "a file of one campaign folder", "a file elsewhere", "put pulses into tests/ or cae/"
            problems.append(Problem(member.where, *wrong))
    times = Counter(condition_tables.folded(str(target)) for target in targets.values())
    for member in [member for member, target in targets.items() if times[condition_tables.folded(str(target))] > 1]:
        problems.append(Problem(member.where, "names that differ by more than capitals", "two alike", "keep one"))
        del targets[member]
    return targets


def _strange(member: Member) -> Problem | None:
    ending = member.path.suffix.lower()
    if ending in (*PULSES, *_NOTES, ".toml", Path(ARCHIVE).suffix):
        return None
    expected = "a file of a campaign (.csv, .parquet, campaign.toml) or one to be imported"
    return Problem(member.where, expected, printable(member.path.name), "unpack or leave it out")


def _in_a_campaign(path: PurePosixPath) -> bool:
    return is_read(path) or (len(path.parts) == 1 and path.suffix in PULSES)


def _place(folder: Path, at_the_top: Sequence[PurePosixPath], problems: list[Problem]) -> None:
    strays = [folder / path for path in at_the_top if path.name not in AT_THE_TOP]
    has_pulses = {role for role in ROLES for end in PULSES if (folder / f"{role}_pulses{end}").is_file()}
    lacking = [role for role in ROLES if strays and role not in has_pulses]
    tables = {role: read_lenient(folder / f"{role}.csv", role, []) for role in lacking}
    unread = [role for role, table in tables.items() if table is None]
    for path in strays:
        homes = [role for role, table in tables.items() if table and path.stem in table.ids] or unread[:1]
        if not homes:
            continue  # nobody's, and not read
        if len(homes) > 1:
            expected = "a pulse named after an id of one table"
            problems.append(Problem(path.name, expected, "an id of both", "zip it in tests/ or cae/"))
        elif (home := folder / homes[0] / path.name).exists():
            problems.append(Problem(path.name, "each pulse once", f"one in {homes[0]}/ too", "keep one"))
        else:
            home.parent.mkdir(exist_ok=True)
            path.rename(home)


def _check_rows(folder: Path, limits: Limits) -> None:
    for path in sorted(folder.rglob("*.parquet")):
        try:
            with pq.ParquetFile(path) as file:
                rows = file.metadata.num_rows
        except (pa.ArrowException, OSError):
            continue  # read_folder reports what is wrong with it
        if rows > limits.rows:
            raise refusal(path.name, f"at most {limits.rows} rows", f"{rows}", "upload fewer runs")
