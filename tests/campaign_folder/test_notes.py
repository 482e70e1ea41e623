"""Notes go into a campaign folder and come back; a damaged file is said; no result depends on them."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pandas as pd
import pytest

from crashfuse import cli
from crashfuse.campaign_folder.load import lay_out
from crashfuse.campaign_folder.notes import FILE, LONGEST_TEXT, MOST, Note, change_notes, read_notes, write_notes
from crashfuse.errors import DataError, UsageError
from crashfuse.files.archive import zipped
from crashfuse.results.render.figure_files import read_figures
from tests.conftest import Capture, content_of

NOTES = (
    Note("T1", "Barrier face\n  replaced"),
    Note("T1", '=HYPERLINK("http://x")', 25.0),
    Note("T2", "hump, “third”; <b>early</b> 'x", 25.5, 40.0),
)


def test_notes_come_back_as_they_were_written(tmp_path: Path) -> None:
    write_notes(tmp_path, NOTES)
    assert read_notes(tmp_path) == NOTES
    table = pd.read_csv(tmp_path / FILE)
    assert list(table) == ["test", "start_ms", "end_ms", "text"]
    assert table["text"].tolist()[:2] == ["Barrier face replaced", '\'=HYPERLINK("http://x")']
    assert [note.when for note in NOTES] == ["", "25 ms", "25.5–40 ms"]
    write_notes(tmp_path, ())
    assert not list(tmp_path.iterdir())
    assert read_notes(tmp_path) == ()
    many = [Note("T1", f"note {number}") for number in range(MOST - 1)]
    write_notes(tmp_path, many)
    change_notes(tmp_path, lambda notes: [*notes, NOTES[0]])
    with pytest.raises(DataError, match="at most 500 notes, found 501"):
        change_notes(tmp_path, lambda notes: [*notes, NOTES[1]])
    assert read_notes(tmp_path) == (*many, NOTES[0])
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


def test_notes_travel_with_a_campaign_that_is_uploaded(campaign_folder: Path, tmp_path: Path) -> None:
    write_notes(campaign_folder, NOTES)
    (tmp_path / "into").mkdir()
    assert read_notes(lay_out([("campaign.zip", zipped(content_of(campaign_folder)))], tmp_path / "into")) == NOTES


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("T1", " "), "needs a text"),
        (("T1", "x" * (LONGEST_TEXT + 1)), "at most 500 characters, not 501"),
        (("T1", "x", None, 3.0), "needs a start"),
        (("T1", "x", 30.0, 20.0), "its start before its end"),
        (("T1", "x", -1.0), "between 0 and 100 ms"),
        (("T1", "x", 20.0, 101.0), "between 0 and 100 ms"),
        (("T1", "x", float("nan")), "a number, not nan"),
    ],
)
def test_what_is_no_note_is_one_sentence(given: tuple[object, ...], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        Note(*given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"test,text\nT1,x\n", "none named start_ms"),
        (b"test,start_ms,end_ms,text\nT1,soon,,x\n", "row 2: expected times in ms, or nothing"),
        (b"test,start_ms,end_ms,text\nT1,,,\n", "row 2: expected A note needs a text"),
        (b"test,start_ms,end_ms,text\nT1,soon,,x\nT1,,,\n", r"row 2: [^\n]+\nnotes\.csv, row 3: "),
        (b"test,start_ms,end_ms,text\n" + b"T1,,,x\n" * (MOST + 1), "at most 500 notes, found 501"),
        (b"\xff\xfe\x00", "text in UTF-8"),
        (b"", "a table with a header"),
    ],
)
def test_a_damaged_file_is_one_sentence(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / FILE).write_bytes(content)
    with pytest.raises(DataError, match=said):
        read_notes(tmp_path)
    for notes in ((NOTES[0],), ()):
        with pytest.raises(DataError, match=said):
            write_notes(tmp_path, notes)
    assert content_of(tmp_path) == {FILE: content}


def test_a_note_of_a_hostile_text_reaches_the_report_of_the_command_as_text(
    campaign_folder: Path, tmp_path: Path
) -> None:
    """A script in notes.csv is shown, not run, in the list and on the figure of the short report."""
    write_notes(campaign_folder, [Note("T1", "<script>alert(1)</script>", 25.0)])
    out = tmp_path / "out"
    options = ["--held-out", "T1", "--approach", "cae", "--workers", "1", "--report", "short"]
    assert cli.main(["study", str(campaign_folder), "--out", str(out), *options]) == cli.DONE
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "<script>alert(1)" not in text
    assert "<td>&lt;script&gt;alert(1)&lt;/script&gt;</td>" in text
    figures = read_figures(out / "report.html").figures
    (drawn,) = [figure.drawn for figure in figures if figure.title.endswith("Pulses over time")]
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in [note["text"] for note in drawn["layout"]["annotations"]]
    assert "Method and settings" not in text


def test_damaged_notes_stop_the_command_before_anything_is_computed(
    campaign_folder: Path, tmp_path: Path, capsys: Capture
) -> None:
    (campaign_folder / FILE).write_text("test,text\n", encoding="utf-8")
    assert cli.main(["study", str(campaign_folder), "--out", str(tmp_path / "out")]) == cli.WRONG_DATA
    assert "notes.csv: expected the columns test, start_ms, end_ms, text" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_column_that_is_there_twice_is_not_lost(tmp_path: Path) -> None:
    content = "test,start_ms,end_ms,text,text\nT1,,,Cold,Anna says warm\n"
    (tmp_path / FILE).write_text(content)
    for use in (read_notes, lambda folder: change_notes(folder, lambda notes: [*notes, Note("T2", "Warm")])):
        with pytest.raises(DataError, match="each column once, found text twice"):
            use(tmp_path)
    assert (tmp_path / FILE).read_text() == content


def test_columns_of_somebody_else_are_not_lost(tmp_path: Path) -> None:
    content = "test,start_ms,end_ms,text,who\nT1,,,Cold,Anna\n"
    (tmp_path / FILE).write_text(content)
    assert read_notes(tmp_path) == (Note("T1", "Cold"),)
    with pytest.raises(DataError, match="found who, which would be lost"):
        change_notes(tmp_path, lambda notes: [*notes, Note("T2", "Warm")])
    assert (tmp_path / FILE).read_text() == content


def test_notes_that_are_added_at_one_time_are_all_kept(tmp_path: Path) -> None:
    """Of four readers, six each: whoever comes second starts from what the first has written."""
    notes = [Note("T1", f"note {number}") for number in range(24)]
    with ThreadPoolExecutor(4) as readers:
        list(readers.map(lambda note: change_notes(tmp_path, lambda there: [*there, note]), notes))
    assert sorted(note.text for note in read_notes(tmp_path)) == sorted(note.text for note in notes)
