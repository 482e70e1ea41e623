"""Trainings in a real browser: watched, shared and stopped while they run."""

import json
import zipfile

import pytest
import safetensors
from selenium.webdriver.common.keys import Keys

from tests.browser.conftest import Server, User

pytestmark = pytest.mark.slow


def test_a_training_survives_a_reload_and_ends_when_nobody_waits_for_it(small_server: Server, user: User) -> None:
    """A second tab finds it, another browser sees whose it is and asks for it, too; it goes on until both cancel."""
    user.open(small_server, "train", seed="1", preset="paper")  # which takes hours
    user.press("Train without them")
    user.sees("LF TCN: ")
    user.browser.refresh()
    user.sees("LF TCN: ")
    first = user.browser.current_window_handle
    user.browser.switch_to.new_window("tab")
    user.open(small_server, "train", seed="1", preset="paper")
    user.sees("LF TCN: ")
    assert not user.all("button", "Train without them")
    second = user.browser.current_window_handle
    user.browser.execute_cdp_cmd("Network.clearBrowserCookies", {})  # another browser from now on
    user.browser.switch_to.new_window("tab")
    user.open(small_server, "study", seed="6", approaches="lf_tcn")  # which nobody has computed
    user.press("Leave out each of 4 tests")
    user.sees("Waiting for its turn behind: A computation of browser ")
    user.press("Cancel")
    user.sees("Cancelled.", timeout_s=10)
    user.open(small_server, "train", seed="1", preset="paper")
    user.sees("Started by browser ")
    assert "Cancel" not in user.texts("button")
    user.press("I want it, too")
    user.sees("Also wanted by browser ")
    user.browser.switch_to.window(second)
    user.sees("Also wanted by browser ")
    user.press("Cancel")
    user.sees("Started by browser ")
    user.browser.switch_to.window(user.browser.window_handles[-1])
    user.press("Cancel")
    user.sees("Cancelled.")
    assert ": cancelled: " in small_server.log
    user.browser.switch_to.window(first)
    assert "Train without them" in user.sees("Cancelled.")
    user.go("Data")
    user.sees("Fingerprint")


def test_fitting_on_all_tests_hands_out_a_model_and_predict_answers_at_once(small_server: Server, user: User) -> None:
    """The file names what it was fitted on, as that of ``crashfuse train`` does; Predict has nothing left to start."""
    user.open(small_server, "train", seed="2")
    user.choose_approaches("Displacement domain")
    user.press("Train on all tests")
    user.sees("Learned from 4 tests")
    user.press("Export")
    user.press("models.zip", '[data-testid="stDownloadButton"] button')
    with zipfile.ZipFile(user.arrived("models.zip")) as archive:
        model_file = archive.extract("displacement_domain.safetensors", user.downloads)
    with safetensors.safe_open(model_file, framework="numpy") as model:
        record = json.loads(model.metadata()["crashfuse"])
    assert (record["approach"], record["preset"], record["seed"]) == ("displacement_domain", "fast", 2)
    user.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    user.go("Predict")
    user.sees("Use the")
    assert "Predict" not in user.texts("button")
