"""A newcomer's first steps in a real browser."""

import json
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from selenium.webdriver.chrome.webdriver import WebDriver

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User


def foreign_hosts(browser: WebDriver) -> set[str]:
    """Hosts other than the server that the page sent anything to."""
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]  # type: ignore[no-untyped-call]
    addresses = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert addresses
    hosts = {urlsplit(address).hostname for address in addresses if address.startswith(("http", "ws"))}
    return {str(host) for host in hosts - {"127.0.0.1"}}


def test_a_newcomer_gets_from_a_cold_link_to_a_rated_comparison(server: "Server", user: "User") -> None:
    """Open /compare, load the sample, train without the networks, see the table; nothing leaves the machine."""
    user.open(server, "compare")
    user.sees("No campaign is open yet")
    user.press("Load the sample campaign")  # the first click counts
    assert "Synthetic" in user.sees("has not been predicted yet")
    user.go("Train")
    user.choose_approaches("CAE", "Displacement domain")
    user.press("Start")
    user.sees("are ready")
    user.press("Compare the predictions", "a")
    table = user.sees("Corridor", '[data-testid="stTable"]')
    assert all(approach in table for approach in ("CAE", "Displacement domain"))
    assert any(grade in table for grade in ("Excellent", "Good", "Fair", "Poor"))
    user.sees("Displacement (mm)", ".js-plotly-plot")
    assert foreign_hosts(user.browser) == set()
