"""Campaign folders and tables that are written: nothing is lost, nothing is half there, nothing is overwritten."""

import io
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.writer import append_to_table, write_campaign
from crashfuse.errors import DataError
from crashfuse.signals.occupant import USUAL_OCCUPANT, OccupantModel
from crashfuse.signals.pulse import Pulse
from tests.campaign_folder.test_load import assert_same
from tests.conftest import content_of


def test_a_campaign_survives_the_round_trip(campaign_on_disk: Path, tmp_path: Path) -> None:
    loaded = replace(load_campaign(campaign_on_disk), name='Our "car" №1', notice="synthetic: «one»")
    write_campaign(loaded, str(tmp_path / "again"))
    again = load_campaign(tmp_path / "again")
    assert again.fingerprint == loaded.fingerprint
    assert (again.name, again.notice, again.factors) == (loaded.name, loaded.notice, loaded.factors)
    assert not again.warnings
    write_campaign(again, tmp_path / "third")
    assert content_of(tmp_path / "third") == content_of(tmp_path / "again")


def test_awkward_texts_survive(campaign: Campaign, tmp_path: Path) -> None:
    factors = (("drive, kind", ' "all" '), ("größe", "x;y"))
    tests = tuple(
        replace(test, id=f"{test.id}, n° «{i}»", condition=replace(test.condition, factors=factors))
        for i, test in enumerate(campaign.tests)
    )
    write_campaign(replace(campaign, tests=tests), tmp_path / "c")
    again = load_campaign(tmp_path / "c")
    assert again.test_ids == tuple(test.id for test in tests)
    assert again.tests[0].condition == tests[0].condition


def test_filtered_pulses_are_not_filtered_again(campaign_folder: Path, tmp_path: Path) -> None:
    (campaign_folder / "campaign.toml").write_text("channel_filter_class = 60\n")
    loaded = load_campaign(campaign_folder)
    write_campaign(loaded, tmp_path / "again")
    again = load_campaign(tmp_path / "again")
    assert again.fingerprint == loaded.fingerprint
    assert again.channel_filter_class == 60
    with (tmp_path / "again" / "campaign.toml").open("a") as stream:
        stream.write("channel_filter_class = 60\n")
    with pytest.raises(DataError, match="or pulses are filtered twice"):
        load_campaign(tmp_path / "again")


def test_an_occupant_model_of_its_own_is_read_and_written(
    campaign: Campaign, campaign_folder: Path, tmp_path: Path
) -> None:
    """The rest stays as usual, 65 and 235 mm, 30 mm and 2500 N/m; the fingerprint is that of the content."""
    assert load_campaign(campaign_folder).occupant == USUAL_OCCUPANT == OccupantModel(65, 235, 30, 2500)
    (campaign_folder / "campaign.toml").write_text("[occupant]\nolc_restraint_mm = 200\nvpi_stiffness_npm = 3000\n")
    found = load_campaign(campaign_folder)
    assert found.occupant == OccupantModel(olc_restraint_mm=200.0, vpi_stiffness_npm=3000.0)
    write_campaign(found, tmp_path / "again")
    assert load_campaign(tmp_path / "again").fingerprint == found.fingerprint
    assert "occupant" not in (tmp_path / "again" / "tests.csv").read_text()
    write_campaign(replace(campaign, occupant=USUAL_OCCUPANT), tmp_path / "usual")
    assert "[occupant]" not in (tmp_path / "usual" / "campaign.toml").read_text()


def test_a_folder_that_holds_something_is_left_alone(campaign: Campaign, tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    write_campaign(campaign, tmp_path / "c")
    before = content_of(tmp_path)
    with pytest.raises(DataError, match="a folder that holds nothing yet"):
        write_campaign(campaign, tmp_path / "c")
    assert content_of(tmp_path) == before


NEW = Pulse(np.array([0.0, 0.001, 0.002]), np.array([0.0, -98.0665, -196.133]))
HEADER = "run,id,acceleration_g,time_ms,sensor"
OLD = [("1", "A", "0.5", "0.0", "x"), ("1", "A", "-1.5", "1.0", "x"), ("2", "B", "-2.5", "0.0", "y")]


def table(path: Path, ids: str = "id") -> Path:
    """A table of two runs, in g and ms, with columns of its own."""
    if path.suffix == ".csv":
        path.write_text("\n".join([HEADER.replace("id", ids), *(",".join(row) for row in OLD)]) + "\n")
    else:
        frame = pd.DataFrame(OLD, columns=HEADER.replace("id", ids).split(","))
        frame = frame.astype({"acceleration_g": "float32", "time_ms": float})
        frame.to_parquet(path, index=False)
    return path


def append(path: Path, pulses: Sequence[tuple[str, Pulse]]) -> None:
    """Have the table with more pulses in its place."""
    new = path.with_name("new")
    append_to_table(path, new, pulses)
    new.replace(path)


def rows_of(path: Path) -> pd.DataFrame:
    """What the table holds; text is text."""
    return pd.read_csv(path, dtype={"run": str, "id": str}) if path.suffix == ".csv" else pd.read_parquet(path)


@pytest.mark.parametrize("name", ["cae_pulses.csv", "cae_pulses.parquet"])
def test_new_rows_follow_in_the_tables_own_units_and_are_empty_in_other_columns(tmp_path: Path, name: str) -> None:
    """In ms and g, whatever the order of columns; old rows are as they were, but for those of the same id."""
    path = table(tmp_path / name)
    before = rows_of(path)
    append(path, [("007", NEW), ("D", NEW)])
    after = rows_of(path)
    assert list(after) == HEADER.split(",")
    pd.testing.assert_frame_equal(after[:3], before)
    assert after["id"][3:].tolist() == ["007"] * 3 + ["D"] * 3
    np.testing.assert_allclose(after["time_ms"][3:], [0.0, 1.0, 2.0] * 2)
    np.testing.assert_allclose(after["acceleration_g"][3:], [0.0, -10.0, -20.0] * 2, rtol=1e-6)
    assert after[["run", "sensor"]][3:].isna().all(axis=None)
    assert [other.name for other in tmp_path.iterdir()] == [name]
    path = table(tmp_path / name)
    append(path, [("A", NEW)])
    after = rows_of(path)
    assert after["id"].tolist() == ["B", "A", "A", "A"]
    np.testing.assert_allclose(after["acceleration_g"], [-2.5, 0.0, -10.0, -20.0], rtol=1e-6)


def test_the_kinds_of_columns_stay(tmp_path: Path) -> None:
    schema = pa.schema([("id", pa.dictionary(pa.int32(), pa.string())), ("time_s", pa.float64())])
    schema = schema.append(pa.field("acceleration_mps2", pa.float32()))
    pq.write_table(pa.table([["A"], [0.0], [-1.0]], schema=schema), tmp_path / "a.parquet")
    append(tmp_path / "a.parquet", [("B", NEW)])
    found = pq.read_table(tmp_path / "a.parquet")
    assert found.schema.equals(schema)
    assert found.column("id").to_pylist() == ["A", "B", "B", "B"]
    assert found.column("time_s").to_pylist() == [0.0, 0.0, 0.001, 0.002]
    numbers = pa.table({"id": [7], "time_s": [0.0], "acceleration_g": [-1.0]})
    pq.write_table(numbers, tmp_path / "n.parquet")
    append(tmp_path / "n.parquet", [("8", NEW)])
    assert pq.read_table(tmp_path / "n.parquet").column("id").to_pylist() == [7, 8, 8, 8]
    before = (tmp_path / "n.parquet").read_bytes()
    with pytest.raises(DataError, match=r"n\.parquet: expected a table that can be added to"):
        append(tmp_path / "n.parquet", [("T9", NEW)])
    assert (tmp_path / "n.parquet").read_bytes() == before


@pytest.mark.parametrize("header", ["id,time_ms", "id,acceleration_g", "id,time_ms,time_s,acceleration_g", "", "x,y"])
def test_a_table_without_its_columns_is_refused_and_stays(tmp_path: Path, header: str) -> None:
    path = tmp_path / "tests_pulses.csv"
    path.write_text(f"{header}\n")
    with pytest.raises(DataError, match=r"tests_pulses\.csv: expected (a column id|one column time_)"):
        append(path, [("A", NEW)])
    assert path.read_text() == f"{header}\n"


def test_what_a_person_typed_is_read_as_meant(tmp_path: Path) -> None:
    path = tmp_path / "tests_pulses.csv"
    path.write_bytes("\ufeffid , time_ms, acceleration_g\n A, 0, -1\n\nB , 0, -2\n".encode())
    append(path, [("A", NEW)])
    after = pd.read_csv(path, skip_blank_lines=True)
    assert list(after) == ["id", "time_ms", "acceleration_g"]
    assert [str(run).strip() for run in after["id"]] == ["B", "A", "A", "A"]


Frames = dict[str, pd.DataFrame]


@pytest.fixture
def read(campaign_on_disk: Path) -> Campaign:
    """The small campaign as it is read: pulses have single precision."""
    return load_campaign(campaign_on_disk)


@pytest.fixture
def frames(read: Campaign) -> Frames:
    """The tables of that campaign."""
    return {name: getattr(read, f"{name}_frame") for name in ("tests", "test_pulses", "cae", "cae_pulses")}


def refusal(frames: Frames, **changed: pd.DataFrame) -> str:
    """What is said against these tables."""
    with pytest.raises(DataError) as caught:
        Campaign.from_frames(**{**frames, **changed}, name="Tiny")
    return str(caught.value)


def test_tables_give_the_campaign_that_they_came_from(read: Campaign, frames: Frames) -> None:
    again = Campaign.from_frames(**frames, name="Tiny")
    assert again.name == "Tiny"
    assert_same(again, read, rtol=1e-6, atol=1e-9)


def test_tables_state_the_filter_class_of_their_pulses(frames: Frames) -> None:
    before = Campaign.from_frames(**frames, name="Tiny")
    labelled = Campaign.from_frames(**frames, name="Tiny", filtered_with=60)
    filtered = Campaign.from_frames(**frames, name="Tiny", channel_filter_class=60)
    assert [each.filter_class for each in (before, labelled, filtered)] == ["filtered as supplied", "CFC 60", "CFC 60"]
    assert labelled.fingerprint == before.fingerprint != filtered.fingerprint
    with pytest.raises(DataError, match="campaign: expected one of the two"):
        Campaign.from_frames(**frames, name="Tiny", channel_filter_class=60, filtered_with=60)


def test_what_is_wrong_is_told_with_table_column_and_row(frames: Frames) -> None:
    tests, pulses = frames["tests"], frames["test_pulses"]
    spoilt, mixed = tests.astype({"speed_mph": object}), pulses.astype({"acceleration_g": object})
    spoilt.loc[2, "speed_mph"], mixed.loc[5, "acceleration_g"] = "fast", "high"
    gap = pulses.copy()
    gap.loc[1300, "acceleration_g"] = np.nan
    for wrong, said in (
        (tests.drop(columns="rear_weight_lb"), "tests: .* rear_weight_lb or rear_weight_kg, found the columns id,"),
        (tests.assign(speed_kph=50.0), "tests: .* found speed_mph, speed_kph; keep one of them"),
        (spoilt, "tests, column speed_mph, row 2: expected a number, found 'fast'; correct the cell."),
        (gap, "test_pulses, column acceleration_g, row 1300: expected a number"),
        (pulses[pulses["id"] != "T2"], "tests, column id: expected a pulse for T2, found none in test_pulses; "),
        (pulses.sort_values("time_ms", kind="stable"), "test_pulses, column id, row 4: .* T1.*; sort the table by id"),
        (pulses.drop(columns="time_ms"), "test_pulses: .* found the columns id, acceleration_g; add the column."),
        (pulses.assign(acceleration_mps2=1.0), "test_pulses: .* found acceleration_g, acceleration_mps2; keep one"),
        (pulses.iloc[:0], "test_pulses: .* found an empty table; add the rows."),
        (pd.concat([pulses, pulses[["time_ms"]]], axis=1), "test_pulses: .* found time_ms twice; rename or remove"),
        (mixed, "test_pulses: expected columns that are numbers or text, found .*; give each column one type"),
    ):
        table = "tests" if "speed_mph" in wrong else "test_pulses"
        assert re.match(said, refusal(frames, **{table: wrong}), flags=re.DOTALL)
    assert refusal(frames, cae=[1]) == "cae: expected a pandas DataFrame, found list; give one."
    with pytest.raises(DataError, match="campaign, column name: expected text of at most 200 characters"):
        Campaign.from_frames(**frames, name=3)  # type: ignore[arg-type]


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
