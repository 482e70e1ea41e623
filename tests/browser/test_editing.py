"""Campaigns edited in a real browser: tests in and out of use, an import undone, all problems of an upload at once."""

import io
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tests.browser.conftest import serve
from tests.campaign_folder.test_additions import content_of
from tests.campaign_folder.test_all_problems import spoil
from tests.importing.crash_files import german
from tests.importing.crashes import clock, half_sine_g

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User

PILL = '[data-testid="stMain"] [data-testid="stButtonGroup"] button'


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator["Server"]:
    """One dashboard for all tests of this module, with no campaign open."""
    with serve(tmp_path_factory.mktemp("desk")) as started:
        yield started


@pytest.fixture
def own(campaign_on_disk: Path, tmp_path: Path) -> Path:
    """A campaign of the user's own."""
    return shutil.copytree(campaign_on_disk, tmp_path / f"car {tmp_path.name[-4:]}")


def open_folder(user: "User", desk: "Server", folder: Path) -> None:
    """Type the folder in and open it."""
    user.open(desk, "data")
    user.fill("A campaign folder on this computer", str(folder))
    user.press("Open folder")
    user.sees("Tests in use")


def held_out_choices(user: "User") -> list[str]:
    """The tests that can be held out, as the sidebar lists them."""
    user.press(
        "", '[data-testid="stSidebar"] [data-testid="stSelectbox"]:has([aria-label*="Held-out"]) [role="combobox"]'
    )
    listed = user.wait(lambda: [option.text.split(" ")[0] for option in user.all('[role="option"]')])
    user.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    return listed


def drop(user: "User", path: Path) -> None:
    """Drop a file and open it."""
    user.wait(lambda: user.browser.find_elements(By.CSS_SELECTOR, 'input[type="file"]'))[0].send_keys(str(path))
    user.sees(path.name, '[data-testid="stFileUploader"]')
    user.press("Open upload")


def test_a_test_is_left_out_of_use_and_used_again(desk: "Server", user: "User", own: Path) -> None:
    """One click: it is gone from Compare, and every page says so; another click, or Undo, and it is back."""
    open_folder(user, desk, own)
    user.press("T3", PILL)
    user.sees("Left out of use: T3.")
    user.go("Compare")
    user.sees("Left out of use: T3", '[data-testid="stSidebar"]')
    assert held_out_choices(user) == ["T1", "T2", "T4"]
    user.go("Data")
    user.press("T3", PILL)
    user.sees("In use again: T3.")
    user.go("Compare")
    assert held_out_choices(user) == ["T1", "T2", "T3", "T4"]
    user.open(desk, "data")  # another day: the folder is offered
    user.press(own.name, '[data-testid="stMain"] button')
    user.sees("In use again: T3.")
    user.press("Undo")
    user.sees("Left out of use: T3.")
    user.press("Undo")
    user.wait(lambda: not (own / "campaign.toml").exists(), "campaign.toml never went.")


def test_an_import_goes_to_the_open_campaign_and_is_undone(
    desk: "Server", user: "User", own: Path, tmp_path: Path
) -> None:
    """The open one is the first choice; what was added is said; undone, the folder is what it was to the byte."""
    before = content_of(own)
    open_folder(user, desk, own)
    table = tmp_path / "Versuch 12.csv"
    table.write_bytes(german(clock(), half_sine_g(clock())))
    drop(user, table)
    for label, value in (("Speed (km/h)", "56"), ("Front weight (kg)", "950"), ("Rear weight (kg)", "750")):
        user.fill(label, value)
    user.sees(f"{own.name}, which is open")
    user.press("Add as test")
    user.sees("Added: 1 test (Versuch 12).")
    assert {"T1", "T2", "T3", "T4", "Versuch 12"} < {button.text for button in user.all(PILL)}
    user.press("Undo")
    user.wait(lambda: "Versuch 12" not in user.find('[data-testid="stMain"]').text)
    assert content_of(own) == before


def test_all_problems_of_an_upload_are_shown_at_once(desk: "Server", user: "User", own: Path, tmp_path: Path) -> None:
    """Eight files spoilt in eight ways: eight rows."""
    told = spoil(own)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for path in own.rglob("*"):
            archive.write(path, path.relative_to(own))
    (tmp_path / "spoilt.zip").write_bytes(stream.getvalue())
    user.open(desk, "data")
    drop(user, tmp_path / "spoilt.zip")
    user.sees(f"cannot be used: {len(told)} problems")
    user.sees("What to do", '[data-testid="stTable"]')
    assert len(user.browser.find_elements(By.CSS_SELECTOR, '[data-testid="stTable"] tbody tr')) == len(told)
