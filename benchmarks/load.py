"""Whether the dashboard holds under use: ``python benchmarks/load.py [--sessions 5] [--minutes 3]`` (needs Chromium).

Several browsers use one server at once, on the sample campaign, all of whose studies have been run before. Each goes
from page to page and from one held-out test to another, with a pause for reading, while the first has a prediction
trained that nobody has asked for yet. Told are the times from a click to the whole page with its figures, whether any
session ever saw an exception, another's test or other ratings than the study's, and the server's memory.

The browsers run on the same cores as the server: with few cores most of a page switch is the browsers' drawing.
"""

import argparse
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from urllib.parse import quote

import numpy as np
from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from crashfuse import Fit, StudyConfig, load_campaign, run_study
from crashfuse.campaign import CrashTest
from crashfuse.units import MPH

ROOT = Path(__file__).resolve().parents[1]
_PAGES = ("Data", "Train", "Compare", "Study", "Predict")
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage"),
    "--window-size=1440,1000",
)
_PAUSE_S = (2.0, 6.0)  # a reader's
_LONGEST_S = 60.0
_FIRST_S = 600.0  # for what has to be read from the cache once


@dataclass
class Session:
    """What one browser has seen."""

    test: str
    took_s: dict[str, list[float]] = field(default_factory=dict)
    trouble: list[str] = field(default_factory=list)
    trains: bool = False


@dataclass(frozen=True)
class Truth:
    """What may be seen: the tests as the sidebar calls them, and each one's ratings by the study."""

    tests: tuple[str, ...]
    ratings: dict[str, set[str]]


def main() -> None:
    """Run the sessions and print what they saw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=5)
    parser.add_argument("--minutes", type=float, default=3.0)
    arguments = parser.parse_args()
    truth = _prepare()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{probe.getsockname()[1]}"
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "server.log"
        environment = {**os.environ, "CRASHFUSE_CAMPAIGN": str(ROOT / "sample_data")}
        command = [sys.executable, "-m", "streamlit", "run", "app.py", "--server.headless", "true"]
        command += ["--server.port", address.rpartition(":")[2]]
        with log.open("wb") as stream:
            server = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=stream, stderr=subprocess.STDOUT)
            try:
                _wait_until_up(address)
                sessions = _use(address, truth, arguments.sessions, 60 * arguments.minutes, server.pid)
            finally:
                server.terminate()
                server.wait()
        _print(sessions, log.read_text(encoding="utf-8"))


def _prepare() -> Truth:
    """Have everything in the cache that the pages show, as on a server that has been in use for a while."""
    campaign = load_campaign(ROOT / "sample_data")
    config = StudyConfig()
    study = run_study(campaign, replace(config, hold_out="both"))
    for name in config.approaches:
        Fit.of(campaign, name, config)
    ratings = {
        fold.held_out: {f"{by_window[60.0].overall:.3f}" for by_window in fold.ratings.values()} for fold in study.folds
    }
    return Truth(tuple(_label(test) for test in campaign.tests), ratings)


def _label(test: CrashTest) -> str:
    return f"{test.id} · {test.condition.speed_mps / MPH:.1f} mph"


def _use(address: str, truth: Truth, n: int, seconds: float, pid: int) -> list[Session]:
    sessions = [Session(truth.tests[(4 * i) % len(truth.tests)]) for i in range(n)]
    with _browser() as browser:  # the first visit of each page reads what the others then share
        browser.get(f"{address}/predict")
        _press(browser, "Predict")
        _wait_for(browser, "Pulse metrics")
        browser.find_element(By.PARTIAL_LINK_TEXT, "Study").click()
        _wait_for(browser, "Mean rating over the tests")
    print(f"Server: {_memory_mib(pid):.0f} MiB before the sessions begin.", flush=True)
    end = time.monotonic() + seconds
    threads = [
        threading.Thread(target=_browse, args=(address, truth, session, end, number))
        for number, session in enumerate(sessions)
    ]
    for thread in threads:
        thread.start()
    most = 0.0
    while any(thread.is_alive() for thread in threads):
        most = max(most, _memory_mib(pid))
        time.sleep(1.0)
    print(f"Server: {most:.0f} MiB at its peak, {_memory_mib(pid):.0f} MiB at the end.")
    return sessions


@contextmanager
def _browser() -> Iterator[WebDriver]:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium") or ""
        for flag in (*_FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        try:
            yield browser
        finally:
            browser.quit()


def _browse(address: str, truth: Truth, session: Session, end: float, number: int) -> None:
    rng = np.random.default_rng(number)
    try:
        with _browser() as browser:
            browser.get(f"{address}/data?held_out={quote(session.test)}")
            _settled(browser, "Sample")
            if number == 0:
                _train_anew(browser)
                session.trains = True
            page = "Train" if number == 0 else "Data"
            while time.monotonic() < end:
                time.sleep(rng.uniform(*_PAUSE_S))
                if page == "Compare" and rng.random() < 0.5:
                    session.test = str(rng.choice([other for other in truth.tests if other != session.test]))
                    _hold_out(browser, session)
                else:
                    page = str(rng.choice([other for other in _PAGES if other != page]))
                    _open(browser, page, session)
                _look(browser, page, session, truth)
    except WebDriverException as error:
        session.trouble.append(f"{type(error).__name__}: {str(error).splitlines()[0]}")


def _train_anew(browser: WebDriver) -> None:
    """Start what is not in the cache: the same test with another seed."""
    browser.find_element(By.PARTIAL_LINK_TEXT, "Train").click()
    _settled(browser, "Train")
    browser.find_element(By.XPATH, "//summary[contains(., 'Advanced')]").click()
    seed = browser.find_element(By.CSS_SELECTOR, 'input[aria-label="Seed"]')
    seed.send_keys(Keys.CONTROL, "a")
    seed.send_keys(str(time.time_ns() % 1_000_000), Keys.ENTER)
    _settled(browser, "Train")
    _press(browser, "Start")
    _wait_for(browser, "Cancel")


def _hold_out(browser: WebDriver, session: Session) -> None:
    """Choose another test in the sidebar, and wait until Compare is whole."""
    field = browser.find_element(By.CSS_SELECTOR, '[data-testid="stSidebar"] input[aria-label*="Held-out test"]')
    field.click()
    field.send_keys(session.test)
    start = time.perf_counter()
    field.send_keys(Keys.ENTER)
    took = _settled_on_compare(browser, session) - start
    session.took_s.setdefault("Compare, another test", []).append(took)


def _open(browser: WebDriver, page: str, session: Session) -> None:
    """Click a page in the sidebar, and wait until it is whole."""
    link = browser.find_element(By.PARTIAL_LINK_TEXT, page)
    start = time.perf_counter()
    link.click()
    if page == "Compare":
        took = _settled_on_compare(browser, session) - start
    else:
        took = _settled(browser, "Sample" if page == "Data" else page) - start
    session.took_s.setdefault(page, []).append(took)


def _look(browser: WebDriver, page: str, session: Session, truth: Truth) -> None:
    """Look for an exception, for another test than was asked for, and for ratings that are not this test's."""
    if browser.find_elements(By.CSS_SELECTOR, '[data-testid="stException"]'):
        session.trouble.append(f"an exception on {page}")
    if page != "Compare":
        return
    own = session.test[:3]
    if f"Test {own}" not in browser.find_element(By.CSS_SELECTOR, '[data-testid="stMain"]').text:
        session.trouble.append(f"{page} did not show test {own}")
    shown = {value.text for value in browser.find_elements(By.CSS_SELECTOR, '[data-testid="stMetricValue"]')}
    if not session.trains and shown != truth.ratings[own]:
        session.trouble.append(f"{page} showed {sorted(shown)} for {own}, not {sorted(truth.ratings[own])}")


def _settled_on_compare(browser: WebDriver, session: Session) -> float:
    """As :func:`_settled`, for this session's test; who trains sees no ratings before the training has ended."""
    return _settled(browser, "Compare", f"Test {session.test[:3]}", rated=not session.trains)


def _settled(browser: WebDriver, title: str, test: str = "", *, rated: bool = False) -> float:
    """Wait until the page has its title, its script has ended and its figures are drawn; returns when that was.

    If asked for, its first subheader has to name a test, and ratings have to be there.
    """
    script = """
        const title = document.querySelector('[data-testid="stMain"] h1');
        const app = document.querySelector('[data-testid="stApp"]');
        const subheader = document.querySelector('[data-testid="stMain"] h3');
        const figures = [...document.querySelectorAll('[data-testid="stPlotlyChart"]')];
        return title && title.innerText.includes(arguments[0]) && app.dataset.testScriptState === 'notRunning'
            && (!arguments[1] || (subheader && subheader.innerText.includes(arguments[1])))
            && (!arguments[2] || document.querySelector('[data-testid="stMetricValue"]'))
            && !document.querySelector('[data-stale="true"]') && figures.every(f => f.querySelector('.main-svg'));
    """
    deadline = time.perf_counter() + _LONGEST_S
    while time.perf_counter() < deadline:
        if browser.execute_script(script, title, test, rated):
            return time.perf_counter()
        time.sleep(0.05)
    raise WebDriverException(f"{title} was not whole after {_LONGEST_S:.0f} s")


def _press(browser: WebDriver, label: str) -> None:
    deadline = time.monotonic() + _LONGEST_S
    path = f"//*[@data-testid='stMain']//button[contains(., '{label}') and not(@disabled)]"
    while not (buttons := browser.find_elements(By.XPATH, path)):
        if time.monotonic() > deadline:
            raise SystemExit(f"There is no button {label}.")
        time.sleep(0.1)
    buttons[0].click()


def _wait_for(browser: WebDriver, words: str) -> None:
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


def _memory_mib(pid: int) -> float:
    """Resident memory of a process; 0 where the system does not tell."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:
        return 0.0
    return int(status.partition("VmRSS:")[2].split()[0]) / 1024


def _print(sessions: list[Session], log: str) -> None:
    print("\n| page | switches | median | 95 % | longest |\n|---|---:|---:|---:|---:|")
    pages = (*_PAGES, "Compare, another test")
    by_page = {page: [t for session in sessions for t in session.took_s.get(page, [])] for page in pages}
    for page, took in {**by_page, "all": [t for own in by_page.values() for t in own]}.items():
        if took:
            figures = " | ".join(f"{x:.2f} s" for x in (np.median(took), np.quantile(took, 0.95), max(took)))
            print(f"| {page} | {len(took)} | {figures} |")
    trouble = [f"{session.test}: {what}" for session in sessions for what in session.trouble]
    print(f"\nTrouble in sessions: {'; '.join(trouble) or 'none'}.")
    print(f"Tracebacks in the log: {log.count('Traceback')}.")
    if "Traceback" in log:
        print(log)


if __name__ == "__main__":
    main()
