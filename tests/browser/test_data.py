"""The page Data and the frame in a real browser: links, both themes, uploads."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar
from urllib.parse import parse_qs, quote_plus, urlsplit

import pytest
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

if TYPE_CHECKING:
    from tests.browser.conftest import Server

SOON = 60  # s
SIDEBAR = '[data-testid="stSidebar"]'
MAIN, TABLE = '[data-testid="stMain"]', '[data-testid="stTable"]'
VIEW = {"campaign": "sample", "held_out": "T03 · 16.7 mph", "window": "0–40 ms", "unit": "m/s²", "sign": "Deceleration"}
T = TypeVar("T")


def wait(browser: WebDriver, found: Callable[[WebDriver], T]) -> T:
    """Wait until something is found; returns it."""
    return WebDriverWait(browser, SOON, ignored_exceptions=[StaleElementReferenceException]).until(found)


def text_with(browser: WebDriver, words: str, css: str = MAIN) -> str:
    """Wait for an element of this kind with these words; returns all its words."""
    return wait(browser, lambda b: next((e.text for e in b.find_elements(By.CSS_SELECTOR, css) if words in e.text), ""))


def press(browser: WebDriver, label: str) -> None:
    """Press the button of this label as soon as there is one."""
    buttons = wait(
        browser, lambda b: [e for e in b.find_elements(By.TAG_NAME, "button") if label in e.text and e.is_enabled()]
    )
    buttons[0].click()


def prefer(browser: WebDriver, theme: str) -> None:
    """Let the system behind the browser prefer the light or the dark theme."""
    feature = {"name": "prefers-color-scheme", "value": theme}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})


def paper(browser: WebDriver) -> str:
    """What the first figure is drawn on."""
    figures = wait(browser, lambda b: b.find_elements(By.CSS_SELECTOR, ".js-plotly-plot .main-svg"))
    return figures[0].value_of_css_property("background-color")


@pytest.mark.parametrize("page", ["data", "train", "compare", "study", "predict"])
def test_a_link_reproduces_the_view_on_a_cold_server(server: "Server", browser: WebDriver, page: str) -> None:
    """Campaign, test, window, unit and sign, on whichever page; a reload and another page keep them."""
    query = "&".join(f"{name}={quote_plus(value)}" for name, value in VIEW.items())

    def asked() -> bool:
        given = {name: values[0] for name, values in parse_qs(urlsplit(browser.current_url).query).items()}
        pressed = [e.text for e in browser.find_elements(By.CSS_SELECTOR, f'{SIDEBAR} [aria-checked="true"]')]
        chosen = [e.get_attribute("value") for e in browser.find_elements(By.CSS_SELECTOR, f"{SIDEBAR} input")]
        return given == VIEW and [*chosen[:2], *pressed] == list(VIEW.values())

    browser.get(f"{server.address}/{page}?{query}")
    wait(browser, lambda _: asked())
    browser.refresh()
    wait(browser, lambda _: asked())
    other = {"data": "Study"}.get(page, "Data")
    next(
        e for e in browser.find_elements(By.CSS_SELECTOR, '[data-testid="stSidebarNavLink"]') if other in e.text
    ).click()
    wait(browser, lambda b: urlsplit(b.current_url).path == f"/{other.lower()}" and asked())
    assert "Traceback" not in server.log


def test_the_page_and_its_figures_follow_the_theme(server: "Server", browser: WebDriver) -> None:
    """Dark from the first sight where the system is, light as soon as it becomes so: page, figures, no reload."""
    prefer(browser, "dark")
    browser.get(f"{server.address}/data?campaign=sample")
    text_with(browser, "CAE runs")
    wait(browser, lambda b: paper(b) == "rgba(20, 24, 31, 1)")
    app = browser.find_element(By.CSS_SELECTOR, '[data-testid="stApp"]')
    assert app.value_of_css_property("background-color") == "rgba(20, 24, 31, 1)"
    prefer(browser, "light")
    wait(browser, lambda b: paper(b) == "rgba(255, 255, 255, 1)")
    assert app.value_of_css_property("background-color") == "rgba(255, 255, 255, 1)"
    assert "Traceback" not in server.log


def test_a_bad_upload_is_refused_and_the_mended_one_opened(
    server: "Server", browser: WebDriver, tmp_path: Path
) -> None:
    """The table says which file; after that the good zip takes its place."""
    sample = Path(__file__).parents[2] / "sample_data"
    for name, left_out in (("bad.zip", "T02.csv"), ("good.zip", None)):
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            for path in sample.rglob("*"):
                if path.name != left_out:
                    archive.write(path, path.relative_to(sample))
        (tmp_path / name).write_bytes(stream.getvalue())

    def drop(name: str) -> None:
        wait(browser, lambda b: b.find_elements(By.CSS_SELECTOR, 'input[type="file"]'))[0].send_keys(
            str(tmp_path / name)
        )
        text_with(browser, name, '[data-testid="stFileUploader"]')
        press(browser, "Open upload")

    browser.get(f"{server.address}/data")
    drop("bad.zip")
    text_with(browser, "cannot be used: 1 problem")
    assert "T02" in text_with(browser, "What to do", TABLE)
    browser.get(f"{server.address}/data")
    drop("good.zip")
    text_with(browser, "Fingerprint")
    assert "campaign=good" in browser.current_url
    assert "Traceback" not in server.log
