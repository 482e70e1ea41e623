"""Campaigns in a real browser: tests in and out of use, and an import undone."""

import shutil
from pathlib import Path

from selenium.webdriver.common.keys import Keys

from tests.browser.conftest import MAIN, PILL, SIDEBAR, Server, User
from tests.conftest import content_of
from tests.importing.crash_files import german
from tests.importing.crashes import clock, half_sine_g

IN_USE = f"{MAIN} {PILL}"  # a pill for each test


def held_out_choices(user: User) -> list[str]:
    """The tests that can be held out, as the sidebar lists them."""
    field = f'{SIDEBAR} [data-testid="stSelectbox"]:has([aria-label*="Held-out"]) [role="combobox"]'
    user.presses_until(lambda: user.texts('[role="option"]'), "", field)
    listed = [option.split(" ")[0] for option in user.texts('[role="option"]')]
    user.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    return listed


def test_tests_are_left_out_of_use_used_again_added_and_undone(
    server: Server, user: User, campaign_on_disk: Path, tmp_path: Path
) -> None:
    """One click: a test is gone from Compare, and every page says so; another click, or Undo, and it is back.

    A German table, with semicolons, decimal commas and bare headers: columns are said, the condition filled in.
    """
    own = shutil.copytree(campaign_on_disk, tmp_path / f"car {tmp_path.name[-4:]}")
    user.open_folder(server, own)
    user.press("T3", IN_USE)
    user.sees("Left out of use: T3.")
    user.go("Compare")
    user.sees("without T3")
    assert held_out_choices(user) == ["T1", "T2", "T4"]
    user.go("Data")
    user.press("T3", IN_USE)
    user.sees("In use again: T3.")
    user.go("Compare")
    assert held_out_choices(user) == ["T1", "T2", "T3", "T4"]
    user.open(server, "data")  # another day: the folder is offered
    user.press(own.name, f"{MAIN} button")
    user.sees("In use again: T3.")
    user.press("Undo")
    user.sees("Left out of use: T3.")
    user.press("Undo")
    user.wait(lambda: not (own / "campaign.toml").exists(), "campaign.toml never went.")
    user.press("T1", IN_USE)
    user.press("Take T1 out of the folder")
    user.sees("Taken out: T1.")
    assert not (own / "tests" / "T1.csv").exists()
    user.press("Undo")
    user.wait((own / "tests" / "T1.csv").exists, "T1 never came back.")
    user.wait(lambda: not (own / ".in-use").exists(), "The change never ended.")
    before = content_of(own)
    user.press("km/h, kg", f"{SIDEBAR} button")  # in which the import then begins
    user.wait(lambda: "system=kph-kg" in user.browser.current_url)
    table = tmp_path / "Versuch 12.csv"
    table.write_bytes(german(clock(), 0 * clock(), half_sine_g(clock()), header="Zeit;Kanal 1;Kanal 2"))
    user.press("Add tests or CAE runs")
    user.uploads(table)
    user.press("Open upload")
    user.sees("Before it can be added")
    sidebar = user.sees("Units", SIDEBAR)
    assert "Held-out test" not in sidebar  # which nothing here depends on
    assert "Rated time window" not in sidebar
    user.press("", 'button[aria-label="Remove Kanal 1"]')
    for label, value in (("Speed (km/h)", "56"), ("Front weight (kg)", "950"), ("Rear weight (kg)", "750")):
        user.fill(label, value)
    user.sees("Read as acceleration: Kanal 2")
    user.sees("Zero velocity (TTZV) at")
    user.find('[data-testid="stPlotlyChart"] .scatterlayer')
    user.sees(f"{own.name}, which is open")
    user.press("Add as test")
    user.sees("Added: 1 test (Versuch 12).")
    user.sees("Fingerprint")
    assert {"T1", "T2", "T3", "T4", "Versuch 12"} < set(user.texts(IN_USE))
    assert (own / "tests.csv").read_text().splitlines()[-1].startswith('"Versuch 12",34.79')
    user.press("Undo")
    user.wait(lambda: not user.all(MAIN, "Versuch 12"))
    assert content_of(own) == before
