"""Trainings in a real browser: watched, shared and stopped while they run."""

from typing import TYPE_CHECKING

import pytest

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User


def test_a_training_survives_a_reload_is_joined_and_can_be_cancelled_by_another_session(
    server: "Server", user: "User"
) -> None:
    """Reload in the middle, open a second tab, cancel there: the first tab says so, and offers to start again."""
    user.open(server, "train", campaign="sample")
    user.press("Start")
    user.sees("LF TCN: ")
    user.browser.refresh()
    user.sees("LF TCN: ")
    first = user.browser.current_window_handle
    user.browser.switch_to.new_window("tab")
    user.open(server, "train", campaign="sample")
    user.sees("LF TCN: ")
    assert [button.text for button in user.all("button") if "Start" in button.text] == []
    user.press("Cancel")
    user.sees("Cancelled.")
    user.browser.switch_to.window(first)
    assert "Start" in user.sees("Cancelled.")
    user.go("Data")
    user.sees("Fingerprint")
