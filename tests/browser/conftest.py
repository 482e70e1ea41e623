"""Dashboards, most of them shared, and people in front of a real browser."""

import csv
import io
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
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar
from urllib.parse import urlencode, urlsplit

import pytest
from selenium import webdriver
from selenium.common.exceptions import (
    ElementClickInterceptedException,
    ElementNotInteractableException,
    StaleElementReferenceException,
    TimeoutException,
)
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

ROOT = Path(__file__).resolve().parents[2]
WITNESS = Path(__file__).with_name("witness")
SOON = 120.0  # s, where many other things run too
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
    "--force-prefers-reduced-motion",  # to draw what moves while one waits takes a fifth of the browser's time
    "--window-size=1440,1000",
)
# What can be seen of a kind, with these words, and all its text. One question to the browser: Selenium's own of each
# element whether it is displayed and what it says take seconds of a page with figures, ten times a second.
_SHOWN = """
const shown = e => e.checkVisibility({ opacityProperty: true, visibilityProperty: true }) && e.getClientRects().length;
const text = e => (e.innerText ?? e.textContent).replace(/[\\u00a0\\t]/g, " ").replace(/\\u2060/g, "").trim();
return [...document.querySelectorAll(arguments[0])].filter(shown).map(e => [e, text(e)])
  .filter(([, text]) => text.includes(arguments[1]));
"""
_REDRAWN = (  # while the page changes
    StaleElementReferenceException, ElementNotInteractableException, ElementClickInterceptedException
)  # fmt: skip
FIGURE, TABLE, SIDEBAR = ".js-plotly-plot", '[data-testid="stTable"]', '[data-testid="stSidebar"]'
MAIN, LINK = '[data-testid="stMain"]', f'{SIDEBAR} [data-testid="stPageLink-NavLink"]'
PILL, POPOVER = '[data-testid="stButtonGroup"] button', '[data-testid="stPopoverBody"]'
DIALOG = '[data-testid="stDialog"]'
APPROACH = ".st-key-explained"  # on Compare
STAR = "button [data-testid='stIconMaterial']"  # at the one that is recommended
LIGHT, DARK = "rgba(255, 255, 255, 1)", "rgba(20, 24, 31, 1)"  # the page's ground in both themes
PAIRED = ("C20", "C21", "C22", "C23")  # CAE runs at the tests' conditions, one of them beyond all others
QUICK = ("cae", "displacement_domain")  # approaches that learn within seconds
T = TypeVar("T")


@dataclass(frozen=True)
class Server:
    """A dashboard."""

    address: str
    log_file: Path
    witness: Path
    """The folder of ``witness/sitecustomize.py``, which hears of all that the server does."""

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

    def open(self, server: Server, page: str, **view: str | tuple[str, ...]) -> None:
        """Open a page by its link."""
        self.browser.get(f"{server.address}/{page}?{urlencode(view, doseq=True)}")

    def open_folder(self, server: Server, folder: Path) -> None:
        """On Data, type in the folder of a campaign and open it."""
        self.open(server, "data")
        self.fill("A folder or file on this computer", str(folder))
        self.press("Open folder")
        self.sees("Tests in use")

    def becomes_another(self) -> None:
        """Someone else sits down, in a browser that no server has seen, and that has nowhere to go back to."""
        self.browser.get("about:blank")
        self.browser.execute_cdp_cmd("Network.clearBrowserCookies", {})
        self.browser.execute_cdp_cmd("Page.resetNavigationHistory", {})  # a full one, 50 pages, counts no further

    def _shown(self, css: str, words: str) -> list[tuple[WebElement, str]]:
        return [(element, text) for element, text in self.browser.execute_script(_SHOWN, css, words)]

    def all(self, css: str, words: str = "") -> list[WebElement]:
        """All elements of this kind, with these words, that can be seen."""
        return [element for element, _ in self._shown(css, words)]

    def texts(self, css: str, words: str = "") -> list[str]:
        """What they say."""
        return [text for _, text in self._shown(css, words)]

    def find(self, css: str, words: str = "") -> WebElement:
        """Wait for an element of this kind with these words."""
        return self.wait(lambda: self.all(css, words), f"There is no {css} with {words!r}.")[0]

    def sees(self, words: str, css: str = MAIN, timeout_s: float = SOON) -> str:
        """Wait until an element of this kind (the page's main part) shows these words; returns all that it shows."""
        return self.wait(lambda: self.texts(css, words), f"{css} never showed {words!r}.", timeout_s)[0]

    def rests(self) -> None:
        """Wait until the page is drawn as it stays: its script has ended."""
        self.wait(lambda: self.browser.find_elements(By.CSS_SELECTOR, '[data-test-script-state="notRunning"]'))

    def types(self, css: str, *keys: str) -> None:
        """Press keys on an element of this kind, whichever is there by then."""

        def typed() -> bool:
            self.find(css).send_keys(*keys)
            return True

        self.wait(typed)

    def press(self, label: str, css: str = "button") -> None:
        """Click the first element of this kind with this label."""
        self.wait(lambda: self._pressed(label, css), f"There is no {label!r} to click.")

    def _pressed(self, label: str, css: str) -> bool:
        """True if there is one that can be clicked, and now has been."""
        for element in self.all(css, label):
            if element.is_enabled():
                self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
                if not self._rests(element):
                    return False
                element.click()
                return True
        return False

    @staticmethod
    def _rests(element: WebElement) -> bool:
        """True if nothing pushes it away: while a page is being drawn, a click would hit what comes in its place."""
        place = element.rect
        time.sleep(0.1)
        return element.rect == place

    def presses_until(self, done: Callable[[], object], label: str, css: str = "button") -> None:
        """Click until something is done."""
        self._clicks_until(done, lambda: self._pressed(label, css), f"Nothing came of a click on {label!r}.")

    def opens(self, popover: str) -> None:
        """Open the popover of this label, again if the page, drawn anew, has lost the click."""
        button = f'{MAIN} [data-testid="stPopover"] button'

        def is_open() -> bool:
            return bool(self.all(POPOVER) and self.all(f'{button}[aria-expanded="true"]', popover))

        def opened() -> bool:
            if not is_open():
                self._pressed(popover, button)
                with suppress(TimeoutException):
                    self.wait(is_open, timeout_s=5)
            return is_open()

        self.wait(opened, f"The popover {popover!r} never opened.")

    def press_inside(self, popover: str, label: str, css: str) -> None:
        """Press what is in the popover of this label, opened again if the page, drawn anew, has closed it."""

        def pressed() -> bool:
            self.opens(popover)
            return self._pressed(label, f"{POPOVER} {css}")

        self.wait(pressed, f"There is no {label!r} to click in {popover!r}.")

    def _clicks_until(self, done: Callable[[], object], click: Callable[[], object], missing: str = "") -> None:
        """Click, and again after a while if nothing came of it: the page may just have been drawn anew."""

        def worked() -> bool:
            click()
            with suppress(TimeoutException):
                return bool(self.wait(done, timeout_s=15))
            return False

        self.wait(worked, missing)

    def fill(self, label: str, text: str) -> None:
        """Type into the field of this label, and leave it."""

        def filled() -> bool:
            for field in self.all(f'input[aria-label="{label}"]'):
                field.send_keys(Keys.CONTROL, "a")
                field.send_keys(f"{text}\t")
                return True
            return False

        self.wait(filled, f"There is no field {label!r}.")

    def uploads(self, file: Path) -> None:
        """Put a file into the page's first field for files."""
        self.wait(lambda: self.browser.find_elements(By.CSS_SELECTOR, 'input[type="file"]'))[0].send_keys(str(file))
        self.sees(file.name, '[data-testid="stFileUploader"]')

    def starts(self, label: str, shown: str) -> None:
        """Start what another test may have started before, and wait until an element of this kind shows its result."""
        buttons = f"{MAIN} button"

        def begun() -> bool:
            return self._pressed(label, buttons) if self.all(buttons, label) else bool(self.all(shown))

        self.wait(begun, f"There is neither {label!r} to click nor {shown}.")
        self.wait(lambda: self.all(shown), f"{label!r} never came to {shown}.", 4 * SOON)

    def go(self, page: str) -> None:
        """Turn to a page by the link in the sidebar, and wait until it has taken the place of the one before."""
        self.press(page, LINK)
        if page != "Data":  # whose title is the campaign's name
            self.wait(lambda: self.all(f"{MAIN} h1", page), f"The page {page} never began.")

    def choose_approaches(self, *labels: str) -> None:
        """On Train, choose these approaches of all."""
        for label in {"CAE", "LF TCN", "Time domain", "Displacement domain", "Fused"} - set(labels):
            self.press(label, PILL)
            self.wait(lambda label=label: self.all(f'{PILL}[aria-pressed="false"]', label))  # type: ignore[misc]

    def open_tab(self, label: str) -> None:
        """Open a tab of the page."""
        self.press(label, '[class*="_tab"] button')

    @property
    def chosen_approach(self) -> str:
        """Whose prediction Compare shows, with its rating."""
        return self.find(f'{APPROACH} [aria-checked="true"]').text

    def chooses_approach(self, label: str) -> None:
        """On Compare, choose whose prediction is shown."""
        self.press(label, f"{APPROACH} button")
        self.wait(lambda: label in self.chosen_approach, f"{label} was never chosen.")

    def rates_over(self, ms: str) -> None:
        """Type the rated time window into the sidebar."""
        self.find(f'{SIDEBAR} input[aria-label*="Rated time window"]').send_keys(ms, Keys.ENTER)

    def clicks_cell(self, figure: str, where: Callable[[float, float], tuple[float, float]], words: str) -> None:
        """Click a spot of the heat map that has ``figure`` in it until the page shows the words.

        Where it lies, right of and below the centre of all cells in pixels, depends on how wide and high they are.
        """

        def click() -> None:
            drawn = self.find(FIGURE, figure)
            self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", drawn)
            cells = drawn.find_element(By.CSS_SELECTOR, ".nsewdrag")
            right, down = where(cells.rect["width"], cells.rect["height"])
            mouse = ActionChains(self.browser)
            mouse.move_to_element_with_offset(cells, round(right), round(down)).perform()
            with suppress(TimeoutException):  # as Plotly names the cell, it hears of a click on it
                self.wait(lambda: self.all(f"{FIGURE} .hoverlayer .hovertext"), timeout_s=5)
            mouse.click().perform()

        self._clicks_until(lambda: self.texts(MAIN, words), click, f"Nothing came of a click on the cell: {words!r}.")

    def clicks_row(self, row: int, across_px: int, css: str = MAIN) -> None:
        """Click a cell of the first table of this kind that lives in one canvas, so far from its left edge."""
        grid = self.find(f'{css} [data-testid="stDataFrame"] canvas')
        self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", grid)
        across, down = round(across_px - grid.rect["width"] / 2), round(52 + 35 * row - grid.rect["height"] / 2)
        ActionChains(self.browser).move_to_element_with_offset(grid, across, down).click().perform()

    def pastes(self, text: str) -> None:
        """Paste what was copied from a spreadsheet, say."""
        allowed = ["clipboardReadWrite", "clipboardSanitizedWrite"]
        self.browser.execute_cdp_cmd("Browser.grantPermissions", {"permissions": allowed})
        copy = "navigator.clipboard.writeText(arguments[0]).then(arguments[1])"
        self.browser.execute_async_script(copy, text)
        ActionChains(self.browser).key_down(Keys.CONTROL).send_keys("v").key_up(Keys.CONTROL).perform()

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

    def arrived(self, name: str) -> Path:
        """The file whose name ends like this, once it is whole: until then the browser keeps an empty one for it."""
        files = self.downloads.glob
        return self.wait(lambda: [file for file in files(f"*{name}") if file.stat().st_size], f"No {name} arrived.")[0]

    def downloads_file(self, name: str) -> str:
        """Press the button of a file; returns what is in it once it has arrived."""
        self.press(name, '[data-testid="stDownloadButton"] button')
        return self.arrived(name).read_text(encoding="utf-8")


def press_tool(user: User, which: str) -> None:
    """Press the first button below a figure or table of this kind; it lies in a part of the page of its own."""

    def pressed() -> bool:
        return bool(
            user.browser.execute_script(
                "const tool = [...document.querySelectorAll('*')].map(e => e.shadowRoot?.querySelector(arguments[0]))"
                ".find(Boolean); tool?.click(); return Boolean(tool)",
                f"button{which}",
            )
        )

    user.wait(pressed, f"There is no button {which}.")


def bands(user: User) -> dict[str, bool]:
    """The bands of the page's first figure by what they are of, and whether they are filled; others are outlined."""
    asked = "return (document.querySelector('.js-plotly-plot')?.data ?? []).filter(each => each.hoverinfo === 'skip')"
    drawn: list[list[str]] = user.browser.execute_script(f"{asked}.map(each => [each.legendgroup, each.fill ?? ''])")
    filled = {name.removeprefix("band of "): fill == "toself" for name, fill in drawn}
    return {name: is_filled for name, is_filled in filled.items() if not name.startswith("whole of ")}


def rows(text: str) -> list[dict[str, str]]:
    """A CSV file's rows by column."""
    return list(csv.DictReader(io.StringIO(text)))


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
    started = Server(f"http://127.0.0.1:{port}", folder / "server.log", folder / "witness")
    environment = {**os.environ, "CRASHFUSE_CACHE": str(folder / "cache"), "STREAMLIT_SERVER_HEADLESS": "true"}
    environment.pop("CRASHFUSE_CAMPAIGN", None)
    environment["CRASHFUSE_WITNESS"] = str(started.witness)
    environment["PYTHONPATH"] = os.pathsep.join([str(WITNESS), *filter(None, [os.environ.get("PYTHONPATH")])])
    started.witness.mkdir()
    (folder / "tmp").mkdir()
    environment["TMPDIR"] = str(folder / "tmp")
    if campaign is not None:
        environment["CRASHFUSE_CAMPAIGN"] = str(campaign)
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


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Every test here is slow."""
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def cold_server(tmp_path: Path) -> Iterator[Server]:
    """A dashboard of the test's own that no session has used yet, with no campaign open."""
    with serve(tmp_path) as started:
        yield started


@pytest.fixture(scope="session")
def shared_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The one of :func:`server`."""
    with serve(tmp_path_factory.mktemp("server")) as started:
        yield started


@pytest.fixture(scope="session")
def shared_small_server(campaign_on_disk: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The one of :func:`small_server`."""
    with serve(tmp_path_factory.mktemp("server"), campaign_on_disk) as started:
        yield started


@pytest.fixture
def server(shared_server: Server) -> Iterator[Server]:
    """A dashboard that many tests share: the sample can be opened by a link, and folders by whoever has them."""
    yield from _in_order(shared_server)


@pytest.fixture
def small_server(shared_small_server: Server) -> Iterator[Server]:
    """A dashboard that many tests share, with the small campaign open; what one has computed the next finds done."""
    yield from _in_order(shared_small_server)


def _in_order(server: Server) -> Iterator[Server]:
    """The server, of which the log tells of no error while one test uses it."""
    before = len(server.log)
    yield server
    assert "Traceback" not in server.log[before:]


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
    """Someone new with an empty page before them, in the light theme; nothing that they do leaves the machine."""
    folder = tmp_path / "downloads"
    chromium.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(folder)})
    someone = User(chromium, folder)
    someone.becomes_another()
    someone.prefers("light")
    chromium.get_log("performance")  # type: ignore[no-untyped-call] # what came before is not theirs
    yield someone
    for tab in chromium.window_handles[1:]:
        chromium.switch_to.window(tab)
        chromium.close()
    chromium.switch_to.window(chromium.window_handles[0])
    chromium.execute_script("try { localStorage.clear(); sessionStorage.clear() } catch {}")
    chromium.get("about:blank")
    chromium.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert _foreign_hosts(chromium) == set()


@pytest.fixture
def engineer(small_server: Server, user: User) -> User:
    """Someone before two quick predictions of a test of the small campaign, at a desk of 1440 px."""
    user.sits_at(1440, 1000)
    user.open(small_server, "compare", test="T1", approaches=QUICK)
    user.starts("Predict test T1", FIGURE)
    return user
