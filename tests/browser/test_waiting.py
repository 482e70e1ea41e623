"""Waiting in a real browser: results as they come, and jobs that run while one looks elsewhere."""

from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import SIDEBAR

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User


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
