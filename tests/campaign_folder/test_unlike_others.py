"""A record whose time zero or sensor zero is off, or whose sensor failed, is told of, and no other."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign_folder.editing import leave_out
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.sample_folder import sample_folder
from crashfuse.errors import DataError
from crashfuse.signals.filters import cfc_filter
from crashfuse.units import G


@pytest.fixture
def few(tmp_path: Path) -> Path:
    """The sample's tests with every tenth of its CAE runs."""
    sample = sample_folder()
    runs = pd.read_csv(sample / "cae.csv").iloc[::10]
    runs.to_csv(tmp_path / "cae.csv", index=False)
    pulses = pd.read_parquet(sample / "cae_pulses.parquet")
    pulses[pulses["id"].isin(runs["id"])].to_parquet(tmp_path / "cae_pulses.parquet", index=False)
    (tmp_path / "tests.csv").write_bytes((sample / "tests.csv").read_bytes())
    (tmp_path / "tests").mkdir()
    for path in (sample / "tests").iterdir():
        (tmp_path / "tests" / path.name).write_bytes(path.read_bytes())
    return tmp_path


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
    """The one test whose time zero is off is named, slow or fast, with what to check."""
    told = changed(few, test_id, late_ms=late_ms)
    assert {sentence.partition(":")[0] for sentence in told} == {f"tests.csv, {test_id}"}
    assert f" ms {word}: " in told[0]
    assert "check its time zero" in told[0]
    assert late_ms < 0 or f"begins {late_ms:.0f}" in told[0] or f"begins {late_ms - 1:.0f}" in told[0]


@pytest.mark.parametrize("offset_g", [-1.5, 1.5])
@pytest.mark.parametrize("test_id", ["T02", "T03", "T09"])
def test_an_offset_of_the_sensor_is_told_of(few: Path, test_id: str, offset_g: float) -> None:
    """The one test whose sensor does not read zero at rest is named, with about the offset."""
    (told,) = [sentence for sentence in changed(few, test_id, offset_g=offset_g) if "mean acceleration" in sentence]
    assert told.startswith(f"tests.csv, {test_id}:")
    assert float(told.partition("off by ")[2].partition(" g")[0].replace("−", "-")) == pytest.approx(offset_g, abs=0.7)


def test_an_offset_so_large_that_the_speed_looks_wrong_is_one_sentence(few: Path) -> None:
    """In a slow test 1.5 g change the velocity as a wrong unit would: what to check has the zero among it."""
    (told,) = changed(few, "T01", offset_g=-1.5)
    assert told.startswith("tests.csv, T01: over its impact speed its change of velocity is ")
    assert "zero of its acceleration" in told


def test_a_campaign_whose_tests_scatter_accuses_none(few: Path) -> None:
    """Where the onsets of all tests scatter by milliseconds, none of them is odd."""
    for place, test_id in enumerate(sorted(path.stem for path in (few / "tests").iterdir())):
        told = changed(few, test_id, late_ms=2.0 * (place % 4))
    assert not [sentence for sentence in told if "deceleration begins" in sentence]


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
    with pytest.raises(DataError) as refused:
        load_campaign(few)
    (problem,) = refused.value.problems
    assert problem.column == "id T09"
    assert "its sensor is saturated" in problem.advice
    leave_out(few, ["T09"])
    assert load_campaign(few).warnings == ()
