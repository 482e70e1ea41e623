"""One writer a folder."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from crashfuse.errors import CrashfuseError
from crashfuse.files.claim import sole_writer

_HOLD = (
    "import sys\n"
    "from pathlib import Path\n"
    "from crashfuse.files.claim import sole_writer\n"
    "with sole_writer(Path(sys.argv[1])):\n"
    "    print('held', flush=True)\n"
    "    sys.stdin.read()\n"
)


@contextmanager
def _held_by_another(folder: Path) -> Iterator["subprocess.Popen[str]"]:
    """A process that writes to the folder until its input ends."""
    command = [sys.executable, "-c", _HOLD, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        yield other
        if other.stdin is not None:
            other.stdin.close()


def test_a_second_process_is_refused_and_told_who_writes(tmp_path: Path) -> None:
    """Until the first has ended; then nothing of the claim is left."""
    out = tmp_path / "out"
    with (
        _held_by_another(out) as other,
        pytest.raises(CrashfuseError, match=rf"\(process {other.pid} on .*\) is writing to .*out; wait until it"),
        sole_writer(out),
    ):
        pytest.fail("It was let in.")
    with sole_writer(out):
        (out / "result").touch()
    assert [path.name for path in out.iterdir()] == ["result"]


def test_the_claim_of_a_process_that_was_killed_is_free(tmp_path: Path) -> None:
    """Nobody has to remove anything by hand."""
    with _held_by_another(tmp_path) as other:
        other.send_signal(signal.SIGKILL if sys.platform != "win32" else signal.SIGTERM)
        other.wait(20)
        with sole_writer(tmp_path):
            pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_made_for_nothing_is_taken_away(tmp_path: Path) -> None:
    """A command that is refused for another reason leaves no empty folders."""
    with sole_writer(tmp_path / "a" / "b"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_where_files_cannot_be_locked_nobody_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An unfair refusal is worse there than two writers, each of whose files is whole."""

    def fail(*_: object, **__: object) -> None:
        raise NotImplementedError

    monkeypatch.setattr("crashfuse.files.claim.FileLock.acquire", fail)
    with sole_writer(tmp_path):
        (tmp_path / "result").touch()
    assert (tmp_path / "result").exists()
