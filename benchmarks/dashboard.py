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


_SETTLED = """
const [title, test, rated] = arguments;
const text = element => element?.textContent ?? "", main = '[data-testid="stMain"]';
const seen = figure => figure?.querySelector(".main-svg") && figure.checkVisibility({ visibilityProperty: true });
const whole = () => {
  const all = css => [...document.querySelectorAll(css)];
  const labels = () => all('[data-testid="stMetricLabel"], .st-key-explained button').map(text);
  return document.querySelector('[data-testid="stApp"]')?.dataset.testScriptState === "notRunning"
    && text(document.querySelector(`${main} h1`)).includes(title)
    && (!test || text(document.querySelector(`${main} h3`)).includes(test))
    && (!rated.length || rated.every(name => labels().some(label => label.includes(name))))
    && !document.querySelector('[data-stale="true"], [data-testid="stSkeleton"]')
    && all('[data-testid="stPlotlyChart"]').every(each => seen(each.querySelector(".js-plotly-plot")));
};
window.settled = null;
const look = () => { if (whole()) window.settled = Date.now(); else setTimeout(look, 20); };
look();
"""


def settled(browser: WebDriver, title: str, test: str = "", *, rated: Collection[str] = ()) -> float:
    """Wait until the page has its title, its script has ended and its figures are seen; returns the time of that.

    The page itself looks: to be asked twenty times a second would take much of a busy browser's time. On request its
    first subheader must also name a test, and there must be ratings with these labels.
    """
    deadline = time.monotonic() + _LONGEST_S
    browser.execute_script(_SETTLED, title, test, list(rated))
    while time.monotonic() < deadline:
        if at_ms := browser.execute_script("return window.settled"):
            return time.perf_counter() - (time.time() - float(at_ms) / 1e3)
        time.sleep(0.1)
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
