"""Campaigns in a real browser: tests in and out of use, an import undone, an upload refused and mended."""

import shutil
from pathlib import Path

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from crashfuse.files.archive import zipped
from tests.browser.conftest import MAIN, PILL, SIDEBAR, TABLE, Server, User
from tests.campaign_folder.test_uploads import spoil
from tests.conftest import content_of
from tests.importing.crash_files import german
from tests.importing.crashes import clock, half_sine_g

pytestmark = pytest.mark.slow

IN_USE = f"{MAIN} {PILL}"  # a pill for each test


@pytest.fixture
def own(campaign_on_disk: Path, tmp_path: Path) -> Path:
    """A campaign of the user's own."""
    return shutil.copytree(campaign_on_disk, tmp_path / f"car {tmp_path.name[-4:]}")


def held_out_choices(user: User) -> list[str]:
    """The tests that can be held out, as the sidebar lists them."""
    field = f'{SIDEBAR} [data-testid="stSelectbox"]:has([aria-label*="Held-out"]) [role="combobox"]'
    user.presses_until(lambda: user.texts('[role="option"]'), "", field)
    listed = [option.split(" ")[0] for option in user.texts('[role="option"]')]
    user.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    return listed


def test_a_test_is_left_out_of_use_and_used_again(server: Server, user: User, own: Path) -> None:
    """One click: it is gone from Compare, and every page says so; another click, or Undo, and it is back."""
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


def test_a_german_table_is_mapped_seen_added_to_the_open_campaign_and_undone(
    server: Server, user: User, own: Path, tmp_path: Path
) -> None:
    """Semicolons, decimal commas, bare headers: the columns are said, the condition filled in, the preview drawn."""
    before = content_of(own)
    user.open_folder(server, own)
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


def test_an_upload_is_refused_with_all_its_problems_and_the_mended_one_opened(
    server: Server, user: User, own: Path, tmp_path: Path
) -> None:
    """Eight files spoilt in eight ways: eight rows, which say which file; after that the good zip takes its place."""
    (tmp_path / "mended.zip").write_bytes(zipped(content_of(own)))
    told = spoil(own)
    (tmp_path / "spoilt.zip").write_bytes(zipped(content_of(own)))
    user.open(server, "data")
    user.uploads(tmp_path / "spoilt.zip")
    user.press("Open upload")
    user.sees(f"cannot be used: {len(told)} problems")
    assert "T2.csv" in user.sees("What to do", TABLE)
    assert len(user.browser.find_elements(By.CSS_SELECTOR, f"{TABLE} tbody tr")) == len(told)
    user.open(server, "data")
    user.uploads(tmp_path / "mended.zip")
    user.press("Open upload")
    user.sees("Fingerprint")
    assert "campaign=mended" in user.browser.current_url
