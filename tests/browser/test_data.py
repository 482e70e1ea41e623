"""Uploads in a real browser."""

import io
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

from selenium.webdriver.common.by import By

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
