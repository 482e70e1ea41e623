"""The campaign folder: settings, both condition tables, both sources of pulses, checked as a whole."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crashfuse.campaign import CaeLibrary, Campaign, CrashTest
from crashfuse.errors import DataError, Problem
from crashfuse.formats.pulses import PulseSource
from crashfuse.formats.tables import ConditionTable, read_conditions
from crashfuse.pulse import DT_S, GRID_S, FloatArray, Pulse, kinematics
from crashfuse.units import KPH, MPH, MS, G

_FEWEST_RUNS = 10
_TEST_STOPS = (0.8, 1.6)  # ΔV over v0: from "not yet stopped at 100 ms" to more rebound than any car has
_RUN_STOPS = (0.3, 2.5)
_LIBRARY_STOPS = (0.8, 1.6)  # the median run: one may be odd, not half of them
_MOVING = 0.05  # of the impact speed: 0.25 % of its energy is left
_BAND_HZ, _HIGH_SHARE = 250, 0.01
_MOST_SPECTRA = 500  # pulses looked at
_CREEP_MPS = 1.0  # below this speed noise decides ΔV over v0


@dataclass(frozen=True, slots=True)
class _Settings:
    name: str
    notice: str = ""
    channel_filter_class: float | None = None
    filtered_with: float | None = None


def load_campaign(folder: str | Path) -> Campaign:
    """Read and check a campaign folder.

    Parameters
    ----------
    folder : str or Path
        With ``tests.csv`` and ``cae.csv``, the pulses of each as ``<source>/<id>.csv`` (or ``.parquet``) or
        ``<source>_pulses.parquet`` (or ``.csv``), and optionally ``campaign.toml``.

    Returns
    -------
    Campaign
        All pulses on the study grid, m/s².

    Raises
    ------
    DataError
        With every problem of the folder, not only the first.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(Problem(str(folder), "a campaign folder", "no such folder", "check the path"))
    problems: list[Problem] = []
    warnings: list[str] = []
    settings = _read_settings(folder, problems, warnings)
    tables: dict[str, ConditionTable] = {}
    pulses: dict[str, FloatArray] = {}
    for source in ("tests", "cae"):
        table = read_conditions(folder / f"{source}.csv", standstill_allowed=source == "cae", problems=problems)
        if table is None:
            continue
        reader = PulseSource(folder, source, settings.channel_filter_class)
        tables[source], pulses[source] = table, reader.read(table.ids)
        if not reader.problems:
            _check_physics(source, table, pulses[source], reader.problems)
            _check_ends(source, table, pulses[source], reader)
            _check_band(source, pulses[source], reader.warnings)
        problems.extend(reader.problems)
        warnings.extend(_shortened(reader.warnings))
    _check_counts(tables, problems)
    if problems:
        raise DataError(problems)
    cae = CaeLibrary(tables["cae"].ids, tables["cae"].conditions, pulses["cae"].astype(np.float32, copy=False))
    cae.accel_mps2.flags.writeable = False
    tests = zip(tables["tests"].ids, tables["tests"].conditions, pulses["tests"], strict=True)
    crash_tests = tuple(CrashTest(test_id, condition, Pulse(GRID_S, accel)) for test_id, condition, accel in tests)
    cfc = settings.channel_filter_class or settings.filtered_with
    return Campaign(settings.name, cae, crash_tests, settings.notice, tuple(warnings), cfc)


def _read_settings(folder: Path, problems: list[Problem], warnings: list[str]) -> _Settings:
    path = folder / "campaign.toml"
    if not path.is_file():
        return _Settings(folder.resolve().name)
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        problems.append(Problem(path.name, "a TOML file in UTF-8", str(error), "correct the file"))
        return _Settings(folder.resolve().name)
    cfc, already = (_filter_class(values, key, problems) for key in ("channel_filter_class", "filtered_with"))
    if cfc is not None and already is not None:
        expected, advice = "one of the two", "leave out channel_filter_class, or pulses are filtered twice"
        problems.append(Problem(path.name, expected, "channel_filter_class and filtered_with", advice))
    values.pop("imported", None)  # where pulses came from, told by crashfuse import
    name, notice = str(values.pop("name", folder.resolve().name)), str(values.pop("notice", ""))
    if values:
        warnings.append(f"{path.name}: {', '.join(values)} is not a setting that crashfuse knows; it is left alone.")
    return _Settings(name, notice, cfc, already)


def _filter_class(values: dict[str, Any], key: str, problems: list[Problem]) -> float | None:
    """Take a channel filter class out of the settings, None for "none"."""
    cfc = values.pop(key, "none")
    if cfc == "none":
        return None
    if isinstance(cfc, bool) or not isinstance(cfc, int | float) or not 1 <= cfc <= 1000:
        expected = 'a channel filter class such as 60 or 180, or "none"'
        problems.append(Problem("campaign.toml", expected, repr(cfc), "correct the value", key))
        return None
    return float(cfc)


def _check_counts(tables: dict[str, ConditionTable], problems: list[Problem]) -> None:
    if "tests" in tables and len(tables["tests"].ids) < 2:
        advice = "add a test: leaving the only one out leaves nothing to learn from"
        problems.append(Problem("tests.csv", "at least 2 tests", "1", advice))
    if "cae" in tables and len(tables["cae"].ids) < _FEWEST_RUNS:
        found = str(len(tables["cae"].ids))
        problems.append(Problem("cae.csv", f"at least {_FEWEST_RUNS} CAE runs", found, "add runs"))


def _check_physics(source: str, table: ConditionTable, accel: FloatArray, problems: list[Problem]) -> None:
    """Compare each pulse's change of velocity with the speed it is said to have been run at."""
    low, high = _TEST_STOPS if source == "tests" else _RUN_STOPS
    speed = np.array([condition.speed_mps for condition in table.conditions])
    velocity = kinematics(accel, 0.0, DT_S).velocity_mps
    biggest = velocity[np.arange(len(speed)), np.abs(velocity).argmax(axis=1)]
    ratio = -biggest / np.maximum(speed, 1e-9)
    moving = speed > _CREEP_MPS
    typical = float(np.median(ratio[moving])) if moving.any() else 1.0
    if source == "cae" and not _LIBRARY_STOPS[0] <= typical <= _LIBRARY_STOPS[1]:
        found = f"{typical:.2f} times it"
        expected = "pulses that take off about the impact speed, half of them at least"
        problems.append(Problem("cae.csv", expected, found, _likely_cause(typical, *_LIBRARY_STOPS)))
        return
    for row in np.flatnonzero(((ratio < low) | (ratio > high)) & (speed > _CREEP_MPS))[:20]:
        v0, delta_v = speed[row], biggest[row]
        found = f"a change of {delta_v / MPH:+.1f} mph ({delta_v / KPH:+.1f} km/h)"
        expected = f"a pulse that takes off about the impact speed of {v0 / MPH:.1f} mph ({v0 / KPH:.1f} km/h)"
        problems.append(
            Problem(
                f"{source}.csv",
                expected,
                found,
                _likely_cause(float(ratio[row]), low, high),
                f"id {table.ids[row]}",
                int(row) + 2,
            )
        )


def _check_ends(source: str, table: ConditionTable, accel: FloatArray, reader: PulseSource) -> None:
    """Refuse a record that ends while the vehicle still moves: the rest of its pulse would be invented."""
    for row, run_id in enumerate(table.ids):
        if run_id not in reader.ends_s:
            continue
        speed, end = table.conditions[row].speed_mps, reader.ends_s[run_id]
        velocity = np.interp(end, GRID_S, kinematics(accel[row], speed, DT_S).velocity_mps)
        if velocity > _MOVING * speed:
            found = f"{velocity / MPH:.1f} mph ({velocity / KPH:.1f} km/h) at its end, {end / MS:.4g} ms"
            expected = "a record that lasts until the vehicle has stopped, or 100 ms"
            place = f"id {run_id}"
            reader.problems.append(Problem(f"{source}.csv", expected, found, "export a longer record", place, row + 2))


def _check_band(source: str, accel: FloatArray, warnings: list[str]) -> None:
    """Warn of pulses with much above the band that the fast time-domain network resolves."""
    if not len(accel):
        return
    some = accel[:: -(-len(accel) // _MOST_SPECTRA)].astype(np.float64)
    power = np.abs(np.fft.rfft(some - some.mean(axis=1, keepdims=True), axis=1)) ** 2
    high = np.fft.rfftfreq(some.shape[1], DT_S) > _BAND_HZ
    if power[:, high].sum() > _HIGH_SHARE * power.sum():
        share = 100 * power[:, high].sum() / power.sum()
        warnings.append(
            f"{source}: {share:.0f} % of the pulses' power lies above {_BAND_HZ} Hz, beyond what is modelled; "
            "set channel_filter_class = 60 in campaign.toml if they are not filtered."
        )


def _likely_cause(ratio: float, low: float, high: float) -> str:
    """Advice from how far ΔV over v0 is off."""
    causes = {
        "flip the sign of the acceleration (braking is negative)": -1.0,
        "check the unit of the acceleration (m/s² under a name that ends in _g?)": G,
        "check the unit of the acceleration (g under a name that ends in _mps2?)": 1 / G,
        "check the unit of the speed (km/h under a name that ends in _mph?)": KPH / MPH,
        "check the unit of the speed (mph under a name that ends in _kph?)": MPH / KPH,
    }
    likely = [advice for advice, factor in causes.items() if low <= ratio / factor <= high]
    return likely[0] if likely else "check the speed, the units and time zero of this pulse"


def _shortened(warnings: list[str], most: int = 5) -> list[str]:
    if len(warnings) <= most:
        return warnings
    return [*warnings[:most], f"{warnings[0].partition(':')[0].split(',')[0]}: {len(warnings) - most} more like these."]
