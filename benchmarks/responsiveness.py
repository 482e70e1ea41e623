"""How long the dashboard lets one wait: ``python benchmarks/responsiveness.py [--beside CHECKOUT]`` (needs Chromium).

Five waits on the sample, whose studies have been run before, each the median: from a link into a cold server to the
first paint of the page's frame (Streamlit's own list of files does not count); a switch of page while four others
switch, too, first with all five browsers on the server's cores, then with only the one that is measured: of the others
the server is asked as by their browsers, which draw elsewhere; on Predict, from the stop of a slider to the figure that
answers, and to the whole page. With another checkout the two take turns, so that what else the machine does slows both.
"""

import argparse
import os
import statistics
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import islice, takewhile
from pathlib import Path

import numpy as np
from dashboard import ROOT, browser, served, settled
from person import Person
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

_PAGES = ("Data", "Train", "Compare", "Study", "Predict")
_LINKS = ("compare", "predict", "study", "data")
_PEOPLE, _SWITCHES, _MOVES = 5, 12, 8
_READING_S = (1.0, 3.0)
_LONGEST_S = 300.0
_CAMPAIGN = ROOT / "sample_data"
_COMPUTE = """
import sys
from crashfuse import Fit, StudyConfig, load_campaign, run_study
campaign, config = load_campaign(sys.argv[1]), StudyConfig(leave_out="both")
run_study(campaign, config)
for name in config.approaches:
    Fit.of(campaign, name, config)
"""
_FIRST_PAINT = """
const look = () => {
  const logos = ['stSidebarLogo', 'stHeaderLogo', 'stLogo'].map(name => `[data-testid="${name}"]`);
  const frame = document.querySelector(logos.join(', '));
  const title = document.querySelector('[data-testid="stMain"] h1');
  if (!window.painted && (frame || title)) window.painted = performance.now() / 1000;
};
new MutationObserver(look).observe(document, {childList: true, subtree: true});
"""
_WATCH_MOVE = """
const curves = () => document.querySelector('.js-plotly-plot')?.querySelectorAll('path.js-line') || [];
const drawn = () => [...curves()].map(curve => curve.getAttribute('d')).join();
const app = document.querySelector('[data-testid="stApp"]');
const before = drawn();
window.move = {};
document.addEventListener('keyup', () => {
  const start = performance.now();
  const look = () => {
    const now = (performance.now() - start) / 1000;
    if (!window.move.figure && drawn() !== before) window.move.figure = now;
    const still = app.dataset.testScriptState === 'notRunning' && !document.querySelector('[data-stale="true"]');
    if (window.move.figure && still) window.move.page = now;
    else requestAnimationFrame(look);
  };
  look();
}, {once: true});
"""
WAITS = (
    "first paint of a link, cold server",
    "switch of page, five browsers on its cores",
    "switch of page, four of five browsers elsewhere",
    "answer on Predict",
    "whole page",
)


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--beside", type=Path, help="another checkout to measure in turns with this one")
    parser.add_argument("--rounds", type=int, default=2)
    arguments = parser.parse_args()
    roots = [ROOT, *([arguments.beside.resolve()] if arguments.beside else [])]
    for root in roots:
        _prepare(root)
    waits: dict[Path, dict[str, list[float]]] = {root: defaultdict(list) for root in roots}
    for number in range(arguments.rounds):
        for root in roots if number % 2 else roots[::-1]:
            for link in _LINKS:
                waits[root][WAITS[0]].append(_first_paint(root, link))
            with served(root, CRASHFUSE_CAMPAIGN=str(_CAMPAIGN)) as dashboard:
                for figure_s, page_s in _moves(dashboard.address):
                    waits[root][WAITS[3]].append(figure_s)
                    waits[root][WAITS[4]].append(page_s)
                waits[root][WAITS[1]] += _switches(dashboard.address, browsers=_PEOPLE)
                waits[root][WAITS[2]] += _switches(dashboard.address, browsers=1)
    print(f"| | {' | '.join(root.name for root in roots)} |\n|---|{'---:|' * len(roots)}")
    for name in WAITS:
        print(f"| {name} | {' | '.join(f'{statistics.median(waits[root][name]):.2f} s' for root in roots)} |")


def _prepare(root: Path) -> None:
    """Fill the cache with everything that the pages show, by the code of a checkout: others cannot use it."""
    environment = {**os.environ, "PYTHONPATH": str(root)}
    subprocess.run([sys.executable, "-c", _COMPUTE, str(_CAMPAIGN)], cwd=root, env=environment, check=True)


def _first_paint(root: Path, link: str) -> float:
    with browser() as user:
        user.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": _FIRST_PAINT})
        with served(root, CRASHFUSE_CAMPAIGN=str(_CAMPAIGN)) as dashboard:
            user.get(f"{dashboard.address}/{link}")
            return _found(user, "return window.painted")


def _moves(address: str) -> list[tuple[float, float]]:
    """Times to the figure and to the whole page after single steps of the speed's slider."""
    took = []
    with browser() as user:
        user.get(f"{address}/predict")
        _found(user, "return document.querySelector('.js-plotly-plot .main-svg') !== null")
        settled(user, "Predict")
        for _ in range(_MOVES + 1):
            slider = user.find_element(By.CSS_SELECTOR, '[data-testid="stSlider"] input')
            user.execute_script(_WATCH_MOVE)
            user.execute_script("arguments[0].focus()", slider)  # a field that cannot be seen, under the thumb
            ActionChains(user).send_keys(Keys.ARROW_LEFT).perform()
            _found(user, "return window.move.page")
            took.append(user.execute_script("return [window.move.figure, window.move.page]"))
            time.sleep(0.5)
    return [(figure_s, page_s) for figure_s, page_s in took[1:]]


def _switches(address: str, browsers: int) -> list[float]:
    """Times of page switches of all browsers, while the people without one here switch, too."""
    took: list[float] = []
    over = threading.Event()

    def pages(number: int) -> Iterator[str]:
        rng, page = np.random.default_rng(number), "Data"
        while True:
            time.sleep(rng.uniform(*_READING_S))
            page = str(rng.choice([other for other in _PAGES if other != page]))
            yield page

    def browse(number: int) -> None:
        with browser() as user:
            user.get(f"{address}/data")
            settled(user, "Sample")
            for page in islice(pages(number), _SWITCHES):
                link = user.find_element(By.PARTIAL_LINK_TEXT, page)
                start = time.perf_counter()
                link.click()
                took.append(settled(user, "Sample" if page == "Data" else page) - start)

    def ask(number: int) -> None:
        with Person.at(address) as person:
            for page in takewhile(lambda _: not over.is_set(), pages(number)):
                person.turn_to(page)

    with ThreadPoolExecutor(_PEOPLE) as people:
        elsewhere = [people.submit(ask, number) for number in range(browsers, _PEOPLE)]
        here = [people.submit(browse, number) for number in range(browsers)]
        wait(here)
        over.set()
    for each in (*here, *elsewhere):
        each.result()
    return took


def _found(user: WebDriver, script: str) -> float:
    """Wait until a script returns something."""
    deadline = time.monotonic() + _LONGEST_S
    while time.monotonic() < deadline:
        if found := user.execute_script(script):
            return float(found)
        time.sleep(0.05)
    shown = user.execute_script("return document.body.innerText")
    raise SystemExit(f"The page never came to {script!r}; it shows:\n{shown}")


if __name__ == "__main__":
    main()
