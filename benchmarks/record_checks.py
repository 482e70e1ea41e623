"""Alarms of the checks of records, on sound records and on broken ones: ``python benchmarks/record_checks.py FOLDER``.

Every campaign in the folder is taken, with its further repeats (``unseen.parquet``, see ``impacts.py``). Each record is
checked as in a campaign: beside the other tests and the CAE runs. Counted is how many sound records are accused of
anything, and how many broken ones are, as recorded and after CFC 60. What a missed fault does is told by the rating of
the record with it against the record without, over 0-80 ms, both after CFC 60. Faults are drawn (``--seed``):

- saturation at 60 to 80 % of the peak, and at 90 to 95 %;
- a signal lost, or held, for 4 to 6 ms in the crash, where that changes it by 20 or 5 % of the peak at least;
- spikes of 60 and 20 g within 1 ms, and white noise of 20 and 5 g (RMS) from a moment in the crash on.

*Stands apart* is counted in groups of four to six records at one speed, drawn ten times: of all as they are, and of one
in each group that another structure gave. It comes from a campaign whose name begins as this one's
(``helmet_left`` for ``helmet_front``), from the speed nearest to theirs, with their speed. With ``--data`` the table is
written to ``record_alarms.csv``.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from impacts import further_repeats
from tables import add_data_option, write

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import ROLES, ConditionTable, read_conditions
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.plausibility import confirmed_faults
from crashfuse.campaign_folder.pulse_files import PulseFiles
from crashfuse.crash_test import CrashTest
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.signals.sensor_faults import sensor_faults
from crashfuse.study.outliers import departures
from crashfuse.units import MS, G

Fault = Callable[[FloatArray, FloatArray, np.random.Generator], FloatArray]
_DRAWN = 10  # times a group of each speed
_WINDOW_MS = 80.0
_FEWEST, _MOST = 4, 6  # records in it
_NONE, _APART, _STRANGER = "none", "none, in a group at one speed", "another structure's, in a group at one speed"
_SMOOTH = "CFC 60"


def _crash(accel: FloatArray) -> npt.NDArray[np.intp]:
    """Samples from the first to the last of 10 % of the peak."""
    return np.arange(*np.flatnonzero(np.abs(accel) > 0.1 * np.abs(accel).max())[[0, -1]])


def _saturated(low: float, high: float) -> Fault:
    def fault(_: FloatArray, accel: FloatArray, rng: np.random.Generator) -> FloatArray:
        level = rng.uniform(low, high) * np.abs(accel).max()
        return np.clip(accel, -level, level)

    return fault


def _stretch(least: float, new: Callable[[FloatArray, int], float]) -> Fault:
    def fault(time_s: FloatArray, accel: FloatArray, rng: np.random.Generator) -> FloatArray:
        step_s, peak = float(time_s[1] - time_s[0]), float(np.abs(accel).max())
        for _ in range(1000):
            first, n = int(rng.choice(_crash(accel))), round(rng.uniform(4 * MS, 6 * MS) / step_s)
            if first + n >= accel.size - 1:  # beyond the end of the record
                continue
            broken = accel.copy()
            broken[first : first + n] = new(accel, first)
            if np.abs(broken - accel).max() >= least * peak:
                return broken
        raise ValueError("no such stretch")

    return fault


def _spike(size_g: float) -> Fault:
    def fault(time_s: FloatArray, accel: FloatArray, rng: np.random.Generator) -> FloatArray:
        at, sign = time_s[rng.choice(_crash(accel))], rng.choice([-1, 1])
        return np.asarray(accel + sign * size_g * G * np.maximum(1 - np.abs(time_s - at) / (0.5 * MS), 0.0))

    return fault


def _noise(size_g: float) -> Fault:
    def fault(_: FloatArray, accel: FloatArray, rng: np.random.Generator) -> FloatArray:
        start = int(rng.choice(_crash(accel)[: 2 * _crash(accel).size // 3]))
        return np.asarray(accel + (np.arange(accel.size) >= start) * rng.normal(0.0, size_g * G, accel.size))

    return fault


FAULTS: dict[str, Fault] = {
    "saturated at 60 to 80 % of the peak": _saturated(0.6, 0.8),
    "saturated at 90 to 95 % of the peak": _saturated(0.9, 0.95),
    "lost for 4 to 6 ms": _stretch(0.2, lambda *_: 0.0),
    "held for 4 to 6 ms": _stretch(0.05, lambda accel, first: accel[first]),
    "spike of 60 g within 1 ms": _spike(60.0),
    "spike of 20 g within 1 ms": _spike(20.0),
    "noise of 20 g (RMS)": _noise(20.0),
    "noise of 5 g (RMS)": _noise(5.0),
}


def _alarms(
    tests: ConditionTable, runs: ConditionTable, test: CrashTest, time_s: FloatArray, accel: FloatArray
) -> set[str]:
    """The kinds of faults that a record is accused of, beside the other tests of its campaign."""
    on_grid = np.interp(GRID_S, time_s, accel).astype(np.float32)
    if test.id not in tests.ids:
        tests = replace(tests, ids=(*tests.ids, test.id), conditions=(*tests.conditions, test.condition))
    pulses = np.zeros((len(tests.ids), GRID_S.size), np.float32)
    pulses[: len(tests.accel_mps2)] = tests.accel_mps2
    pulses[tests.ids.index(test.id)] = on_grid
    tests = replace(tests, accel_mps2=pulses, faults={test.id: sensor_faults(time_s, accel)})
    return {fault.kind for faults in confirmed_faults(tests, runs, is_comparable=True).values() for fault in faults}


def _sensors(folder: Path, campaign: Campaign, further: Sequence[CrashTest], seed: int) -> Iterator[dict[str, object]]:
    """Whether each record is accused, without a fault and with each."""
    tests, runs = (PulseFiles(folder, role).read(read_conditions(folder / f"{role}.csv", role)) for role in ROLES)
    records = {i: (one.time_s, one.accel_mps2) for i, _, one in PulseFiles(folder, "tests").records(tests.ids) if one}
    if further:
        for name, rows in pd.read_parquet(folder / "unseen.parquet").groupby("id"):
            records[str(name)] = rows.time_ms.to_numpy() * MS, rows.acceleration_g.to_numpy() * G
    for test in (*campaign.tests, *further):
        time_s, accel = records[test.id]
        smooth = partial(cfc_filter, cfc=60, dt_s=float(time_s[1] - time_s[0]))
        sound = Pulse(GRID_S, np.interp(GRID_S, time_s, smooth(accel)))
        for name, fault in {_NONE: None, **FAULTS}.items():
            rng = np.random.default_rng([seed, *f"{folder.name} {test.id} {name}".encode()])
            broken = accel if fault is None else fault(time_s, accel, rng)
            smoothed = smooth(broken)
            faulty = Pulse(GRID_S, np.interp(GRID_S, time_s, smoothed))
            rating = rate_windows(sound, faulty, [_WINDOW_MS])[_WINDOW_MS].overall
            for seen, given in {"as recorded": broken, _SMOOTH: smoothed}.items():
                kinds = _alarms(tests, runs, test, time_s, given)
                row = {"record": name, "seen": seen, "test": test.id, "kinds": " ".join(sorted(kinds))}
                yield {**row, "found": bool(kinds), "rating": rating}


def _apart(
    campaign: Campaign, records: Sequence[CrashTest], others: Sequence[CrashTest], seed: int
) -> Iterator[dict[str, object]]:
    """Whether each record of drawn groups stands apart, and whether one of another structure does in its place."""
    rng = np.random.default_rng(seed)
    for speed_mps in sorted({test.condition.speed_mps for test in records}):
        pool = [test for test in records if test.condition.speed_mps == speed_mps]
        away = [abs(other.condition.speed_mps - speed_mps) for other in others]
        nearest = [other for other, off in zip(others, away, strict=True) if off == min(away)]
        for _ in range(_DRAWN if len(pool) >= _FEWEST else 0):
            size = min(int(rng.integers(_FEWEST, _MOST + 1)), len(pool))
            first, *group = (pool[i] for i in rng.permutation(len(pool))[:size])
            found = _standing_apart(campaign, [first, *group])
            yield from ({"record": _APART, "test": test.id, "found": test.id in found} for test in (first, *group))
            if nearest:
                other = nearest[rng.integers(len(nearest))]
                scaled = other.pulse.accel_mps2 * (speed_mps / other.condition.speed_mps)
                put = replace(first, id=f"other {other.id}", pulse=Pulse(GRID_S, scaled))
                yield {"record": _STRANGER, "test": put.id, "found": put.id in _standing_apart(campaign, [put, *group])}


def _standing_apart(campaign: Campaign, tests: Sequence[CrashTest]) -> set[str]:
    return {one.test for one in departures(replace(campaign, tests=tuple(tests)))}


def alarms(folder: Path, seed: int, campaigns: Mapping[Path, Campaign]) -> pd.DataFrame:
    """What is found in the records of one of the campaigns, a row each."""
    campaign, further = campaigns[folder], further_repeats(folder, campaigns[folder])
    kind, others = folder.name.partition("_")[0], list[CrashTest]()
    for other, one in campaigns.items():
        if other != folder and other.name.startswith(kind):
            others += [*one.tests, *further_repeats(other, one)]
    found = [*_sensors(folder, campaign, further, seed), *_apart(campaign, [*campaign.tests, *further], others, seed)]
    return pd.DataFrame([{"series": folder.name, "seen": "as recorded", **row} for row in found])


def counted(frame: pd.DataFrame) -> pd.DataFrame:
    """How many were found of how many, by fault."""
    by = frame.groupby(["record", "seen"], sort=False)["found"].agg(["sum", "size"]).unstack()
    by.columns = [f"{'found' if what == 'sum' else 'records'}, {seen}" for what, seen in by.columns]
    by = by.astype("Int64")
    missed = frame[(frame["seen"] == _SMOOTH) & ~frame["found"].astype(bool)].groupby("record")["rating"]
    for name, share in {"median": 0.5, "lowest twentieth": 0.05}.items():
        by[f"rating of the missed, {name}"] = missed.quantile(share).map("{:.3f}".format)
    return by.reset_index().rename(columns={"record": "fault"})


def main() -> None:
    """Check all records and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("folder", type=Path, help="with a campaign in each of its folders")
    parser.add_argument("--seed", type=int, default=0)
    add_data_option(parser)
    given = parser.parse_args()
    campaigns = {path.parent: load_campaign(path.parent) for path in sorted(given.folder.glob("*/tests.csv"))}
    frame = pd.concat([alarms(folder, given.seed, campaigns) for folder in campaigns])
    accused = frame[frame["record"].isin([_NONE, _APART]) & frame["found"]]
    print(accused[["series", "record", "seen", "test", "kinds"]].drop_duplicates().to_string(index=False))
    by_series = frame.groupby(["record", "seen", "series"], sort=False)["found"].mean().unstack()
    print(by_series.to_string(float_format="{:.3f}".format))
    print(counted(frame).to_string(index=False))
    if given.data:
        write(counted(frame), given.data / "record_alarms.csv", key="fault")


if __name__ == "__main__":
    main()
