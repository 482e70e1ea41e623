"""A campaign as tables in memory: the same checks and sentences as its folder, and back without a loss."""

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse import Campaign, DataError, load_campaign, write_campaign
from crashfuse.files.archive import zipped
from tests.conftest import content_of

Frames = dict[str, pd.DataFrame]


@pytest.fixture
def read(campaign_on_disk: Path) -> Campaign:
    """The small campaign as it is read: pulses have single precision."""
    return load_campaign(campaign_on_disk)


@pytest.fixture
def frames(read: Campaign) -> Frames:
    """The tables of that campaign."""
    return {
        "tests": read.tests_frame,
        "test_pulses": read.test_pulses_frame,
        "cae": read.cae_frame,
        "cae_pulses": read.cae_pulses_frame,
    }


def refusal(frames: Frames, **changed: pd.DataFrame) -> str:
    """What is said against these tables."""
    with pytest.raises(DataError) as caught:
        Campaign.from_frames(**{**frames, **changed}, name="Tiny")
    return str(caught.value)


def test_tables_give_the_campaign_that_they_came_from(read: Campaign, frames: Frames) -> None:
    """Every pulse to single precision, every condition as accurately as tables are written, factors and ids."""
    again = Campaign.from_frames(**frames, name="Tiny")
    assert again.name == "Tiny"
    assert again.test_ids == read.test_ids
    assert again.cae.ids == read.cae.ids
    np.testing.assert_allclose(again.cae.accel_mps2, read.cae.accel_mps2, rtol=1e-6, atol=1e-9)
    for one, other in zip(again.tests, read.tests, strict=True):
        np.testing.assert_allclose(one.pulse.accel_mps2, other.pulse.accel_mps2, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(one.condition.vector, other.condition.vector, rtol=1e-11)
        assert one.condition.factors == other.condition.factors


def test_a_folder_taken_through_memory_is_the_same_folder(read: Campaign, tmp_path: Path) -> None:
    """Its pulses to single precision."""
    write_campaign(read, tmp_path / "one")
    tables = read.tests_frame, read.test_pulses_frame, read.cae_frame, read.cae_pulses_frame
    write_campaign(Campaign.from_frames(*tables, name=read.name), tmp_path / "other")
    for path in ["cae_pulses.parquet", *(f"tests/{test}.csv" for test in read.test_ids)]:
        one, other = (
            pd.read_parquet(folder / path) if path.endswith("parquet") else pd.read_csv(folder / path)
            for folder in (tmp_path / "one", tmp_path / "other")
        )
        pd.testing.assert_frame_equal(one, other, rtol=1e-6, atol=1e-9)


def test_tables_may_come_in_any_of_the_units(read: Campaign, frames: Frames) -> None:
    """SI, km/h and kg: stated by the names of the columns."""
    tests = frames["tests"].rename(columns={"speed_mph": "speed_kph"})
    tests["speed_kph"] *= 1.609344
    pulses = frames["test_pulses"]
    in_si = pd.DataFrame(
        {"id": pulses["id"], "time_s": pulses["time_ms"] / 1e3, "acceleration_mps2": pulses["acceleration_g"] * 9.80665}
    )
    again = Campaign.from_frames(**{**frames, "tests": tests, "test_pulses": in_si}, name="Tiny")
    for one, other in zip(again.tests, read.tests, strict=True):
        np.testing.assert_allclose(one.pulse.accel_mps2, other.pulse.accel_mps2, atol=1e-4)
        np.testing.assert_allclose(one.condition.vector, other.condition.vector, rtol=1e-11)


def test_tables_state_the_filter_class_of_their_pulses(frames: Frames) -> None:
    """Pulses that were filtered before stay as they are; those to be filtered are; both is one too many."""
    before = Campaign.from_frames(**frames, name="Tiny")
    labelled = Campaign.from_frames(**frames, name="Tiny", filtered_with=60)
    filtered = Campaign.from_frames(**frames, name="Tiny", channel_filter_class=60)
    assert [each.filter_class for each in (before, labelled, filtered)] == ["filtered as supplied", "CFC 60", "CFC 60"]
    assert labelled.fingerprint == before.fingerprint != filtered.fingerprint
    with pytest.raises(DataError, match="campaign: expected one of the two"):
        Campaign.from_frames(**frames, name="Tiny", channel_filter_class=60, filtered_with=60)


def test_what_is_wrong_is_told_with_table_column_and_row(frames: Frames) -> None:
    """Rows count from 0, as the tables do."""
    tests, pulses = frames["tests"], frames["test_pulses"]
    assert refusal(frames, tests=tests.drop(columns="rear_weight_lb")).startswith(
        "tests: expected one column rear_weight_lb or rear_weight_kg, found the columns id, speed_mph"
    )
    assert "found speed_mph, speed_kph; keep one of them" in refusal(frames, tests=tests.assign(speed_kph=50.0))
    spoilt = tests.astype({"speed_mph": object})
    spoilt.loc[2, "speed_mph"] = "fast"
    assert (
        refusal(frames, tests=spoilt)
        == "tests, column speed_mph, row 2: expected a number, found 'fast'; correct the cell."
    )
    gap = pulses.copy()
    gap.loc[1300, "acceleration_g"] = np.nan
    assert "test_pulses, column acceleration_g, row 1300: expected a number" in refusal(frames, test_pulses=gap)
    lacking = refusal(frames, test_pulses=pulses[pulses["id"] != "T2"])
    assert lacking == (
        "tests, column id: expected a pulse for T2, found none in test_pulses; add its pulse or remove its row."
    )
    mixed = refusal(frames, test_pulses=pulses.sort_values("time_ms", kind="stable"))
    assert mixed.startswith("test_pulses, column id, row 4: expected the rows of one id together, found rows of T1")
    assert mixed.endswith("; sort the table by id, then by time.")
    assert refusal(frames, cae=[1]) == "cae: expected a DataFrame, found list; give a pandas DataFrame."


def test_a_zip_is_read_as_its_folder(campaign_on_disk: Path, tmp_path: Path) -> None:
    """The campaign is the same."""
    path = tmp_path / "read.zip"
    path.write_bytes(zipped(content_of(campaign_on_disk)))
    assert load_campaign(path).fingerprint == load_campaign(campaign_on_disk).fingerprint


def test_a_campaign_says_in_a_line_what_it_holds(read: Campaign) -> None:
    """No wall of numbers, in a notebook a table in which everything is text."""
    assert repr(read) == "<Campaign 'campaign': 4 tests, 24 CAE runs>"
    hostile = Campaign("<b>T</b>", read.cae, read.tests, notice="<script>alert(1)</script>")
    shown = hostile._repr_html_()
    assert "<script>" not in shown
    assert "&lt;b&gt;T&lt;/b&gt;: 4 tests" in shown
    (table,) = pd.read_html(io.StringIO(shown))
    assert table["Test"].tolist() == list(read.test_ids)
    assert table["Speed (mph)"].tolist() == [15.0, 25.0, 26.0, 35.0]


def test_what_tables_lack_or_have_twice_is_one_sentence(frames: Frames) -> None:
    """A column, a unit, rows, a type: the table is named, and what to do."""
    pulses = frames["test_pulses"]
    assert refusal(frames, test_pulses=pulses.drop(columns="time_ms")) == (
        "test_pulses: expected one column time_ms or time_s, found the columns id, acceleration_g; add the column."
    )
    assert refusal(frames, test_pulses=pulses.assign(acceleration_mps2=1.0)) == (
        "test_pulses: expected one column acceleration_g or acceleration_mps2, found acceleration_g, "
        "acceleration_mps2; keep one of them."
    )
    assert refusal(frames, test_pulses=pulses.iloc[:0]) == (
        "test_pulses: expected at least one row, found an empty table; add the rows."
    )
    twice = pd.concat([pulses, pulses[["time_ms"]]], axis=1)
    assert refusal(frames, test_pulses=twice) == (
        "test_pulses: expected each column once, found time_ms twice; rename or remove one."
    )
    mixed = pulses.astype({"acceleration_g": object})
    mixed.loc[5, "acceleration_g"] = "high"
    said = refusal(frames, test_pulses=mixed)
    assert said.startswith("test_pulses: expected columns that are numbers or text, found")
    assert said.endswith("; give each column one type.")
    with pytest.raises(DataError, match="campaign, column name: expected text of at most 200 characters"):
        Campaign.from_frames(**frames, name=3)  # type: ignore[arg-type]


def test_pulses_without_a_row_are_left_out_and_told_of(frames: Frames) -> None:
    """As in a folder: whoever takes a row out of the table need not take its pulse out, but reads of it."""
    found = Campaign.from_frames(**{**frames, "tests": frames["tests"].iloc[1:]}, name="Tiny")
    assert found.test_ids == ("T2", "T3", "T4")
    assert found.warnings == ("test_pulses: pulses without a row in tests are left out, namely T1.",)
    assert found.warnings[0] in found._repr_html_()
