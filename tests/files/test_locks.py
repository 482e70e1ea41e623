"""One writer a folder."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from crashfuse.errors import DataError
from crashfuse.files.atomic import NAME, locked, sole_writer

_HOLD = (
    "import sys\n"
    "from pathlib import Path\n"
    "from crashfuse.files.atomic import sole_writer\n"
    "with sole_writer(Path(sys.argv[1])):\n"
    "    print('held', flush=True)\n"
    "    sys.stdin.read()\n"
)


@contextmanager
def _held_by_another(folder: Path) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, "-c", _HOLD, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        yield other
        if other.stdin is not None:
            other.stdin.close()


def test_a_second_process_is_refused_and_told_who_writes(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with (
        _held_by_another(out) as other,
        pytest.raises(DataError, match=rf"out: expected .* found process {other.pid} on .* writing to it; wait until"),
        sole_writer(out),
    ):
        pytest.fail("It was let in.")
    with sole_writer(out):
        (out / "result").touch()
    assert [path.name for path in out.iterdir()] == ["result"]
    with sole_writer(tmp_path / "for" / "nothing"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_the_claim_of_a_process_that_was_killed_is_free(tmp_path: Path) -> None:
    with _held_by_another(tmp_path) as other:
        other.send_signal(signal.SIGKILL if sys.platform != "win32" else signal.SIGTERM)
        other.wait(20)
        with sole_writer(tmp_path):
            pass
    assert list(tmp_path.iterdir()) == []


def test_of_many_that_wait_one_at_a_time_is_let_in(tmp_path: Path) -> None:
    count = tmp_path / "count"
    count.write_text("0")

    def add(_: int) -> None:
        with locked(tmp_path / "lock", 30.0):
            before = int(count.read_text())
            time.sleep(0.001)
            count.write_text(str(before + 1))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(add, range(100)))
    assert count.read_text() == "100"
    assert [path.name for path in tmp_path.iterdir()] == ["count"]


@pytest.mark.skipif(sys.platform == "win32", reason="rights are no bits there")
def test_what_a_killed_process_left_can_be_locked_by_another_user(tmp_path: Path) -> None:
    mask = os.umask(0o077)
    try:
        with sole_writer(tmp_path):
            assert (tmp_path / NAME).stat().st_mode & 0o666 == 0o666
    finally:
        os.umask(mask)


def test_where_files_cannot_be_locked_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("crashfuse.files.atomic.FileLock.acquire", fail)
    with pytest.raises(OSError, match="No locks"), sole_writer(tmp_path / "out"):
        pytest.fail("It was let in.")
    assert list(tmp_path.iterdir()) == []
