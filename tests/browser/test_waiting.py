"""Waiting in a real browser: results as they come, and jobs that run while one looks elsewhere."""

import re

from selenium.webdriver.common.keys import Keys

from crashfuse.approaches.registry import LABELS
from tests.browser.conftest import APPROACH, MAIN, POPOVER, SIDEBAR, STAR, Server, User, bands


def test_results_are_shown_as_they_come_and_the_sidebar_leads_to_them(small_server: Server, user: User) -> None:
    """Next starts the job; the displacement domain is rated before the networks; the sidebar names the job."""
    user.open(small_server, "data", seed="3")  # with which nobody has predicted yet
    user.press("Next: predict test T2")  # in the middle of the speeds
    user.sees(" so far", timeout_s=240)  # the step, and how long it has worked
    rated = re.compile(r"Displacement domain\s+0\.\d+[^A-Z]*(Fair|Good|Excellent)")
    user.wait(lambda: any(map(rated.search, user.texts(MAIN, "still training"))), timeout_s=240)
    user.go("Data")
    user.sees("Fingerprint")
    user.press("predict test T2", f"{SIDEBAR} button")
    user.sees("T2: 25.0 mph")
    assert "/compare" in user.browser.current_url
    user.go("Predict")  # which has nothing to show yet, and ends early
    user.sees("Ready: ", SIDEBAR, timeout_s=400)
    user.press("Ready: ", f"{SIDEBAR} button")
    user.find(f"{APPROACH} {STAR}")
    shown = user.find(APPROACH).text
    assert all(approach in shown for approach in ("LF TCN", "Time domain", "Fused"))
    user.wait(lambda: not user.all(SIDEBAR, "Ready"))
    for chosen in ("time_domain", "displacement_domain"):
        user.chooses_approach(LABELS[chosen])
        user.wait(lambda chosen=chosen: bands(user) == {chosen: True})  # type: ignore[misc]
    user.opens("More")
    why = user.sees("rated", POPOVER)
    user.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    user.open_tab("Ratings and metrics")
    made_of = r"Made of \d+ % .*, because the nearest test is [\d.]+ mph away"
    user.press("More metrics", "summary")
    user.wait(lambda: re.search(made_of, f"{why} {user.sees('Pulse metric')}"), "Nothing said what Fused is made of.")
    user.chooses_approach(LABELS["time_domain"])
    user.open_tab("Why")
    user.sees("Time domain 0.", '[data-testid="stMarkdown"]')
    assert "compare_tab=Why&explained=time_domain" in user.browser.current_url
