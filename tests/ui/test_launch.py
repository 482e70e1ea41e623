"""`crashfuse app` serves the dashboard, on this machine only, and ends with its process."""

import contextlib
import http.client
import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from streamlit import net_util
from streamlit.web.server.server_util import is_url_from_allowed_origins

from crashfuse import cli
from crashfuse.ui import launch as launching
from tests.conftest import ROOT

SAFE = {
    "server.address": "127.0.0.1",
    "server.allowedHosts": ["localhost", "127.0.0.1"],
    "server.enableXsrfProtection": True,
    "server.enableCORS": True,
    "browser.gatherUsageStats": False,
    "client.showErrorDetails": "none",
}
OWN_COMMAND = "from crashfuse.ui.launch import launch; launch(8501, None)"
STREAMLITS_COMMAND = "cli.main(['run', 'app.py'], standalone_mode=False)"


def _answers(port: int) -> bool:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/_stcore/health", timeout=5) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def _opened(port: int, host: str) -> bool:
    """Whether a page under this name may open the socket that all of the dashboard goes through."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    asked = {
        "Host": f"{host}:{port}",
        "Origin": f"http://{host}:{port}",
        "Connection": "Upgrade",
        "Upgrade": "websocket",
    }
    key = {"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}
    connection.request("GET", "/_stcore/stream", headers=asked | key)
    with contextlib.closing(connection):
        return connection.getresponse().status == http.HTTPStatus.SWITCHING_PROTOCOLS


@pytest.mark.slow
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
        opened = {host: answered and _opened(port, host) for host in ("127.0.0.1", "localhost", "elsewhere.example")}
        server.terminate()
        server.wait(20)
    assert answered, (tmp_path / "log").read_text()
    assert not _answers(port)
    assert opened == {"127.0.0.1": True, "localhost": True, "elsewhere.example": False}


def test_a_campaign_that_is_not_there_is_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence before any server starts."""
    assert cli.main(["app", "--campaign", str(tmp_path / "nowhere")]) == cli.WRONG_USAGE
    assert "There is no folder" in capsys.readouterr().err


def test_a_page_that_is_refused_makes_no_look_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A stranger's page that tries the dashboard does not make it ask the network for this machine's own address."""
    monkeypatch.setattr(launching, "main", lambda *_, **__: None)
    monkeypatch.setattr(net_util, "_external_ip", None)
    monkeypatch.setattr(net_util, "_make_blocking_http_get", lambda *_, **__: pytest.fail("it was asked"))
    monkeypatch.chdir(tmp_path)
    launching.launch(8501, None)
    assert not is_url_from_allowed_origins("http://elsewhere.example")
    assert is_url_from_allowed_origins("http://localhost:8501")


def _settings(command: str, folder: Path, environment: dict[str, str]) -> dict[str, object]:
    """What Streamlit makes of its files, the environment and a command line, in a process of its own."""
    program = (
        "import json, os, sys\n"
        "from streamlit import config\n"
        "from streamlit.web import bootstrap, cli\n"
        "bootstrap.run_asgi_app = lambda *_, **__: None\n"
        "sys.argv = ['crashfuse']\n"
        f"{command}\n"
        f"names = {[*SAFE, 'server.maxUploadSize']!r}\n"
        "print(json.dumps({name: config.get_option(name) for name in names}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=environment, check=True, capture_output=True, text=True
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize(("command", "folder"), [(OWN_COMMAND, Path("/")), (STREAMLITS_COMMAND, ROOT)])
@pytest.mark.slow
def test_nothing_leaves_the_machine_by_default(command: str, folder: Path) -> None:
    """One machine, no telemetry, no strangers' requests, no tracebacks for them; uploads of up to 200 MB."""
    assert _settings(command, folder, dict(os.environ)) == {**SAFE, "server.maxUploadSize": 200}


@pytest.mark.slow
def test_the_command_is_safe_whatever_the_environment_says() -> None:
    """Settings for other dashboards of the same user do not open this one."""
    open_wide = {
        "STREAMLIT_SERVER_ADDRESS": "0.0.0.0",  # noqa: S104
        "STREAMLIT_SERVER_ALLOWED_HOSTS": "*",
        "STREAMLIT_SERVER_ENABLE_XSRF_PROTECTION": "false",
        "STREAMLIT_BROWSER_GATHER_USAGE_STATS": "true",
        "STREAMLIT_CLIENT_SHOW_ERROR_DETAILS": "full",
    }
    found = _settings(OWN_COMMAND, Path("/"), {**os.environ, **open_wide})
    assert {name: found[name] for name in SAFE} == SAFE
