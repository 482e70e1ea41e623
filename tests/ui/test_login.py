"""The log-in: a server on which it is set up wrongly does not start."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from crashfuse import cli
from crashfuse.errors import DataError, UsageError
from crashfuse.ui import login

if TYPE_CHECKING:
    from tests.ui.conftest import Session

GOOD = """
[auth]
redirect_uri = "https://crashfuse.example.com/oauth2callback"
cookie_secret = "0123456789abcdef0123456789abcdef"
client_id = "crashfuse"
client_secret = "xxx"
server_metadata_url = "https://login.example.com/.well-known/openid-configuration"
"""
NAMED = GOOD.replace("client_id", "[auth.example]\nclient_id")


@pytest.mark.parametrize("text", [GOOD, NAMED, "other = 1", ""])
def test_what_streamlit_understands_is_taken(text: str, tmp_path: Path) -> None:
    """One provider, several by name, or none."""
    file = tmp_path / "secrets.toml"
    file.write_text(text)
    login.check([file, tmp_path / "nowhere.toml"])


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
    text: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sentence for each thing that is wrong, exit code 1."""
    file = tmp_path / "secrets.toml"
    file.write_text(text)
    with pytest.raises(DataError, match=sentence):
        login.check([file])
    assert cli.main(["app", "--login", str(file)]) == cli.WRONG_DATA
    assert "problem" in capsys.readouterr().err


def test_a_log_in_that_was_asked_for_must_be_set_up(tmp_path: Path) -> None:
    """A file without the section, or no file at all."""
    (tmp_path / "empty.toml").touch()
    for name in ("empty.toml", "nowhere.toml"):
        assert cli.main(["app", "--login", str(tmp_path / name)]) == cli.WRONG_DATA


def test_what_the_log_in_needs_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The extra, by the command that installs it."""
    file = tmp_path / "secrets.toml"
    file.write_text(GOOD)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(UsageError, match=r'pip install "crashfuse\[login\]"'):
        login.check([file])


@pytest.mark.usefixtures("open_campaign")
def test_a_log_in_stays_required_if_its_file_is_lost(
    visit: Callable[..., "Session"], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Streamlit would then know of no log-in, and let in everybody."""
    lost = threading.Event()
    lost.set()
    monkeypatch.setattr(login, "_insisted", lost)
    session = visit("train")
    assert "Nobody can log in at the moment." in session.words
    assert not session.app.selectbox
    assert not session.charts
