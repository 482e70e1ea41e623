"""The page Data: opening a campaign, refusing what is none, and showing what is in it."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder import history
from crashfuse.campaign_folder.editing import leave_out, use_again
from crashfuse.campaign_folder.history import changed_by
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import Problem
from crashfuse.execution.cache import default_folder
from crashfuse.files.archive import zipped
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.facts import Fact
from crashfuse.ui.kit import campaigns, uploads, visitors
from crashfuse.ui.kit.results import problem_table
from crashfuse.units import G
from tests.conftest import content_of
from tests.ui.conftest import Session, begin


def kept() -> list[Path]:
    """Folders of uploads that the server keeps."""
    return list(uploads._scratch().iterdir())


def test_a_newcomer_sees_what_this_is_and_one_button() -> None:
    """The first page has a sentence, the sample, a field for a folder and one for files."""
    session = begin()
    assert "full-frontal barrier tests" in session.words
    assert session.buttons == ["Load the sample campaign", "Open folder", "Up", "Open this folder", "Open upload"]
    assert [field.label for field in session.app.text_input] == ["A folder or file on this computer"]
    assert len(session.app.file_uploader) == 1


@pytest.mark.slow
def test_the_sample_is_made_where_it_was_not_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, campaign_folder: Path
) -> None:
    """An installed package has no checkout beside it: the sample is written into the cache folder, once."""
    written: list[Path] = []

    def write(folder: Path) -> None:
        written.append(folder)
        shutil.copytree(campaign_folder, folder)

    monkeypatch.setattr(history, "SHIPPED", tmp_path / "nowhere")
    monkeypatch.setattr("crashfuse.synthetic.sample.write_sample", write)
    for _ in range(2):
        st.cache_resource.clear()
        assert begin().press("Load the sample campaign").numbers["Tests"] == "4"
    assert len(written) == 1
    assert [path.name for path in default_folder().iterdir()] == ["sample"]


@pytest.mark.slow
def test_a_folder_that_is_opened_is_shown(campaign_folder: Path) -> None:
    session = begin().open_folder(str(campaign_folder))
    assert session.app.sidebar.selectbox(key="campaign").value == campaign_folder.name
    assert session.numbers == {"Tests": "4", "Test speeds": "15–35 mph", "CAE runs": "24"}
    assert f"Fingerprint {load_campaign(campaign_folder).fingerprint[:12]}" in session.words
    for tab, charts in (("Tests", 1), ("CAE model", 3), ("Conditions", 1)):
        assert session.open_tab("data", tab).finish().charts == charts
    (table,) = session.tables
    assert table["Test"].tolist() == ["T1", "T2", "T3", "T4"]
    assert table["Speed (mph)"].tolist() == ["15.0", "25.0", "26.0", "35.0"]
    assert table["CAE pulse"].tolist() == ["C20", "C21", "C22", "C23"]


@pytest.mark.slow
@pytest.mark.usefixtures("open_campaign")
def test_the_cae_model_is_held_against_each_test(campaign: Campaign) -> None:
    """By metrics and, last, its rating over the window that was chosen; a click overlays another test."""
    session = begin(data_tab="CAE model", window="40", test="T2")
    table = session.tables[0]
    assert "|".join(table.columns[2:]) == "Peak (g)|Crush (mm)|TTZV (ms)|OLC (g)|SM25 (g)|Rating, 0–40 ms"
    run, test = Pulse(GRID_S, campaign.cae.accel_mps2[20].astype(float)), campaign.tests[0]
    rating = rate_windows(test.pulse, run, [40.0])[40.0]
    assert table["Rating, 0–40 ms"][0] == f"{rating.overall:.3f} {rating.grade}"
    of_cae, measured = (round(float(-pulse.accel_mps2.min() / G), 1) for pulse in (run, test.pulse))
    minus = f"{of_cae - measured:+.1f}".replace("-", "−")
    assert table["Peak (g)"][0] == minus
    session.app.toggle(key="cae and test").set_value(True).run()
    assert session.tables[0]["Peak (g)"][0] == f"{of_cae} / {measured} {minus}"
    session.app.button_group(key="test over CAE").set_value("T3").run()
    session.finish()
    assert session.app.session_state["test"] == "T3"
    assert "The CAE model rates" in session.words


@pytest.mark.slow
def test_the_quality_of_the_cae_runs_is_shown(campaign_folder: Path) -> None:
    """By the campaign's limits, with those that fail named and all of them listed."""
    table = pd.read_csv(campaign_folder / "cae.csv")
    table["hourglass_share"] = [0.2, *[0.01] * 22, None]
    table.to_csv(campaign_folder / "cae.csv", index=False)
    (campaign_folder / "campaign.toml").write_text("[cae_quality]\nhourglass_share = 0.1\n")
    session = begin().open_folder(str(campaign_folder)).open_tab("data", "CAE model")
    assert "22 of 24 pass, 1 fail; 1 cannot be judged" in session.words
    assert "Runs that fail" in session.words
    (quality,) = (table for table in session.tables if "At worst (%)" in table)
    assert quality["At worst (%)"].tolist() == ["–", "20", "–"]
    assert session.app.dataframe[0].value["CAE run"].tolist() == ["C00"]


def test_a_folder_is_picked_level_by_level(campaign_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the home folder, or the one that pages may open, above which it does not go."""
    top = campaign_folder.parent
    (top / ".hidden").mkdir()
    monkeypatch.setenv("CRASHFUSE_ROOT", str(top))
    session = begin()
    picker = next(field for field in session.app.selectbox if field.label == "Folders in it")
    assert campaign_folder.name in picker.options
    assert ".hidden" not in picker.options
    assert next(button for button in session.app.button if button.label == "Up").disabled
    picker.select(campaign_folder.name).run()
    assert session.app.text_input(key="folder").value == str(campaign_folder)
    assert session.press("Open this folder").numbers["Tests"] == "4"


@pytest.mark.slow
def test_a_bad_folder_shows_every_problem_and_no_traceback(campaign_folder: Path) -> None:
    """Two things are wrong; both are said, with the place and what to do, and can be taken away."""
    (campaign_folder / "tests" / "T2.csv").unlink()
    cae = campaign_folder / "cae.csv"
    cae.write_text(cae.read_text().replace("front_weight_lb", "front_weight"))
    session = begin().open_folder(str(campaign_folder))
    assert "cannot be used: 2 problems" in session.words
    (table,) = session.tables
    assert table.columns.tolist() == ["File", "Row", "Column", "Expected", "Found", "What to do"]
    told = table.apply(" ".join, axis=1)
    assert all(told.str.contains(what).any() for what in ("T2", "front_weight"))
    assert "Traceback" not in session.words
    assert session.downloads == ["problems.csv"]
    assert session.app.sidebar.selectbox(key="campaign").value is None
    assert "cannot be used" not in session.press("Load the sample campaign").words


@pytest.mark.parametrize("text", ["/no/such/folder", "", "\0"])
def test_a_folder_that_is_none_breaks_nothing(text: str) -> None:
    assert begin().open_folder(text).app.sidebar.selectbox(key="campaign").value is None


@pytest.mark.parametrize(
    ("name", "found", "advice"),
    [
        ("car.zip", "tables in an archive", "Upload it if it is a campaign, or unpack it and name its folder"),
        ("prog.exe", "a file of another kind", "Name the folder that holds tests.csv and cae.csv"),
    ],
)
def test_a_file_in_the_field_for_a_folder_is_said_to_be_one(
    campaign_folder: Path, tmp_path: Path, name: str, found: str, advice: str
) -> None:
    (tmp_path / name).write_bytes(zipped(content_of(campaign_folder)))
    (table,) = begin().open_folder(str(tmp_path / name)).tables
    assert (table["Found"].tolist(), table["What to do"].tolist()) == ([found], [advice])


@pytest.mark.slow
def test_the_same_problems_are_shown_at_two_places(open_campaign: Path) -> None:
    session = begin()
    (open_campaign / "tests.csv").unlink()
    assert len(session.open_folder(str(open_campaign)).tables) == 2


@pytest.mark.slow
def test_a_zip_is_opened_under_its_name(campaign_folder: Path) -> None:
    """The same data as in the folder; dropped twice it is one campaign."""
    content = zipped(content_of(campaign_folder))
    session = begin()
    for _ in range(2):
        session.upload({"sled.zip": content})
        assert str(session.app.sidebar.selectbox(key="campaign").value).startswith("sled-")
        assert session.app.title[0].value == "sled"
        assert f"Fingerprint {load_campaign(campaign_folder).fingerprint[:12]}" in session.words
        assert len(kept()) == 1
    assert [campaigns.label(name)[:13] for name in campaigns.opened_here()] == ["sample", "sled (upload "]


@pytest.mark.slow
def test_the_files_of_a_campaign_are_opened_together(campaign_folder: Path) -> None:
    session = begin().upload({path.name: path.read_bytes() for path in campaign_folder.rglob("*") if path.is_file()})
    assert session.numbers == {"Tests": "4", "Test speeds": "15–35 mph", "CAE runs": "24"}
    assert not session.press("Open another campaign").app.file_uploader[0].value


@pytest.mark.slow
def test_a_bad_upload_is_refused_row_by_row_and_not_kept(campaign_folder: Path) -> None:
    """Two cells that are no number in one file, by their rows, and another file that is missing."""
    pulse = campaign_folder / "tests" / "T3.csv"
    lines = pulse.read_text().splitlines()
    for row in (5, 6):
        lines[row - 1] = lines[row - 1].split(",")[0] + ",=oops"
    pulse.write_text("\n".join(lines))
    (campaign_folder / "tests" / "T2.csv").unlink()
    session = begin().upload({"bad.zip": zipped(content_of(campaign_folder))})
    (table,) = session.tables
    (cells,) = table[table["Column"] == "acceleration_g"][["File", "Row", "Found", "What to do"]].to_numpy().tolist()
    assert cells == ["tests/T3.csv", "5–6", "'=oops'", "Correct the cell"]
    assert table["Expected"].str.contains("T2").any()
    assert kept() == []
    assert list(campaigns.opened_here()) == ["sample"]


def test_a_strangers_file_name_is_shown_as_text() -> None:
    session = begin().upload({"![x](www.example.org) $a$ :tada: `b` <i>.exe": b"MZ"})
    (shown,) = session.tables[0]["File"]
    assert "![x](www.example.org) $a$" in shown
    table = session.app.table[0].proto.arrow_data
    (raw,) = pa.ipc.open_stream(table.styler.display_values).read_pandas().iloc[:, 0]  # what the browser shows
    for mark in ("![", "](", "$a$", "www.", "<i>"):
        assert mark not in raw


@pytest.mark.parametrize(("name", "content"), [("prog.exe", b"MZ"), ("report.pdf", b"%PDF"), ("T1.parquet", b"PAR1")])
def test_a_file_that_is_refused_is_named(name: str, content: bytes) -> None:
    assert begin().upload({name: content}).tables[0]["File"].tolist() == [name]


def test_nothing_dropped_or_all_too_large_is_said() -> None:
    """The browser keeps back what is over the limit; the page says what the limit is and the other way."""
    (table,) = begin().press("Open upload").tables
    assert table["Expected"].tolist() == ["files of at most 200 MB each"]
    assert table["What to do"].tolist() == ["Choose the files, and open a larger campaign as a folder"]
    assert kept() == []


@pytest.mark.slow
def test_a_full_disk_is_a_sentence(campaign_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(uploads, "lay_out", full)
    session = begin().upload({"a.zip": zipped(content_of(campaign_folder))})
    assert session.tables[0]["Found"].tolist() == ["No space left on device"]
    assert kept() == []


def test_problems_that_differ_by_the_row_alone_are_shown_as_one() -> None:
    """Neighbouring rows as a range, others listed; the table to take away has each of its own."""
    bad = [Problem("a.csv", "a number", "'x'", "correct the cell", "v", row) for row in (2, 3, 4)]
    other = [Problem("a.csv", "a number", "'y'", "correct the cell", "v", row) for row in (7, 9)]
    missing = Problem("b.csv", "this file", "no such file", "add it")
    assert problem_table([*bad, *other, missing], merged=True)["Row"].tolist() == ["2–4", "7, 9", ""]
    assert problem_table([*bad, *other, missing])["Row"].tolist() == ["2", "3", "4", "7", "9", ""]


@pytest.mark.usefixtures("open_campaign")
@pytest.mark.slow
def test_the_filter_is_drawn_over_what_was_read(campaign: Campaign) -> None:
    """Two curves a test, and the peak that the filter leaves of the held-out one; every other page stays unfiltered."""
    session = begin(test="T2")
    before = json.loads(session.app.get("plotly_chart")[0].proto.spec)["data"]
    session.app.button_group(key="filter").set_value("CFC 60").run()
    after = json.loads(session.app.get("plotly_chart")[0].proto.spec)["data"]
    assert (len(before), len(after)) == (4, 8)
    pulse = campaign.test("T2").pulse
    filtered = cfc_filter(pulse.accel_mps2, cfc=60, dt_s=pulse.dt_s)
    read_peak, peak = (np.abs(accel).max() / G for accel in (pulse.accel_mps2, filtered))
    assert f"from {read_peak:.1f} to {peak:.1f} g" in session.words
    session.go("train").go("data")
    assert session.app.button_group(key="filter").value == "CFC 60"


@pytest.mark.slow
def test_what_a_single_test_allows_is_said_on_every_page(open_campaign: Path) -> None:
    """It is shown, and can be learned from; the pages that leave tests out say why they can't."""
    table = open_campaign / "tests.csv"
    table.write_text("\n".join(table.read_text().splitlines()[:2]) + "\n")
    session = begin()
    assert session.numbers["Tests"] == "1"
    assert "Only one test: nothing can be left out" in session.words
    assert session.go("train").buttons == ["Export", "Train on all tests"]
    for page in ("compare", "study"):
        session.go(page)
        assert "T1 is the only test: without it there is nothing to learn from." in session.words
        assert not session.buttons
    assert session.go("predict").buttons


@pytest.mark.slow
@pytest.mark.usefixtures("open_campaign")
def test_the_badge_of_a_test_that_stands_apart_overlays_the_tests_at_its_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    """With what sets it apart; a button brings the others back, and so does any other badge."""
    values = {"speed_mps": 11.4, "differs_by_g": 9.0, "others_differ_by_g": 3.0}
    facts = lambda _: (Fact("test.stands_apart", values, ("T3",)),)  # noqa: E731
    monkeypatch.setattr("crashfuse.ui.kit.frame.campaign_facts", facts)
    monkeypatch.setattr("crashfuse.ui.data.campaign_facts", facts)
    session = begin("study")
    (badge,) = (button for button in session.app.button if "stands apart" in button.label)
    badge.click()
    assert session.run().app.title[0].value != "Study"
    assert session.app.session_state["overlaid"] == ["T2", "T3"]
    assert "differs from the other tests" in session.words
    session.press("All 4 tests")
    assert session.app.session_state["overlaid"] == []
    assert "differs from the other tests" not in session.words


def pills(session: Session) -> list[Any]:
    """The marks of the tests in use; none where the campaign cannot be edited."""
    return [group for group in session.app.pills if group.label == "Tests in use"]


def in_use(session: Session) -> list[str]:
    return list(pills(session)[0].value)


@pytest.mark.slow
def test_a_test_is_left_out_of_use_and_the_change_undone(open_campaign: Path) -> None:
    """It is gone from numbers and choices, and said to be, on every page; the button brings it back."""
    session = begin()
    pills(session)[0].set_value(["T1", "T2", "T4"]).run()
    session = session.run()
    assert session.numbers["Tests"] == "3"
    assert "Left out of use: T3." in session.words
    assert in_use(session) == ["T1", "T2", "T4"]
    session.fill({"Why is T3": "its sensor came loose"})
    assert "T3 (its sensor came loose)" in str(load_campaign(open_campaign).remarks)
    for page in ("compare", "study", "predict", "data"):
        assert "its sensor came loose" in session.go(page).answer[":orange[without T3]"]
    session.press("Undo")  # of the reason
    assert session.press("Undo").numbers["Tests"] == "4"
    assert in_use(session) == ["T1", "T2", "T3", "T4"]
    assert not (open_campaign / "campaign.toml").exists()


@pytest.mark.slow
def test_a_test_whose_sensor_failed_is_left_out_by_a_click(open_campaign: Path) -> None:
    path = open_campaign / "tests" / "T3.csv"
    table = pd.read_csv(path)
    table.loc[table["time_ms"].between(30, 35), "acceleration_g"] = 0.0
    table.to_csv(path, index=False)
    session = begin()
    assert "tests.csv, T3: its signal is lost from 30.0 to 35.0 ms" in session.words
    session = session.press("Leave T3 out of use")
    assert in_use(session) == ["T1", "T2", "T4"]
    assert "T3 (its signal is lost from 30.0 to 35.0 ms" in str(load_campaign(open_campaign).remarks)
    assert "Leave T3 out of use" not in session.buttons


def test_undo_takes_back_the_change_that_it_stands_beside(open_campaign: Path) -> None:
    """What another window changed since stays, and whose it is stands there."""
    leave_out(open_campaign, ["T3"])
    session = begin()
    with changed_by("ben@example.org"):
        leave_out(open_campaign, ["T1"])
    session = session.press("Undo")
    assert "Nothing was changed: 1 problem" in session.words
    assert session.tables[0]["Found"].tolist()[0].startswith("“Left out of use: T1” by ben@example.org, 20")
    assert in_use(session) == ["T2", "T4"]
    assert in_use(session.press("Undo")) == ["T1", "T2", "T4"]


def test_a_file_of_equal_size_and_time_is_read_again(open_campaign: Path) -> None:
    """Whether it was written anew or another took its place, as a copy that keeps times does."""
    table, seen = open_campaign / "tests.csv", {begin().numbers["Test speeds"]}
    before, stat = table.read_text(), table.stat()
    for digit in "67":
        new = table.with_name("new") if digit == "7" else table
        new.write_text(f"{before[:-2]}{digit}\n")
        os.utime(new, ns=(stat.st_atime_ns, stat.st_mtime_ns))
        new.replace(table)
        assert (table.stat().st_size, table.stat().st_mtime_ns) == (stat.st_size, stat.st_mtime_ns)
        seen.add(campaigns.load("campaign").fingerprint)
    assert len(seen) == 3


def test_a_reason_that_a_click_overtook_leaves_nothing_out(open_campaign: Path) -> None:
    """Text that is typed is sent along with the click that ends typing, here on the test itself."""
    leave_out(open_campaign, ["T3"])
    session = begin()
    session.fill({"Why is T3": "its sensor came loose", "Tests in use": ["T1", "T2", "T3", "T4"]})
    assert in_use(session) == ["T1", "T2", "T3", "T4"]
    leave_out(open_campaign, ["T3"])
    session = begin()
    use_again(open_campaign, ["T3"])  # in another session
    session.fill({"Why is T3": "its sensor came loose"})
    assert in_use(session) == ["T1", "T2", "T3", "T4"]
    assert not (open_campaign / "campaign.toml").exists()


@pytest.mark.slow
def test_the_held_out_test_may_be_taken_out(open_campaign: Path) -> None:
    """Another one is held out then, without a complaint about the link; what was changed since is not undone."""
    session = begin(test="T3")
    pills(session)[0].set_value(["T1", "T2", "T4"]).run()
    session = session.press("Take T3 out of the folder")
    assert session.numbers["Tests"] == "3"
    assert "This link" not in session.words
    assert not (open_campaign / "tests" / "T3.csv").exists()
    table = open_campaign / "tests.csv"
    table.write_text(table.read_text() + "\n")
    session = session.press("Undo")
    assert "Nothing was changed: 1 problem" in session.words
    assert session.tables[0]["Found"].tolist() == ["one that was changed since"]
    assert not (open_campaign / "tests" / "T3.csv").exists()


@pytest.mark.slow
def test_the_last_test_in_use_stays(open_campaign: Path) -> None:
    session = begin()
    pills(session)[0].set_value([]).run()
    assert "Nothing was changed: 1 problem" in session.words
    assert session.tables[0]["Found"].tolist() == ["At least one test has to stay in use."]
    assert not (open_campaign / "campaign.toml").exists()
    assert in_use(session.run()) == ["T1", "T2", "T3", "T4"]


@pytest.mark.slow
def test_a_copy_of_the_sample_is_edited(tmp_path: Path) -> None:
    """The sample itself offers nothing but that copy, which is open at once."""
    session = begin().press("Load the sample campaign")
    assert not pills(session)
    session.field("Folder of the copy").set_value("copy")
    session = session.press("Save the copy")
    assert session.tables[0]["What to do"].tolist() == ["Name a folder by its whole path"]
    session.field("Folder of the copy").set_value(str(tmp_path / "mine"))
    session = session.press("Save the copy")
    assert session.app.selectbox(key="campaign").value == "mine"
    assert len(in_use(session)) == 11
    assert load_campaign(tmp_path / "mine").name == "Sample (synthetic)"


@pytest.fixture
def anna(monkeypatch: pytest.MonkeyPatch) -> None:
    """All sessions are of one browser."""
    monkeypatch.setattr(visitors, "browser", lambda: "anna")


@pytest.mark.slow
@pytest.mark.usefixtures("anna")
def test_a_folder_opened_before_is_one_click_away(campaign_folder: Path) -> None:
    other = shutil.copytree(campaign_folder, campaign_folder.with_name("other"))
    for folder in (other, campaign_folder):
        begin().open_folder(str(folder))
    st.cache_resource.clear()
    shutil.rmtree(other)
    session = begin()
    assert "other" not in session.buttons
    assert session.press("campaign").numbers["Tests"] == "4"


@pytest.mark.usefixtures("anna")
@pytest.mark.parametrize("content", [b"", b"[1]", b"\xff", b"[" * 60_000, b"0" * 2_000_000, b"{}", b'{"a": 1}'])
def test_damage_to_what_is_kept_of_visitors_is_ignored(content: bytes, tmp_path: Path) -> None:
    default_folder().mkdir(parents=True, exist_ok=True)
    (default_folder() / "visitors.json").write_bytes(content)
    assert campaigns.recent_folders() == ()
    campaigns.remember(tmp_path)
    assert campaigns.recent_folders() == (tmp_path,)
    assert visitors.kept_for_visitor() == {"folders": [str(tmp_path)]}


@pytest.mark.usefixtures("anna")
def test_the_list_of_folders_is_short(tmp_path: Path) -> None:
    """The last ones, each once; two of one name are told apart."""
    folders = [tmp_path / "a" / "car", tmp_path / "b" / "car", *(tmp_path / f"c{i}" for i in range(9))]
    for folder in folders:
        folder.mkdir(parents=True)
    for folder in (*folders, folders[0], folders[1], folders[0]):
        campaigns.remember(folder)
    listed = campaigns.recent_folders()
    assert listed[:3] == (folders[0], folders[1], folders[-1])
    assert len(listed) == 8
    assert campaigns.folder_labels(listed)[:3] == ["a/car", "b/car", "c8"]


@pytest.mark.slow
@pytest.mark.usefixtures("anna")
def test_pages_offer_and_copy_only_inside_the_roots(
    campaign_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder opened before the server was restricted is not offered, and no copy is saved elsewhere."""
    inside = shutil.copytree(campaign_folder, tmp_path / "root" / "inside")
    for folder in (campaign_folder, inside):
        campaigns.remember(folder)
    monkeypatch.setenv(visitors.ROOTS, str(tmp_path / "root"))
    session = begin()
    assert "inside" in session.buttons
    assert campaign_folder.name not in session.buttons
    session = session.press("Load the sample campaign")
    session.field("Folder of the copy").set_value(str(tmp_path / "elsewhere"))
    assert session.press("Save the copy").tables[0]["Found"].tolist() == ["one outside"]
    assert not (tmp_path / "elsewhere").exists()
