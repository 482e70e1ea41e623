"""The campaign folder: every form is read alike, and everything that is wrong is said in sentences."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign, unread_files
from crashfuse.errors import DataError
from crashfuse.signals.pulse import GRID_S
from crashfuse.units import KPH, LB, MPH, MS, G


def assert_same(one: Campaign, other: Campaign) -> None:
    """Compare two campaigns to float32 precision."""
    assert one.cae.ids == other.cae.ids
    np.testing.assert_allclose(one.cae.vectors, other.cae.vectors, rtol=1e-12)
    np.testing.assert_allclose(one.cae.accel_mps2, other.cae.accel_mps2, rtol=1e-5, atol=1e-3)
    for a, b in zip(one.tests, other.tests, strict=True):
        assert (a.id, a.condition.factors) == (b.id, b.condition.factors)
        np.testing.assert_allclose(a.pulse.accel_mps2, b.pulse.accel_mps2, rtol=1e-5, atol=1e-3)


def test_a_folder_holds_what_was_written(campaign: Campaign, campaign_folder: Path) -> None:
    """Reading gives the very conditions and pulses, in SI, in float32, with nothing to warn of."""
    loaded = load_campaign(campaign_folder)
    assert_same(loaded, campaign)
    assert loaded.cae.accel_mps2.dtype == np.float32
    assert loaded.warnings == ()
    assert loaded.name == "campaign"


def _cae_as_csv(folder: Path) -> None:
    pd.read_parquet(folder / "cae_pulses.parquet").to_csv(folder / "cae_pulses.csv", index=False)
    (folder / "cae_pulses.parquet").unlink()


def _cae_as_files(folder: Path) -> None:
    (folder / "cae").mkdir()
    for i, (run_id, rows) in enumerate(pd.read_parquet(folder / "cae_pulses.parquet").groupby("id")):
        rows = rows.drop(columns="id")
        if i % 2:
            rows.to_csv(folder / "cae" / f"{run_id}.csv", index=False)
        else:
            rows.to_parquet(folder / "cae" / f"{run_id}.parquet", index=False)
    (folder / "cae_pulses.parquet").unlink()


def _tests_as_table(folder: Path) -> None:
    files = sorted((folder / "tests").iterdir())
    pd.concat([pd.read_csv(file).assign(id=file.stem) for file in files]).to_parquet(folder / "tests_pulses.parquet")
    shutil.rmtree(folder / "tests")


def _categorical_ids(folder: Path) -> None:
    frame = pd.read_parquet(folder / "cae_pulses.parquet")
    frame.assign(id=frame["id"].astype("category")).to_parquet(folder / "cae_pulses.parquet", row_group_size=777)


def _ids_as_index(folder: Path) -> None:
    pd.read_parquet(folder / "cae_pulses.parquet").set_index("id").to_parquet(folder / "cae_pulses.parquet")


def _numbers_as_text(folder: Path) -> None:
    frame = pd.read_parquet(folder / "cae_pulses.parquet")
    frame.assign(time_ms=frame["time_ms"].map(repr)).to_parquet(folder / "cae_pulses.parquet", index=False)


def _as_a_spreadsheet_leaves_it(folder: Path) -> None:
    for path in (folder / "tests.csv", folder / "tests" / "T1.csv"):
        lines = path.read_text().replace(",", ", ").split("\n")
        path.write_text("\ufeff" + "\r\n".join([*(f"{line}," if line else line for line in lines), ",,", ",,", ""]))


def _small_batches(folder: Path) -> None:
    frame = pd.read_parquet(folder / "cae_pulses.parquet")
    frame.to_parquet(folder / "cae_pulses.parquet", row_group_size=1000)


@pytest.mark.parametrize(
    "rewrite",
    [
        *(_cae_as_csv, _cae_as_files, _tests_as_table, _categorical_ids, _ids_as_index, _numbers_as_text),
        *(_as_a_spreadsheet_leaves_it, _small_batches),
    ],
)
def test_every_form_of_the_folder_gives_the_same_campaign(
    campaign_folder: Path, rewrite: Callable[[Path], None]
) -> None:
    """One file a pulse or one tidy table, CSV or Parquet: the numbers are the same."""
    before = load_campaign(campaign_folder)
    rewrite(campaign_folder)
    assert_same(load_campaign(campaign_folder), before)


@pytest.mark.slow
def test_runs_cut_by_a_batch_are_joined(campaign_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A batch that ends within a run changes nothing."""
    before = load_campaign(campaign_folder)
    monkeypatch.setattr("crashfuse.files.parquet._BATCH_ROWS", 700)
    assert_same(load_campaign(campaign_folder), before)
    _cae_as_csv(campaign_folder)
    monkeypatch.setattr("crashfuse.files.csv_text._BLOCK", 9999)
    assert_same(load_campaign(campaign_folder), before)


@pytest.mark.parametrize(("unit", "factor"), [("kph", KPH), ("mps", 1.0)])
def test_speed_is_converted_by_its_columns_ending(campaign_folder: Path, unit: str, factor: float) -> None:
    """The same speed in another unit is the same campaign."""
    before = load_campaign(campaign_folder)
    for name in ("tests.csv", "cae.csv"):
        table = pd.read_csv(campaign_folder / name)
        table[f"speed_{unit}"] = table.pop("speed_mph") * MPH / factor
        table["front_weight_kg"] = table.pop("front_weight_lb") * LB
        table.to_csv(campaign_folder / name, index=False)
    assert_same(load_campaign(campaign_folder), before)


def test_pulses_are_converted_by_their_columns_endings(campaign_folder: Path) -> None:
    """Seconds and m/s² give the same campaign as milliseconds and g."""
    before = load_campaign(campaign_folder)
    for path in (campaign_folder / "tests").iterdir():
        table = pd.read_csv(path)
        table["time_s"] = table.pop("time_ms") * MS
        table["acceleration_mps2"] = table.pop("acceleration_g") * G
        table.to_csv(path, index=False)
    assert_same(load_campaign(campaign_folder), before)


def test_a_long_fast_record_is_cropped_and_resampled(campaign: Campaign, campaign_folder: Path) -> None:
    """A record of -50 to 200 ms at 20 kHz keeps its acceleration on the study grid."""
    time = np.arange(-0.05, 0.2, 5e-5)
    accel = np.interp(time, GRID_S, campaign.tests[0].pulse.accel_mps2, left=0, right=0)
    table = pd.DataFrame({"time_s": time.round(9), "acceleration_mps2": accel})
    table.to_csv(campaign_folder / "tests" / "T1.csv", index=False)
    pulse = load_campaign(campaign_folder).tests[0].pulse
    np.testing.assert_allclose(pulse.accel_mps2, campaign.tests[0].pulse.accel_mps2, atol=0.5)


def test_the_filter_class_of_the_settings_is_applied_to_the_whole_record(campaign_folder: Path) -> None:
    """CFC 60 takes a 2 kHz ripple out of a test and leaves its change of velocity."""
    path = campaign_folder / "tests" / "T1.csv"
    table = pd.read_csv(path)
    clean = load_campaign(campaign_folder).tests[0].pulse.accel_mps2
    table["acceleration_g"] += 20 * np.sin(2 * np.pi * 2000 * table["time_ms"] * MS)
    table.to_csv(path, index=False)
    (campaign_folder / "campaign.toml").write_text('name = "Filtered"\nchannel_filter_class = 60\n')
    loaded = load_campaign(campaign_folder)
    assert loaded.name == "Filtered"
    np.testing.assert_allclose(
        loaded.tests[0].pulse.accel_mps2[100:1000], clean[100:1000], atol=0.04 * np.abs(clean).max()
    )


def test_a_record_that_ends_early_goes_on_without_acceleration_and_says_so(campaign_folder: Path) -> None:
    """92 ms are enough to work with, but the reader is told."""
    path = campaign_folder / "tests" / "T2.csv"
    pd.read_csv(path).query("time_ms <= 92").to_csv(path, index=False)
    loaded = load_campaign(campaign_folder)
    assert "tests/T2.csv: the record ends at 92 ms" in loaded.warnings[0]
    assert not loaded.tests[1].pulse.accel_mps2[GRID_S > 0.0925].any()
    assert [test.recorded_s for test in loaded.tests] == pytest.approx([np.inf, 0.092, np.inf, np.inf])


def test_unfiltered_pulses_are_warned_of(campaign_folder: Path) -> None:
    """A ripple at 1 kHz is beyond what the networks resolve: the sentence says what to set."""
    for path in (campaign_folder / "tests").iterdir():
        table = pd.read_csv(path)
        table["acceleration_g"] += 20 * np.sin(2 * np.pi * 1000 * table["time_ms"] * MS)
        table.to_csv(path, index=False)
    (warning,) = load_campaign(campaign_folder).warnings
    assert "power lies above 250 Hz" in warning
    assert "channel_filter_class = 60" in warning


def test_a_little_noise_is_told_too(campaign_folder: Path) -> None:
    """0.2 g are less than a 1000th of the power, and ten times what CFC 60 leaves; with the filter it is gone."""
    rng = np.random.default_rng(0)
    for path in (campaign_folder / "tests").iterdir():
        table = pd.read_csv(path)
        table["acceleration_g"] += rng.normal(0.0, 0.2, len(table))
        table.to_csv(path, index=False)
    (warning,) = load_campaign(campaign_folder).warnings
    assert "above 400 Hz the pulses hold 0." in warning
    assert "channel_filter_class = 60" in warning


def test_files_that_nothing_reads_are_named(campaign_folder: Path, tmp_path: Path) -> None:
    """At the top and among the pulses; not what systems leave and what tells of the folder, nor our own files."""
    assert unread_files(campaign_folder) == ""
    for name in ("README.md", ".DS_Store", "notes.csv", "criteria.toml", "LICENSE", "Thumbs.db"):
        (campaign_folder / name).touch()
    assert unread_files(campaign_folder) == ""
    (campaign_folder / "summary.csv").touch()
    (campaign_folder / "tests" / "T9.xlsx").touch()
    (campaign_folder / "study").mkdir()
    told = unread_files(campaign_folder)
    assert told.partition(": ")[2] == "study/, summary.csv, tests/T9.xlsx."
    for number in range(8):
        (campaign_folder / f"more{number}.csv").touch()
    assert unread_files(campaign_folder).endswith(" and 6 more.")
    assert unread_files(tmp_path / "campaign.zip") == ""


def test_a_single_test_is_enough_to_predict_and_not_to_check(campaign_folder: Path) -> None:
    """The campaign is read, with a word on what cannot be done."""
    table = campaign_folder / "tests.csv"
    table.write_text("\n".join(table.read_text().splitlines()[:2]) + "\n")
    for test_id in ("T2", "T3", "T4"):
        (campaign_folder / "tests" / f"{test_id}.csv").unlink()
    loaded = load_campaign(campaign_folder)
    assert loaded.test_ids == ("T1",)
    (warning,) = loaded.warnings
    assert warning.startswith("Only one test: nothing can be left out")


def test_an_id_may_look_like_a_missing_value(campaign_folder: Path) -> None:
    """A run named NA is a run."""
    _cae_as_csv(campaign_folder)
    for name in ("cae.csv", "cae_pulses.csv"):
        path = campaign_folder / name
        path.write_text(path.read_text().replace("C07,", "NA,"))
    assert "NA" in load_campaign(campaign_folder).cae.ids


def test_a_test_that_lacks_a_factor_of_the_others_is_named(campaign_folder: Path) -> None:
    """Left empty, as after an import that could not know it: the campaign is sound, and the reader is told."""
    table = pd.read_csv(campaign_folder / "tests.csv", dtype=str)
    table.loc[table["id"] == "T3", "drive"] = ""
    table.to_csv(campaign_folder / "tests.csv", index=False)
    (warning,) = load_campaign(campaign_folder).warnings
    assert warning == "tests.csv, drive: not given for T3; fill it in, for tests may differ by it."


def test_pulses_without_a_row_are_left_out_with_a_warning(campaign_folder: Path) -> None:
    """A stray file does no harm."""
    shutil.copy(campaign_folder / "tests" / "T1.csv", campaign_folder / "tests" / "T9.csv")
    loaded = load_campaign(campaign_folder)
    assert loaded.test_ids == ("T1", "T2", "T3", "T4")
    assert loaded.warnings == ("tests: pulses without a row in tests.csv are left out, namely T9.",)


def _edit(name: str, change: Callable[[pd.DataFrame], pd.DataFrame | None]) -> Callable[[Path], None]:
    """Change a CSV file of the folder in place."""

    def edit(folder: Path) -> None:
        table = pd.read_csv(folder / name).astype(object)
        changed = change(table)
        (table if changed is None else changed).to_csv(folder / name, index=False)

    return edit


def _set(name: str, row: int, column: str, value: object) -> Callable[[Path], None]:
    """Put a value into a cell (0 is the first row of data)."""
    return _edit(
        name, lambda table: table.__setitem__(column, [*table[column][:row], value, *table[column][row + 1 :]])
    )


BAD_FOLDERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no tests table": (
        lambda f: (f / "tests.csv").unlink(),
        "tests.csv: expected this file, found no such file; add it.",
    ),
    "missing column": (
        _edit("tests.csv", lambda t: t.drop(columns="rear_weight_lb")),
        "tests.csv: expected one column rear_weight_lb or rear_weight_kg, found the columns id, speed_mph, "
        "front_weight_lb, drive; add the column.",
    ),
    "unknown unit": (
        _edit("cae.csv", lambda t: t.rename(columns={"speed_mph": "speed_knots"})),
        "cae.csv: expected one column speed_mph or speed_kph or speed_mps, found speed_knots; let the column's name "
        "end in its unit.",
    ),
    "two units": (_edit("cae.csv", lambda t: t.assign(speed_kph=1)), "found speed_mph, speed_kph; keep one of them."),
    "pulse without unit": (
        _edit("tests/T1.csv", lambda t: t.rename(columns={"acceleration_g": "acceleration"})),
        "tests/T1.csv: expected one column acceleration_g or acceleration_mps2, found acceleration;",
    ),
    "missing pulse": (
        lambda f: (f / "tests" / "T3.csv").unlink(),
        "tests.csv, column id: expected a pulse for T3, found none in tests/ or tests_pulses;",
    ),
    "no pulses": (
        lambda f: (f / "cae_pulses.parquet").unlink(),
        "cae: expected the pulses either in cae_pulses.parquet (or .csv) or in cae/<id>.csv, found neither;",
    ),
    "a pulse twice": (
        lambda f: pd.read_csv(f / "tests" / "T2.csv").to_parquet(f / "tests" / "T2.parquet"),
        "tests/: expected one pulse for T2, found T2.csv and T2.parquet; keep one of them.",
    ),
    "pulses twice": (lambda f: (f / "cae").mkdir(), "found cae_pulses.parquet and cae/; keep one form."),
    "duplicate id": (
        _set("tests.csv", 2, "id", "T1"),
        "tests.csv, column id, row 4: expected each id once, found 'T1' a second time;",
    ),
    "id that leaves the folder": (
        _set("tests.csv", 0, "id", "../T1"),
        "tests.csv, column id, row 2: expected an id that can name a file, found '../T1', a slash; rename it.",
    ),
    "id that Windows cannot keep": (
        _set("tests.csv", 0, "id", "con"),
        "tests.csv, column id, row 2: expected an id that can name a file, found 'con', a name that Windows keeps",
    ),
    "id that is a formula": (
        _set("cae.csv", 3, "id", "=1+1"),
        "cae.csv, column id, row 5: expected an id that no spreadsheet takes for a formula, found '=1+1';",
    ),
    "factor that a terminal obeys": (
        _set("tests.csv", 0, "drive", "\x1b[2J"),
        "tests.csv, column drive, row 2: expected plain text of at most 200 characters, found '\\\\x1b[2J'",
    ),
    "column twice": (
        lambda f: (f / "tests.csv").write_text("id,speed_mph,id\nT1,20,T1\n"),
        "tests.csv: expected each column once, found id twice; keep one of them.",
    ),
    "decimal commas": (
        lambda f: (f / "tests" / "T1.csv").write_text("time_ms,acceleration_g\n0,0\n0,08,-1,5\n"),
        "tests/T1.csv, row 3: expected 2 cells as in the header, found 4 in the line '0,08,-1,5'; write decimal points",
    ),
    "semicolons": (
        lambda f: (f / "tests.csv").write_text("id;speed_mph\nT1;20\n"),
        "tests.csv: expected commas between the columns, found semicolons; export it with commas, or bring it in with",
    ),
    "UTF-16": (
        lambda f: (f / "tests" / "T1.csv").write_text("time_ms,acceleration_g\n0,0\n", encoding="utf-16"),
        "tests/T1.csv: expected text in UTF-8, found bytes that are none (Latin-1, UTF-16, or no text at all);",
    ),
    "true and false": (
        _edit("tests/T1.csv", lambda t: t.assign(acceleration_g=True)),
        "tests/T1.csv, column acceleration_g, row 2: expected a number, found 'True'; correct the cell.",
    ),
    "beyond any vehicle": (
        _set("tests/T1.csv", 9, "acceleration_g", "-1e300"),
        "tests/T1.csv, column acceleration_g, row 11: expected a number up to 1.02e+05, found '-1e+300'; correct the",
    ),
    "a weight in grams": (
        _edit("tests.csv", lambda t: t.assign(front_weight_lb=t.front_weight_lb * 1000)),
        "tests.csv, column front_weight_lb, row 3: expected a number up to 2.2e+05, found",
    ),
    "a nested column": (
        lambda f: pq.write_table(
            pa.table({"id": ["C00"], "time_ms": [[1.0]], "acceleration_g": [0.0]}), f / "cae_pulses.parquet"
        ),
        "cae_pulses.parquet, column time_ms: expected numbers, found values of type list<element: double>; export it",
    ),
    "half a Parquet file": (
        lambda f: (f / "cae_pulses.parquet").write_bytes((f / "cae_pulses.parquet").read_bytes()[:-50]),
        "cae_pulses.parquet: expected a sound Parquet file, found a damaged or another one (",
    ),
    "a folder instead of a table": (
        lambda f: (f / "tests.csv").rename(f / "old.csv").with_name("tests.csv").mkdir(),
        "tests.csv: expected a file, found a folder; put the file itself there.",
    ),
    "a folder instead of settings": (
        lambda f: (f / "campaign.toml").mkdir(),
        "campaign.toml: expected a file, found a folder; put the file itself there.",
    ),
    "a name that is none": (
        lambda f: (f / "campaign.toml").write_text("name = [1]"),
        "campaign.toml, column name: expected text of at most 200 characters, found a value of type list;",
    ),
    "a filter class that is none": (
        lambda f: (f / "campaign.toml").write_text("channel_filter_class = 5000"),
        'such as 60 or 180, or "none", found 5000; correct the value.',
    ),
    "an endless record": (
        lambda f: (f / "tests" / "T1.csv").write_text("time_ms,acceleration_g\n" + "0,0\n" * 2_000_001),
        "tests/T1.csv, column time_ms, row 2: expected at most 2000000 samples a record, found",
    ),
    "text in a number": (
        _set("tests.csv", 1, "speed_mph", "fast"),
        "tests.csv, column speed_mph, row 3: expected a number, found 'fast'; correct the cell.",
    ),
    "NaN in a table": (
        _set("cae.csv", 5, "front_weight_lb", "nan"),
        "cae.csv, column front_weight_lb, row 7: expected a number, found 'nan';",
    ),
    "empty cell in a pulse": (
        _set("tests/T2.csv", 10, "acceleration_g", None),
        "tests/T2.csv, column acceleration_g, row 12: expected a number, found an empty cell;",
    ),
    "text in a pulse": (
        _set("tests/T2.csv", 10, "acceleration_g", "n/k"),
        "tests/T2.csv, column acceleration_g, row 12: expected a number, found 'n/k';",
    ),
    "unsorted time": (
        _edit("tests/T1.csv", lambda t: pd.concat([t[:5], t[5:7][::-1], t[7:]])),
        "tests/T1.csv, column time_ms, row 8: expected time that increases from row to row, found 0.4 ms after 0.48 "
        "ms; sort the rows by time",
    ),
    "time twice": (
        _edit("tests/T1.csv", lambda t: pd.concat([t[:5], t[4:]])),
        "row 7: expected time that increases from row to row, found 0.32 ms after 0.32 ms; delete the duplicates",
    ),
    "uneven time": (
        _edit("tests/T1.csv", lambda t: t.drop(index=100)),
        "tests/T1.csv, column time_ms, row 102: expected evenly sampled time, found a step of 0.16 ms among steps",
    ),
    "short record": (
        _edit("tests/T1.csv", lambda t: t[t.time_ms < 50]),
        "tests/T1.csv, column time_ms: expected a record from 0 to at least 60 ms (100 ms is best), found 0 to 49.92",
    ),
    "milliseconds called seconds": (
        _edit("tests/T1.csv", lambda t: t.rename(columns={"time_ms": "time_s"})),
        "tests/T1.csv, column time_s: expected the record of a crash, of about 100 ms, found one of 99.92 s; check the "
        "unit of time: if it is ms, name it time_ms.",
    ),
    "seconds called milliseconds": (
        _edit("tests/T1.csv", lambda t: t.assign(time_ms=t.time_ms / 1000)),
        "found 0 to 0.09992 ms; check the unit of time: if it is s, name it time_s.",
    ),
    "a pulse under another id": (
        lambda f: (f / "tests" / "T3.csv").rename(f / "tests" / "TT3.csv"),
        "expected a pulse for T3, found none in tests/ or tests_pulses, but TT3 without a row; add its pulse or remove",
    ),
    "late start": (
        _edit("tests/T1.csv", lambda t: t[t.time_ms > 5]),
        "tests/T1.csv, column time_ms: expected a record from 0 to at least 60 ms (100 ms is best), found 5.04 to",
    ),
    "record that ends before the stop": (
        _edit(
            "tests/T4.csv",
            lambda t: t.assign(time_ms=1.4 * t.time_ms, acceleration_g=t.acceleration_g / 1.4)[t.time_ms < 45],
        ),
        "tests.csv, column id T4, row 5: expected a record that lasts until the vehicle has stopped, or 100 ms, found",
    ),
    "slow sampling": (
        _edit("tests/T1.csv", lambda t: t[::25]),
        "expected at least 1000 samples a second, found 500 Hz;",
    ),
    "empty table": (
        _edit("tests.csv", lambda t: t[:0]),
        "tests.csv: expected a header and at least one row, found an empty table;",
    ),
    "empty pulse": (
        _edit("tests/T1.csv", lambda t: t[:0]),
        "tests/T1.csv: expected a header and rows, found an empty table;",
    ),
    "empty file": (
        lambda f: (f / "tests" / "T1.csv").write_text(""),
        "tests/T1.csv: expected a table with a header, found an empty one;",
    ),
    "no Parquet": (
        lambda f: (f / "cae_pulses.parquet").write_text("id,time_ms\n"),
        "cae_pulses.parquet: expected a sound Parquet file, found a damaged or another one (",
    ),
    "test at standstill": (
        _set("tests.csv", 0, "speed_mph", 0),
        "tests.csv, column speed_mph, row 2: expected a number of at least 0.224, found 0",
    ),
    "negative run speed": (
        _set("cae.csv", 0, "speed_mph", -1),
        "cae.csv, column speed_mph, row 2: expected a number of at least 0, found -1",
    ),
    "wrong sign": (
        _edit("tests/T1.csv", lambda t: t.assign(acceleration_g=-t.acceleration_g)),
        "tests.csv, column id T1, row 2: expected a change of velocity near the impact speed of 15.0 mph (24.1 km/h)"
        ", found a change of +16.5 mph (+26.6 km/h); flip the sign of the acceleration (deceleration is negative).",
    ),
    "m/s² called g": (
        _edit("tests/T1.csv", lambda t: t.assign(acceleration_g=t.acceleration_g * G)),
        "check the unit of the acceleration (m/s² under a name that ends in _g?).",
    ),
    "km/h called mph": (
        _edit("tests.csv", lambda t: t.assign(speed_mph=t.speed_mph / KPH * MPH)),
        "check the unit of the speed (km/h under a name that ends in _mph?).",
    ),
    "km/h called mph in the library": (
        _edit("cae.csv", lambda t: t.assign(speed_mph=t.speed_mph / KPH * MPH)),
        "cae.csv: expected changes of velocity near the impact speed, for half of the runs at least, found 0.68 "
        "times it; check the unit of the speed (km/h under a name that ends in _mph?).",
    ),
    "few runs": (_edit("cae.csv", lambda t: t[:9]), "cae.csv: expected at least 10 CAE runs, found 9;"),
    "bad settings": (
        lambda f: (f / "campaign.toml").write_text("channel_filter_class = sixty"),
        "campaign.toml: expected a TOML file in UTF-8, found",
    ),
    "bad filter class": (
        lambda f: (f / "campaign.toml").write_text('channel_filter_class = "60 Hz"'),
        'campaign.toml, column channel_filter_class: expected a channel filter class such as 60 or 180, or "none"',
    ),
}


@pytest.mark.parametrize(("spoil", "sentence"), BAD_FOLDERS.values(), ids=BAD_FOLDERS)
def test_bad_input_gets_one_clear_sentence(
    campaign_folder: Path, spoil: Callable[[Path], object], sentence: str
) -> None:
    """Each fault is named with file, column, row, what was expected, what was found, and what to do."""
    spoil(campaign_folder)
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    matching = [str(problem) for problem in raised.value.problems if sentence in str(problem)]
    assert matching, str(raised.value)
    assert matching[0].endswith(".")


def test_a_fault_of_one_file_raises_no_false_alarm_elsewhere(campaign_folder: Path) -> None:
    """One unreadable pulse is one problem: its test is not reported as missing too."""
    (campaign_folder / "tests" / "T1.csv").write_text("")
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    assert len(raised.value.problems) == 1


def test_all_problems_are_listed_at_once(campaign_folder: Path) -> None:
    """Three faults in three files come back together."""
    for name in ("missing column", "no Parquet", "bad settings"):
        BAD_FOLDERS[name][0](campaign_folder)
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    assert {problem.where for problem in raised.value.problems} == {"tests.csv", "cae_pulses.parquet", "campaign.toml"}


def test_what_is_wrong_with_pulses_is_said_beside_what_is_wrong_with_their_table(campaign_folder: Path) -> None:
    """An id twice, a word for a weight, a stretch without samples and a pulse that is missing: each is said."""
    _set("tests.csv", 3, "id", "T1")(campaign_folder)
    _set("tests.csv", 1, "rear_weight_lb", "heavy")(campaign_folder)
    _edit("tests/T2.csv", lambda t: t.assign(acceleration_g=t.acceleration_g.where(~t.index.isin(range(20, 41)))))(
        campaign_folder
    )
    (campaign_folder / "tests" / "T3.csv").unlink()
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    assert [(problem.where, problem.column) for problem in raised.value.problems] == [
        ("tests.csv", "id"),
        ("tests.csv", "rear_weight_lb"),
        ("tests/T2.csv", "acceleration_g"),
        ("tests.csv", "id"),
    ]


def test_empty_cells_under_each_other_are_one_problem(campaign_folder: Path) -> None:
    """21 of them and one elsewhere are two, with the first and the last row."""
    gap = [*range(20, 41), 100]
    _edit("tests/T2.csv", lambda t: t.assign(acceleration_g=t.acceleration_g.where(~t.index.isin(gap))))(
        campaign_folder
    )
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    assert [(problem.row, problem.found) for problem in raised.value.problems] == [
        (22, "rows 22–42, empty"),
        (102, "an empty cell"),
    ]


def test_one_bad_cell_that_is_not_listed_is_counted_as_one(campaign_folder: Path) -> None:
    """21 words for numbers: twenty are listed."""
    words = range(100, 121)
    _edit("tests/T2.csv", lambda t: t.assign(acceleration_g=t.acceleration_g.where(~t.index.isin(words), "x")))(
        campaign_folder
    )
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    assert len(raised.value.problems) == 21
    assert raised.value.problems[-1].found == "1 more of the cells that are no number"


def test_a_thousand_bad_cells_are_counted_not_listed(campaign_folder: Path) -> None:
    """The list stays readable."""
    _edit("tests/T1.csv", lambda t: t.assign(acceleration_g="x"))(campaign_folder)
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    assert len(raised.value.problems) == 21
    assert "1230 more cells that are no number" in str(raised.value.problems[-1])


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    """The path is the message."""
    with pytest.raises(DataError, match=r"nowhere: expected a campaign folder, found no such folder; check the path\."):
        load_campaign(tmp_path / "nowhere")


def test_a_file_in_place_of_a_folder_is_said_to_be_one(campaign_folder: Path) -> None:
    """It is there, so nobody is to look for another path."""
    with pytest.raises(DataError, match="expected a campaign folder, found a file; name the folder that it lies in"):
        load_campaign(campaign_folder / "tests.csv")


def test_a_table_sorted_by_time_is_one_problem(campaign_folder: Path) -> None:
    """Not one a row, nor one a run for its lone samples."""
    path = campaign_folder / "cae_pulses.parquet"
    pd.read_parquet(path).sort_values("time_ms", kind="stable").to_parquet(path, index=False)
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    assert [str(problem) for problem in raised.value.problems] == [
        "cae_pulses.parquet, column id, row 26: expected the rows of one id together, found rows of C00 in two places; "
        "sort the file by id, then by time."
    ]


@pytest.mark.parametrize(("name", "what"), [("tests.csv", "speed_mph"), ("cae.csv", "id")])
def test_a_fault_of_every_run_is_shown_twenty_times_and_counted(campaign_folder: Path, name: str, what: str) -> None:
    """ΔV that does not fit, pulses that are missing: what is not listed is counted."""
    many = 30
    rows = [f"X{i},{80 if what == 'speed_mph' else 20},2000,1500" for i in range(many)]
    (campaign_folder / name).write_text("\n".join(["id,speed_mph,front_weight_lb,rear_weight_lb", *rows]))
    if name == "tests.csv":
        for i in range(many):
            shutil.copy(campaign_folder / "tests" / "T2.csv", campaign_folder / "tests" / f"X{i}.csv")
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    of_one_kind = [problem for problem in raised.value.problems if "record of its own" not in problem.expected]
    assert len(of_one_kind) == 21
    assert f"found {many - 20} more like these; correct them too." in str(of_one_kind[-1])


@pytest.mark.parametrize(("factor", "advice"), [(KPH / MPH, "mph under a name"), (MPH / KPH, "km/h under a name")])
def test_a_speed_in_the_other_unit_is_warned_of_where_its_change_of_velocity_is_possible(
    campaign_folder: Path, factor: float, advice: str
) -> None:
    """One test rebounds so much, or so little, that ΔV over v0 passes; beside CAE runs at its speed it stands out."""
    path = campaign_folder / "tests" / "T3.csv"
    pulse = pd.read_csv(path)
    rebound = 1.35 if factor > 1 else 0.95  # over v0; every pulse of this campaign has 1.1
    pulse["acceleration_g"] *= rebound / 1.1
    pulse.to_csv(path, index=False)
    assert not any("over its impact speed" in warning for warning in load_campaign(campaign_folder).warnings)
    _edit("tests.csv", lambda t: t.assign(speed_mph=t.speed_mph.where(t.id != "T3", t.speed_mph * factor)))(
        campaign_folder
    )
    (warning,) = load_campaign(campaign_folder).warnings
    assert warning.startswith("tests.csv, T3: over its impact speed its change of velocity is ")
    assert advice in warning


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (
            lambda t: t.assign(front_weight_lb=t.front_weight_lb * LB, rear_weight_lb=t.rear_weight_lb * LB),
            "(kilograms",
        ),
        (
            lambda t: t.rename(columns={"front_weight_lb": "front_weight_kg", "rear_weight_lb": "rear_weight_kg"}),
            "(pounds",
        ),
        (
            lambda t: t.rename(columns={"front_weight_lb": "rear_weight_lb", "rear_weight_lb": "front_weight_lb"}),
            "which a",
        ),
        (lambda t: t.assign(front_weight_lb=1.3 * t.front_weight_lb), ""),
    ],
)
def test_weights_that_are_like_the_runs_only_in_the_other_unit_or_exchanged_are_warned_of(
    campaign_folder: Path, change: Callable[[pd.DataFrame], pd.DataFrame], advice: str
) -> None:
    """A vehicle that is heavier than all runs is an extrapolation, no mistake."""
    assert load_campaign(campaign_folder).warnings == ()
    _edit("tests.csv", change)(campaign_folder)
    warnings = load_campaign(campaign_folder).warnings
    assert len(warnings) == (4 if advice else 0)
    assert all(
        f"its weights are unlike those of all CAE runs; check {'their unit ' * (advice[0] == '(')}{advice}" in said
        for said in warnings
    )


def test_names_from_the_settings_are_one_harmless_line(campaign_folder: Path) -> None:
    """What a terminal would obey is shown, not done."""
    (campaign_folder / "campaign.toml").write_text('name = "\\u001b[31mred\\u202e"\nnotice = "two\\nlines"\n')
    loaded = load_campaign(campaign_folder)
    assert loaded.name == "\\x1b[31mred\\u202e"
    assert loaded.notice == "two lines"
