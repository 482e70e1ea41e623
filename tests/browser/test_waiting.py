"""Waiting in a real browser: a cold server, results as they come, and jobs that run while one looks elsewhere."""

from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import SIDEBAR

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User

WATCH = """
const seen = window.seen = new Set();
new MutationObserver(() => {
  for (const link of document.querySelectorAll('[data-testid="stSidebarNavLink"]')) seen.add(link.innerText.trim());
  const main = document.querySelector('[data-testid="stMain"]');
  if (main && main.innerText.includes("Starting")) seen.add("Starting");
  if (main && main.querySelector("h1")) seen.add(main.querySelector("h1").innerText.trim());
}).observe(document, {childList: true, subtree: true, characterData: true});
"""


def test_a_link_into_a_cold_server_paints_the_frame_and_no_list_of_files(cold_server: "Server", user: "User") -> None:
    """The page's name at once, never the names of the files in pages/."""
    script = user.browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": WATCH})
    user.open(cold_server, "compare", campaign="sample")
    user.sees("has not been predicted yet")
    seen = user.browser.execute_script("return [...window.seen]")
    user.browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
    assert "Compare" in seen
    assert not {"app", "compare", "data", "predict", "study", "train"} & set(seen)


def test_results_are_shown_as_they_come_and_the_sidebar_leads_to_them(small_server: "Server", user: "User") -> None:
    """Next starts the job; the displacement domain is rated before the networks; the sidebar names the job."""
    user.open(small_server, "data", seed="3")  # with which nobody has predicted yet
    user.press("Next: predict test T2")  # in the middle of the speeds
    user.sees("left · ", timeout_s=240)  # one time for the whole job
    rated = user.sees("still training", timeout_s=240)
    assert "Displacement domain" in rated
    assert "Good" in rated or "Excellent" in rated or "Fair" in rated
    user.go("Data")
    user.sees("Fingerprint")
    user.press("predict test T2", f"{SIDEBAR} button")
    user.sees("T2: 25.0 mph")
    assert "/compare" in user.browser.current_url
    user.go("Data")
    user.sees("Ready: ", SIDEBAR, timeout_s=400)
    user.press("Ready: ", f"{SIDEBAR} button")
    shown = user.sees("recommended")
    assert all(approach in shown for approach in ("LF TCN", "Time domain", "Fused"))
    user.wait(lambda: not user.all(SIDEBAR, "Ready"))
