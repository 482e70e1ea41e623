"""Whether the dashboard holds under use: ``python benchmarks/load.py [--sessions 5] [--minutes 3]`` (needs Chromium).

Several browsers use one server at once. Each holds out another test, and goes from page to page with a pause for
reading, while the first has a study trained that nobody has asked for before. Told are the times from a click to the
whole page, whether any session ever saw another's test or an exception, and the server's memory.

The browsers run on the same cores as the server: with few cores most of a page switch is the browser's drawing.
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
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import numpy as np
from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.by import By

ROOT = Path(__file__).resolve().parents[1]
_PAGES = ("Data", "Train", "Compare", "Study", "Predict")
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage"),
    "--window-size=1440,1000",
)
_PAUSE_S = (2.0, 6.0)  # a reader's
_LONGEST_S = 60.0


@dataclass
class Session:
    """What one browser has seen."""

    test: str
    switches_s: dict[str, list[float]] = field(default_factory=dict)
    trouble: list[str] = field(default_factory=list)


def main() -> None:
    """Run the sessions and print what they saw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=5)
    parser.add_argument("--minutes", type=float, default=3.0)
    arguments = parser.parse_args()
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
                sessions = _use(address, arguments.sessions, 60 * arguments.minutes, server.pid)
            finally:
                server.terminate()
                server.wait()
        _print(sessions, log.read_text(encoding="utf-8"))


def _use(address: str, n: int, seconds: float, pid: int) -> list[Session]:
    tests = ["T05 · 24.8 mph", "T02 · 12.1 mph", "T04 · 22.0 mph", "T09 · 35.1 mph", "T11 · 35.2 mph"]
    sessions = [Session(tests[i % len(tests)]) for i in range(n)]
    end = time.monotonic() + seconds
    threads = [
        threading.Thread(target=_browse, args=(address, session, end, number))
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


def _browse(address: str, session: Session, end: float, number: int) -> None:
    rng = np.random.default_rng(number)
    with tempfile.TemporaryDirectory() as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium") or ""
        for flag in (*_FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        try:
            browser.get(f"{address}/data?held_out={quote(session.test)}")
            _settled(browser, "Sample")
            if number == 0:
                _open(browser, "Train", session, record=False)
                browser.find_element(By.XPATH, "//button[contains(., 'Start')]").click()
            while time.monotonic() < end:
                _open(browser, str(rng.choice(_PAGES)), session)
                time.sleep(rng.uniform(*_PAUSE_S))
        except WebDriverException as error:
            session.trouble.append(f"{type(error).__name__}: {str(error).splitlines()[0]}")
        finally:
            browser.quit()


def _open(browser: WebDriver, page: str, session: Session, *, record: bool = True) -> None:
    """Click a page in the sidebar, wait until it is whole, and look for trouble."""
    (link,) = (e for e in browser.find_elements(By.CSS_SELECTOR, '[data-testid="stSidebarNavLink"]') if page in e.text)
    start = time.perf_counter()
    link.click()
    took = _settled(browser, "Sample" if page == "Data" else page) - start
    if record:
        session.switches_s.setdefault(page, []).append(took)
    if browser.find_elements(By.CSS_SELECTOR, '[data-testid="stException"]'):
        session.trouble.append(f"an exception on {page}")
    shown = browser.find_element(By.CSS_SELECTOR, '[data-testid="stMain"]').text
    own = session.test[:3]
    if page == "Compare" and f"Test {own}" not in shown:
        session.trouble.append(f"{page} did not show test {own}")


def _settled(browser: WebDriver, title: str) -> float:
    """Wait until the page has its title and its script has ended; returns when that was."""
    script = """
        const title = document.querySelector('[data-testid="stMain"] h1');
        const app = document.querySelector('[data-testid="stApp"]');
        return title && title.innerText.includes(arguments[0]) && app.dataset.testScriptState === 'notRunning';
    """
    deadline = time.perf_counter() + _LONGEST_S
    while time.perf_counter() < deadline:
        if browser.execute_script(script, title):
            return time.perf_counter()
        time.sleep(0.05)
    raise WebDriverException(f"{title} was not whole after {_LONGEST_S:.0f} s")


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
    by_page = {page: [t for session in sessions for t in session.switches_s.get(page, [])] for page in _PAGES}
    for page, took in {**by_page, "all": [t for own in by_page.values() for t in own]}.items():
        if took:
            figures = " | ".join(f"{x:.2f} s" for x in (np.median(took), np.quantile(took, 0.95), max(took)))
            print(f"| {page} | {len(took)} | {figures} |")
    trouble = [f"{session.test}: {what}" for session in sessions for what in session.trouble]
    print(f"\nTrouble in sessions: {'; '.join(trouble) or 'none'}.")
    print(f"Tracebacks in the log: {log.count('Traceback')}.")


if __name__ == "__main__":
    main()
