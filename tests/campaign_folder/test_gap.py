"""A gap before the barrier in CAE runs is told with its size, accuses no test, and is taken out by one setting."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crashfuse.campaign_folder.gap import find_gap, gap_s
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.sample_folder import sample_folder
from crashfuse.errors import DataError
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray
from crashfuse.units import MPH, G

LONG_S = np.arange(2500) * DT_S


def half_sine(speed_mps: float, contact_s: float) -> FloatArray:
    """A pulse that takes 1.1 times the speed in 70 ms from contact on."""
    at = (GRID_S - contact_s) / 0.07
    return -1.1 * speed_mps * np.pi / 2 / 0.07 * np.where((at > 0) & (at < 1), np.sin(np.pi * np.clip(at, 0, 1)), 0.0)


@settings(max_examples=30, deadline=None)
@given(
    gap_mm=st.floats(100, 400),  # 5 ms at least: a shorter wait before a gentle pulse is no sudden contact
    speeds=st.lists(st.floats(6, 20), min_size=4, max_size=12, unique=True),
    every=st.sampled_from([1, 2]),
)
def test_the_distance_is_found_whatever_it_is(gap_mm: float, speeds: list[float], every: int) -> None:
    """In all runs or in half of them; each is moved through it by its speed, and the others are left as they are."""
    gaps = np.where(np.arange(len(speeds)) % every == 0, gap_mm * 1e-3, 0.0)
    pulses = [half_sine(v, gap / v) for v, gap in zip(speeds, gaps, strict=True)]
    tests = half_sine(15.0, 0.0)[None].astype(np.float32)
    gap = find_gap(np.array(speeds), np.array(pulses, dtype=np.float32), np.array([15.0]), tests)
    assert gap is not None
    assert gap.distance_m == pytest.approx(gap_mm * 1e-3, abs=8e-3)
    for v, own, pulse in zip(speeds, gaps, pulses, strict=True):
        assert gap_s(GRID_S, pulse, v, gap_mm * 1e-3) == pytest.approx(own / v)


@pytest.mark.parametrize("late_s", [np.full(8, 0.004), np.full(8, 0.02), np.tile([0.012, 0.03], 4)])
def test_what_is_late_over_no_one_distance_is_told_as_a_time(late_s: FloatArray) -> None:
    """A common trigger shifts all runs by one time, and two models may have two gaps: no distance is proposed."""
    speeds = np.linspace(6, 18, 8)
    late = np.array([half_sine(v, by) for v, by in zip(speeds, late_s, strict=True)], dtype=np.float32)
    tests = np.array([half_sine(v, 0.0) for v in speeds], dtype=np.float32)
    gap = find_gap(speeds, late, speeds, tests)
    assert gap is not None
    assert gap.distance_m is None
    assert gap.hides_tests
    assert gap.lasts_s == pytest.approx((late_s.min(), late_s.max()), abs=1e-3)
    assert "check the time zero of the CAE runs" in gap.warning


def test_what_tests_have_too_is_no_gap() -> None:
    """Where tests have the same free travel, the model is right."""
    speeds = np.linspace(6, 18, 8)
    gaps = np.array([half_sine(v, 0.2 / v) for v in speeds], dtype=np.float32)
    late = np.array([half_sine(v, 0.02) for v in speeds], dtype=np.float32)
    tests = np.array([half_sine(v, 0.0) for v in speeds], dtype=np.float32)
    assert find_gap(speeds, gaps, speeds, gaps) is None
    assert find_gap(speeds, late, speeds, late) is None
    assert find_gap(speeds, tests, speeds, tests) is None


def test_one_run_before_the_barrier_hides_no_test(tmp_path: Path) -> None:
    """It is told, and a test whose time zero is off is, too."""
    folder = tmp_path / "campaign"
    with_gap(folder, 0.2, every=40, filtered=False, slowest_mph=9)
    path = folder / "tests" / "T05.csv"
    record = pd.read_csv(path)
    record["acceleration_g"] = np.interp(record["time_ms"] - 5, record["time_ms"], record["acceleration_g"], left=0.0)
    record.to_csv(path, index=False)
    gap, late = load_campaign(folder).warnings
    assert proposed_mm(gap) == pytest.approx(200, abs=4)
    assert "not compared" not in gap
    assert late.startswith("tests.csv, T05: its deceleration begins")


def with_gap(folder: Path, gap_m: float, *, every: int, filtered: bool, slowest_mph: float) -> FloatArray:
    """The sample with some of its CAE runs, 200 ms long, of which some begin before the barrier; their pulses."""
    sample = load_campaign(sample_folder())
    runs = pd.read_csv(sample_folder() / "cae.csv")
    runs = runs[runs["speed_mph"] > slowest_mph].iloc[::25]
    tables, wanted = [], []
    for place, (run_id, mph) in enumerate(zip(runs["id"], runs["speed_mph"], strict=True)):
        accel = sample.cae.accel_mps2[sample.cae.ids.index(run_id)].astype(np.float64)
        after_s = gap_m / (mph * MPH) if place % every == 0 else 0.0
        record = np.interp(LONG_S - after_s, GRID_S, accel, left=0.0, right=0.0)
        record = cfc_filter(record, cfc=60, dt_s=DT_S) if filtered else record
        tables.append(pd.DataFrame({"id": run_id, "time_s": LONG_S, "acceleration_g": record / G}))
        wanted.append(np.interp(GRID_S + after_s, LONG_S, record))
    folder.mkdir()
    runs.to_csv(folder / "cae.csv", index=False)
    pd.concat(tables).to_parquet(folder / "cae_pulses.parquet", index=False)
    (folder / "tests.csv").write_bytes((sample_folder() / "tests.csv").read_bytes())
    (folder / "tests").mkdir()
    for path in (sample_folder() / "tests").iterdir():
        (folder / "tests" / path.name).write_bytes(path.read_bytes())
    return np.array(wanted)


def proposed_mm(told: str) -> int:
    """The setting that a sentence proposes."""
    return int(told.partition("cae_gap_mm = ")[2].partition(" ")[0])


@pytest.mark.parametrize(("every", "filtered", "gap_mm"), [(1, False, 200), (1, True, 120), (2, False, 300)])
def test_a_library_with_a_gap_accuses_no_test(tmp_path: Path, every: int, filtered: bool, gap_mm: int) -> None:
    """One note says how far and what to do; with the setting nothing is left to say, and pulses begin at contact."""
    folder = tmp_path / "campaign"
    wanted = with_gap(folder, gap_mm * 1e-3, every=every, filtered=filtered, slowest_mph=9)
    (told,) = load_campaign(folder).warnings
    assert proposed_mm(told) == pytest.approx(gap_mm, abs=10 if filtered else 4)
    assert ("the CAE runs" in told.split(":")[1][:14]) == (every == 1)
    (folder / "campaign.toml").write_text(f"cae_gap_mm = {gap_mm}\n")
    campaign = load_campaign(folder)
    assert campaign.warnings == ()
    np.testing.assert_allclose(campaign.cae.accel_mps2, wanted, atol=1e-3 * G)
    if not filtered:
        (folder / "campaign.toml").write_text(f"cae_gap_mm = {gap_mm - 80}\n")
        assert proposed_mm(load_campaign(folder).warnings[0]) == pytest.approx(gap_mm, abs=4)


def test_a_run_that_never_gets_there_names_the_gap(tmp_path: Path) -> None:
    """At 2 m/s a gap of 300 mm takes 150 ms: the run is refused as before, with the gap as the thing to check."""
    folder = tmp_path / "campaign"
    with_gap(folder, 0.3, every=1, filtered=False, slowest_mph=0)
    with pytest.raises(DataError) as caught:
        load_campaign(folder)
    assert {problem.advice for problem in caught.value.problems} == {
        "take the gap before the barrier out: cae_gap_mm = 300 in campaign.toml"
    }


@pytest.mark.parametrize("value", ['"200"', "-1", "true", "nan", "20000"])
def test_a_gap_that_is_no_distance_is_refused(campaign_folder: Path, value: str) -> None:
    """With what was found, and what may stand there."""
    with (campaign_folder / "campaign.toml").open("a") as stream:
        stream.write(f"\ncae_gap_mm = {value}\n")
    with pytest.raises(DataError, match="cae_gap_mm: expected a distance in mm, at most 10,000"):
        load_campaign(campaign_folder)
