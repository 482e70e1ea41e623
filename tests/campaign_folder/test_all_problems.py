"""All that is wrong with a campaign is told in one pass, however its files come."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from crashfuse import cli
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.upload import lay_out
from crashfuse.errors import DataError
from crashfuse.files.archive import zipped
from tests.conftest import content_of

TOLD = {
    "a missing column": "tests.csv: expected one column rear_weight_lb or rear_weight_kg",
    "text for a number": "cae.csv, column front_weight_lb, row 5: expected a number, found 'heavy'",
    "an id twice": "cae.csv, column id, row 8: expected each id once, found 'C01' a second time",
    "a pulse that is missing": "tests.csv, column id: expected a pulse for T1",
    "a sample that is missing": "T2.csv, column acceleration_g, row 102: expected a number, found an empty cell",
    "a flipped sign": "flip the sign of the acceleration (deceleration is negative)",
    "a unit that is unknown": "expected one column acceleration_g or acceleration_mps2, found acceleration_ftps2",
    "damaged settings": "campaign.toml: expected a TOML file in UTF-8",
}


def edited(path: Path, edit: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    """Change a table."""
    edit(pd.read_csv(path)).to_csv(path, index=False)


def spoil(campaign_folder: Path) -> dict[str, str]:
    """Spoil every file of the small campaign in another way; returns what is to be told of each."""
    edited(campaign_folder / "tests.csv", lambda t: t.drop(columns="rear_weight_lb"))
    edited(
        campaign_folder / "cae.csv",
        lambda t: t.assign(
            front_weight_lb=t.front_weight_lb.astype(object).where(t.index != 3, "heavy"),
            id=t.id.where(t.index != 6, "C01"),
        ),
    )
    tests = campaign_folder / "tests"
    (tests / "T1.csv").unlink()
    edited(tests / "T2.csv", lambda t: t.assign(acceleration_g=t.acceleration_g.where(t.index != 100)))
    edited(tests / "T3.csv", lambda t: t.assign(acceleration_g=-t.acceleration_g))
    edited(tests / "T4.csv", lambda t: t.rename(columns={"acceleration_g": "acceleration_ftps2"}))
    (campaign_folder / "campaign.toml").write_text("name = 'never closed\n")
    return TOLD


@pytest.fixture
def spoilt(campaign_folder: Path) -> Path:
    """A campaign with every file spoilt in another way."""
    spoil(campaign_folder)
    return campaign_folder


def the_folder(folder: Path, _: Path) -> None:
    """Open it."""
    load_campaign(folder)


def a_zip(folder: Path, into: Path) -> None:
    """Upload it zipped."""
    load_campaign(lay_out([("car.zip", zipped(content_of(folder)))], into))


def loose_files(folder: Path, into: Path) -> None:
    """Upload its files together."""
    load_campaign(lay_out([(path.name, path.read_bytes()) for path in folder.rglob("*") if path.is_file()], into))


@pytest.mark.parametrize("opened", [the_folder, a_zip, loose_files], ids=lambda way: way.__name__)
def test_a_campaign_with_every_file_spoilt_tells_it_all_at_once(
    spoilt: Path, tmp_path: Path, opened: Callable[[Path, Path], None]
) -> None:
    """Nobody has to upload eight times to hear of eight faults; and nothing else is told."""
    with pytest.raises(DataError) as raised:
        opened(spoilt, tmp_path)
    sentences = [str(problem) for problem in raised.value.problems]
    for fault, sentence in TOLD.items():
        assert sum(sentence in told for told in sentences) == 1, fault
    assert len(sentences) == len(TOLD)


def test_the_command_line_tells_it_all_at_once(spoilt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each in a line, then how many they are."""
    assert cli.main(["check", str(spoilt)]) == cli.WRONG_DATA
    printed = capsys.readouterr().err
    assert all(sentence in printed for sentence in TOLD.values())
    assert printed.splitlines()[-1] == f"{len(TOLD)} problems found."


def test_a_file_that_does_not_belong_hides_nothing(spoilt: Path, tmp_path: Path) -> None:
    """What an upload should not hold, and a pulse that is nobody's, are told beside what is wrong with the rest."""
    files = [(path.name, path.read_bytes()) for path in spoilt.rglob("*") if path.is_file()]
    strays = [("notes.docx", b"x"), ("T9.csv", b"time_ms,acceleration_g\n0,0\n")]
    with pytest.raises(DataError) as raised:
        lay_out([*files, *strays], tmp_path)
    told = str(raised.value)
    assert all(sentence in told for sentence in TOLD.values())
    assert "notes.docx: expected a file of a campaign" in told
    assert "T9.csv: expected a pulse named after an id" in told
    assert [path.name for path in tmp_path.iterdir()] == ["campaign"]


@pytest.mark.parametrize("gone", ["the file", "the ids", "the speeds"])
def test_pulses_are_checked_without_their_table(campaign_folder: Path, gone: str) -> None:
    """Without tests.csv, or a column of it, a damaged pulse is told; without speeds, one that does not brake, too."""
    table, pulse = campaign_folder / "tests.csv", campaign_folder / "tests" / "T2.csv"
    if gone == "the file":
        table.unlink()
    else:
        edited(table, lambda t: t.drop(columns="id" if gone == "the ids" else "speed_mph"))
    edited(pulse, lambda t: t.assign(acceleration_g=t.acceleration_g.where(t.index != 100)))
    edited(campaign_folder / "tests" / "T3.csv", lambda t: t.assign(acceleration_g=-t.acceleration_g))
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    told = str(raised.value)
    assert told.startswith("tests.csv: ")
    assert "tests/T2.csv, column acceleration_g, row 102" in told
    assert ("expected a pulse that brakes" in told) is (gone == "the speeds")


def test_loose_pulses_of_a_table_that_cannot_be_read_are_checked(spoilt: Path, tmp_path: Path) -> None:
    """Nothing says that they are tests, but that they are no CAE runs."""
    files = [(p.name, p.read_bytes()) for p in spoilt.rglob("*") if p.is_file() and p.name != "tests.csv"]
    with pytest.raises(DataError) as raised:
        load_campaign(lay_out(files, tmp_path))
    told = str(raised.value)
    assert "tests.csv: expected this file" in told
    assert "T2.csv, column acceleration_g, row 102" in told


def test_every_line_with_a_decimal_comma_is_told(campaign_folder: Path) -> None:
    """Not only the first."""
    table = campaign_folder / "tests.csv"
    lines = table.read_text().splitlines()
    damaged = [line.replace(".", ",", 1) if row > 1 else line for row, line in enumerate(lines)]
    table.write_text("\n".join(damaged))
    with pytest.raises(DataError) as raised:
        load_campaign(campaign_folder)
    rows = [problem.row for problem in raised.value.problems if "write decimal points" in problem.advice]
    assert rows == [3, 4, 5]
