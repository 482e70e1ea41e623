"""Records and CAE runs that cannot be, by themselves or beside the others, are told of, and no others."""

import re
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import ConditionTable
from crashfuse.campaign_folder.editing import leave_out
from crashfuse.campaign_folder.history import sample_folder
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.plausibility import find_gap, gap_s
from crashfuse.condition import Condition
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray
from crashfuse.units import MPH, G
from tests.conftest import problems_of

LONG_S = np.arange(2500) * DT_S


def half_sine(speed_mps: float, contact_s: float) -> FloatArray:
    """A pulse that takes 1.1 times the speed in 70 ms from contact on."""
    at = (GRID_S - contact_s) / 0.07
    return -1.1 * speed_mps * np.pi / 2 / 0.07 * np.where((at > 0) & (at < 1), np.sin(np.pi * np.clip(at, 0, 1)), 0.0)


def table(speeds_mps: Iterable[float], pulses: Sequence[FloatArray]) -> ConditionTable:
    """Rows at these speeds with these pulses."""
    n, conditions = len(pulses), (Condition.of_vector([speed, 1000.0, 700.0]) for speed in speeds_mps)
    return ConditionTable("cae", ("",) * n, tuple(conditions), (0,) * n, accel_mps2=np.array(pulses, np.float32))


@settings(max_examples=30, deadline=None)
@given(
    gap_mm=st.floats(100, 400),  # 5 ms at least: a shorter wait before a gentle pulse is no sudden contact
    speeds=st.lists(st.floats(6, 20), min_size=4, max_size=12, unique=True),
    every=st.sampled_from([1, 2]),
)
@example(gap_mm=100.0, speeds=[6.0, 7.0, 20.0, 19.75], every=1)
def test_the_distance_is_found_whatever_it_is(gap_mm: float, speeds: list[float], every: int) -> None:
    """In all runs or in half of them; each is moved through it by its speed, and the others are left as they are."""
    gaps = np.where(np.arange(len(speeds)) % every == 0, gap_mm * 1e-3, 0.0)
    pulses = [half_sine(v, gap / v) for v, gap in zip(speeds, gaps, strict=True)]
    gap = find_gap(table(speeds, pulses), table([15.0], [half_sine(15.0, 0.0)]))
    assert gap is not None
    assert gap.distance_m == pytest.approx(gap_mm * 1e-3, abs=8e-3)
    for v, own, pulse in zip(speeds, gaps, pulses, strict=True):
        assert gap_s(GRID_S, pulse, v, gap_mm * 1e-3) == pytest.approx(own / v)


@pytest.mark.parametrize("late_s", [np.full(8, 0.004), np.full(8, 0.02), np.tile([0.012, 0.03], 4)])
def test_what_is_late_over_no_one_distance_is_told_as_a_time(late_s: FloatArray) -> None:
    """A common trigger shifts all runs by one time, and two models may have two gaps: no distance is proposed."""
    speeds = np.linspace(6, 18, 8)
    late = [half_sine(v, by) for v, by in zip(speeds, late_s, strict=True)]
    gap = find_gap(table(speeds, late), table(speeds, [half_sine(v, 0.0) for v in speeds]))
    assert gap is not None
    assert gap.distance_m is None
    assert gap.hides_tests
    assert gap.lasts_s == pytest.approx((late_s.min(), late_s.max()), abs=1e-3)
    assert "check the time zero of the CAE runs" in gap.warning


def test_one_run_before_the_barrier_hides_no_test(sample: Campaign, tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    with_gap(sample, folder, 0.2, every=40, filtered=False, slowest_mph=9)
    gap, late = changed(folder, "T05", late_ms=5.0)
    assert proposed_mm(gap) == pytest.approx(200, abs=4)
    assert "not compared" not in gap
    assert late.startswith("tests.csv, T05: its deceleration begins")


def with_runs(folder: Path, runs: pd.DataFrame, pulses: pd.DataFrame) -> Path:
    """The sample's tests with other CAE runs."""
    folder.mkdir(exist_ok=True)
    runs.to_csv(folder / "cae.csv", index=False)
    pulses.to_parquet(folder / "cae_pulses.parquet", index=False)
    shutil.copy(sample_folder() / "tests.csv", folder)
    shutil.copytree(sample_folder() / "tests", folder / "tests")
    return folder


def with_gap(
    sample: Campaign, folder: Path, gap_m: float, *, every: int, filtered: bool, slowest_mph: float
) -> FloatArray:
    """The sample with some of its CAE runs, 200 ms long, of which some begin before the barrier; their pulses."""
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
    with_runs(folder, runs, pd.concat(tables))
    return np.array(wanted)


def proposed_mm(told: str) -> int:
    """The setting that a sentence proposes."""
    return int(told.partition("cae_gap_mm = ")[2].partition(" ")[0])


@pytest.mark.parametrize(("every", "filtered", "gap_mm"), [(1, False, 200), (1, True, 120), (2, False, 300)])
def test_a_library_with_a_gap_accuses_no_test(
    sample: Campaign, tmp_path: Path, every: int, filtered: bool, gap_mm: int
) -> None:
    """One note says how far and what to do; with the setting nothing is left to say, and pulses begin at contact."""
    folder = tmp_path / "campaign"
    wanted = with_gap(sample, folder, gap_mm * 1e-3, every=every, filtered=filtered, slowest_mph=9)
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


def test_a_run_that_never_gets_there_names_the_gap(sample: Campaign, tmp_path: Path) -> None:
    """At 2 m/s a gap of 300 mm takes 150 ms: the run is refused as before, with the gap as the thing to check."""
    folder = tmp_path / "campaign"
    with_gap(sample, folder, 0.3, every=1, filtered=False, slowest_mph=0)
    assert {problem.advice for problem in problems_of(lambda: load_campaign(folder))} == {
        "take the gap before the barrier out: cae_gap_mm = 300 in campaign.toml"
    }


@pytest.fixture(scope="module")
def tenth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample's tests with every tenth of its CAE runs."""
    runs = pd.read_csv(sample_folder() / "cae.csv").iloc[::10]
    pulses = pd.read_parquet(sample_folder() / "cae_pulses.parquet")
    return with_runs(tmp_path_factory.mktemp("tenth"), runs, pulses[pulses["id"].isin(runs["id"])])


@pytest.fixture
def few(tenth: Path, tmp_path: Path) -> Path:
    """A copy to be changed."""
    return shutil.copytree(tenth, tmp_path / "few")


def changed(folder: Path, test_id: str, *, late_ms: float = 0.0, offset_g: float = 0.0) -> tuple[str, ...]:
    """What is warned of once a test is recorded so."""
    path = folder / "tests" / f"{test_id}.csv"
    record = pd.read_csv(path)
    time, accel = record["time_ms"], record["acceleration_g"]
    record["acceleration_g"] = np.interp(time - late_ms, time, accel, left=0.0) + offset_g
    record.to_csv(path, index=False)
    return load_campaign(folder).warnings


def test_records_as_they_should_be_are_not_warned_of(few: Path) -> None:
    """The scatter of good tests is no finding, neither in many nor in any single one."""
    assert load_campaign(few).warnings == ()
    table = pd.read_csv(few / "tests.csv")
    for row in range(len(table)):
        table.iloc[[row]].to_csv(few / "tests.csv", index=False)
        assert not [told for told in load_campaign(few).warnings if told.startswith("tests.csv")]


@pytest.mark.parametrize(("late_ms", "word"), [(3.0, "late"), (5.0, "late"), (-5.0, "early")])
@pytest.mark.parametrize("test_id", ["T01", "T05", "T11"])
def test_a_shifted_record_is_told_of(few: Path, test_id: str, late_ms: float, word: str) -> None:
    told = changed(few, test_id, late_ms=late_ms)
    assert {sentence.partition(":")[0] for sentence in told} == {f"tests.csv, {test_id}"}
    assert f" ms {word} by the other tests" in told[0]
    assert "check its time zero" in told[0]
    assert late_ms < 0 or f"begins {late_ms:.0f}" in told[0] or f"begins {late_ms - 1:.0f}" in told[0]


@pytest.mark.parametrize("offset_g", [-1.5, 1.5])
@pytest.mark.parametrize("test_id", ["T02", "T03", "T09"])
def test_an_offset_of_the_sensor_is_told_of(few: Path, test_id: str, offset_g: float) -> None:
    (told,) = [sentence for sentence in changed(few, test_id, offset_g=offset_g) if "mean acceleration" in sentence]
    assert told.startswith(f"tests.csv, {test_id}:")
    measured, expected = map(float, re.findall(r"(-?[\d.]+) g[, ]", told.replace("−", "-"))[:2])
    assert measured - expected == pytest.approx(offset_g, abs=0.7)


def saturated(folder: Path, test_id: str, level_g: float, *, cfc: float | None) -> None:
    """Store a test as a sensor records it that ends at a level, at 20 kHz, raw or filtered."""
    path = folder / "tests" / f"{test_id}.csv"
    record = pd.read_csv(path)
    time_ms = np.arange(0, 100, 0.05)
    accel = np.maximum(np.interp(time_ms, record["time_ms"], record["acceleration_g"]), -level_g)
    if cfc is not None:
        accel = cfc_filter(accel, cfc=cfc, dt_s=5e-5)
    pd.DataFrame({"time_ms": time_ms, "acceleration_g": accel.round(4)}).to_csv(path, index=False)


@pytest.mark.parametrize("cfc", [None, 60])
def test_a_saturated_sensor_is_no_offset(few: Path, cfc: float | None) -> None:
    """What it cut off changes the mean, too, but it is told of once, by what happened."""
    path = few / "tests" / "T09.csv"
    level_g = 0.6 * pd.read_csv(path)["acceleration_g"].abs().max()
    saturated(few, "T09", level_g, cfc=cfc)
    campaign = load_campaign(few)
    (told,) = campaign.warnings
    assert told.startswith("tests.csv, T09: its sensor is saturated")
    assert "--leave-out T09" in told
    (fault,) = campaign.test("T09").faults
    assert fault.kind == "saturated"
    assert -fault.size_mps2 / G == pytest.approx(level_g, rel=0.02)
    assert not any(test.faults for test in campaign.tests if test.id != "T09")


def test_a_sensor_so_saturated_that_the_vehicle_does_not_stop_is_refused_by_its_cause(few: Path) -> None:
    """Speed, unit and time zero are right: what to do is said, and done, and the campaign is read again."""
    saturated(few, "T09", 12, cfc=None)
    (problem,) = problems_of(lambda: load_campaign(few))
    assert problem.column == "id T09"
    assert "its sensor is saturated" in problem.advice
    leave_out(few, ["T09"])
    assert load_campaign(few).warnings == ()
