"""Changes of a campaign folder: whatever happens in the middle, it is as before or as after, and undo brings all back.

A process is killed, or a file operation fails, at each file operation of a change in turn: an audit hook sees them all.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from crashfuse.campaign_folder import history
from crashfuse.campaign_folder.editing import add_to_campaign, leave_out, remove_tests, say_why, use_again
from crashfuse.campaign_folder.history import Change, changed_by, changes, settle, undo
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import DataError, UsageError
from tests.campaign_folder.test_editing import addition
from tests.conftest import ROOT, content_of

Content = dict[str, bytes]
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_AT_FAULT = "the disk is at fault"


class Killed(BaseException):
    """The end of a process: nothing that it would still do is done."""


class Faults:
    """Counts the operations that change files, and at one of them lets the process die, or that operation fail."""

    def __init__(self) -> None:
        self.thread, self.at, self.done, self.kills = 0, 0, 0, False
        sys.addaudithook(self._see)

    @contextmanager
    def at_operation(self, at: int, *, kills: bool) -> Iterator[None]:
        """Context in which the operation of this number, from 1, is the last one, or fails."""
        self.thread, self.at, self.done, self.kills = threading.get_ident(), at, 0, kills
        try:
            yield
        finally:
            self.thread = 0

    def _see(self, event: str, given: tuple[object, ...]) -> None:
        if self.thread != threading.get_ident():
            return
        writes = event == "open" and isinstance(given[2], int) and bool(given[2] & _WRITES)
        if not writes and event not in ("os.rename", "os.remove", "os.link", "os.mkdir", "os.rmdir"):
            return
        if not isinstance(given[0], str | os.PathLike) or os.fspath(given[0]).endswith(".in-use"):
            return  # the operating system frees the lock
        self.done += 1
        if self.done == self.at and writes:
            thread, self.thread = self.thread, 0
            Path(os.fspath(given[0])).write_bytes(b"half of wh")  # that far it got
            self.thread = thread
        if self.kills and self.done >= self.at:
            raise Killed
        if self.done == self.at:
            raise OSError(5, _AT_FAULT)


FAULTS = Faults()


def visible(folder: Path) -> Content:
    """All files but those that are hidden."""
    return {name: content for name, content in content_of(folder).items() if not name.startswith(".")}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four tests in files of their own, a CAE run in a table, and a change that can be undone."""
    folder = tmp_path_factory.mktemp("small") / "car"
    speeds = {"A": 22.0, "B": 30.0, "C": 35.0, "D": 40.0}
    tests = [addition(test_id, speed_mph) for test_id, speed_mph in speeds.items()]
    add_to_campaign(folder, {"tests": tests, "cae": [addition("R1", 33.0)]})
    pd.read_csv(folder / "cae" / "R1.csv").assign(id="R1").to_csv(folder / "cae_pulses.csv", index=False)
    shutil.rmtree(folder / "cae")
    shutil.rmtree(folder / ".undo")
    leave_out(folder, ["D"], "its sensor came loose")
    return folder


def _add(folder: Path) -> object:
    runs = [addition("R2", 31.0), addition("R3", 32.0)]
    return add_to_campaign(folder, {"tests": [addition("E", 45.0)], "cae": runs})


CHANGES: dict[str, Callable[[Path], object]] = {
    "leave out": lambda folder: leave_out(folder, ["A"]),
    "use again": lambda folder: use_again(folder, ["D"]),
    "take out": lambda folder: remove_tests(folder, ["B", "D"]),
    "add": _add,
    "undo": undo,
}


@pytest.mark.parametrize("kills", [True, False], ids=["killed", "failed"])
@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.slow
def test_a_change_that_is_cut_short_is_none_or_whole(small: Path, tmp_path: Path, name: str, kills: bool) -> None:
    """At whichever operation; the campaign opens as before or as after, and every change can be undone from there."""
    change, first = CHANGES[name], tmp_path / "first"
    before = visible(small)
    shutil.copytree(small, first)
    change(first)
    after = visible(first)
    undo_all(first)
    origin, reached, at = visible(first), [], 0
    while True:
        at += 1
        folder = shutil.copytree(small, tmp_path / str(at))
        try:
            with FAULTS.at_operation(at, kills=kills):
                change(folder)
        except (Killed, OSError) as error:
            if not kills and _AT_FAULT not in str(error):
                raise
        if FAULTS.done < at:
            break
        settle(folder)
        reached.append(visible(folder))
        assert reached[-1] in (before, after), f"neither, cut short at operation {at}"
        edited = leave_out(folder, ["C"])  # what is left behind is in nobody's way, and sweeps nothing away
        assert changes(folder)[0].what == edited
        undo_all(folder)
        assert visible(folder) == origin, f"not undone, cut short at operation {at}"
        shutil.rmtree(folder)
    assert before in reached
    assert len(reached) > 8


def undo_all(folder: Path) -> None:
    """Undo every change that is kept."""
    while changes(folder):
        undo(folder)


EDITS: dict[str, Callable[[Path, str], object]] = {
    "leave out": lambda folder, test_id: leave_out(folder, [test_id]),
    "say why": lambda folder, test_id: say_why(folder, test_id, 'a "word"'),
    "say no more": lambda folder, test_id: say_why(folder, test_id, ""),
    "use again": lambda folder, test_id: use_again(folder, [test_id]),
    "take out": lambda folder, test_id: remove_tests(folder, [test_id]),
    "add": lambda folder, _: _add(folder),
}


class Editing(RuleBasedStateMachine):
    """Edits and undos in any order, some of which are killed: the folder is always one of the states expected."""

    folder: Path
    small: Path

    @initialize()
    def begin(self) -> None:
        """A folder of its own."""
        self.scratch = Path(tempfile.mkdtemp())
        self.folder = shutil.copytree(self.small, self.scratch / "car")
        undo_all(self.folder)
        self.states = [visible(self.folder)]

    def teardown(self) -> None:
        """What can be undone leads back to the beginning, one state at a time."""
        while changes(self.folder):
            self.states.pop()
            undo(self.folder)
            assert visible(self.folder) == self.states[-1]
        with history.taking_turns(self.folder):
            assert not list(self.folder.glob(".undo/*"))
        shutil.rmtree(self.scratch)

    def change(self, make: Callable[[Path], object], at: int) -> None:
        """Make a change that is killed at an operation, if it has so many, and compare with one that is not."""
        copy = self.scratch / "copy"
        shutil.copytree(self.folder, copy)
        try:
            make(copy)
        except (UsageError, DataError) as error:
            with pytest.raises(type(error)):
                make(self.folder)
            return
        finally:
            after = visible(copy)
            shutil.rmtree(copy)
        try:
            with FAULTS.at_operation(at, kills=True):
                make(self.folder)
        except Killed:
            settle(self.folder)
        if visible(self.folder) != self.states[-1]:
            if make is undo:
                self.states.pop()
            else:
                self.states.append(after)
        assert visible(self.folder) in (self.states[-1], after)

    @rule(edit=st.sampled_from([*EDITS]), test_id=st.sampled_from("ABCDE"), at=st.integers(1, 60))
    def edit(self, edit: str, test_id: str, at: int) -> None:
        """A test, or two CAE runs with it."""
        self.change(lambda folder: EDITS[edit](folder, test_id), at)

    @precondition(lambda self: bool(changes(self.folder)))
    @rule(at=st.integers(1, 60))
    def undo(self, at: int) -> None:
        """The last of them."""
        self.change(undo, at)

    @invariant()
    def nothing_waits(self) -> None:
        """No change is half done, and what is there is the last state that was expected."""
        if hasattr(self, "states"):
            assert visible(self.folder) == self.states[-1]


@pytest.mark.slow
def test_edits_and_undos_in_any_order_keep_every_state(small: Path) -> None:
    """Up to ten, with kills at any operation of any of them."""
    Editing.small = small
    case = Editing.TestCase
    case.settings = settings(max_examples=15, stateful_step_count=8, deadline=None)
    case().runTest()


_EDIT = """
import sys
from pathlib import Path
from crashfuse.campaign_folder.editing import leave_out, use_again
print("ready", flush=True)
sys.stdin.readline()
for _ in range(8):
    leave_out(Path(sys.argv[1]), [sys.argv[2]])
    use_again(Path(sys.argv[1]), [sys.argv[2]])
leave_out(Path(sys.argv[1]), [sys.argv[2]])
"""


@pytest.mark.slow
def test_two_users_with_caches_of_their_own_lose_no_edit(small: Path, tmp_path: Path) -> None:
    """Each of three leaves out a test of theirs, seventeen edits each at one time: all three are left out."""
    folder = shutil.copytree(small, tmp_path / "car")
    undo_all(folder)
    users = []
    for test_id in "ABC":
        environment = {**os.environ, "CRASHFUSE_CACHE": str(tmp_path / test_id), "PYTHONPATH": str(ROOT)}
        command = [sys.executable, "-c", _EDIT, str(folder), test_id]
        users.append(subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
    for user in users:
        assert user.stdout is not None
        assert user.stdout.readline() == b"ready\n"
    for user in users:
        user.communicate(b"go\n")
        assert user.returncode == 0
    assert (folder / "campaign.toml").read_text().startswith('unused = ["A", "B", "C"]\n')
    assert len(changes(folder)) == len(list((folder / ".undo").iterdir())) == 10  # what older ones replaced is let go
    assert not (folder / ".in-use").exists()


def test_who_waits_too_long_is_refused_and_changes_nothing(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even with another cache; once the first has ended, it is let in."""
    folder = shutil.copytree(small, tmp_path / "car")
    before = visible(folder)
    monkeypatch.setattr(history, "_PATIENCE_S", 0.3)
    with ThreadPoolExecutor(1) as other, history.taking_turns(folder):
        monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path / "another"))
        refused = other.submit(leave_out, folder, ["A"]).exception()
        assert (folder / ".in-use").exists()
    assert isinstance(refused, DataError)
    assert f"found process {os.getpid()} on" in str(refused)
    assert visible(folder) == before
    leave_out(folder, ["A"])


def interrupted(folder: Path) -> None:
    """Take a test out, and be killed before the change is complete."""

    def dead(*_: object) -> None:
        raise Killed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "rename", dead)
        patch.setattr(history, "_put_back", dead)
        with pytest.raises(Killed):
            remove_tests(folder, ["B"])


def test_opening_puts_an_interrupted_change_back(campaign_folder: Path) -> None:
    leave_out(campaign_folder, ["T4"])
    (campaign_folder / "tests.csv").write_text((campaign_folder / "tests.csv").read_text().replace("T2", "B"))
    (campaign_folder / "tests" / "T2.csv").rename(campaign_folder / "tests" / "B.csv")
    before = visible(campaign_folder)
    interrupted(campaign_folder)
    assert visible(campaign_folder) != before
    assert load_campaign(campaign_folder).test_ids == ("T1", "B", "T3")
    assert visible(campaign_folder) == before
    assert [change.what for change in changes(campaign_folder)] == ["Left out of use: T4"]


@pytest.mark.parametrize("spoilt", ["tests.csv", ".undo/000002/before/tests/B.csv", ".undo/000002/begun.json"])
def test_what_was_changed_since_an_interruption_is_not_written_over(small: Path, tmp_path: Path, spoilt: str) -> None:
    folder = shutil.copytree(small, tmp_path / "car")
    interrupted(folder)
    (folder / spoilt).write_text("id,speed_mph\nmine,30\n")
    before = content_of(folder)
    for look in (lambda: settle(folder), lambda: leave_out(folder, ["A"])):
        with pytest.raises(DataError, match=r"\.undo/000002"):
            look()
    assert content_of(folder) == before
    shutil.rmtree(folder / ".undo" / "000002")
    settle(folder)


@pytest.mark.parametrize("damage", [b"", b"{", b"\xff", None])
def test_a_damaged_record_of_a_change_blocks_nothing(small: Path, tmp_path: Path, damage: bytes | None) -> None:
    """Edits go on after it and are undone, and what came before it is undone where no file was changed since."""
    folder = shutil.copytree(small, tmp_path / "car")
    before = visible(folder)
    remove_tests(folder, ["B"])
    record = folder / ".undo" / "000002" / "change.json"
    record.unlink() if damage is None else record.write_bytes(damage)
    assert leave_out(folder, ["A"]) == "Left out of use: A"
    assert [change.number for change in changes(folder)] == [3, 1]
    assert (record.parent / "before" / "tests" / "B.csv").read_bytes() == before["tests/B.csv"]
    assert undo(folder).what == "Left out of use: A"
    assert undo(folder).what == "Left out of use: D (its sensor came loose)"
    assert (record.parent / "before" / "tests" / "B.csv").read_bytes() == before["tests/B.csv"]


def test_undo_takes_back_the_change_that_is_meant_alone(small: Path, tmp_path: Path) -> None:
    """If another was made since, it is said whose that is, and nothing is undone."""
    folder = shutil.copytree(small, tmp_path / "car")
    seen = changes(folder)[0]
    with changed_by("anna@example.org"):
        leave_out(folder, ["A"])
    before = content_of(folder)
    with pytest.raises(DataError, match=r"found “Left out of use: A” by anna@example\.org, 20\d\d-"):
        undo(folder, seen)
    assert content_of(folder) == before
    mine = changes(folder)[0]
    assert isinstance(mine, Change)
    assert undo(folder, mine) == mine
    assert undo(folder, seen) == seen


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
@pytest.mark.parametrize("name", ["tests", ".undo"])
def test_nothing_behind_a_link_is_changed(small: Path, tmp_path: Path, name: str) -> None:
    """It may be anybody's: neither by an edit, nor by opening a folder whose last change was interrupted."""
    folder, elsewhere = shutil.copytree(small, tmp_path / "car"), tmp_path / "elsewhere"
    acts: list[Callable[[], object]] = [lambda: remove_tests(folder, ["A"])]
    if name == "tests":
        interrupted(folder)
        acts.append(lambda: settle(folder))
    else:
        (folder / ".undo" / "000001" / "change.json").unlink()  # as of anybody's folder of that name
    (folder / name).rename(elsewhere)
    (folder / name).symlink_to(elsewhere)
    before = content_of(elsewhere)
    for act in acts:
        with pytest.raises(DataError, match="a link to one elsewhere"):
            act()
    assert content_of(elsewhere) == before
