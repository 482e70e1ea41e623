"""The log of a server, and whether its log-in can work."""

import logging
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from crashfuse import cli
from crashfuse.errors import DataError, UsageError
from crashfuse.execution import visitors
from crashfuse.execution.jobs import Jobs
from crashfuse.execution.visitors import Visitor
from tests.conftest import Capture

ANNA = Visitor("k1", "anna@example.com")
GOOD = """
[auth]
redirect_uri = "https://crashfuse.example.com/oauth2callback"
cookie_secret = "0123456789abcdef0123456789abcdef"
client_id = "crashfuse"
client_secret = "xxx"
server_metadata_url = "https://login.example.com/.well-known/openid-configuration"
"""
NAMED = GOOD.replace("client_id", "[auth.example]\nclient_id")


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
    monkeypatch.setenv(visitors.LOG, str(file))
    visitors.begin_log()
    visitors.note_in_log(ANNA, "opened /srv/evil\n2026 ben: opened everything")
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
    monkeypatch.delenv(visitors.LOG, raising=False)
    visitors.begin_log()
    refusals = visitors.Refusals()
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
    visitors.begin_log()  # once more, and each line is still there once
    visitors.note_in_log({ANNA, Visitor("k2", "browser 0a1b2c")}, "did it")
    assert capsys.readouterr().err.count("anna@example.com and browser 0a1b2c: did it\n") == 1


@pytest.mark.parametrize(("text", "asks"), [(GOOD, True), (NAMED, True), ("other = 1", False), ("", False)])
def test_what_streamlit_understands_is_taken(text: str, asks: bool, tmp_path: Path) -> None:
    file = tmp_path / "secrets.toml"
    file.write_text(text)
    assert visitors.check_login([file, tmp_path / "nowhere.toml"]) is asks


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (GOOD.replace("[auth]", "[auth"), "expected a TOML file that can be read"),
        ("[auth]", r"\[auth\]: expected redirect_uri, found none"),
        (NAMED.replace("client_secret", "secret"), "expected client_secret, found none"),
        (GOOD.replace("/oauth2callback", ""), "expected the server's address with /oauth2callback"),
        (GOOD.replace("0123456789abcdef0123456789abcdef", "short"), "expected at least 32 random characters, found 5"),
    ],
)
def test_a_server_that_would_let_in_everybody_does_not_start(
    text: str, sentence: str, tmp_path: Path, capsys: Capture
) -> None:
    """One sentence for each thing that is wrong, exit code 1."""
    file = tmp_path / "secrets.toml"
    file.write_text(text)
    with pytest.raises(DataError, match=sentence):
        visitors.check_login([file])
    assert cli.main(["app", "--login", str(file)]) == cli.WRONG_DATA
    assert "problem" in capsys.readouterr().err


def test_a_log_in_that_was_asked_for_must_be_set_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither a file without the section, nor no file; the extra that it needs is named."""
    (tmp_path / "empty.toml").touch()
    for name in ("empty.toml", "nowhere.toml"):
        assert cli.main(["app", "--login", str(tmp_path / name)]) == cli.WRONG_DATA
    file = tmp_path / "secrets.toml"
    file.write_text(GOOD)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(UsageError, match=r'pip install "\.\[login\]"'):
        visitors.check_login([file])
