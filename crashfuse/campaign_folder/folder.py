"""The campaign folder: settings, both condition tables and both sets of pulses, checked as a whole."""

import math
import re
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import TABLES, ConditionTable, read_what_can_be
from crashfuse.campaign_folder.copies import check_runs_differ, check_tests_differ
from crashfuse.campaign_folder.gap import Gap, find_gap
from crashfuse.campaign_folder.history import settle
from crashfuse.campaign_folder.plausibility import (
    check_band,
    check_ends,
    check_physics,
    check_units,
    fault_advice,
    unlike_weights,
)
from crashfuse.campaign_folder.pulse_files import PulseFiles
from crashfuse.campaign_folder.quality_columns import failing
from crashfuse.campaign_folder.settings import read_settings
from crashfuse.campaign_folder.unlike_others import confirmed_faults, unlike_others
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem, printable, shortened
from crashfuse.files.archive import left_by_the_system
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.sensor_faults import SensorFault

_FEWEST_RUNS = 10
PULSES = (".csv", ".parquet")
"""Endings of tables of pulses."""
FILES = (*TABLES, "campaign.toml", "criteria.toml", "matrix.csv", "notes.csv")
"""The files of a campaign folder beside its pulses."""
AT_THE_TOP = {*FILES, *(f"{role}_pulses{ending}" for role in ("tests", "cae") for ending in PULSES)}
"""The files of a campaign folder that do not lie in a folder in it."""
_ABOUT = re.compile(r"(?i)(readme|licen[cs]e)(\..*)?|.*\.md")
_NAMED = 5


def read_folder(folder: str | Path) -> Campaign:
    """Read and check a campaign folder, see :func:`crashfuse.campaign_folder.load.load_campaign`."""
    folder = Path(folder)
    if not folder.is_dir():
        found, advice = "no such folder", "check the path"
        if folder.exists():
            found, advice = "a file", "name the folder that it lies in, or a zip of it"
        raise DataError(Problem(str(folder), "a campaign folder", found, advice))
    settle(folder)
    problems: list[Problem] = []
    warnings: list[str] = []
    settings = read_settings(folder, problems, warnings)
    tables: dict[str, ConditionTable] = {}
    pulses: dict[str, FloatArray] = {}
    ends_s: dict[str, float] = {}
    faults: Mapping[str, tuple[SensorFault, ...]] = {}
    unused: tuple[tuple[str, Condition], ...] = ()
    gap: Gap | None = None
    for role in ("tests", "cae"):
        table = read_what_can_be(folder / f"{role}.csv", role, problems)
        speeds = {} if table is None else dict(zip(table.ids, _speeds(table), strict=True))
        gap_m = settings.cae_gap_m if role == "cae" else 0.0
        reader = PulseFiles(folder, role, settings.channel_filter_class, gap_m, speeds)
        if table is None:
            reader.check()
        else:
            if role == "tests" and settings.unused:
                table, unused = _without_unused(table, settings.unused, problems)
            passed_over = [test_id for test_id, _ in unused] if role == "tests" else []
            tables[role], pulses[role] = table, reader.read(table.ids, passed_over)
            measured = (_speeds(tables["tests"]), pulses["tests"]) if role == "cae" and "tests" in tables else None
            gap = _check_pulses(role, table, pulses[role], reader, measured)
        if role == "tests":
            ends_s, faults = reader.ends_s, reader.faults
        problems.extend(reader.problems)
        warnings.extend(_shortened(reader.warnings))
    left_out = failing(tables["cae"].quality, settings.quality) if "cae" in tables else []
    gone = tuple((tables["cae"].ids[place], tables["cae"].quality[place]) for place in left_out)
    if left_out:
        tables["cae"] = tables["cae"].without(left_out)
        pulses["cae"] = np.delete(pulses["cae"], left_out, axis=0)
    _check_counts(tables, len(left_out), problems, warnings)
    if problems:
        raise DataError(shortened(problems))
    is_comparable = gap is None or not gap.hides_tests
    faults = confirmed_faults(tables, pulses, faults, is_comparable=is_comparable)
    warnings += _shortened([f"tests.csv, {test}: {fault_advice(test, failed)}." for test, failed in faults.items()])
    # of tests against CAE runs that have a gap nothing can be seen
    for findings in (check_units, unlike_weights, unlike_others) if is_comparable else (unlike_weights,):
        explained = {warning.partition(":")[0] for warning in warnings}  # by a failed sensor, a wrong speed or unit
        warnings += _shortened([said for said in findings(tables, pulses) if said.partition(":")[0] not in explained])
    _check_factors(tables["tests"], warnings)
    runs = tables["cae"]
    cae = CaeLibrary(runs.ids, runs.conditions, pulses["cae"].astype(np.float32, copy=False), runs.quality, gone)
    check_runs_differ(runs, cae.accel_mps2, warnings)
    cae.accel_mps2.flags.writeable = False
    tests = zip(tables["tests"].ids, tables["tests"].conditions, pulses["tests"], strict=True)
    crash_tests = tuple(
        CrashTest(test_id, condition, Pulse(GRID_S, accel), ends_s.get(test_id, math.inf), faults.get(test_id, ()))
        for test_id, condition, accel in tests
    )
    cfc = settings.channel_filter_class or settings.filtered_with
    return Campaign(
        settings.name, cae, crash_tests, settings.notice, tuple(warnings), cfc, settings.quality.limits,
        settings.occupant, _common({settings.tests_imported_with.get(test.id) for test in crash_tests}),
        tables["tests"].units, unused, settings.unused,
    )  # fmt: skip


def unread_files(folder: Path) -> str:
    """A sentence on the files of a campaign folder that nothing reads; empty if there are none, and for a zip."""
    if not folder.is_dir():
        return ""
    unread = []
    for path in sorted(folder.iterdir()):
        if path.name in ("tests", "cae") and path.is_dir():
            unread += [f"{path.name}/{one.name}" for one in sorted(path.iterdir()) if one.suffix not in PULSES]
        elif path.name not in AT_THE_TOP:
            unread.append(path.name + "/" * path.is_dir())
    unread = [name for name in unread if not left_by_the_system(name.rstrip("/")) and not _ABOUT.fullmatch(name)]
    if not unread:
        return ""
    more = f" and {len(unread) - _NAMED} more" if len(unread) > _NAMED else ""
    named = ", ".join(printable(name, 60) for name in unread[:_NAMED])
    return f"Not read, as no file of a campaign has such a name: {named}{more}."


def _without_unused(
    table: ConditionTable, ids: Collection[str], problems: list[Problem]
) -> tuple[ConditionTable, tuple[tuple[str, Condition], ...]]:
    """The tests that are in use, and id and condition of those that are left out of it."""
    where, key = "campaign.toml", "unused"
    for test_id in ids:
        if test_id not in table.ids:
            expected, advice = "ids of tests.csv", "correct or remove the id"
            problems.append(Problem(where, expected, repr(printable(test_id, 60)), advice, key))
    places = [place for place, test_id in enumerate(table.ids) if test_id in ids]
    if len(places) == len(table.ids):
        problems.append(
            Problem(where, "a test that is in use", "all of them left out", "take one out of the list", key)
        )
    return table.without(places), tuple((table.ids[place], table.conditions[place]) for place in places)


def _speeds(table: ConditionTable) -> FloatArray:
    return np.array([condition.speed_mps for condition in table.conditions])


def _check_pulses(
    role: str,
    table: ConditionTable,
    accel: FloatArray,
    reader: PulseFiles,
    tests: tuple[FloatArray, FloatArray] | None,
) -> Gap | None:
    """Check every pulse that could be read against its condition, and tests against each other.

    Returns the gap before the barrier of CAE runs, if they have one by the speeds and pulses of ``tests``.
    """
    if reader.unread:
        table, accel = table.without(reader.unread), np.delete(accel, reader.unread, axis=0)
    gap = None
    if tests is not None:
        gap = find_gap(_speeds(table), accel, *tests, taken_m=reader.gap_m if reader.through_gap else 0.0)
        reader.warnings += [gap.warning] if gap else []
    check_physics(role, table, accel, reader.faults, reader.problems, gap.advice if gap else "")
    check_ends(role, table, accel, reader.ends_s, reader.faults, reader.problems)
    check_band(role, accel, reader.warnings)
    if role == "tests":
        check_tests_differ(table, accel, reader.ends_s, reader.problems, reader.warnings)
    return gap


def _common(classes: set[float | None]) -> float | None:
    return classes.pop() if len(classes) == 1 else None


def _check_counts(
    tables: dict[str, ConditionTable], left_out: int, problems: list[Problem], warnings: list[str]
) -> None:
    if "tests" in tables and len(tables["tests"].ids) == 1:
        warnings.append(
            "Only one test: nothing can be left out, so nothing can be checked; predictions can be made, but how much "
            "tests differ from each other is assumed."
        )
    if "cae" in tables and len(tables["cae"].ids) < _FEWEST_RUNS:
        found = str(len(tables["cae"].ids)) + f", and {left_out} left out for their quality" * (left_out > 0)
        problems.append(Problem("cae.csv", f"at least {_FEWEST_RUNS} CAE runs", found, "add runs"))


def _check_factors(tests: ConditionTable, warnings: list[str]) -> None:
    """Warn of tests without a value for a factor that other tests have."""
    known = [dict(condition.factors) for condition in tests.conditions]
    for name in dict.fromkeys(name for factors in known for name, value in factors.items() if value):
        lacking = [test for test, factors in zip(tests.ids, known, strict=True) if not factors.get(name)]
        if lacking:
            named = ", ".join(lacking[:5]) + " …" * (len(lacking) > 5)
            warnings += [f"tests.csv, {name}: not given for {named}; fill it in, for tests may differ by it."]


def _shortened(warnings: list[str], most: int = 5) -> list[str]:
    if len(warnings) <= most:
        return warnings
    return [*warnings[:most], f"{warnings[0].partition(':')[0].split(',')[0]}: {len(warnings) - most} more like these."]
