"""`crashfuse app` serves the dashboard, on this machine only, and ends with its process."""

import os
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from crashfuse import cli


def _answers(port: int) -> bool:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/_stcore/health", timeout=5) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def test_the_command_serves_until_it_is_ended(campaign_folder: Path, tmp_path: Path) -> None:
    """Started anywhere, with a relative folder: it answers, and nothing is left running behind it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "crashfuse", "app", "--port", str(port), "--campaign", campaign_folder.name]
    environment = {**os.environ, "STREAMLIT_SERVER_HEADLESS": "true"}
    with (tmp_path / "log").open("wb") as log:
        server = subprocess.Popen(command, cwd=campaign_folder.parent, env=environment, stdout=log, stderr=log)
        deadline = time.monotonic() + 60
        while not _answers(port) and server.poll() is None and time.monotonic() < deadline:
            time.sleep(0.1)
        answered = _answers(port)
        server.terminate()
        server.wait(20)
    assert answered, (tmp_path / "log").read_text()
    assert not _answers(port)


def test_a_campaign_that_is_not_there_is_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence before any server starts."""
    assert cli.main(["app", "--campaign", str(tmp_path / "nowhere")]) == cli.WRONG_USAGE
    assert "There is no folder" in capsys.readouterr().err
