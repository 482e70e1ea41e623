"""A server of its own and people in front of a real browser."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar
from urllib.parse import quote_plus, urlsplit

import pytest
from selenium import webdriver
from selenium.common.exceptions import ElementNotInteractableException, StaleElementReferenceException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

ROOT = Path(__file__).resolve().parents[2]
SOON = 60.0  # s, where other things run too
_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--window-size=1440,1000",
)
_REDRAWN = (StaleElementReferenceException, ElementNotInteractableException)  # while the page changes
MAIN, LINK = '[data-testid="stMain"]', '[data-testid="stSidebar"] [data-testid="stPageLink-NavLink"]'
T = TypeVar("T")


@dataclass(frozen=True)
class Server:
    """A dashboard."""

    address: str
    log_file: Path

    @property
    def log(self) -> str:
        """What it has printed so far."""
        return self.log_file.read_text(encoding="utf-8")


@dataclass(frozen=True)
class User:
    """Someone in front of the browser; every step waits until it can be taken."""

    browser: WebDriver
    downloads: Path

    def wait(self, found: Callable[[], T], missing: str = "", timeout_s: float = SOON) -> T:
        """Wait until something is found; returns it."""
        waiting = WebDriverWait(self.browser, timeout_s, poll_frequency=0.1, ignored_exceptions=_REDRAWN)
        return waiting.until(lambda _: found(), missing)

    def open(self, server: Server, page: str, **view: str) -> None:
        """Open a page by its link."""
        query = "&".join(f"{name}={quote_plus(value)}" for name, value in view.items())
        self.browser.get(f"{server.address}/{page}?{query}")

    def all(self, css: str) -> list[WebElement]:
        """All elements of this kind that can be seen."""
        return [element for element in self.browser.find_elements(By.CSS_SELECTOR, css) if element.is_displayed()]

    def find(self, css: str, words: str = "") -> WebElement:
        """Wait for an element of this kind with these words."""
        return self.wait(lambda: [e for e in self.all(css) if words in e.text], f"There is no {css} with {words!r}.")[0]

    def sees(self, words: str, css: str = MAIN, timeout_s: float = SOON) -> str:
        """Wait until an element of this kind (the page's main part) shows these words; returns all that it shows."""
        return self.wait(
            lambda: next((e.text for e in self.all(css) if words in e.text), ""),
            f"{css} never showed {words!r}.",
            timeout_s,
        )

    def press(self, label: str, css: str = "button") -> None:
        """Click the first element of this kind with this label."""

        def pressed() -> bool:
            for element in self.all(css):
                if label in element.text and element.is_enabled():
                    self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
                    element.click()
                    return True
            return False

        self.wait(pressed, f"There is no {label!r} to click.")

    def fill(self, label: str, text: str) -> None:
        """Type into the field of this label, and leave it."""

        def filled() -> bool:
            for field in self.all(f'input[aria-label="{label}"]'):
                field.send_keys(Keys.CONTROL, "a")
                field.send_keys(f"{text}\t")
                return True
            return False

        self.wait(filled, f"There is no field {label!r}.")

    def go(self, page: str) -> None:
        """Turn to a page by the link in the sidebar."""
        self.press(page, LINK)

    def choose_approaches(self, *labels: str) -> None:
        """On Train, choose these approaches of all."""
        for label in {"CAE", "LF TCN", "Time domain", "Displacement domain", "Fused"} - set(labels):
            self.press(label, '[data-testid="stButtonGroup"] button')
            self.wait(
                lambda label=label: any(  # type: ignore[misc]
                    label in e.text and e.get_attribute("aria-pressed") == "false"
                    for e in self.all('[data-testid="stButtonGroup"] button')
                )
            )

    def open_tab(self, label: str) -> None:
        """Open a tab of the page."""
        self.press(label, '[class*="_tab"] button')

    def sits_at(self, width: int, height: int, zoom: float = 1.0) -> None:
        """Make the window so many pixels large, and zoom the page."""
        size = {"width": round(width / zoom), "height": round(height / zoom)}
        self.browser.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride", {**size, "deviceScaleFactor": zoom, "mobile": False}
        )

    def prefers(self, theme: str) -> None:
        """Let the system behind the browser prefer the light or the dark theme."""
        feature = {"name": "prefers-color-scheme", "value": theme}
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})

    def downloads_file(self, name: str) -> str:
        """Press the button of a file; returns what is in it once it has arrived."""
        self.press(name, '[data-testid="stDownloadButton"] button')
        file = self.downloads / name
        self.wait(file.is_file, f"{name} never arrived.")  # under another name until it is whole
        return file.read_text(encoding="utf-8")


@contextmanager
def serve(folder: Path, campaign: Path | None = None, *options: str) -> Iterator[Server]:
    """Run the dashboard as ``streamlit run app.py`` does, or ``crashfuse app`` with options, with an empty cache."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "streamlit", "run", "app.py"]
    command += ["--server.port", str(port)]
    if options:
        command = [sys.executable, "-m", "crashfuse", "app", "--port", str(port), *options]
    environment = {**os.environ, "CRASHFUSE_CACHE": str(folder / "cache"), "STREAMLIT_SERVER_HEADLESS": "true"}
    environment.pop("CRASHFUSE_CAMPAIGN", None)
    (folder / "tmp").mkdir()
    environment["TMPDIR"] = str(folder / "tmp")
    if campaign is not None:
        environment["CRASHFUSE_CAMPAIGN"] = str(campaign)
    started = Server(f"http://127.0.0.1:{port}", folder / "server.log")
    with started.log_file.open("wb") as log:
        process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=log, stderr=subprocess.STDOUT)
        try:
            _wait_until_up(started, process)
            yield started
        finally:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            sys.stdout.write(started.log)  # shown if the test fails
    assert "Traceback" not in started.log
    if process.returncode != -signal.SIGKILL:
        assert [path.name for path in (folder / "tmp").glob("crashfuse-*")] == []  # uploads, and what workers shared


def _wait_until_up(server: Server, process: "subprocess.Popen[bytes]") -> None:
    deadline = time.monotonic() + SOON
    while time.monotonic() < deadline and process.poll() is None:
        try:
            # the health check starts no session: the server stays cold
            with urllib.request.urlopen(f"{server.address}/_stcore/health", timeout=5):  # noqa: S310
                return
        except OSError:
            time.sleep(0.1)
    pytest.fail(f"The dashboard did not start:\n{server.log}")


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    """A dashboard that no session has used yet, with no campaign open."""
    with serve(tmp_path) as started:
        yield started


@pytest.fixture(scope="module")
def small_server(campaign_on_disk: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """One dashboard for all tests of a module, with the small campaign open."""
    with serve(tmp_path_factory.mktemp("server"), campaign_on_disk) as started:
        yield started


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WebDriver]:
    """One Chromium for all tests, with a fresh profile, which notes every request it makes."""
    programs = [shutil.which(name) for name in ("chromium", "chromedriver")]
    if None in programs:
        reason = "chromium and chromedriver are not installed (Debian: apt-get install chromium chromium-driver)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    options = webdriver.ChromeOptions()
    options.binary_location = str(programs[0])
    options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
    for flag in (*_FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=Service(str(programs[1])))
    try:
        yield driver
    finally:
        driver.quit()


def _foreign_hosts(browser: WebDriver) -> set[str]:
    """Hosts other than the server that the pages sent anything to."""
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]  # type: ignore[no-untyped-call]
    addresses = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert addresses
    hosts = {urlsplit(address).hostname for address in addresses if address.startswith(("http", "ws"))}
    return {str(host) for host in hosts - {"127.0.0.1"}}


@pytest.fixture
def user(chromium: WebDriver, tmp_path: Path) -> Iterator[User]:
    """Someone with an empty page before them, in the light theme; nothing that they do leaves the machine."""
    folder = tmp_path / "downloads"
    chromium.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(folder)})
    someone = User(chromium, folder)
    someone.prefers("light")
    chromium.get_log("performance")  # type: ignore[no-untyped-call] # what came before is not theirs
    yield someone
    for tab in chromium.window_handles[1:]:
        chromium.switch_to.window(tab)
        chromium.close()
    chromium.switch_to.window(chromium.window_handles[0])
    chromium.get("about:blank")
    chromium.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert _foreign_hosts(chromium) == set()
