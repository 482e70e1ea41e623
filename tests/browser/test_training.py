"""Computations in a real browser: watched, shared and stopped while they run, or ended by want of memory."""

from tests.browser.conftest import MAIN, QUICK, Server, User


def test_a_training_ends_when_nobody_waits_for_it_and_what_failed_succeeds_the_next_time(
    small_server: Server, user: User
) -> None:
    """After a reload, in a second tab it is there; another browser sees whose it is; it goes on until both cancel.

    A study that runs out of memory, or whose processes are killed, says so where it was started, and can go on.
    """
    user.open(small_server, "train", seed="1", preset="paper")  # which takes hours
    user.press("Train without them")
    user.sees(" so far", timeout_s=240)  # the step, and how long it has worked
    user.browser.refresh()
    user.sees(" so far")
    first = user.browser.current_window_handle
    user.browser.switch_to.new_window("tab")
    user.open(small_server, "train", seed="1", preset="paper")
    user.sees(" so far")
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
    study = f"{MAIN} button", "Leave out each of 4 tests"
    failures = {"memory": "Memory ran out. Close other programs", "kills": "Workers died 3 times in a row"}
    for seed, (fails, message) in enumerate(failures.items(), start=8):
        user.open(small_server, "study", approaches=QUICK, seed=str(seed))
        user.find(*study)
        (small_server.witness / fails).touch()
        try:
            user.press(study[1], study[0])
            user.sees(message)
        finally:
            (small_server.witness / fails).unlink()
        user.press(study[1], study[0])
        user.sees("Mean over the tests")
