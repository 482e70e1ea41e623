"""Ids name files on every platform, and what the solver says of CAE runs is read, checked and used."""

import unicodedata
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.cae_library import NAMED_LIMITS, RunQuality
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import id_trouble, safe_id
from crashfuse.campaign_folder.editing import Addition, add_to_campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.writer import write_campaign
from crashfuse.errors import DataError
from crashfuse.files.archive import name_trouble
from crashfuse.importing import Reading, read_records
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.testing.readers import written
from tests.campaign_folder.test_refusals import edit
from tests.conftest import problems_of
from tests.importing.crash_files import german
from tests.importing.crashes import clock, half_sine_g

COMPOSED, APART = (unicodedata.normalize(form, "Prüfung é") for form in ("NFC", "NFD"))


@given(name=st.text())
def test_any_name_becomes_an_id(name: str) -> None:
    run_id = safe_id(name)
    assert id_trouble(run_id) is None
    assert name_trouble(f"{run_id}.csv") is None
    assert safe_id(run_id) == run_id


@pytest.mark.parametrize(
    ("name", "run_id"),
    [
        *((name, name) for name in ("T1", "Test 3 (rear).v2")),
        ('=HYPERLINK("http://x")', "_HYPERLINK(_http___x_)"),
        ("-20C Versuch", "_20C Versuch"),
        ("run?1*", "run_1_"),
        ("con", "_con"),
        (" . ", "record"),
        (APART, COMPOSED),
    ],
)
def test_as_much_of_a_name_is_kept_as_can_be(name: str, run_id: str) -> None:
    assert safe_id(name) == run_id


@pytest.mark.parametrize(("one", "other"), [("V1", "v1"), (COMPOSED, APART), ("STRASSE", "straße")])
def test_ids_that_a_file_system_takes_for_one_are_refused(campaign_folder: Path, one: str, other: str) -> None:
    """One of the two pulses would be lost on the way to another machine."""
    table = campaign_folder / "tests.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    lines[1:3] = [f"{run_id},{line.partition(',')[2]}" for run_id, line in zip((one, other), lines[1:3], strict=True)]
    table.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(DataError, match=r"row 3: expected each id once, found .* a second time, as"):
        load_campaign(campaign_folder)


def test_a_pulse_is_found_whose_name_has_its_accents_apart(campaign_folder: Path) -> None:
    (campaign_folder / "tests" / "T1.csv").rename(campaign_folder / "tests" / f"{APART}.csv")
    table = campaign_folder / "tests.csv"
    table.write_text(table.read_text(encoding="utf-8").replace("T1,", f"{COMPOSED},", 1), encoding="utf-8")
    assert COMPOSED in load_campaign(campaign_folder).test_ids


def test_a_foreign_name_that_is_no_id_is_made_one_and_told(tmp_path: Path) -> None:
    """Its first step says so; a name that the user gave stays."""
    table = german(clock(-0.01, 0.12, 2000), half_sine_g(clock(-0.01, 0.12, 2000)))
    path = written(tmp_path, {"=1+1.csv": table}) / "=1+1.csv"
    (record,) = read_records(Reading(path))
    assert record.id == "_1+1"
    assert "Its id is _1+1, because '=1+1' cannot name a file on every system." in record.steps
    (record,) = read_records(Reading(path, record_id="=1+1"))
    assert record.id == "=1+1"


def with_columns(folder: Path, **columns: Mapping[str, object]) -> None:
    """Write columns of cae.csv, of the runs that are named."""
    edit("cae.csv", lambda t: t.assign(**{name: t.id.map(by_run) for name, by_run in columns.items()}))(folder)


def test_shares_are_read_and_empty_cells_are_not_recorded(campaign_folder: Path) -> None:
    before = load_campaign(campaign_folder)
    with_columns(campaign_folder, energy_change={"C00": -0.012, "C01": 0.0}, added_mass_share={"C01": 1e-17})
    cae = load_campaign(campaign_folder).cae
    assert before.cae.quality == ()
    assert cae.quality[:3] == (RunQuality(-0.012), RunQuality(0.0, None, 1e-17), RunQuality())
    assert cae.conditions[0].factors == before.cae.conditions[0].factors
    assert cae.fingerprint == before.cae.fingerprint


def test_quality_and_limits_survive_the_round_trip(campaign_on_disk: Path, tmp_path: Path) -> None:
    campaign = load_campaign(campaign_on_disk)
    quality = tuple(RunQuality(0.1 * i / 3, None if i % 2 else i / 7e3) for i in range(len(campaign.cae)))
    limits = replace(NAMED_LIMITS["nchrp-179"], name="limits of this campaign", energy_change=1 / 3)
    for stated in (limits, NAMED_LIMITS["euro-ncap-vt-2025"]):
        told = replace(campaign, cae=replace(campaign.cae, quality=quality), quality_limits=stated)
        write_campaign(told, folder := tmp_path / stated.name)
        again = load_campaign(folder)
        assert again.cae.quality == quality
        assert again.quality_limits == stated
        assert again.fingerprint == campaign.fingerprint


def test_what_is_said_of_a_test_is_no_part_of_its_condition(campaign_folder: Path, tmp_path: Path) -> None:
    """Whether the CAE model was tuned to it, and about_ columns, survive the round trip and change no fingerprint."""
    before = load_campaign(campaign_folder)
    columns = {"cae_tuned": ["yes", "No ", "", "TRUE"], "about_date": ["2026-03-01", "", "", "2026-04-01"]}
    edit("tests.csv", lambda t: t.assign(**columns))(campaign_folder)
    said = load_campaign(campaign_folder)
    assert [test.cae_tuned for test in said.tests] == [True, False, None, True]
    assert said.tests[0].about == (("about_date", "2026-03-01"),)
    assert (said.fingerprint, said.factors) == (before.fingerprint, before.factors)
    write_campaign(said, tmp_path / "again")
    framed = Campaign.from_frames(
        said.tests_frame, said.test_pulses_frame, said.cae_frame, said.cae_pulses_frame, name=said.name
    )
    for other in (load_campaign(tmp_path / "again"), framed):
        assert [(test.cae_tuned, test.about) for test in other.tests] == [(t.cae_tuned, t.about) for t in said.tests]
    assert said.tests_frame["cae_tuned"].tolist() == ["yes", "no", "", "yes"]
    assert "cae_tuned" not in before.tests_frame
    edit("tests.csv", lambda t: t.assign(cae_tuned=["yes", "maybe", "", ""]))(campaign_folder)
    (problem,) = problems_of(lambda: load_campaign(campaign_folder))
    assert (problem.column, problem.row, problem.found) == ("cae_tuned", 3, "'maybe'")


@pytest.mark.parametrize("settings", ['limits = "euro-ncap-vt-2025"', "hourglass_share = 0.1"])
def test_runs_that_fail_are_left_out_where_that_is_asked_for(campaign_folder: Path, settings: str) -> None:
    """They change the fingerprint, for less is learned from; runs of which nothing is recorded stay."""
    before = load_campaign(campaign_folder)
    with_columns(campaign_folder, hourglass_share={"C02": 0.1, "C03": 0.0999, "C22": 0.4})
    toml = campaign_folder / "campaign.toml"
    toml.write_text(f"[cae_quality]\n{settings}\n")
    assert load_campaign(campaign_folder).fingerprint == before.fingerprint
    toml.write_text(f"[cae_quality]\n{settings}\nleave_out_failing = true\n")
    after = load_campaign(campaign_folder)
    assert set(before.cae.ids) - set(after.cae.ids) == {"C02", "C22"}
    assert after.cae.left_out == (("C02", RunQuality(None, 0.1)), ("C22", RunQuality(None, 0.4)))
    assert len(after.cae.quality) == len(after.cae.accel_mps2) == len(after.cae) == len(before.cae) - 2
    assert after.fingerprint != before.fingerprint
    assert before.cae.paired_run(before.tests[2].condition) == 22
    assert after.cae.paired_run(before.tests[2].condition) is None
    write_campaign(after, campaign_folder.parent / "again")
    assert load_campaign(campaign_folder.parent / "again").fingerprint == after.fingerprint
    with_columns(campaign_folder, hourglass_share={f"C{i:02d}": 0.2 for i in range(15)})
    with pytest.raises(DataError, match="at least 10 CAE runs, found 9, and 15 left out for their quality"):
        load_campaign(campaign_folder)


def test_columns_are_added_to_a_table_that_lacks_them(campaign_folder: Path, campaign: Campaign) -> None:
    condition, accel = campaign.cae.conditions[3], campaign.cae.accel_mps2[3].astype(float)
    told = (RunQuality(0.01, 0.02), RunQuality(added_mass_share=0.03), RunQuality())
    for run_id, quality in zip("ABC", told, strict=True):
        add_to_campaign(campaign_folder, {"cae": [Addition(run_id, condition, Pulse(GRID_S, accel), quality=quality)]})
    cae = load_campaign(campaign_folder).cae
    assert cae.quality[0] == RunQuality()
    assert cae.quality[-3:] == told
