"""The same record twice: copies are found however they were made, and crashes that are alike are left alone."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.copies import ONE_RECORD, copied_runs, sensors_of_one_crash, similar_tests
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray
from crashfuse.units import G
from tests.conftest import ROOT, SHARED, needs_shared

ONE_CRASH = "one condition to the digit"
WORLDS = ("alpha", "beta", "eta", "theta")
MADE: dict[str, Callable[[FloatArray], FloatArray]] = {
    "exactly": lambda accel: accel,
    "with a little noise": lambda accel: accel + np.random.default_rng(0).normal(0.0, 0.05 * G, accel.size),
    "5 ms later": lambda accel: np.interp(GRID_S - 5e-3, GRID_S, accel),
    "5 ms sooner": lambda accel: np.interp(GRID_S + 5e-3, GRID_S, accel),
    "12 ms sooner": lambda accel: np.interp(GRID_S + 12e-3, GRID_S, accel),
    "half": lambda accel: 0.5 * accel,
    "double": lambda accel: 2.0 * accel,
    "with a sensor's zero": lambda accel: accel + 0.3 * G,
    "at 1 kHz": lambda accel: np.interp(GRID_S, GRID_S[::12], accel[::12]),
    "at 10 kHz": lambda accel: np.interp(GRID_S, GRID_S[::2], accel[::2]),
    "filtered again": lambda accel: cfc_filter(accel, cfc=60, dt_s=DT_S),
    "cropped at 62 ms": lambda accel: accel[:775],
    "to 0.1 g": lambda accel: np.round(accel / G, 1) * G,
    "all of it": lambda accel: (
        np.round(cfc_filter(0.6 * np.interp(GRID_S - 4e-3, GRID_S, accel), cfc=60, dt_s=DT_S) / G + 0.1, 2) * G
    ),
}


def pulses(campaign: Campaign) -> FloatArray:
    """The pulses of its tests."""
    return np.array([test.pulse.accel_mps2 for test in campaign.tests])


@pytest.mark.parametrize("way", MADE)
def test_a_copy_of_a_test_is_found_however_it_was_made(sample: Campaign, way: str) -> None:
    tests = pulses(sample)
    n = len(tests)
    for place, accel in enumerate(tests):
        ((pair, share),) = similar_tests([*tests, MADE[way](accel)]).items()
        assert pair == (place, n)
        assert share < ONE_RECORD


@pytest.mark.parametrize(
    ("name", "differs", "is_told"),
    [("T09_right", 0.25, True), ("T09 tunnel", 0.07, True), ("T12", 0.07, True), ("T12", 0.25, False)],
)
def test_a_second_sensor_of_a_crash_is_told(sample: Campaign, name: str, differs: float, is_told: bool) -> None:
    """By its name, or as its condition is another test's to the digit; where most are repeated the name has to tell."""
    tests = [*sample.tests]
    accel = pulses(sample)
    unlike = np.where(GRID_S < 0.09, np.sin(2 * np.pi * GRID_S / 0.03), 0.0)
    second = accel[8] + differs * np.linalg.norm(accel[8]) * unlike / np.linalg.norm(unlike)
    ids, conditions = [*(test.id for test in tests), name], [*(test.condition for test in tests), tests[8].condition]
    found = [*sensors_of_one_crash(ids, conditions, np.vstack([accel, second]))]
    assert [pair for *pair, _ in found] == ([[8, 11]] if is_told else [])
    assert [share for *_, share in found] == pytest.approx([differs] * is_told, rel=0.05)
    about = [(("about_date", f"2026-11-{day:02}"),) for day in range(1, len(ids) + 1)]
    assert not [*sensors_of_one_crash(ids, conditions, np.vstack([accel, second]), about)]
    repeated = [*sensors_of_one_crash([*ids, *map(str, range(12))], [*conditions] * 2, np.vstack([accel, second] * 2))]
    assert [pair for *pair, _ in repeated] == ([[8, 11]] if is_told and name != "T12" else [])


def test_check_names_the_sensors(tmp_path: Path) -> None:
    folder = shutil.copytree(ROOT / "sample_data", tmp_path / "campaign")
    with (folder / "tests.csv").open("a") as table:
        table.write("T09_right,35.10,2107.68,1556.64,Type I,FWD\n")
    record = pd.read_csv(folder / "tests" / "T09.csv")
    record["acceleration_g"] += np.where(record["time_ms"] < 90, np.sin(record["time_ms"] / 5), 0.0)
    record.to_csv(folder / "tests" / "T09_right.csv", index=False)
    assert f"tests.csv, T09 and T09_right: {ONE_CRASH}" in " ".join(load_campaign(folder).warnings)


@needs_shared
@pytest.mark.parametrize("world", WORLDS)
def test_crashes_of_other_vehicles_are_not_copies(world: str) -> None:
    """Repeats at one condition among them, of lumped masses and of finite elements, and no CAE run is told of."""
    campaign = load_campaign(SHARED / "worlds" / world)
    tests = list(pulses(campaign))
    for path in sorted((SHARED / "worlds" / world / "repeats").glob("*.csv")):
        table = pd.read_csv(path)
        tests.append(np.interp(GRID_S, table["time_ms"] * 1e-3, table["acceleration_g"] * G, right=0.0))
    assert similar_tests(tests) == {}
    assert not any("the same pulse" in warning or ONE_CRASH in warning for warning in campaign.warnings)


@needs_shared
@pytest.mark.parametrize("series", ["helmet_front", "helmet_left", "quadcopter", "cone_blunt", "cone_spring"])
def test_measured_repeats_are_no_copies(series: str) -> None:
    """Foam repeats to a few per cent; hundreds of further impacts at the same conditions are never one record."""
    folder = SHARED / "real" / "impacts" / series
    campaign = load_campaign(folder)
    assert not any(ONE_CRASH in warning for warning in campaign.warnings)
    tests = list(pulses(campaign))
    if (folder / "unseen.parquet").is_file():
        for _, record in pd.read_parquet(folder / "unseen.parquet").groupby("id"):
            tests.append(np.interp(GRID_S, record["time_ms"] * 1e-3, record["acceleration_g"] * G))
    assert min(similar_tests(tests).values(), default=1.0) > 1.3 * ONE_RECORD


@needs_shared
def test_two_good_repeats_are_told(tmp_path: Path) -> None:
    """They correlate to 0.9999 once shifted: a campaign with both can be opened, and both are named."""
    folder = shutil.copytree(SHARED / "real" / "impacts" / "helmet_left", tmp_path / "campaign")
    for path in (SHARED / "real" / "impacts" / "two_repeats").glob("*.csv"):
        (folder / "tests" / path.name).unlink()
        (folder / "tests" / path.name).write_bytes(path.read_bytes())
    (told,) = [warning for warning in load_campaign(folder).warnings if "hardly differ" in warning]
    assert "A30_07 and A30_09 (1.3 %)" in told


@pytest.mark.parametrize("way", ["exactly", "half", "double", "at 10 kHz"])
def test_copies_among_cae_runs_are_told(sample: Campaign, way: str) -> None:
    """The same pulse at another speed, scaled or not; what is alike because the conditions are is no copy."""
    cae = sample.cae
    speeds = cae.vectors[:, 0]
    for run in np.flatnonzero(speeds > 4)[::150].tolist():
        accel = np.vstack([cae.accel_mps2, MADE[way](cae.accel_mps2[run].astype(np.float64))]).astype(np.float32)
        assert copied_runs(np.append(speeds, 0.9 * speeds[run]), accel) == [(run, len(cae))]


def test_a_copied_cae_run_is_a_warning(campaign_folder: Path) -> None:
    pulses_of = pd.read_parquet(campaign_folder / "cae_pulses.parquet")
    own = pulses_of.id == "C05"
    pulses_of.loc[own, "acceleration_g"] = pulses_of.loc[pulses_of.id == "C15", "acceleration_g"].to_numpy()
    table = pd.read_csv(campaign_folder / "cae.csv")
    speed = table.loc[table.id == "C15", "speed_mph"].item()
    table.loc[table.id == "C05", "speed_mph"] = speed * 1.05
    table.to_csv(campaign_folder / "cae.csv", index=False)
    pulses_of.to_parquet(campaign_folder / "cae_pulses.parquet", index=False)
    (warning,) = load_campaign(campaign_folder).warnings
    assert warning == ("cae.csv: the same pulse, scaled at most, for C05 and C15; check that none is a copy.")


def test_a_large_library_is_looked_through_in_little_time() -> None:
    """20,000 runs that vary in four ways take less than two seconds of CPU, and the copy is found."""
    rng = np.random.default_rng(0)
    speeds = rng.uniform(4, 17, 20_000)
    angle = np.where(GRID_S < 0.08, np.pi * GRID_S / 0.08, 0.0).astype(np.float32)
    accel = -np.tile(np.sin(angle), (speeds.size, 1))
    for harmonic in (2, 3, 4, 5):
        accel += rng.uniform(-0.2, 0.2, (speeds.size, 1)).astype(np.float32) * np.sin(harmonic * angle)
    accel *= speeds[:, None].astype(np.float32)
    accel[7_000], speeds[7_000] = 0.8 * accel[123], 0.8 * speeds[123] + 4
    began = time.process_time()
    assert (123, 7_000) in copied_runs(speeds, accel)
    assert time.process_time() - began < 2
