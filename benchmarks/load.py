"""Load test of the dashboard: ``python benchmarks/load.py [--sessions 5] [--minutes 3]`` (needs Chromium).

Several browsers use one server at once, on the sample campaign, all of whose studies have been run before. Each moves
from page to page and from one held-out test to another, with a pause for reading, while the first trains a prediction
that is not in the cache. Reported are the times from a click to the complete page with its figures, whether any
session ever saw an exception, another session's test or ratings other than the study's, and the server's memory.

The browsers run on the same cores as the server: with few cores, most of the time of a page switch is their drawing.
"""

import argparse
import threading
import time
from dataclasses import dataclass, field, replace
from urllib.parse import quote

import numpy as np
from dashboard import ROOT, Dashboard, browser, press, served, settled, wait_for
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from crashfuse import Fit, StudyConfig, load_campaign, run_study
from crashfuse.crash_test import CrashTest
from crashfuse.units import MPH

_PAGES = ("Data", "Train", "Compare", "Study", "Predict")
_PAUSE_S = (2.0, 6.0)  # reading time


@dataclass
class Session:
    """What one browser has seen."""

    test: str
    took_s: dict[str, list[float]] = field(default_factory=dict)
    trouble: list[str] = field(default_factory=list)
    trains: bool = False


@dataclass(frozen=True)
class Truth:
    """Expected content: the tests as named in the sidebar, and each one's ratings in the study."""

    tests: tuple[str, ...]
    ratings: dict[str, set[str]]


def main() -> None:
    """Run the sessions and print what they saw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=5)
    parser.add_argument("--minutes", type=float, default=3.0)
    arguments = parser.parse_args()
    truth = _prepare()
    with served(CRASHFUSE_CAMPAIGN=str(ROOT / "sample_data")) as dashboard:
        sessions = _use(dashboard, truth, arguments.sessions, 60 * arguments.minutes)
        log = dashboard.log
    _print(sessions, log)


def _prepare() -> Truth:
    """Fill the cache with everything that the pages show, as on a server that has been in use for a while."""
    campaign = load_campaign(ROOT / "sample_data")
    config = StudyConfig()
    study = run_study(campaign, replace(config, leave_out="both"))
    for name in config.approaches:
        Fit.of(campaign, name, config)
    ratings = {
        fold.held_out: {f"{by_window[60.0].overall:.3f}" for by_window in fold.ratings.values()} for fold in study.folds
    }
    return Truth(tuple(_label(test) for test in campaign.tests), ratings)


def _label(test: CrashTest) -> str:
    return f"{test.id} · {test.condition.speed_mps / MPH:.1f} mph"


def _use(dashboard: Dashboard, truth: Truth, n: int, seconds: float) -> list[Session]:
    sessions = [Session(truth.tests[(4 * i) % len(truth.tests)]) for i in range(n)]
    with browser() as first:  # the first visit to each page reads what the others then share
        first.get(f"{dashboard.address}/predict")
        wait_for(first, "Pulse metrics")
        first.find_element(By.PARTIAL_LINK_TEXT, "Study").click()
        wait_for(first, "Mean rating over the tests")
    print(f"Server: {dashboard.memory_mib:.0f} MiB before the sessions begin.", flush=True)
    end = time.monotonic() + seconds
    threads = [
        threading.Thread(target=_browse, args=(dashboard.address, truth, session, end, number))
        for number, session in enumerate(sessions)
    ]
    for thread in threads:
        thread.start()
    most = 0.0
    while any(thread.is_alive() for thread in threads):
        most = max(most, dashboard.memory_mib)
        time.sleep(1.0)
    print(f"Server: {most:.0f} MiB at its peak, {dashboard.memory_mib:.0f} MiB at the end.")
    return sessions


def _browse(address: str, truth: Truth, session: Session, end: float, number: int) -> None:
    rng = np.random.default_rng(number)
    try:
        with browser() as own:
            own.get(f"{address}/data?held_out={quote(session.test)}")
            settled(own, "Sample")
            if number == 0:
                _train_anew(own)
                session.trains = True
            page = "Train" if number == 0 else "Data"
            while time.monotonic() < end:
                time.sleep(rng.uniform(*_PAUSE_S))
                if page == "Compare" and rng.random() < 0.5:
                    session.test = str(rng.choice([other for other in truth.tests if other != session.test]))
                    _hold_out(own, session)
                else:
                    page = str(rng.choice([other for other in _PAGES if other != page]))
                    _open(own, page, session)
                _look(own, page, session, truth)
    except WebDriverException as error:
        session.trouble.append(f"{type(error).__name__}: {str(error).splitlines()[0]}")


def _train_anew(browser: WebDriver) -> None:
    """Start a computation that is not in the cache: the same test with another seed."""
    browser.find_element(By.PARTIAL_LINK_TEXT, "Train").click()
    settled(browser, "Train")
    browser.find_element(By.XPATH, "//summary[contains(., 'Advanced')]").click()
    seed = browser.find_element(By.CSS_SELECTOR, 'input[aria-label="Seed"]')
    seed.send_keys(Keys.CONTROL, "a")
    seed.send_keys(str(time.time_ns() % 1_000_000), Keys.ENTER)
    settled(browser, "Train")
    press(browser, "Start")
    wait_for(browser, "Cancel")


def _hold_out(browser: WebDriver, session: Session) -> None:
    """Choose another test in the sidebar, and wait until Compare is complete."""
    field = browser.find_element(By.CSS_SELECTOR, '[data-testid="stSidebar"] input[aria-label*="Held-out test"]')
    field.click()
    field.send_keys(session.test)
    start = time.perf_counter()
    field.send_keys(Keys.ENTER)
    took = _settled_on_compare(browser, session) - start
    session.took_s.setdefault("Compare, another test", []).append(took)


def _open(browser: WebDriver, page: str, session: Session) -> None:
    """Click a page in the sidebar, and wait until it is complete."""
    link = browser.find_element(By.PARTIAL_LINK_TEXT, page)
    start = time.perf_counter()
    link.click()
    if page == "Compare":
        took = _settled_on_compare(browser, session) - start
    else:
        took = settled(browser, "Sample" if page == "Data" else page) - start
    session.took_s.setdefault(page, []).append(took)


def _look(browser: WebDriver, page: str, session: Session, truth: Truth) -> None:
    """Check for an exception, a test other than the one chosen, and ratings that are not this test's."""
    if browser.find_elements(By.CSS_SELECTOR, '[data-testid="stException"]'):
        session.trouble.append(f"an exception on {page}")
    if page != "Compare":
        return
    own = session.test[:3]
    if f"Test {own}" not in browser.find_element(By.CSS_SELECTOR, '[data-testid="stMain"]').text:
        session.trouble.append(f"{page} did not show test {own}")
    rated = '[data-testid="stMetricValue"], .st-key-explained strong'
    shown = {value.text for value in browser.find_elements(By.CSS_SELECTOR, rated)}
    if not session.trains and shown != truth.ratings[own]:
        session.trouble.append(f"{page} showed {sorted(shown)} for {own}, not {sorted(truth.ratings[own])}")


def _settled_on_compare(browser: WebDriver, session: Session) -> float:
    """Like :func:`settled`, for this session's test; a session that trains sees no ratings before the training ends."""
    return settled(browser, "Compare", f"Test {session.test[:3]}", rated=() if session.trains else ("Fused",))


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
