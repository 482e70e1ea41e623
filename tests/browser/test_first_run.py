"""The dashboard in a real browser: links into a server that nobody has used, and a newcomer's first steps."""

import json
from typing import TYPE_CHECKING, Literal
from urllib.parse import urlsplit

import pytest
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.webdriver import WebDriver
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

if TYPE_CHECKING:
    from tests.browser.conftest import Server

SOON, TRAINING = 60, 600  # s; a minute where nothing else runs
CONTENT = '[data-testid="stMain"]'


def wait_for(browser: WebDriver, words: str, timeout_s: float = SOON, css: str = CONTENT) -> str:
    """Wait until an element of this kind (the page's main part) shows these words; returns all that it shows."""

    def shown(_: WebDriver) -> str | Literal[False]:
        texts = [element.text for element in browser.find_elements(By.CSS_SELECTOR, css)]
        return next((text for text in texts if words in text), False)

    wait = WebDriverWait(browser, timeout_s, ignored_exceptions=[StaleElementReferenceException])
    return wait.until(shown, f"The page never showed {words!r}.")


def press(browser: WebDriver, label: str, css: str = "button") -> None:
    """Click the first visible element of this kind that carries the label."""

    def found(_: WebDriver) -> WebElement | Literal[False]:
        elements = browser.find_elements(By.CSS_SELECTOR, css)
        return next((e for e in elements if label in e.text and e.is_displayed() and e.is_enabled()), False)

    wait = WebDriverWait(browser, SOON, ignored_exceptions=[StaleElementReferenceException])
    wait.until(found, f"There is no {label!r} to click.").click()


def foreign_hosts(browser: WebDriver) -> set[str]:
    """Hosts other than the server that the page sent anything to."""
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]  # type: ignore[no-untyped-call]
    addresses = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert addresses
    hosts = {urlsplit(address).hostname for address in addresses if address.startswith(("http", "ws"))}
    return {str(host) for host in hosts - {"127.0.0.1"}}


@pytest.mark.parametrize("page", ["data", "study"])
def test_a_link_opens_its_page_on_a_cold_server(server: "Server", browser: WebDriver, page: str) -> None:
    """The page stands in its frame, with the other pages beside it, though app.py has never run."""
    browser.get(f"{server.address}/{page}")
    wait_for(browser, "Load the sample campaign")
    assert urlsplit(browser.current_url).path == f"/{page}"
    links = [e.text for e in browser.find_elements(By.CSS_SELECTOR, '[data-testid="stSidebarNavLink"]')]
    assert [link.split()[-1] for link in links] == ["Data", "Train", "Compare", "Study", "Predict"]
    press(browser, "Load the sample campaign")  # the first click counts
    wait_for(browser, "Synthetic")
    assert "Traceback" not in server.log


def test_a_newcomer_gets_from_a_cold_link_to_a_rated_comparison(server: "Server", browser: WebDriver) -> None:
    """Open /compare, load the sample, train the fast preset for one test, see the table; nothing leaves the machine."""
    browser.get(f"{server.address}/compare")
    wait_for(browser, "No campaign is open yet")
    press(browser, "Load the sample campaign")
    wait_for(browser, "has not been predicted yet")
    press(browser, "Train", '[data-testid="stSidebarNavLink"]')
    wait_for(browser, "Leave a test out")
    press(browser, "Start")
    wait_for(browser, "Cancel")
    browser.refresh()  # the training goes on
    wait_for(browser, "are ready", TRAINING)
    press(browser, "Compare", '[data-testid="stSidebarNavLink"]')
    table = wait_for(browser, "Corridor", css='[data-testid="stTable"]')
    for approach in ("CAE", "LF TCN", "Time domain", "Displacement domain"):
        assert approach in table
    assert any(grade in table for grade in ("Excellent", "Good", "Fair", "Poor"))
    wait_for(browser, "Displacement (mm)", css=".js-plotly-plot")
    assert foreign_hosts(browser) == set()
    assert "Traceback" not in server.log
