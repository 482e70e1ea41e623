"""Writing: all or nothing, whatever happens in the middle."""

import os
import subprocess
import sys
import time
from pathlib import Path
from uuid import uuid4

import pytest

from crashfuse import cli
from crashfuse.errors import DataError
from crashfuse.files.atomic import new_folder, write_atomically, written_together
from tests.conftest import Capture, content_of


def test_files_get_to_their_folder_together(tmp_path: Path) -> None:
    write_atomically(tmp_path / "a.csv", b"old")
    with written_together(tmp_path, last="a.csv") as folder:
        write_atomically(folder / "a.csv", b"new")
        write_atomically(folder / "more" / "b.csv", b"new")
        assert (tmp_path / "a.csv").read_bytes() == b"old"
    assert content_of(tmp_path) == {"a.csv": b"new", "more/b.csv": b"new"}
    assert len(list(tmp_path.iterdir())) == 2


def test_the_file_that_tells_of_the_others_moves_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the machine stops between two moves, it does not claim what is not there."""
    moved: list[str] = []
    replace = Path.replace

    def recorded(self: Path, target: Path) -> Path:
        moved.append(target.name)
        return replace(self, target)

    with written_together(tmp_path, last="a.json") as folder:
        for name in ("a.json", "b.csv", "z.csv"):
            write_atomically(folder / name, b"")
        monkeypatch.setattr(Path, "replace", recorded)
    assert moved[-1] == "a.json"
    assert len(moved) == 3


def test_files_that_cannot_all_be_written_change_nothing(tmp_path: Path) -> None:
    write_atomically(tmp_path / "a.csv", b"old")
    with pytest.raises(OSError, match="No space"), written_together(tmp_path, last="b.csv") as folder:  # noqa: PT012
        write_atomically(folder / "a.csv", b"new")
        raise OSError(28, "No space left on device")
    assert content_of(tmp_path) == {"a.csv": b"old"}
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("there", [False, True])
def test_a_new_folder_appears_when_it_is_whole(tmp_path: Path, there: bool) -> None:
    """It may take the place of an empty folder; of a file, or of a folder that holds anything, it never does."""
    folder = tmp_path / "c"
    if there:
        folder.mkdir()
    with new_folder(folder) as home:
        write_atomically(home / "a.csv", b"new")
        assert not content_of(folder)
    assert content_of(tmp_path) == {"c/a.csv": b"new"}
    for taken in (folder, folder / "a.csv"):
        with pytest.raises(DataError, match="a folder that holds nothing yet"), new_folder(taken):
            pass
    assert content_of(tmp_path) == {"c/a.csv": b"new"}


@pytest.mark.parametrize("folder", [False, True])
def test_what_the_disk_has_no_room_for_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: bool) -> None:
    """A full disk names no file, and the temporary name would say nothing: it is the one that was asked for."""

    def full(path: Path, _: bytes) -> int:
        path.touch()
        raise OSError(28, "No space left on device")

    def write(target: Path) -> None:
        if not folder:
            write_atomically(target, b"new")
            return
        with new_folder(target) as home:
            write_atomically(home / "a.csv", b"new")

    monkeypatch.setattr(Path, "write_bytes", full)
    target = tmp_path / "report.html"
    with pytest.raises(OSError, match="No space left") as caught:
        write(target)
    assert caught.value.filename == str(target)
    assert not content_of(tmp_path)


@pytest.mark.slow
def test_a_disk_that_is_full_at_the_end_of_a_study_costs_nothing_but_time(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """One sentence, exit code 1, no table of this study; the same command then writes them all."""

    def full(path: Path, content: bytes) -> None:
        if path.name == "metrics.csv":
            raise OSError(28, "No space left on device", str(path))
        write_atomically(path, content)

    out = tmp_path / "out"
    command = ["study", str(campaign_on_disk), "--out", str(out), "--approach", "cae", "--held-out", "T1"]
    monkeypatch.setattr("crashfuse.results.files.write_atomically", full)
    assert cli.main(command) == cli.WRONG_DATA
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith(f"crashfuse: Nothing was written to {out}: No space left on device. What was finished")
    assert list(content_of(out)) == ["study.json"]
    assert b'"finished": false' in (out / "study.json").read_bytes()
    monkeypatch.undo()
    assert cli.main([*command, "--resume"]) == cli.DONE
    assert {"scores.csv", "pulses.csv", "metrics.csv", "report.html", "study.json"} == set(content_of(out))


def test_what_a_killed_process_left_is_cleared_away_in_time(tmp_path: Path) -> None:
    """Killed in mid-write, it leaves a file. A day later it goes, and nothing else: until then it may be anybody's."""
    write = "import os, sys; from crashfuse.files import atomic; os.fsync = lambda _: os.kill(os.getpid(), 9); "
    write += "atomic.write_atomically(atomic.Path(sys.argv[1], 'a'), b'1')"
    for folder in (tmp_path / "now", tmp_path / "later"):
        assert subprocess.run([sys.executable, "-c", write, str(folder)], check=False).returncode != 0
    earlier = tmp_path / "later" / f".unfinished-elsewhere-2-{uuid4().hex}"  # of the first version
    named_alike = tmp_path / "later" / ".unfinished-business"
    earlier.mkdir()
    named_alike.touch()
    for path in (tmp_path / "later").iterdir():
        os.utime(path, (time.time() - 90_000,) * 2)
    for folder in (tmp_path / "now", tmp_path / "later"):
        write_atomically(folder / "a", b"1")
    assert {path.name for path in (tmp_path / "later").iterdir()} == {"a", ".unfinished-business"}
    assert len(list((tmp_path / "now").iterdir())) == 2
