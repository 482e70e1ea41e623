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
from pathlib import Path, PurePosixPath

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder import plausibility
from crashfuse.campaign_folder.condition_tables import TABLES, ConditionTable, Role, folded, listed, read_lenient
from crashfuse.campaign_folder.copies import check_runs_differ, check_tests_differ
from crashfuse.campaign_folder.history import settle
from crashfuse.campaign_folder.pulse_files import PulseFiles
from crashfuse.campaign_folder.settings import read_settings
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem, UsageError, as_path, collecting, printable, refuse_all, shortened
from crashfuse.files import archive
from crashfuse.files.archive import DEFAULT_LIMITS, Budget, Limits, Member
from crashfuse.files.parquet import ParquetTable
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.wall import Wall
from crashfuse.units import KN, MS
from crashfuse.vehicle_archive import VehicleArchive, load_archive

_FEWEST_RUNS = 10
PULSES = (".csv", ".parquet")  # endings of tables of pulses
WALLS: Mapping[str, str] = {"tests": "tests_wall.parquet", "cae": "cae_wall.parquet"}  # forces of the barrier
WALL_COLUMNS = ("id", "time_ms", "force_kn")
ARCHIVE = "archive.cfa"  # of past vehicles that teach the campaign
FILES = (*TABLES, "campaign.toml", "criteria.toml", "matrix.csv", "notes.csv", ARCHIVE, *WALLS.values())
AT_THE_TOP = {*FILES, *(f"{role}_pulses{ending}" for role in WALLS for ending in PULSES)}  # in no folder
_ABOUT = re.compile(r"(?i)(readme|licen[cs]e)(\..*)?|.*\.md")
_ROLES: tuple[Role, ...] = ("tests", "cae")
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
        raise DataError(Problem(str(folder), "a campaign folder, or a zip of one", found, "check the path"))
    settle(folder)
    problems, warnings = list[Problem](), list[str]()
    settings = read_settings(folder, problems, warnings)
    tables, pulses, ends_s = dict[str, ConditionTable](), dict[str, FloatArray](), dict[str, float]()
    faults: plausibility.Faults = {}
    unused: tuple[tuple[str, Condition], ...] = ()
    gap: plausibility.Gap | None = None
    for role in _ROLES:
        table = read_lenient(folder / f"{role}.csv", role, problems)
        speeds = {} if table is None else dict(zip(table.ids, table.speeds_mps, strict=True))
        gap_m = settings.cae_gap_m if role == "cae" else 0.0
        reader = PulseFiles(folder, role, settings.channel_filter_class, gap_m, speeds)
        if table is None:
            reader.check()
        else:
            if role == "tests" and settings.unused:
                table, unused = _without_unused(table, settings.unused, problems)
            passed_over = [test_id for test_id, _ in unused] if role == "tests" else []
            tables[role], pulses[role] = table, reader.read(table.ids, passed_over)
            measured = (tables["tests"].speeds_mps, pulses["tests"]) if role == "cae" and "tests" in tables else None
            gap = _check_pulses(role, table, pulses[role], reader, measured)
        if role == "tests":
            ends_s, faults = reader.ends_s, reader.faults
        problems.extend(reader.problems)
        warnings.extend(_shortened(reader.warnings))
    left_out = settings.quality.failing(tables["cae"].quality) if "cae" in tables else []
    failed = tuple((tables["cae"].ids[place], tables["cae"].quality[place]) for place in left_out)
    if left_out:
        tables["cae"] = tables["cae"].without(left_out)
        pulses["cae"] = np.delete(pulses["cae"], left_out, axis=0)
    _check_counts(tables, len(left_out), problems, warnings)
    walls, walls_of_runs = (_read_walls(folder / name, problems) for name in WALLS.values())
    kept: VehicleArchive | None = None
    if archive is None and (folder / ARCHIVE).is_file():
        with collecting(problems):
            kept = read_archive(folder / ARCHIVE)
    if problems:
        raise DataError(shortened(problems))
    is_comparable = gap is None or not gap.hides_tests
    faults = plausibility.confirmed_faults(tables, pulses, faults, is_comparable=is_comparable)
    warnings += _shortened([f"tests.csv, {i}: {plausibility.fault_advice(i, of_i)}." for i, of_i in faults.items()])
    checks = [plausibility.check_units, plausibility.unlike_weights, plausibility.unlike_others]
    # of tests against CAE runs that have a gap nothing can be seen
    for findings in checks if is_comparable else [plausibility.unlike_weights]:
        explained = {warning.partition(":")[0] for warning in warnings}  # by a failed sensor, a wrong speed or unit
        warnings += _shortened([line for line in findings(tables, pulses) if line.partition(":")[0] not in explained])
    _check_factors(tables["tests"], warnings)
    runs, table = tables["cae"], tables["tests"]
    runs_accel = pulses["cae"].astype(np.float32, copy=False)
    cae = CaeLibrary(runs.ids, runs.conditions, runs_accel, runs.quality, failed, runs.about)
    check_runs_differ(runs, cae.accel_mps2, warnings)
    cae.accel_mps2.flags.writeable = False
    rows_of_tests = zip(table.ids, table.conditions, pulses["tests"], table.tuned, table.about, strict=True)
    crash_tests = tuple(
        CrashTest(i, at, Pulse(GRID_S, a), ends_s.get(i, math.inf), faults.get(i, ()), tuned, about, walls.get(i))
        for i, at, a, tuned, about in rows_of_tests
    )
    accused = [(f"tests.csv, {test.id}", test.wall, test.pulse.accel_mps2, test.condition) for test in crash_tests]
    of_runs = zip(cae.ids, cae.accel_mps2, cae.conditions, strict=True)
    accused += [(f"cae.csv, {i}", walls_of_runs[i], accel, at) for i, accel, at in of_runs if i in walls_of_runs]
    for kind in WALLS:
        rows = ((who, wall.beside(accel), at) for who, wall, accel, at in accused if wall and who.startswith(kind))
        findings_of = ((who, one.findings(at.mass_kg, at.speed_mps)) for who, one, at in rows if at.speed_mps)
        warnings += _shortened([f"{who}: {text}." for who, texts in findings_of for text in texts])
    cfc = settings.channel_filter_class or settings.filtered_with
    import_cfcs = {settings.tests_imported_with.get(test.id) for test in crash_tests}
    first = settings.name, cae, crash_tests, settings.notice, tuple(warnings), cfc, settings.quality.limits
    filtered_with = import_cfcs.pop() if len(import_cfcs) == 1 else None
    further = settings.occupant, filtered_with, tables["tests"].units, unused, settings.unused
    campaign = Campaign(*first, *further)
    if archive is not None:
        return campaign.with_archive(archive)
    return campaign if kept is None else _taught(campaign, kept)


def read_archive(path: Path) -> VehicleArchive:
    """The archive of past vehicles that lies in a campaign folder; a DataError if it is none."""
    try:
        return load_archive(path)
    except DataError as error:
        advice = f"take it out of the folder, or {error.problems[0].advice}"
        raise DataError([replace(problem, where=path.name, advice=advice) for problem in error.problems]) from error


def _taught(campaign: Campaign, archive: VehicleArchive) -> Campaign:
    try:
        return campaign.with_archive(archive)
    except UsageError as error:
        expected, advice = "past vehicles, at most one of them this one", "take it out of the folder"
        raise DataError(Problem(ARCHIVE, expected, str(error), advice)) from error


def _read_walls(path: Path, problems: list[Problem]) -> dict[str, Wall]:
    walls = dict[str, Wall]()
    if path.is_file():
        with collecting(problems), ParquetTable.opened(path, path.name) as table:
            if not {*WALL_COLUMNS} <= {*table.names}:
                expected = f"the columns {', '.join(WALL_COLUMNS)}"
                raise DataError(Problem(path.name, expected, listed(table.names), "import the tests again"))
            rows = pd.concat([frame for frame, _ in table.blocks(WALL_COLUMNS)])
            for test_id, of_test in rows.groupby("id", observed=True, sort=False):
                cells = (of_test[name].astype(object) for name in WALL_COLUMNS[1:])  # texts or numbers
                time_ms, force_kn = (pd.to_numeric(of, errors="coerce").to_numpy(np.float64) for of in cells)
                walls[str(test_id)] = Wall(time_ms * MS, force_kn * KN)
                walls[str(test_id)].require_force(f"{path.name}, {printable(str(test_id), 60)}")
    return walls


def unread_files(campaign: Path) -> str:
    """A sentence on the files of a campaign folder, or a zip of one, that nothing reads; empty if there are none."""
    if campaign.is_dir():
        folders = [campaign, *(campaign / role for role in _ROLES if (campaign / role).is_dir())]
        paths = [path.relative_to(campaign).as_posix() + "/" * path.is_dir() for of in folders for path in of.iterdir()]
    elif campaign.is_file():
        members = members_of_zip(campaign.name, campaign.read_bytes(), DEFAULT_LIMITS)
        root = _root(members, campaign.name)
        inside = [member.path.relative_to(root).parts for member in members if root in member.path.parents]
        paths = [_listed(parts, 2 if parts[0] in _ROLES else 1) for parts in inside]
    else:
        return ""
    unread = [name for name in sorted({*paths} - {f"{role}/" for role in _ROLES}) if not _is_read(name)]
    unread = [name for name in unread if not (archive.left_by_the_system(name.rstrip("/")) or _ABOUT.fullmatch(name))]
    return f"Not read, as no file of a campaign is called so: {listed(unread)}." if unread else ""


def _listed(parts: Sequence[str], depth: int) -> str:
    return "/".join(parts[:depth]) + "/" * (len(parts) > depth)


def _is_read(name: str) -> bool:
    folder, _, file = name.rpartition("/")
    return PurePosixPath(file).suffix in PULSES if folder and file else name in AT_THE_TOP


def _without_unused(
    table: ConditionTable, ids: Collection[str], problems: list[Problem]
) -> tuple[ConditionTable, tuple[tuple[str, Condition], ...]]:
    places = [place for place, test_id in enumerate(table.ids) if test_id in ids]
    wrong = [repr(printable(test_id, 60)) for test_id in ids if test_id not in table.ids]
    wrong += ["all of them"] if len(places) == len(table.ids) else []
    expected = "campaign.toml", "ids of tests.csv, not all of them"
    problems += [Problem(*expected, found, "correct the list", "unused") for found in wrong]
    return table.without(places), tuple((table.ids[place], table.conditions[place]) for place in places)


def _check_pulses(
    role: str, table: ConditionTable, accel: FloatArray, reader: PulseFiles, tests: tuple[FloatArray, FloatArray] | None
) -> plausibility.Gap | None:
    """Check every pulse against its condition, and tests against each other; returns the gap of CAE runs, if any."""
    if reader.unread:
        table, accel = table.without(reader.unread), np.delete(accel, reader.unread, axis=0)
    gap = None
    if tests is not None:
        taken_m = reader.gap_m if reader.through_gap else 0.0
        gap = plausibility.find_gap(table.speeds_mps, accel, *tests, taken_m=taken_m)
        reader.warnings += [gap.warning] if gap else []
    plausibility.check_physics(role, table, accel, reader.faults, reader.problems, gap.advice if gap else "")
    reader.problems += plausibility.check_ends(role, table, accel, reader.ends_s, reader.faults)
    plausibility.check_band(role, accel, reader.warnings)
    if role == "tests":
        check_tests_differ(table, accel, reader.ends_s, reader.problems, reader.warnings)
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
                    _name_alone(folder / path)
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
        raise DataError(Problem("upload", expected, found, "zip all of it together"))
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
        raise DataError(Problem(where, "tests.csv and cae.csv", "neither", "add the tables of tests and of CAE runs"))
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
    times = Counter(folded(str(target)) for target in targets.values())
    for member in [member for member, target in targets.items() if times[folded(str(target))] > 1]:
        problems.append(Problem(member.where, "names that differ by more than capitals", "two alike", "keep one"))
        del targets[member]
    return targets


def _name_alone(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()


def _strange(member: Member) -> Problem | None:
    ending = member.path.suffix.lower()
    if ending in (*PULSES, *_NOTES, ".toml", Path(ARCHIVE).suffix):
        return None
    expected = "a file of a campaign (.csv, .parquet, campaign.toml) or one to be imported"
    return Problem(member.where, expected, printable(member.path.name), "unpack or leave it out")


def _in_a_campaign(path: PurePosixPath) -> bool:
    match path.parts:
        case (name,):
            return name in AT_THE_TOP or path.suffix in PULSES
        case (role, _):
            return role in _ROLES and path.suffix in PULSES
    return False


def _place(folder: Path, at_the_top: Sequence[PurePosixPath], problems: list[Problem]) -> None:
    """Move each pulse beside the tables to the role that has its id, else to the one whose table cannot be read."""
    strays = [folder / path for path in at_the_top if path.name not in AT_THE_TOP]
    has_pulses = {role for role in _ROLES for end in PULSES if (folder / f"{role}_pulses{end}").is_file()}
    lacking = [role for role in _ROLES if strays and role not in has_pulses]
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
    """Reject a Parquet table that packs too many rows into few bytes."""
    for path in sorted(folder.rglob("*.parquet")):
        try:
            with pq.ParquetFile(path) as file:
                rows = file.metadata.num_rows
        except (pa.ArrowException, OSError):
            continue  # read_folder reports what is wrong with it
        if rows > limits.rows:
            raise DataError(Problem(path.name, f"at most {limits.rows} rows", f"{rows}", "upload fewer runs"))
