"""Files that pages offer are those that the command line writes."""

import re
from collections.abc import Callable

import pandas as pd
import pytest

from crashfuse.files.csv_text import csv_bytes
from crashfuse.ui import downloads
from tests.conftest import ROOT


def test_a_downloaded_table_is_the_file_of_the_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Byte for byte, in as many digits: two files of one certification that differ are a finding in a review.

    Its name on a page begins with what it is about, and the settings where they are not the usual ones.
    """
    monkeypatch.setattr("streamlit.session_state", {"page": "predict", "seed": 7})
    table = pd.DataFrame({"id": ["A"], "value": [24.958261014512296], "lower": [None]})
    offered: dict[str, Callable[[], bytes]] = {}

    def take(_: str, write: Callable[[], bytes], file_name: str, **__: object) -> None:
        offered[file_name] = write

    monkeypatch.setattr("crashfuse.ui.downloads.st.download_button", take)
    for of, name in (("", "certification.csv"), ("my car T09, 56 km/h", "my-car-T09-56-km-h_seed-7_certification.csv")):
        downloads.download_table("certification.csv", lambda: table, of)
        assert offered[name]() == csv_bytes(table) == b"id,value,lower\nA,24.9583,\n"


def test_every_file_that_a_page_offers_says_what_it_holds() -> None:
    """A row of file names tells only those who know the files; none is explained that no page offers."""
    sources = [*(ROOT / "crashfuse" / "ui").rglob("*.py"), *(ROOT / "pages").glob("*.py")]
    offered = {
        name
        for source in sources
        for name in re.findall(r'download_(?:table|bytes)\("([^"]+)"', source.read_text(encoding="utf-8"))
    }
    assert offered == set(downloads._HOLDS)
