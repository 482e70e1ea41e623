"""The server: its start, what it refuses, and its first seconds."""

import contextlib
import http.client
import http.server
import json
import os
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from crashfuse import cli
from crashfuse.errors import OUT_OF_MEMORY
from tests.conftest import ROOT, Capture
from tests.test_imports import loaded

SAFE = {
    "server.address": "127.0.0.1",
    "server.allowedHosts": ["localhost", "127.0.0.1"],
    "server.enableXsrfProtection": True,
    "server.enableCORS": True,
    "server.enableAgentApi": False,
    "browser.gatherUsageStats": False,
    "client.showErrorDetails": "none",
    "client.allowedOrigins": [],
    "runner.magicEnabled": False,
}
OWN_COMMAND = "from crashfuse.ui.server import launch; launch(8501, None)"
STREAMLITS_COMMAND = "cli.main(['run', 'app.py'], standalone_mode=False)"
_CLOSED = ("/_stcore/metrics", "/_stcore/metrics/", "/_stcore/%6detrics")
_ELSEWHERE, _CONFIGURED = "elsewhere.example", "https://tools.example"


def _pages(port: int) -> list[str]:
    """Where pages come from: from this server, from another one of this machine, and from elsewhere."""
    return [f"localhost:{port}", f"127.0.0.1:{port}", "localhost", f"localhost:{port + 1}", f"{_ELSEWHERE}:{port}"]


def _answers(port: int) -> bool:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/_stcore/health", timeout=5) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def _opened(port: int, host: str, origin: str | None) -> bool:
    """Whether a page of this origin may open, under this name, the socket that all of the dashboard goes through."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    asked = {"Host": host, "Connection": "Upgrade", "Upgrade": "websocket"}
    asked |= {} if origin is None else {"Origin": origin}
    key = {"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}
    connection.request("GET", "/_stcore/stream", headers=asked | key)
    with contextlib.closing(connection):
        return connection.getresponse().status == http.HTTPStatus.SWITCHING_PROTOCOLS


def _headers(port: int, path: str) -> dict[str, str]:
    """The status of an answer, and names, in lower case, and values of what comes before it."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", path)
    with contextlib.closing(connection):
        answer = connection.getresponse()
        return {"status": str(answer.status), **{name.lower(): value for name, value in answer.getheaders()}}


@contextlib.contextmanager
def _network() -> Iterator[tuple[dict[str, str], list[str]]]:
    """All of the network, as a proxy: what to tell a process so that it goes there, and what is asked of it."""
    asked: list[str] = []

    class Proxy(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_error(http.HTTPStatus.BAD_GATEWAY)

        do_CONNECT = do_GET  # noqa: N815 - the name that the base class looks for

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
            """Nothing is logged."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Proxy) as proxy:
        threading.Thread(target=proxy.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{proxy.server_address[1]}"
        yield {"HTTP_PROXY": address, "HTTPS_PROXY": address, "http_proxy": address, "https_proxy": address}, asked
        proxy.shutdown()


@pytest.mark.parametrize("own", [True, False])
@pytest.mark.slow
def test_the_command_serves_until_it_is_ended(own: bool, campaign_folder: Path, tmp_path: Path) -> None:
    """By our command, anywhere, with a relative folder, or by Streamlit's: answers, and is shut to other sites."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "streamlit", "run", "app.py", "--server.port", str(port)]
    if own:
        command = [sys.executable, "-m", "crashfuse", "app", "--port", str(port), "--campaign", campaign_folder.name]
    with (tmp_path / "log").open("wb") as log, _network() as (way, asked):
        environment = {**os.environ, **way, "STREAMLIT_SERVER_HEADLESS": "true"}
        environment["STREAMLIT_SERVER_CORS_ALLOWED_ORIGINS"] = _CONFIGURED
        place = campaign_folder.parent if own else ROOT
        server = subprocess.Popen(command, cwd=place, env=environment, stdout=log, stderr=log)
        deadline = time.monotonic() + 60
        while not _answers(port) and server.poll() is None and time.monotonic() < deadline:
            time.sleep(0.1)
        answered = _answers(port)
        here, proxied = f"localhost:{port}", "localhost"
        asked_by: list[tuple[str, str | None]] = [
            (host, f"http://{page}") for host in (here, f"127.0.0.1:{port}", _ELSEWHERE) for page in _pages(port)
        ]
        asked_by += [(here, None), (here, "null"), (here, _CONFIGURED), (proxied, f"https://{proxied}")]
        opened = [pair for pair in asked_by if answered and _opened(port, *pair)]
        headers = [_headers(port, path) for path in ("/", "/compare", "/_stcore/health", "/%2e%2e/x", *_CLOSED)]
        server.terminate()
        server.wait(60)
    assert answered, (tmp_path / "log").read_text()
    assert not _answers(port)
    told = (tmp_path / "log").read_text()
    assert "Traceback" not in told
    assert told.count(f" page of 'http://{_ELSEWHERE}:{port}': was refused ") == 1  # of three times
    assert server.returncode == 0 or not own  # Streamlit's own says "Aborted!", and by which code depends on the moment
    assert opened == [
        *((host, f"http://{host}") for host in (here, f"127.0.0.1:{port}")),
        *((here, None), (here, _CONFIGURED), (proxied, f"https://{proxied}")),
    ]
    assert {header["x-frame-options"] for header in headers} == {"DENY"}
    (policy,) = {header["content-security-policy"] for header in headers}
    assert policy == "frame-ancestors 'none'; default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'"
    assert [header["status"] for header in headers[-3:]] == ["404"] * 3
    assert asked == []


def test_a_folder_that_is_not_there_is_one_sentence(tmp_path: Path, capsys: Capture) -> None:
    assert cli.main(["app", "--campaign", str(tmp_path / "nowhere")]) == cli.WRONG_USAGE
    assert "There is no folder" in capsys.readouterr().err
    file = tmp_path / "nowhere" / "log"
    assert cli.main(["app", "--log", str(file)]) == cli.WRONG_DATA
    assert capsys.readouterr().err == f"crashfuse: {file} cannot be read or written: no such file or directory.\n"


def test_memory_that_runs_out_while_a_page_is_drawn_is_a_sentence() -> None:
    def page() -> None:
        from crashfuse.ui.server import tell

        assert tell(MemoryError())
        assert not tell(ValueError())

    app = AppTest.from_function(page).run()
    assert not app.exception
    assert [error.value for error in app.error] == [OUT_OF_MEMORY]


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


OPEN_WIDE = {
    "STREAMLIT_SERVER_ADDRESS": "0.0.0.0",  # noqa: S104
    "STREAMLIT_SERVER_ALLOWED_HOSTS": "*",
    "STREAMLIT_SERVER_ENABLE_XSRF_PROTECTION": "false",
    "STREAMLIT_SERVER_ENABLE_AGENT_API": "true",
    "STREAMLIT_BROWSER_GATHER_USAGE_STATS": "true",
    "STREAMLIT_CLIENT_SHOW_ERROR_DETAILS": "full",
}


@pytest.mark.parametrize(
    ("command", "folder", "environment"),
    [(OWN_COMMAND, Path("/"), {}), (OWN_COMMAND, Path("/"), OPEN_WIDE), (STREAMLITS_COMMAND, ROOT, {})],
)
@pytest.mark.slow
def test_nothing_leaves_the_machine(command: str, folder: Path, environment: dict[str, str]) -> None:
    """One machine, no telemetry, no strangers' requests, no tracebacks for them; uploads of up to 200 MB.

    Nor do settings for other dashboards of the same user open the one of our command.
    """
    assert _settings(command, folder, {**os.environ, **environment}) == {**SAFE, "server.maxUploadSize": 200}


def test_the_server_starts_before_anything_slow_is_imported() -> None:
    """Neither PyTorch nor SciPy, scikit-learn or pandas: they are imported while the first page's frame is painted."""
    (found,) = loaded("import sys, crashfuse.ui.server; print(*sys.modules)")
    assert found
    assert not {"torch", "scipy", "sklearn", "pandas"} & found
