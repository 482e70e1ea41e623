"""The log of a server."""

import re
import time
from pathlib import Path

import pytest

from crashfuse.execution import server_log
from crashfuse.execution.jobs import Jobs
from crashfuse.execution.server_log import Visitor
from tests.conftest import Capture

ANNA = Visitor("k1", "anna@example.com")


def test_a_line_tells_when_who_and_what(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A job's start and end, with the reason if it failed; lines are appended, and none is made by a name."""
    file = tmp_path / "log"
    file.write_text("before\n")
    monkeypatch.setenv(server_log.LOG, str(file))
    server_log.begin_log()
    server_log.note_in_log(ANNA, "opened /srv/evil\n2026 ben: opened everything")
    assert Jobs().start("a", "sled: fit", lambda _: 1 / 0, ANNA).wait(10)
    before, opened, *lines = file.read_text().splitlines()
    assert before == "before"
    stamp = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d{4} anna@example\.com: "
    assert re.fullmatch(stamp + r"opened /srv/evil\\n2026 ben: opened everything", opened)
    assert re.fullmatch(stamp + "started: sled: fit", lines[0])
    assert re.fullmatch(stamp + r"failed: sled: fit \(This should not have happened \(ZeroDivisionError.*", lines[-1])
    assert "Traceback (most recent call last):" in lines


def test_a_refused_page_is_told_with_what_to_do_once_a_minute(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither name is long or begins a line; another origin has its own line, but a flood of origins has an end."""
    monkeypatch.delenv(server_log.LOG, raising=False)
    server_log.begin_log()
    refusals = server_log.Refusals()
    for _ in range(3):
        refusals.note("https://proxy.example\n2026 anna: opened all", "127.0.0.1:8501")
    (line,) = capsys.readouterr().err.splitlines()
    assert r" page of 'https://proxy.example\n2026 anna: opened all': was refused and stays empty, for " in line
    assert " asked for as '127.0.0.1:8501'. " in line
    assert line.endswith("or add the address to server.corsAllowedOrigins.")
    refusals.note("https://" + "x" * 5000, "y" * 5000)
    (line,) = capsys.readouterr().err.splitlines()
    assert len(line) < 800
    for i in range(1000):
        refusals.note(f"https://{i}.example", None)
    assert len(capsys.readouterr().err.splitlines()) == 18
    later = time.monotonic() + 61
    monkeypatch.setattr("time.monotonic", lambda: later)
    refusals.note("https://0.example", "localhost")
    assert "https://0.example" in capsys.readouterr().err
    server_log.begin_log()  # once more, and each line is still there once
    server_log.note_in_log({ANNA, Visitor("k2", "browser 0a1b2c")}, "did it")
    assert capsys.readouterr().err.count("anna@example.com and browser 0a1b2c: did it\n") == 1
