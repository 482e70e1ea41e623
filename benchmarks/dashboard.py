"""A dashboard server with browsers, for measurements through the pages (needs Chromium)."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.by import By

ROOT = Path(__file__).resolve().parents[1]
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage"),
    "--window-size=1440,1000",
)
_LONGEST_S = 60.0
_FIRST_S = 600.0  # for data to be read from the cache for the first time, or computed


@dataclass(frozen=True)
class Dashboard:
    """A running server."""

    address: str
    pid: int
    log_file: Path

    @property
    def log(self) -> str:
        """Its output so far."""
        return self.log_file.read_text(encoding="utf-8")

    @property
    def memory_mib(self) -> float:
        """Its resident memory; 0 where the system does not report it."""
        try:
            status = Path(f"/proc/{self.pid}/status").read_text(encoding="utf-8")
        except OSError:
            return 0.0
        return int(status.partition("VmRSS:")[2].split()[0]) / 1024


@contextmanager
def served(root: Path = ROOT, **environment: str) -> Iterator[Dashboard]:
    """Run the dashboard of a checkout on a free port, with these additional environment variables."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "streamlit", "run", "app.py", "--server.headless", "true"]
    command += ["--server.port", str(port)]
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "server.log"
        with log.open("wb") as stream:
            server = subprocess.Popen(
                command,
                cwd=root,
                env={**os.environ, "PYTHONPATH": str(root), **environment},
                stdout=stream,
                stderr=subprocess.STDOUT,
            )
            try:
                address = f"http://127.0.0.1:{port}"
                _wait_until_up(address)
                yield Dashboard(address, server.pid, log)
            finally:
                server.terminate()
                server.wait()


@contextmanager
def browser() -> Iterator[WebDriver]:
    """A browser with its own profile."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium") or ""
        for flag in (*_FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        try:
            yield driver
        finally:
            driver.quit()


def settled(browser: WebDriver, title: str, test: str = "", *, rated: Collection[str] = ()) -> float:
    """Wait until the page has its title, its script has ended and its figures are drawn; returns the time of that.

    On request its first subheader must also name a test, and there must be ratings with these labels.
    """
    script = """
        const title = document.querySelector('[data-testid="stMain"] h1');
        const app = document.querySelector('[data-testid="stApp"]');
        const subheader = document.querySelector('[data-testid="stMain"] h3');
        const names = '[data-testid="stMetricLabel"], .cf-name > :first-child';
        const labels = [...document.querySelectorAll(names)].map(l => l.innerText.trim());
        const figures = [...document.querySelectorAll('[data-testid="stPlotlyChart"]')];
        return title && title.innerText.includes(arguments[0]) && app.dataset.testScriptState === 'notRunning'
            && (!arguments[1] || (subheader && subheader.innerText.includes(arguments[1])))
            && arguments[2].every(label => labels.includes(label))
            && !document.querySelector('[data-stale="true"]') && figures.every(f => f.querySelector('.main-svg'));
    """
    deadline = time.perf_counter() + _LONGEST_S
    while time.perf_counter() < deadline:
        if browser.execute_script(script, title, test, list(rated)):
            return time.perf_counter()
        time.sleep(0.05)
    raise WebDriverException(f"{title} was not whole after {_LONGEST_S:.0f} s")


def press(browser: WebDriver, label: str) -> None:
    """Click the first enabled button of the page with this label."""
    deadline = time.monotonic() + _LONGEST_S
    path = f"//*[@data-testid='stMain']//button[contains(., '{label}') and not(@disabled)]"
    while not (buttons := browser.find_elements(By.XPATH, path)):
        if time.monotonic() > deadline:
            raise SystemExit(f"There is no button {label}.")
        time.sleep(0.1)
    buttons[0].click()


def wait_for(browser: WebDriver, words: str) -> None:
    """Wait until the page shows this text."""
    deadline = time.monotonic() + _FIRST_S
    while words not in browser.find_element(By.CSS_SELECTOR, '[data-testid="stMain"]').text:
        if time.monotonic() > deadline:
            raise SystemExit(f"The page never showed {words!r}.")
        time.sleep(0.2)


def _wait_until_up(address: str) -> None:
    for _ in range(600):
        try:
            with urllib.request.urlopen(f"{address}/_stcore/health", timeout=5):  # noqa: S310 - it is ours
                return
        except OSError:
            time.sleep(0.1)
    raise SystemExit("The server did not start.")
