"""The campaign folder: settings, both condition tables and both sets of pulses, checked as a whole."""

import math
from collections.abc import Collection
from pathlib import Path

import numpy as np

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import ConditionTable, read_what_can_be
from crashfuse.campaign_folder.copies import check_runs_differ, check_tests_differ
from crashfuse.campaign_folder.history import settle
from crashfuse.campaign_folder.plausibility import check_band, check_ends, check_physics, check_units, unlike_weights
from crashfuse.campaign_folder.pulse_files import PulseFiles
from crashfuse.campaign_folder.quality_columns import failing
from crashfuse.campaign_folder.settings import read_settings
from crashfuse.campaign_folder.unlike_others import unlike_others
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem, printable, shortened
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse

_FEWEST_RUNS = 10


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
    unused: tuple[tuple[str, Condition], ...] = ()
    for role in ("tests", "cae"):
        table = read_what_can_be(folder / f"{role}.csv", role, problems)
        reader = PulseFiles(folder, role, settings.channel_filter_class)
        if table is None:
            reader.check()
        else:
            if role == "tests" and settings.unused:
                table, unused = _without_unused(table, settings.unused, problems)
            passed_over = [test_id for test_id, _ in unused] if role == "tests" else []
            tables[role], pulses[role] = table, reader.read(table.ids, passed_over)
            _check_pulses(role, table, pulses[role], reader)
        if role == "tests":
            ends_s = reader.ends_s
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
    check_units(tables, pulses, warnings)
    warnings += _shortened(unlike_weights(tables))
    known = {warning.partition(":")[0] for warning in warnings}  # a wrong speed or unit explains the rest
    warnings += _shortened([told for told in unlike_others(tables, pulses) if told.partition(":")[0] not in known])
    _check_factors(tables["tests"], warnings)
    runs = tables["cae"]
    cae = CaeLibrary(runs.ids, runs.conditions, pulses["cae"].astype(np.float32, copy=False), runs.quality, gone)
    check_runs_differ(runs, cae.accel_mps2, warnings)
    cae.accel_mps2.flags.writeable = False
    tests = zip(tables["tests"].ids, tables["tests"].conditions, pulses["tests"], strict=True)
    crash_tests = tuple(
        CrashTest(test_id, condition, Pulse(GRID_S, accel), ends_s.get(test_id, math.inf))
        for test_id, condition, accel in tests
    )
    cfc = settings.channel_filter_class or settings.filtered_with
    return Campaign(
        settings.name, cae, crash_tests, settings.notice, tuple(warnings), cfc, settings.quality.limits,
        settings.occupant, _common({settings.tests_imported_with.get(test.id) for test in crash_tests}),
        tables["tests"].units, unused, settings.unused,
    )  # fmt: skip


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


def _check_pulses(role: str, table: ConditionTable, accel: FloatArray, reader: PulseFiles) -> None:
    """Check every pulse that could be read against its condition, and tests against each other."""
    if reader.unread:
        table, accel = table.without(reader.unread), np.delete(accel, reader.unread, axis=0)
    check_physics(role, table, accel, reader.problems)
    check_ends(role, table, accel, reader)
    check_band(role, accel, reader.warnings)
    if role == "tests":
        check_tests_differ(table, accel, reader.problems)


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
