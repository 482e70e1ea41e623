"""The folder of a command's results."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from crashfuse import cli
from crashfuse.files.atomic import sole_writer
from tests.cli.conftest import Shell, run

WEIGHTS = ["--front-weight-lb", "2000", "--rear-weight-lb", "1600"]
COMMANDS = {"predict": ["--speed-mph", "30", *WEIGHTS], "sweep": WEIGHTS}
COMMANDS |= {name: [] for name in ("study", "certify", "train", "learning-curve", "next-test")}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_that_another_command_writes_to_is_refused(
    command: str, campaign_folder: Path, tmp_path: Path, shell: Shell
) -> None:
    """In one sentence, before anything is computed; the other's files are left alone."""
    out = tmp_path / "out"
    with sole_writer(out):
        (out / "begun").touch()
        line, _ = shell.wrong_data(command, campaign_folder, "--out", out, *COMMANDS[command]).splitlines()
        assert [path.name for path in out.iterdir() if not path.name.startswith(".")] == ["begun"]
    assert line.startswith(f"{out}: expected a folder that nobody writes to, found process ")
    assert line.endswith("writing to it; wait until that has ended, or name another.")


@pytest.mark.skipif(sys.platform == "win32", reason="a process is not stopped for a while there")
@pytest.mark.slow
def test_of_two_studies_into_one_folder_the_second_is_refused(campaign_on_disk: Path, tmp_path: Path) -> None:
    """As commands at one time, the first of them stopped in mid-study; it then ends as if nothing had been."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "crashfuse", "study", str(campaign_on_disk), "--out", str(out)]
    command += ["--approach", "cae", "--workers", "1"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as first:
        lock = out / ".in-use"  # named by who holds it, once it is held
        while first.poll() is None and not (lock.is_file() and lock.stat().st_size):
            time.sleep(0.001)
        first.send_signal(signal.SIGSTOP)
        try:
            second = subprocess.run(command, capture_output=True, text=True, check=False)
        finally:
            first.send_signal(signal.SIGCONT)
    assert (first.returncode, second.returncode) == (cli.DONE, cli.WRONG_DATA)
    assert second.stderr.startswith(f"{out}: expected a folder that nobody writes to, found process ")
    assert (out / "scores.csv").is_file()


def test_a_command_that_fails_leaves_no_empty_folder(campaign_folder: Path, tmp_path: Path) -> None:
    """The claim is given back, and with it the folder that was made for it."""
    (campaign_folder / "cae.csv").unlink()
    out = tmp_path / "deep" / "out"
    for _ in range(2):
        assert run("study", campaign_folder, "--out", out) == cli.WRONG_DATA
        assert not out.parent.exists()
