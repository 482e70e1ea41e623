"""The log of a server: one line for each thing that somebody did."""

import logging
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from crashfuse.ui import journal
from crashfuse.ui.jobs import Jobs
from crashfuse.ui.visitors import Visitor

ANNA = Visitor("k1", "anna@example.com")


@pytest.fixture(autouse=True)
def as_it_was() -> Iterator[None]:
    """The program's loggers are given back as they were."""
    whole = logging.getLogger("crashfuse")
    before = list(whole.handlers), whole.propagate
    yield
    for handler in whole.handlers:
        handler.close()
    whole.handlers[:], whole.propagate = before


def test_a_line_tells_when_who_and_what(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A job's start and end, with the reason if it failed; lines are appended, and none is made by a name."""
    file = tmp_path / "log"
    file.write_text("before\n")
    monkeypatch.setenv(journal.LOG, str(file))
    journal.begin()
    journal.note(ANNA, "opened /srv/evil\n2026 ben: opened everything")
    assert Jobs().start("a", "sled: fit", lambda _: 1 / 0, ANNA).wait(10)
    before, opened, *lines = file.read_text().splitlines()
    assert before == "before"
    stamp = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d{4} anna@example\.com: "
    assert re.fullmatch(stamp + r"opened /srv/evil\\n2026 ben: opened everything", opened)
    assert re.fullmatch(stamp + "started: sled: fit", lines[0])
    assert re.fullmatch(stamp + r"failed: sled: fit \(This should not have happened \(ZeroDivisionError.*", lines[-1])
    assert "Traceback (most recent call last):" in lines


def test_a_refused_page_is_told_with_what_to_do_once_a_minute(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither name is long or begins a line; another origin has its own line, but a flood of origins has an end."""
    monkeypatch.delenv(journal.LOG, raising=False)
    journal.begin()
    refusals = journal.Refusals()
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


def test_without_a_file_lines_go_to_standard_error(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each once."""
    monkeypatch.delenv(journal.LOG, raising=False)
    journal.begin()
    journal.begin()
    journal.note({ANNA, Visitor("k2", "browser 0a1b2c")}, "did it")
    assert capsys.readouterr().err.count("anna@example.com and browser 0a1b2c: did it\n") == 1
