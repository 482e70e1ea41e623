"""Ids name files on every platform; foreign names are made into such ids."""

import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.campaign_folder.additions import Addition, add_to_campaign
from crashfuse.campaign_folder.ids import folded, id_trouble, safe_id
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.condition import Condition
from crashfuse.errors import DataError
from crashfuse.files.archive import name_trouble
from crashfuse.importing import Reading, read_records
from crashfuse.testing.readers import written
from tests.importing.crash_files import german
from tests.importing.crashes import clock, half_sine_g

COMPOSED, APART = (unicodedata.normalize(form, "Prüfung é") for form in ("NFC", "NFD"))


@pytest.mark.parametrize("char", '*?|<>"')
def test_a_character_that_windows_keeps_for_itself_is_refused(char: str) -> None:
    """It could not be written there."""
    trouble = id_trouble(f"T{char}1")
    assert trouble is not None
    assert trouble[1].endswith(f"the character {char}")


@given(name=st.text())
def test_any_name_becomes_an_id(name: str) -> None:
    """Whatever a laboratory calls its files."""
    run_id = safe_id(name)
    assert id_trouble(run_id) is None
    assert name_trouble(f"{run_id}.csv") is None
    assert safe_id(run_id) == run_id


@pytest.mark.parametrize(
    ("name", "run_id"),
    [
        ("T1", "T1"),
        ("Test 3 (rear).v2", "Test 3 (rear).v2"),
        ('=HYPERLINK("http://x")', "_HYPERLINK(_http___x_)"),
        ("-20C Versuch", "_20C Versuch"),
        ("run?1*", "run_1_"),
        ("con", "_con"),
        (" . ", "record"),
        (APART, COMPOSED),
    ],
)
def test_as_much_of_a_name_is_kept_as_can_be(name: str, run_id: str) -> None:
    """A fine one stays as it is."""
    assert safe_id(name) == run_id


@pytest.mark.parametrize(("one", "other"), [("V1", "v1"), (COMPOSED, APART), ("STRASSE", "straße")])
def test_ids_that_a_file_system_takes_for_one_are_refused(campaign_folder: Path, one: str, other: str) -> None:
    """One of the two pulses would be lost on the way to another machine."""
    table = campaign_folder / "tests.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    lines[1:3] = [f"{run_id},{line.partition(',')[2]}" for run_id, line in zip((one, other), lines[1:3], strict=True)]
    table.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(DataError, match=r"row 3: expected ids that differ by more than capitals or the form of their"):
        load_campaign(campaign_folder)


def test_an_addition_is_refused_that_a_file_system_takes_for_one_that_is_there(campaign_folder: Path) -> None:
    """And two of one name are."""
    test = load_campaign(campaign_folder).tests[0]
    condition = Condition.of_vector(
        [test.condition.speed_mps, test.condition.front_weight_kg, test.condition.rear_weight_kg]
    )
    for ids in (["t1"], [COMPOSED, APART]):
        with pytest.raises(DataError, match=r"not there yet|each id once"):
            add_to_campaign(campaign_folder, "tests", [Addition(run_id, condition, test.pulse) for run_id in ids])
    assert folded(COMPOSED) == folded(APART)


def test_a_pulse_is_found_whose_name_has_its_accents_apart(campaign_folder: Path) -> None:
    """As a Mac writes it."""
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
