"""Editing a campaign: pulses added, tests left out of use or taken out, and the folder as it was, byte for byte."""

import json
import os
import re
import shlex
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from crashfuse import cli
from crashfuse.campaign_folder import editing
from crashfuse.campaign_folder.history import changes, sample_folder, undo
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.notes import Note, write_notes
from crashfuse.campaign_folder.settings import LONGEST_REASON
from crashfuse.condition import Condition
from crashfuse.errors import DataError, UsageError
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.units import KPH, LB, MPH
from tests.archives import made_archive
from tests.campaign_folder.test_load import reshape
from tests.conftest import Capture, content_of, problems_of

CONDITION = Condition.of_vector([30 * MPH, 2050 * LB, 1500 * LB], (("drive", "AWD"), ("colour", "red")))


def addition(run_id: str = "New", speed_mph: float = 30.0) -> editing.Addition:
    """A half-sine pulse that stops its car, sooner the faster it is."""
    condition = replace(CONDITION, speed_mps=speed_mph * MPH)
    duration_s = 0.090 - 5e-4 * speed_mph
    peak = 1.1 * condition.speed_mps * np.pi / (2 * duration_s)
    pulse = Pulse(GRID_S, np.where(duration_s > GRID_S, -peak * np.sin(np.pi * GRID_S / duration_s), 0.0))
    return editing.Addition(
        run_id, condition, pulse, {"source": 'a "file"\n\x7f', "steps": ("one", "two"), "time_zero_ms": 1.5}
    )


@pytest.mark.parametrize("role", ["tests", "cae"])
@pytest.mark.parametrize("form", ["files", "parquet", "csv"])
def test_a_pulse_is_added_where_the_others_are_and_taken_back(campaign_folder: Path, role: str, form: str) -> None:
    reshape(campaign_folder, role, form)
    before, content = load_campaign(campaign_folder), content_of(campaign_folder)
    new, rows = addition("10146"), (campaign_folder / f"{role}.csv").read_bytes()
    editing.add_to_campaign(campaign_folder, {role: [new]})  # type: ignore[dict-item]
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
    assert (campaign_folder / f"{role}.csv").read_bytes().startswith(rows)
    np.testing.assert_allclose(accel, new.pulse.accel_mps2, atol=1e-4)
    assert not after.warnings
    editing.add_to_campaign(campaign_folder, {role: [addition("A", 35.0), addition("B", 22.0)]})  # type: ignore[dict-item]
    what = "test" if role == "tests" else "CAE run"
    assert [one.what for one in changes(campaign_folder)] == [f"Added: 2 {what}s (A, B)", f"Added: 1 {what} (10146)"]
    undo(campaign_folder)
    assert len(load_campaign(campaign_folder).tests) == len(after.tests)
    undo(campaign_folder)
    assert content_of(campaign_folder) == content
    assert not (campaign_folder / ".undo").exists()  # the journal goes with the last change
    with pytest.raises(DataError, match="expected a change that can be undone, found none"):
        undo(campaign_folder)


def test_a_campaign_is_begun(tmp_path: Path) -> None:
    home = tmp_path / "new" / "car"
    editing.add_to_campaign(home, {"tests": [addition("A"), addition("B", 35.0)]})
    editing.add_to_campaign(home, {"tests": [addition("C", 40.0)]})
    for n, named in ((5, "R50, R51, R52, R53, R54"), (6, "R60 to R65")):  # all, as long as they are few
        [added] = editing.add_to_campaign(home, {"cae": [addition(f"R{n}{i}", 5.0 * n + i) for i in range(n)]})
        assert str(added) == f"Added: {n} CAE runs ({named})"
    begun = load_campaign(home)
    assert begun.test_ids == ("A", "B", "C")
    assert begun.factors == {"colour": ("red",), "drive": ("AWD",)}
    assert len(begun.cae) == 11
    table = pd.read_csv(home / "tests.csv")
    assert table["speed_kph"].tolist() == pytest.approx([v * MPH / KPH for v in (30, 35, 40)])
    assert not begun.warnings


def test_a_folder_of_other_files_is_no_campaign(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").touch()
    problems = problems_of(lambda: editing.add_to_campaign(tmp_path, {"tests": [addition()]}))
    assert (problems[0].where, problems[0].found) == (str(tmp_path), "other files")
    assert list(content_of(tmp_path)) == ["letter.txt"]
    (tmp_path / "campaign.toml").write_text('name = "Ours"\n')
    editing.add_to_campaign(tmp_path, {"tests": [addition()]})
    assert (tmp_path / "tests" / "New.csv").is_file()


def test_a_copy_of_a_test_is_refused_and_nothing_changes(campaign_folder: Path) -> None:
    """Under another id, scaled, or twice in one source: with it the campaign could no longer be opened."""
    first = addition("First")
    editing.add_to_campaign(campaign_folder, {"tests": [first]})
    before = content_of(campaign_folder)
    scaled = replace(first, id="Second", pulse=Pulse(GRID_S, 1.02 * first.pulse.accel_mps2))
    other = addition("Third", 40.0)
    for new in ([scaled], [other, replace(other, id="Fourth")]):
        with pytest.raises(DataError, match=r"as it would become.*the same record for"):
            editing.add_to_campaign(campaign_folder, {"tests": new})
        assert content_of(campaign_folder) == before
    (campaign_folder / "campaign.toml").write_text('unused = ["First"]\n', encoding="utf-8")
    editing.add_to_campaign(campaign_folder, {"tests": [scaled]})  # it takes the place of one that is not in use
    assert load_campaign(campaign_folder).test_ids[-1] == "Second"


def test_an_id_that_is_there_is_refused_and_nothing_changes(campaign_folder: Path) -> None:
    before = content_of(campaign_folder)
    for ids, message in (
        (["New", "T1"], "an id that is not there yet, found 'T1'"),
        (["t1"], "an id that is not there yet, found 't1'"),  # on Windows and macOS their files would be one
        (["New", "New"], "each id once"),
        (["New", "../x"], "an id that can name a file, found '../x', with /"),
        (["New", "=1+1"], "an id that no spreadsheet takes for a formula, found '=1\\+1'"),
        (["-20C Versuch"], "an id that no spreadsheet takes for a formula"),
        (["New", " x"], "ends in a dot or a space"),
        (["New", "x:y"], "found 'x:y', with :"),
    ):
        with pytest.raises(DataError, match=message):
            editing.add_to_campaign(campaign_folder, {"tests": [addition(i) for i in ids]})
        assert content_of(campaign_folder) == before


def test_an_addition_cut_short_leaves_all_as_it_was(campaign_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fingerprint = load_campaign(campaign_folder).fingerprint

    write_bytes = Path.write_bytes

    def no_table(path: Path, content: bytes) -> int:
        if path.name == "tests.csv" and path.is_relative_to(campaign_folder):
            raise OSError(28, "disk full", str(path))
        return write_bytes(path, content)

    monkeypatch.setattr(Path, "write_bytes", no_table)
    with pytest.raises(OSError, match="disk full") as caught:
        editing.add_to_campaign(campaign_folder, {"tests": [addition()]})
    assert caught.value.filename == str(campaign_folder)  # not what keeps the history
    assert load_campaign(campaign_folder).fingerprint == fingerprint
    assert not (campaign_folder / "tests" / "New.csv").exists()
    monkeypatch.undo()
    editing.add_to_campaign(campaign_folder, {"tests": [addition()]})
    assert load_campaign(campaign_folder).test_ids[-1] == "New"


SETTINGS = '# ours\nname = "Our car"  # the red one\n\n[occupant]\nvpi_slack_mm = 20.0\n'


@pytest.fixture
def folder(campaign_folder: Path) -> Path:
    """The small campaign, with settings that end in a table."""
    (campaign_folder / "campaign.toml").write_text(SETTINGS)
    return campaign_folder


def test_a_test_left_out_of_use_is_gone_from_the_campaign_and_stays_in_the_folder(folder: Path) -> None:
    before = load_campaign(folder)
    assert editing.leave_out(folder, ["T3"]) == "Left out of use: T3"
    after = load_campaign(folder)
    assert after.test_ids == ("T1", "T2", "T4")
    assert after.fingerprint == before.without(["T3"]).fingerprint != before.fingerprint
    assert after.unused == (("T3", before.test("T3").condition),)
    assert after.remarks == ("Left out of use, neither learned from nor rated: T3 (no reason given).",)
    assert (folder / "tests" / "T3.csv").is_file()
    assert (folder / "campaign.toml").read_text() == f'unused = ["T3"]\n{SETTINGS}'
    editing.leave_out(folder, ["T1"])
    assert load_campaign(folder).test_ids == ("T2", "T4")
    assert editing.use_again(folder, ["T3", "T1"]) == "In use again: T3, T1"
    assert (folder / "campaign.toml").read_text() == SETTINGS
    assert load_campaign(folder).fingerprint == before.fingerprint


def test_why_a_test_is_left_out_stays_with_it(folder: Path) -> None:
    """Given with it or later, in one line that TOML reads; told among the changes, and gone when it is used again.

    It is cut to what the page takes, with the sign that it was; one that just fits stays whole.
    """
    odd = 'sensor "B" came\n loose } at 20 ms'
    assert editing.leave_out(folder, ["T3"], odd) == 'Left out of use: T3 (sensor "B" came loose } at 20 ms)'
    editing.leave_out(folder, ["T1"])
    campaign = load_campaign(folder)
    assert campaign.remarks == (
        'Left out of use, neither learned from nor rated: T1 (no reason given), T3 (sensor "B" came loose } at 20 ms).',
    )
    editing.say_why(folder, "T1", "repeated as T2")
    editing.say_why(folder, "T3", "")
    assert load_campaign(folder).why_unused == {"T1": "repeated as T2", "T3": ""}
    assert load_campaign(folder).fingerprint == campaign.fingerprint
    editing.use_again(folder, ["T1"])
    assert (folder / "campaign.toml").read_text() == f'unused = ["T3"]\n{SETTINGS}'
    editing.use_again(folder, ["T3"])
    for why, kept in (("x" * LONGEST_REASON, "x" * LONGEST_REASON), ("y" * 300, "y" * (LONGEST_REASON - 1) + "…")):
        editing.leave_out(folder, ["T3"], why)
        assert load_campaign(folder).why_unused == {"T3": kept}
        editing.use_again(folder, ["T3"])


@pytest.mark.parametrize("why", ["", 'see [3]} # "4"'])
def test_an_id_may_hold_what_ends_a_list(folder: Path, why: str) -> None:
    table = folder / "tests.csv"
    table.write_text(table.read_text().replace("T1", "T[1]}"))
    (folder / "tests" / "T1.csv").rename(folder / "tests" / "T[1]}.csv")
    editing.leave_out(folder, ["T[1]}"], why)
    editing.leave_out(folder, ["T2"])
    assert load_campaign(folder).test_ids == ("T3", "T4")
    editing.use_again(folder, ["T[1]}", "T2"])
    assert (folder / "campaign.toml").read_text() == SETTINGS


@pytest.mark.parametrize("line", ["unused = {old}", 'unused = ["T1"]'])
def test_what_looks_like_the_list_in_another_setting_stays(folder: Path, line: str) -> None:
    """A notice of several lines may quote one, above the list itself."""
    notice = f'notice = """\n{line}\n"""\n'
    (folder / "campaign.toml").write_text(f"{notice}{SETTINGS}")
    editing.leave_out(folder, ["T2"])
    assert (folder / "campaign.toml").read_text() == f'unused = ["T2"]\n{notice}{SETTINGS}'
    (folder / "campaign.toml").write_text(f'{notice}unused = ["T2"]\n{SETTINGS}')
    editing.use_again(folder, ["T2"])
    assert (folder / "campaign.toml").read_text() == f"{notice}{SETTINGS}"


def test_a_text_full_of_what_looks_like_the_list_is_not_searched_to_its_end(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of 20,000 would be: minutes, while nobody else can edit."""
    text, tried = 'made_with = """\n' + "unused = [\n" * 20_000 + f'"""\n{SETTINGS}', list[str]()
    (folder / "campaign.toml").write_text(text)
    read = editing._values

    def counting(text: str) -> dict[str, object] | None:
        tried.append(text)
        return read(text)

    monkeypatch.setattr(editing, "_values", counting)
    editing.leave_out(folder, ["T2"])
    assert len(tried) < 100
    assert (folder / "campaign.toml").read_text() == f'unused = ["T2"]\n{text}'


def test_a_list_that_a_person_wrote_is_edited_or_left_alone(folder: Path) -> None:
    others = SETTINGS[SETTINGS.index("[") :]
    (folder / "campaign.toml").write_text(f'name = "Car"\nunused = [\n  "T1",\n] # sensor came loose\n{others}')
    editing.leave_out(folder, ["T2"])
    assert load_campaign(folder).test_ids == ("T3", "T4")
    editing.use_again(folder, ["T1", "T2"])
    assert load_campaign(folder).test_ids == ("T1", "T2", "T3", "T4")
    n, text = len(changes(folder)), '"unused" = ["T1"]\n'
    (folder / "campaign.toml").write_text(text)
    with pytest.raises(DataError, match=r'set it by hand: unused = \["T1", "T2"\]'):
        editing.leave_out(folder, ["T2"])
    assert (folder / "campaign.toml").read_text() == text
    assert len(changes(folder)) == n


def test_a_damaged_test_can_be_left_out(folder: Path) -> None:
    (folder / "tests" / "T2.csv").write_text("lost")
    pd.read_csv(folder / "tests.csv").astype({"speed_mph": object}).assign(
        speed_mph=lambda t: t.speed_mph.where(t.id != "T3", "fast")
    ).to_csv(folder / "tests.csv", index=False)
    editing.leave_out(folder, ["T2"])
    with pytest.raises(DataError, match="'fast'"):
        load_campaign(folder)
    editing.remove_tests(folder, ["T3"])
    assert load_campaign(folder).test_ids == ("T1", "T4")


@pytest.mark.parametrize("form", ["files", "parquet", "csv"])
def test_a_test_is_taken_out_and_back(folder: Path, form: str) -> None:
    reshape(folder, "tests", form)
    editing.leave_out(folder, ["T2"])
    before, loaded = content_of(folder), load_campaign(folder)
    lines = (folder / "tests.csv").read_bytes().splitlines(keepends=True)
    assert editing.remove_tests(folder, ["T2", "T4"]) == "Taken out: T2, T4"
    after = load_campaign(folder)
    assert after.test_ids == ("T1", "T3")
    assert after.unused == ()
    assert after.warnings == ()
    assert after.fingerprint == loaded.without(["T4"]).fingerprint
    assert (folder / "tests.csv").read_bytes() == b"".join([lines[0], lines[1], lines[3]])
    assert not list((folder / "tests").glob("T[24].*"))
    assert undo(folder).what == "Taken out: T2, T4"
    assert content_of(folder) == before


@pytest.mark.parametrize(
    "changed", ["tests.csv", "campaign.toml", "tests/New.csv", ".undo/000001/before/tests.csv"], ids=str
)
def test_nothing_is_undone_over_what_was_changed_since(folder: Path, changed: str) -> None:
    editing.add_to_campaign(folder, {"tests": [addition()]})
    path = folder / changed
    new = path.read_bytes() + b"\n"
    path.unlink()  # an editor that saves under the same name
    path.write_bytes(new)
    before = content_of(folder)
    (problem,) = problems_of(lambda: undo(folder))
    assert problem.where == changed
    assert content_of(folder) == before


def test_what_is_there_already_is_passed_over(folder: Path) -> None:
    editing.add_to_campaign(folder, {"tests": [addition("A"), addition("B", 35.0)]})
    [added] = editing.add_to_campaign(folder, {"tests": [addition("B", 35.0), addition("C", 22.0), addition("A")]})
    assert str(added) == "Added: 1 test (C); there already: 2"
    assert load_campaign(folder).test_ids == ("T1", "T2", "T3", "T4", "A", "B", "C")
    before = content_of(folder)
    with pytest.raises(DataError, match="an id that is not there yet, found 'A'"):
        editing.add_to_campaign(folder, {"tests": [addition("A", 31.0), addition("D", 20.0)]})
    with pytest.raises(DataError, match="found A, B, there already all the same"):
        editing.add_to_campaign(folder, {"tests": [addition("A"), addition("B", 35.0)]})
    assert content_of(folder) == before


@pytest.mark.parametrize("name", ["../../secret.csv", "/etc/hosts.csv", "tests/../../secret.csv", "notes.txt", 7, None])
def test_a_journal_from_elsewhere_touches_nothing_outside(folder: Path, name: object) -> None:
    """A folder may come from anyone: a list that names other files is no list of ours."""
    (folder.parent / "secret.csv").write_text("mine")
    editing.leave_out(folder, ["T1"])
    path = folder / ".undo" / "000001" / "change.json"
    told = json.loads(path.read_text())
    told["files"] = [{"name": name, "before": None, "after": None}]
    path.write_text(json.dumps(told))
    assert changes(folder) == ()
    for text in ("", "[]", "{}", "[" * 100_000, '{"number": 1, "what": "x", "when": "y", "files": [1]}'):
        path.write_text(text)
        assert changes(folder) == ()
    assert (folder.parent / "secret.csv").read_text() == "mine"


@pytest.mark.parametrize(
    ("edit", "ids", "sentence"),
    [
        (editing.leave_out, ["T9"], "There is no test 'T9' that is in use; there is T1, T2, T4."),
        (editing.leave_out, ["T3"], "There is no test 'T3' that is in use; there is T1, T2, T4."),
        (editing.leave_out, ["T1", "T2", "T4"], "At least one test has to stay in use."),
        (editing.use_again, ["T1"], "There is no test 'T1' that is left out of use; there is T3."),
        (editing.remove_tests, ["T1", "T2", "T4"], "At least one test has to stay in use."),
        (lambda folder, ids: editing.say_why(folder, ids[0], ""), ["T1"], "no test 'T1' that is left out of use; "),
    ],
)
def test_what_cannot_be_edited_is_said(folder: Path, edit: Callable[..., str], ids: list[str], sentence: str) -> None:
    editing.leave_out(folder, ["T3"])
    before = content_of(folder)
    with pytest.raises(UsageError, match=re.escape(sentence)):
        edit(folder, ids)
    assert content_of(folder) == before


def test_the_sample_is_not_edited_but_a_copy_is(tmp_path: Path) -> None:
    for edit in (lambda: editing.leave_out(sample_folder(), ["T01"]), lambda: undo(sample_folder())):
        with pytest.raises(DataError, match="copy it"):
            edit()
    with pytest.raises(DataError, match="copy it"):
        editing.add_to_campaign(sample_folder(), {"tests": [addition()]})
    editing.copy_campaign(sample_folder(), tmp_path / "copy")
    assert load_campaign(tmp_path / "copy").fingerprint == load_campaign(sample_folder()).fingerprint
    assert (tmp_path / "copy" / "criteria.toml").is_file()
    (tmp_path / "copy" / "notes.csv").write_text("test,start_ms,end_ms,text\n")
    made_archive().save(tmp_path / "copy" / "archive.cfa")
    editing.copy_campaign(tmp_path / "copy", tmp_path / "again")
    assert all((tmp_path / "again" / name).is_file() for name in ("notes.csv", "archive.cfa"))
    editing.leave_out(tmp_path / "copy", ["T01"])
    assert "T01" not in load_campaign(tmp_path / "copy").test_ids


def test_the_command_line_edits_and_undoes(folder: Path, capsys: Capture) -> None:
    folder = folder.rename(folder.with_name("$(touch x) it's mine"))
    untouched = shutil.copytree(folder, folder.with_name("untouched"))
    assert cli.main(["edit", str(folder), "--leave-out", "T1", "T2", "--because", "no t0"]) == cli.DONE
    assert cli.main(["edit", str(folder), "--use", "T1"]) == cli.DONE
    assert cli.main(["edit", str(folder), "--use", "T1", "--because", "no t0"]) == cli.WRONG_USAGE
    assert cli.main(["edit", str(folder), "--remove", "T2"]) == cli.DONE
    assert shlex.split(capsys.readouterr().out.splitlines()[-1])[-6:-3] == ["edit", str(folder), "--undo"]
    assert cli.main(["edit", str(folder)]) == cli.DONE
    listed = capsys.readouterr().out.splitlines()
    ends = ["Taken out: T2", "In use again: T1", "Left out of use: T1, T2 (no t0)"]
    assert [line.partition("  ")[2].partition("  ")[2] for line in listed[1:]] == ends
    assert cli.main(["edit", str(folder), "--leave-out", "T9"]) == cli.WRONG_USAGE
    for end in ends:
        assert cli.main(["edit", str(folder), "--undo"]) == cli.DONE
        assert capsys.readouterr().out == f"Undone: {end}.\n"
    assert cli.main(["edit", str(folder), "--undo"]) == cli.WRONG_DATA
    assert content_of(folder) == content_of(untouched)


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_tuning_is_said_in_the_table_and_taken_back(folder: Path, ending: str, capsys: Capture) -> None:
    table = folder / "tests.csv"
    table.write_bytes(table.read_bytes().replace(b"\n", ending.encode()))
    before, fingerprint = table.read_bytes(), load_campaign(folder).fingerprint
    assert cli.main(["edit", str(folder), "--cae-tuned", "T1", "T3"]) == cli.DONE
    assert "CAE model tuned to: T1, T3. crashfuse edit" in capsys.readouterr().out
    assert load_campaign(folder).fingerprint == fingerprint
    assert cli.main(["edit", str(folder), "--not-cae-tuned", "T3"]) == cli.DONE
    assert [test.cae_tuned for test in load_campaign(folder).tests] == [True, None, False, None]
    n = len(changes(folder))
    assert cli.main(["edit", str(folder), "--not-cae-tuned", "T3"]) == cli.DONE
    assert len(changes(folder)) == n
    assert cli.main(["edit", str(folder), "--cae-tuned", "T9"]) == cli.WRONG_USAGE
    undo(folder)
    undo(folder)
    assert table.read_bytes() == before


@pytest.mark.skipif(sys.platform == "win32", reason="rights are no bits there")
@pytest.mark.parametrize(("mode", "of_folder"), [(0o664, 0o775), (0o640, 0o750), (0o600, 0o700)])
def test_who_shares_a_folder_can_read_what_an_edit_wrote(folder: Path, mode: int, of_folder: int) -> None:
    """Files that were replaced, new ones and what an undo needs: whatever the mask of who edits."""
    for path in (folder, *folder.rglob("*")):
        path.chmod(of_folder if path.is_dir() else mode)
    mask = os.umask(0o077 if mode > 0o600 else 0)
    try:
        editing.say_tuned(folder, ["T1"], tuned=True)
        editing.leave_out(folder, ["T2"], "cold")
        editing.add_to_campaign(folder, {"tests": [addition()]})
        write_notes(folder, [Note("T1", "cold")])
    finally:
        os.umask(mask)
    assert {"campaign.toml", "notes.csv", "tests/New.csv", ".undo/000003/change.json"} <= {*content_of(folder)}
    found = {path.is_dir(): path.stat().st_mode & 0o777 for path in folder.rglob("*")}
    assert found == {True: of_folder, False: mode}
    assert len({path.stat().st_mode for path in folder.rglob("*")}) == 2


def test_hard_links_are_not_needed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = content_of(folder)

    def none(*_: object, **__: object) -> None:
        raise OSError("not supported")

    monkeypatch.setattr(os, "link", none)
    editing.remove_tests(folder, ["T1"])
    undo(folder)
    assert content_of(folder) == before


@pytest.mark.parametrize(
    ("settings", "changed", "message"),
    [
        (b"", {"factors": (("drive", "a\x1bb"),)}, "drive, row 6: expected text of at most"),
        (b"", {"speed_mps": 0.01}, "speed_mph, row 6: expected a number of at least"),
        (b"", {"rear_weight_kg": 1e6}, "rear_weight_lb, row 6: expected a number up to"),
        (b"name = \xe9", {}, "expected text in UTF-8"),
        (b"name = [", {}, "toml as it would"),
        (b"notice = 7", {}, "column notice"),
    ],
)
def test_what_could_not_be_read_back_is_not_written(
    campaign_folder: Path, settings: bytes, changed: dict[str, Any], message: str
) -> None:
    """A campaign that can be opened stays one; it is judged by what reads it then."""
    (campaign_folder / "campaign.toml").write_bytes(settings)
    before = content_of(campaign_folder)
    with pytest.raises(DataError, match=message):
        editing.add_to_campaign(
            campaign_folder, {"tests": [replace(addition(), condition=replace(CONDITION, **changed))]}
        )
    assert content_of(campaign_folder) == before


def test_an_archive_is_put_in_and_taken_out_and_either_is_undone(campaign_folder: Path) -> None:
    campaign, before, content = load_campaign(campaign_folder), content_of(campaign_folder), made_archive().content
    with pytest.raises(DataError, match=r"^archive\.cfa: expected an archive"):
        editing.set_archive(campaign_folder, campaign, content[:-1])
    with pytest.raises(UsageError, match="shares tests"):
        editing.set_archive(campaign_folder, campaign, made_archive(campaign, campaign).content)
    assert content_of(campaign_folder) == before
    editing.set_archive(campaign_folder, campaign, content)
    assert (campaign_folder / "archive.cfa").read_bytes() == content
    editing.set_archive(campaign_folder, campaign, None)
    assert load_campaign(campaign_folder).prior is None
    undo(campaign_folder)
    assert (campaign_folder / "archive.cfa").read_bytes() == content
    undo(campaign_folder)
    assert content_of(campaign_folder) == before
