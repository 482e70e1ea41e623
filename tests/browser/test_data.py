"""Uploads in a real browser."""

import io
import shutil
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from selenium.webdriver.common.by import By

from tests.importing.crash_files import german
from tests.importing.crashes import clock, half_sine_g

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    from tests.browser.conftest import Server, User


def test_a_bad_upload_is_refused_and_the_mended_one_opened(server: "Server", user: "User", tmp_path: Path) -> None:
    """The table says which file; after that the good zip takes its place."""
    sample = Path(__file__).parents[2] / "sample_data"
    for name, left_out in (("bad.zip", "T02.csv"), ("good.zip", None)):
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            for path in sample.rglob("*"):
                if path.name != left_out:
                    archive.write(path, path.relative_to(sample))
        (tmp_path / name).write_bytes(stream.getvalue())

    def drop(name: str) -> None:
        fields = user.wait(lambda: user.browser.find_elements(By.CSS_SELECTOR, 'input[type="file"]'))
        fields[0].send_keys(str(tmp_path / name))
        user.sees(name, '[data-testid="stFileUploader"]')
        user.press("Open upload")

    user.open(server, "data")
    drop("bad.zip")
    user.sees("cannot be used: 1 problem")
    assert "T02" in user.sees("What to do", '[data-testid="stTable"]')
    user.open(server, "data")
    drop("good.zip")
    user.sees("Fingerprint")
    assert "campaign=good" in user.browser.current_url


def test_a_german_table_is_mapped_seen_and_added(server: "Server", user: "User", tmp_path: Path) -> None:
    """Semicolons, decimal commas and bare headers: the columns are said, the condition filled in, the preview drawn."""
    campaign = tmp_path / "campaign"
    shutil.copytree(Path(__file__).parents[2] / "sample_data", campaign)
    time_s = clock()
    table = tmp_path / "Versuch 12.csv"
    table.write_bytes(german(time_s, 0 * time_s, half_sine_g(time_s), header="Zeit;Kanal 1;Kanal 2"))
    user.open(server, "data")
    user.wait(lambda: user.browser.find_elements(By.CSS_SELECTOR, 'input[type="file"]'))[0].send_keys(str(table))
    user.sees(table.name, '[data-testid="stFileUploader"]')
    user.press("Open upload")
    user.sees("Before it can be added")
    user.press("", 'button[aria-label="Remove Kanal 1"]')
    for label, value in (("Speed (km/h)", "56"), ("Front weight (kg)", "950"), ("Rear weight (kg)", "750")):
        user.fill(label, value)
    user.sees("Column Kanal 2 is the acceleration")
    user.sees("Zero velocity (TTZV) at")
    user.find('[data-testid="stPlotlyChart"] .scatterlayer')
    user.fill("Campaign folder on this computer", str(campaign))
    user.press("Add as test")
    user.sees("Fingerprint")
    assert "campaign=campaign" in user.browser.current_url
    assert (campaign / "tests.csv").read_text().splitlines()[-1].startswith('"Versuch 12",34.79')
