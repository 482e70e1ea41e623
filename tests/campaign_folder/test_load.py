"""The campaign folder: every form is read alike, and everything that is wrong is said in sentences."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign, unread_files
from crashfuse.errors import DataError
from crashfuse.signals.pulse import GRID_S
from crashfuse.units import KPH, LB, MPH, MS, G
from tests.archives import made_archive
from tests.campaign_folder.test_refusals import edit
from tests.conftest import problems_of


def assert_same(one: Campaign, other: Campaign, rtol: float = 1e-5, atol: float = 1e-3) -> None:
    """Compare two campaigns, by default to float32 precision."""
    assert one.cae.ids == other.cae.ids
    np.testing.assert_allclose(one.cae.vectors, other.cae.vectors, rtol=1e-11)
    np.testing.assert_allclose(one.cae.accel_mps2, other.cae.accel_mps2, rtol, atol)
    for a, b in zip(one.tests, other.tests, strict=True):
        assert (a.id, a.condition.factors) == (b.id, b.condition.factors)
        np.testing.assert_allclose(a.condition.vector, b.condition.vector, rtol=1e-11)
        np.testing.assert_allclose(a.pulse.accel_mps2, b.pulse.accel_mps2, rtol, atol)


def test_a_folder_holds_what_was_written(campaign: Campaign, campaign_folder: Path) -> None:
    loaded = load_campaign(campaign_folder)
    assert_same(loaded, campaign)
    assert loaded.cae.accel_mps2.dtype == np.float32
    assert loaded.warnings == ()
    assert loaded.name == "campaign"


def reshape(folder: Path, role: str, form: str) -> None:
    """Rewrite the pulses of a role in another form, in ms and m/s²: one table, or files in both formats."""
    loaded = load_campaign(folder)
    pulses = loaded.test_pulses_frame if role == "tests" else loaded.cae_pulses_frame
    pulses["acceleration_mps2"] = G * pulses.pop("acceleration_g")
    shutil.rmtree(folder / role, ignore_errors=True)
    (folder / f"{role}_pulses.parquet").unlink(missing_ok=True)
    if form != "files":
        _write(pulses, folder / f"{role}_pulses.{form}")
        return
    (folder / role).mkdir()
    for n, (run_id, rows) in enumerate(pulses.groupby("id", observed=True)):
        _write(rows.drop(columns="id"), folder / role / f"{run_id}.{('csv', 'parquet')[n % 2]}")


def _write(table: pd.DataFrame, path: Path) -> None:
    (table.to_csv if path.suffix == ".csv" else table.to_parquet)(path, index=False)


def _as_a_spreadsheet_leaves_it(folder: Path) -> None:
    for path in (folder / "tests.csv", folder / "tests" / "T1.csv"):
        lines = path.read_text().replace(",", ", ").split("\n")
        path.write_text("\ufeff" + "\r\n".join([*(f"{line}," if line else line for line in lines), ",,", ",,", ""]))


def _cae(change: Callable[[pd.DataFrame], pd.DataFrame], **options: Any) -> Callable[[Path], None]:
    """Write the table of CAE pulses otherwise."""
    name = "cae_pulses.parquet"
    return lambda folder: change(pd.read_parquet(folder / name)).to_parquet(folder / name, **options)


REWRITTEN: dict[str, Callable[[Path], None]] = {
    "cae as csv": partial(reshape, role="cae", form="csv"),
    "cae as files": partial(reshape, role="cae", form="files"),
    "tests as parquet": partial(reshape, role="tests", form="parquet"),
    "categories": _cae(lambda table: table.astype({"id": "category"}), row_group_size=777),
    "ids as index": _cae(lambda table: table.set_index("id")),
    "numbers as text": _cae(lambda table: table.assign(time_ms=table["time_ms"].map(repr))),
    "as a spreadsheet leaves it": _as_a_spreadsheet_leaves_it,
    "small batches": _cae(lambda table: table, row_group_size=1000),
}


@pytest.mark.parametrize("form", REWRITTEN)
def test_every_form_of_the_folder_gives_the_same_campaign(
    campaign_folder: Path, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = load_campaign(campaign_folder)
    REWRITTEN[form](campaign_folder)
    monkeypatch.setattr("crashfuse.files.parquet._BATCH_ROWS", 7000)
    monkeypatch.setattr("crashfuse.files.csv_text._BLOCK", 99_999)
    assert_same(load_campaign(campaign_folder), before)


@pytest.mark.parametrize(("unit", "factor"), [("kph", KPH), ("mps", 1.0)])
def test_units_are_converted_by_the_endings_of_columns(campaign_folder: Path, unit: str, factor: float) -> None:
    before = load_campaign(campaign_folder)
    for name in ("tests.csv", "cae.csv"):
        table = pd.read_csv(campaign_folder / name)
        table[f"speed_{unit}"] = table.pop("speed_mph") * MPH / factor
        table["front_weight_kg"] = table.pop("front_weight_lb") * LB
        table.to_csv(campaign_folder / name, index=False)
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
    filtered = loaded.tests[0].pulse.accel_mps2
    np.testing.assert_allclose(filtered[100:1000], clean[100:1000], atol=0.04 * np.abs(clean).max())


def test_a_record_that_ends_early_goes_on_without_acceleration_and_says_so(campaign_folder: Path) -> None:
    """92 ms are enough to work with, but the reader is told."""
    path = campaign_folder / "tests" / "T2.csv"
    pd.read_csv(path).query("time_ms <= 92").to_csv(path, index=False)
    loaded = load_campaign(campaign_folder)
    assert "tests/T2.csv: the record ends at 92 ms" in loaded.warnings[0]
    assert not loaded.tests[1].pulse.accel_mps2[GRID_S > 0.0925].any()
    assert [test.recorded_s for test in loaded.tests] == pytest.approx([np.inf, 0.092, np.inf, np.inf])


@pytest.mark.parametrize(
    ("ripple_g", "noise_g", "finding"),
    [(20, 0, "power lies above 250 Hz"), (0, 0.2, "above 400 Hz the pulses hold 0.")],
)
def test_unfiltered_pulses_are_warned_of(campaign_folder: Path, ripple_g: float, noise_g: float, finding: str) -> None:
    """A ripple at 1 kHz, or 0.2 g of noise, ten times what CFC 60 leaves: the sentence says what to set."""
    rng = np.random.default_rng(0)
    for path in (campaign_folder / "tests").iterdir():
        table = pd.read_csv(path)
        table["acceleration_g"] += ripple_g * np.sin(2 * np.pi * 1000 * table["time_ms"] * MS)
        table["acceleration_g"] += rng.normal(0.0, noise_g, len(table))
        table.to_csv(path, index=False)
    (warning,) = load_campaign(campaign_folder).warnings
    assert finding in warning
    assert "channel_filter_class = 60" in warning


def test_files_that_nothing_reads_are_named(campaign_folder: Path) -> None:
    """At the top and among the pulses; not what systems leave and what tells of the folder, nor our own files."""
    assert unread_files(campaign_folder) == ""
    for name in ("README.md", ".DS_Store", "notes.csv", "criteria.toml", "archive.cfa", "LICENSE", "Thumbs.db"):
        (campaign_folder / name).touch()
    assert unread_files(campaign_folder) == ""
    (campaign_folder / "summary.csv").touch()
    (campaign_folder / "tests" / "T9.xlsx").touch()
    (campaign_folder / "study").mkdir()
    assert unread_files(campaign_folder).partition(": ")[2] == "study/, summary.csv, tests/T9.xlsx."


_no_drive = edit("tests.csv", lambda t: t.assign(drive=t.drive.where(t.id != "T3", "")))


def _one_more(folder: Path) -> None:
    shutil.copy(folder / "tests" / "T1.csv", folder / "tests" / "T9.csv")


def _one_test(folder: Path) -> None:
    edit("tests.csv", lambda t: t[:1])(folder)
    for test_id in ("T2", "T3", "T4"):
        (folder / "tests" / f"{test_id}.csv").unlink()


@pytest.mark.parametrize(
    ("change", "ids", "told"),
    [
        (_one_test, "1", "Only one test: "),
        (_no_drive, "1234", "tests.csv, drive: not given for T3; fill it in, for tests may differ by it."),
        (_one_more, "1234", "tests: pulses without a row in tests.csv are left out, namely T9."),
    ],
)
def test_what_keeps_no_campaign_from_being_used_is_told(
    campaign_folder: Path, change: Callable[[Path], object], ids: str, told: str
) -> None:
    """With one test nothing can be checked; a factor left empty may matter; a stray file does no harm."""
    change(campaign_folder)
    loaded = load_campaign(campaign_folder)
    assert loaded.test_ids == tuple(f"T{number}" for number in ids)
    (warning,) = loaded.warnings
    assert warning.startswith(told)


def test_filter_class_of_the_import_is_that_of_all_tests(campaign_folder: Path) -> None:
    entries = [f'[[imported]]\nid = "T{i}"\nas = "tests"\nchannel_filter_class = 60.0\n' for i in range(1, 5)]
    others = [*entries[:3], entries[3].replace("60.0", '"none"')]
    for lines, told in ((entries, "CFC 60"), (entries[:3], "filtered as supplied"), (others, "filtered as supplied")):
        (campaign_folder / "campaign.toml").write_text("\n".join(lines))
        assert load_campaign(campaign_folder).filter_class == told


def test_an_id_may_look_like_a_missing_value(campaign_folder: Path) -> None:
    reshape(campaign_folder, "cae", "csv")
    for name in ("cae.csv", "cae_pulses.csv"):
        path = campaign_folder / name
        path.write_text(path.read_text().replace("C07,", "NA,"))
    assert "NA" in load_campaign(campaign_folder).cae.ids


def test_bad_cells_of_a_column_are_shortened(campaign_folder: Path) -> None:
    """21 empty ones and one elsewhere are two problems, with the first and the last row; a thousand are counted."""
    gap = [*range(20, 41), 100]
    edit("tests/T2.csv", lambda t: t.assign(acceleration_g=t.acceleration_g.where(~t.index.isin(gap))))(campaign_folder)
    told = [(problem.row, problem.found) for problem in problems_of(lambda: load_campaign(campaign_folder))]
    assert told == [(22, "rows 22–42, empty"), (102, "an empty cell")]
    edit("tests/T2.csv", lambda t: t.assign(acceleration_g="x"))(campaign_folder)
    problems = problems_of(lambda: load_campaign(campaign_folder))
    assert len(problems) == 21
    assert "1230 more cells that are none" in str(problems[-1])


@pytest.mark.parametrize(("name", "found"), [("nowhere", "no such folder"), ("campaign/tests.csv", "a file")])
def test_what_is_no_folder_is_named(campaign_folder: Path, name: str, found: str) -> None:
    with pytest.raises(DataError, match=rf"{name}: expected a campaign folder, or a zip of one, found {found};"):
        load_campaign(campaign_folder.parent / name)


@pytest.mark.parametrize(("name", "what"), [("tests.csv", "speed_mph"), ("cae.csv", "id")])
def test_a_fault_of_every_run_is_shown_twenty_times_and_counted(campaign_folder: Path, name: str, what: str) -> None:
    many = 30
    rows = [f"X{i},{80 if what == 'speed_mph' else 20},2000,1500" for i in range(many)]
    (campaign_folder / name).write_text("\n".join(["id,speed_mph,front_weight_lb,rear_weight_lb", *rows]))
    if name == "tests.csv":
        for i in range(many):
            shutil.copy(campaign_folder / "tests" / "T2.csv", campaign_folder / "tests" / f"X{i}.csv")
    problems = problems_of(lambda: load_campaign(campaign_folder))
    of_one_kind = [problem for problem in problems if "record of its own" not in problem.expected]
    assert len(of_one_kind) == 21
    assert f"found {many - 20} more like these; correct them too." in str(of_one_kind[-1])


@pytest.mark.parametrize(("factor", "advice"), [(KPH / MPH, "mph in a column"), (MPH / KPH, "km/h in a column")])
def test_a_speed_in_the_other_unit_is_warned_of_where_its_change_of_velocity_is_possible(
    campaign_folder: Path, factor: float, advice: str
) -> None:
    """One test rebounds so much, or so little, that ΔV over v0 passes; beside CAE runs at its speed it stands out."""
    path = campaign_folder / "tests" / "T3.csv"
    pulse = pd.read_csv(path)
    rebound = 1.35 if factor > 1 else 0.95  # over v0; every pulse of this campaign has 1.1
    pulse["acceleration_g"] *= rebound / 1.1
    pulse.to_csv(path, index=False)
    assert not any("its change of velocity" in warning for warning in load_campaign(campaign_folder).warnings)
    edit("tests.csv", lambda t: t.assign(speed_mph=t.speed_mph.where(t.id != "T3", t.speed_mph * factor)))(
        campaign_folder
    )
    (warning,) = load_campaign(campaign_folder).warnings
    assert warning.startswith("tests.csv, T3: its change of velocity is ")
    assert advice in warning


WEIGHTS_LB = ("front_weight_lb", "rear_weight_lb")


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (lambda t: t.assign(**{name: t[name] * LB for name in WEIGHTS_LB}), "(kilograms"),
        (lambda t: t.rename(columns={name: name.replace("lb", "kg") for name in WEIGHTS_LB}), "(pounds"),
        (lambda t: t.rename(columns=dict(zip(WEIGHTS_LB, WEIGHTS_LB[::-1], strict=True))), "which a"),
        (lambda t: t.assign(front_weight_lb=1.3 * t.front_weight_lb), ""),
    ],
)
def test_weights_that_are_like_the_runs_only_in_the_other_unit_or_exchanged_are_warned_of(
    campaign_folder: Path, change: Callable[[pd.DataFrame], pd.DataFrame], advice: str
) -> None:
    """A vehicle that is heavier than all runs is an extrapolation, no mistake."""
    assert load_campaign(campaign_folder).warnings == ()
    edit("tests.csv", change)(campaign_folder)
    warnings = load_campaign(campaign_folder).warnings
    assert len(warnings) == (4 if advice else 0)
    assert all(
        f"its weights are unlike those of all CAE runs; check {'their unit ' * (advice[0] == '(')}{advice}" in said
        for said in warnings
    )


def test_names_from_the_settings_are_one_harmless_line(campaign_folder: Path) -> None:
    (campaign_folder / "campaign.toml").write_text('name = "\\u001b[31mred\\u202e"\nnotice = "two\\nlines"\n')
    loaded = load_campaign(campaign_folder)
    assert loaded.name == "\\x1b[31mred\\u202e"
    assert loaded.notice == "two lines"


def test_the_archive_in_the_folder_teaches_it_unless_another_is_named(
    campaign: Campaign, campaign_folder: Path, tmp_path: Path
) -> None:
    """Whatever others were named before; the campaign is taken out of an archive that it is in."""
    plain, archive = load_campaign(campaign_folder), made_archive()
    archive.save(campaign_folder / "archive.cfa")
    with_this_one = made_archive(plain)
    with_this_one.save(tmp_path / "other.cfa")
    loaded, other = load_campaign(campaign_folder), load_campaign(campaign_folder, tmp_path / "other.cfa")
    assert loaded.prior is not None
    assert loaded.prior.vehicles == ("Sedan", "Van", "Coupe")
    assert loaded.fingerprint == plain.with_archive(archive).fingerprint != plain.fingerprint
    assert other.prior is not None
    assert (other.prior.vehicles, other.prior.taken_out) == (("Sedan", "Van"), "campaign")
    assert_same(loaded, campaign)


def test_an_archive_that_cannot_be_used_is_one_problem_beside_the_others(campaign_folder: Path) -> None:
    path, plain = campaign_folder / "archive.cfa", load_campaign(campaign_folder)
    path.write_bytes(made_archive(plain, plain).content)
    (twice,) = problems_of(lambda: load_campaign(campaign_folder))
    assert (twice.where, twice.advice) == (path.name, "take it out of the folder")
    path.write_bytes(made_archive().content[:-1])
    (campaign_folder / "tests" / "T1.csv").unlink()
    damaged, missing = sorted(problems_of(lambda: load_campaign(campaign_folder)), key=lambda problem: problem.where)
    assert damaged.where == path.name
    assert damaged.advice == "take it out of the folder, or learn it again with crashfuse learn-archive"
    assert "T1" in str(missing)
