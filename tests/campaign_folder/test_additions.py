"""Pulses added to campaign folders: all of them or none, and nothing is overwritten."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign_folder.additions import Addition, add_to_campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.condition import Condition
from crashfuse.errors import DataError
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.units import KPH, LB, MPH, G
from tests.conftest import content_of

CONDITION = Condition.of_vector([30 * MPH, 2050 * LB, 1500 * LB], (("drive", "AWD"), ("colour", "red")))


def addition(run_id: str = "New", speed_mph: float = 30.0) -> Addition:
    """A half-sine pulse that stops its car, sooner the faster it is."""
    condition = replace(CONDITION, speed_mps=speed_mph * MPH)
    duration_s = 0.090 - 5e-4 * speed_mph
    peak = 1.1 * condition.speed_mps * np.pi / (2 * duration_s)
    pulse = Pulse(GRID_S, np.where(duration_s > GRID_S, -peak * np.sin(np.pi * GRID_S / duration_s), 0.0))
    return Addition(
        run_id, condition, pulse, {"source": 'a "file"\n\x7f', "steps": ("one", "two"), "time_zero_ms": 1.5}
    )


@pytest.mark.parametrize("role", ["tests", "cae"])
@pytest.mark.parametrize("form", ["files", "parquet", "csv"])
def test_a_pulse_is_added_where_the_others_are(campaign_folder: Path, role: str, form: str) -> None:
    """In any form of a role, in the table's own units; the rest of the campaign stays as it was."""
    _reshape(campaign_folder, role, form)
    before = load_campaign(campaign_folder)
    new = addition("10146")
    add_to_campaign(campaign_folder, role, [new])  # type: ignore[arg-type]
    after = load_campaign(campaign_folder)
    if role == "tests":
        assert after.test_ids == (*before.test_ids, "10146")
        found, accel = after.tests[-1].condition, after.tests[-1].pulse.accel_mps2
        assert found.factors == (("drive", "AWD"),)  # the table has no column for the other
        assert after.without(["10146"]).fingerprint == before.fingerprint
    else:
        assert after.cae.ids == (*before.cae.ids, "10146")
        found, accel = after.cae.conditions[-1], after.cae.accel_mps2[-1]
        np.testing.assert_array_equal(after.cae.accel_mps2[:-1], before.cae.accel_mps2)
    np.testing.assert_allclose(found.vector, new.condition.vector, rtol=1e-9)
    np.testing.assert_allclose(accel, new.pulse.accel_mps2, atol=1e-4)
    assert not after.warnings


def test_a_campaign_is_begun(tmp_path: Path) -> None:
    """Without a campaign there, its table has the columns that are known, and its settings tell the sources."""
    add_to_campaign(tmp_path / "new" / "car", "tests", [addition("A"), addition("B", 35.0)])
    add_to_campaign(tmp_path / "new" / "car", "tests", [addition("C", 40.0)])
    add_to_campaign(tmp_path / "new" / "car", "cae", [addition(f"R{i}", 20.0 + i) for i in range(12)])
    begun = load_campaign(tmp_path / "new" / "car")
    assert begun.test_ids == ("A", "B", "C")
    assert begun.factors == {"colour": ("red",), "drive": ("AWD",)}
    assert len(begun.cae) == 12
    table = pd.read_csv(tmp_path / "new" / "car" / "tests.csv")
    assert table["speed_kph"].tolist() == pytest.approx([v * MPH / KPH for v in (30, 35, 40)])
    assert not begun.warnings


def test_a_copy_of_a_test_is_refused_and_nothing_changes(campaign_folder: Path) -> None:
    """Under another id, scaled, or twice in one source: with it the campaign could no longer be opened."""
    first = addition("First")
    add_to_campaign(campaign_folder, "tests", [first])
    before = content_of(campaign_folder)
    scaled = replace(first, id="Second", pulse=Pulse(GRID_S, 1.02 * first.pulse.accel_mps2))
    other = addition("Third", 40.0)
    for new in ([scaled], [other, replace(other, id="Fourth")]):
        with pytest.raises(DataError, match=r"as it would become.*the same record for"):
            add_to_campaign(campaign_folder, "tests", new)
        assert content_of(campaign_folder) == before
    (campaign_folder / "campaign.toml").write_text('unused = ["First"]\n', encoding="utf-8")
    add_to_campaign(campaign_folder, "tests", [scaled])  # it takes the place of one that is not in use
    assert load_campaign(campaign_folder).test_ids[-1] == "Second"


def test_an_id_that_is_there_is_refused_and_nothing_changes(campaign_folder: Path) -> None:
    """Neither table, nor pulse, nor settings: all or nothing."""
    before = content_of(campaign_folder)
    for ids, message in (
        (["New", "T1"], "an id that is not there yet, found 'T1'"),
        (["New", "New"], "each id once"),
        (["New", "../x"], "an id that can name a file, found '../x', a slash"),
        (["New", "=1+1"], "an id that no spreadsheet takes for a formula, found '=1\\+1'"),
        (["-20C Versuch"], "an id that no spreadsheet takes for a formula"),
        (["New", " x"], "ends in a dot or a space"),
        (["New", "x:y"], "a drive letter or a colon"),
    ):
        with pytest.raises(DataError, match=message):
            add_to_campaign(campaign_folder, "tests", [addition(i) for i in ids])
        assert content_of(campaign_folder) == before


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        (replace(CONDITION, factors=(("drive", "a\x1bb"),)), "drive, row 6: expected plain text"),
        (replace(CONDITION, speed_mps=0.01), "speed_mph, row 6: expected a number of at least"),
        (replace(CONDITION, rear_weight_kg=1e6), "rear_weight_lb, row 6: expected a number up to"),
    ],
)
def test_what_could_not_be_read_back_is_not_written(campaign_folder: Path, condition: Condition, message: str) -> None:
    """A campaign that can be opened stays one."""
    before = content_of(campaign_folder)
    with pytest.raises(DataError, match=message):
        add_to_campaign(campaign_folder, "tests", [replace(addition(), condition=condition)])
    assert content_of(campaign_folder) == before


def test_a_folder_of_other_things_does_not_become_a_campaign(tmp_path: Path) -> None:
    """Who names the wrong folder is told so, and it stays as it was."""
    (tmp_path / "thesis.docx").write_bytes(b"years of work")
    with pytest.raises(DataError, match="expected a campaign folder, or an empty one"):
        add_to_campaign(tmp_path, "tests", [addition()])
    assert content_of(tmp_path) == {"thesis.docx": b"years of work"}


def test_ids_that_only_capitals_tell_apart_are_refused(campaign_folder: Path) -> None:
    """On Windows and macOS their files would be one."""
    with pytest.raises(DataError, match="an id that is not there yet, found 't1'"):
        add_to_campaign(campaign_folder, "tests", [addition("t1")])


def test_a_table_that_is_not_in_order_is_refused(campaign_folder: Path) -> None:
    """What is wrong with the campaign is said before anything is added to it."""
    (campaign_folder / "campaign.toml").write_text("name = ")
    before = content_of(campaign_folder)
    with pytest.raises(DataError, match="a TOML file in UTF-8"):
        add_to_campaign(campaign_folder, "tests", [addition()])
    (campaign_folder / "campaign.toml").unlink()
    (campaign_folder / "tests.csv").write_text("id,speed_mph\nT1,x\n")
    with pytest.raises(DataError, match="front_weight_lb"):
        add_to_campaign(campaign_folder, "tests", [addition()])
    assert {name for name in before if name != "campaign.toml"} == set(content_of(campaign_folder))


def test_an_addition_cut_short_leaves_the_campaign_as_it_was(
    campaign_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The table is written last; if it can't be, the pulses before it go, and a second try succeeds."""
    fingerprint = load_campaign(campaign_folder).fingerprint

    write_bytes = Path.write_bytes

    def no_table(path: Path, content: bytes) -> int:
        if path.name == "tests.csv" and path.is_relative_to(campaign_folder):
            raise OSError(28, "disk full", str(path))
        return write_bytes(path, content)

    monkeypatch.setattr(Path, "write_bytes", no_table)
    with pytest.raises(OSError, match="disk full") as caught:
        add_to_campaign(campaign_folder, "tests", [addition()])
    assert caught.value.filename == str(campaign_folder)  # not what keeps the history
    assert load_campaign(campaign_folder).fingerprint == fingerprint
    assert not (campaign_folder / "tests" / "New.csv").exists()
    monkeypatch.undo()
    add_to_campaign(campaign_folder, "tests", [addition()])
    assert load_campaign(campaign_folder).test_ids[-1] == "New"


def test_a_pulse_without_a_row_is_not_overwritten(campaign_folder: Path) -> None:
    """A file that is there may be somebody's."""
    (campaign_folder / "tests" / "New.csv").write_text("time_s,acceleration_g\n0,0\n")
    with pytest.raises(DataError, match="another pulse there, without a row"):
        add_to_campaign(campaign_folder, "tests", [addition()])
    assert (campaign_folder / "tests" / "New.csv").read_text() == "time_s,acceleration_g\n0,0\n"


def _reshape(folder: Path, role: str, form: str) -> None:
    """Rewrite the pulses of a role in another form, in ms and m/s²."""
    loaded = load_campaign(folder)
    pulses = (
        [(test.id, test.pulse.accel_mps2) for test in loaded.tests]
        if role == "tests"
        else list(zip(loaded.cae.ids, loaded.cae.accel_mps2.astype(float), strict=True))
    )
    for old in folder.glob(f"{role}/*.csv"):
        old.unlink()
    (folder / f"{role}_pulses.parquet").unlink(missing_ok=True)
    tables = [
        pd.DataFrame({"id": run_id, "time_ms": GRID_S * 1e3, "acceleration_mps2": accel}) for run_id, accel in pulses
    ]
    match form:
        case "files":
            (folder / role).mkdir(exist_ok=True)
            for (run_id, _), table in zip(pulses, tables, strict=True):
                table.drop(columns="id").to_csv(folder / role / f"{run_id}.csv", index=False)
        case "parquet":
            _without(folder / role)
            pd.concat(tables).astype({"id": "category"}).to_parquet(folder / f"{role}_pulses.parquet", index=False)
        case "csv":
            _without(folder / role)
            pd.concat(tables).to_csv(folder / f"{role}_pulses.csv", index=False)


def _without(folder: Path) -> None:
    if folder.is_dir():
        folder.rmdir()


def test_units_of_the_tables_are_kept(campaign_folder: Path) -> None:
    """A table in mph and lb gets its new row in mph and lb, and the old rows stay to the byte."""
    old = (campaign_folder / "tests.csv").read_bytes()
    add_to_campaign(campaign_folder, "tests", [addition()])
    new = (campaign_folder / "tests.csv").read_bytes()
    assert new.startswith(old)
    assert pd.read_csv(campaign_folder / "tests.csv").iloc[-1]["speed_mph"] == pytest.approx(30.0)
    assert addition().pulse.accel_mps2.min() < -10 * G


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"name = \xe9", "bytes that are none"),
        (b"name = [", "campaign.toml as it would"),
        (b"notice = 7", "column notice"),
    ],
)
def test_a_campaign_toml_that_could_not_be_read_back_stops_an_addition(
    campaign_folder: Path, content: bytes, found: str
) -> None:
    """It is judged by what reads it when the campaign is opened; nothing has changed."""
    (campaign_folder / "campaign.toml").write_bytes(content)
    before = content_of(campaign_folder)
    with pytest.raises(DataError, match=found):
        add_to_campaign(campaign_folder, "tests", [addition()])
    assert content_of(campaign_folder) == before
