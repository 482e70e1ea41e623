"""Files that pages offer are those that the command line writes."""

from collections.abc import Callable

import pandas as pd
import pytest

from crashfuse.files.csv_output import csv_bytes
from crashfuse.ui import downloads


def test_a_downloaded_table_is_the_file_of_the_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Byte for byte, in as many digits: two files of one certification that differ are a finding in a review."""
    table = pd.DataFrame({"id": ["A"], "value": [24.958261014512296], "lower": [None]})
    offered: dict[str, Callable[[], bytes]] = {}
    monkeypatch.setattr(
        "crashfuse.ui.downloads.st.download_button", lambda name, write, **_: offered.update({name: write})
    )
    downloads.download_table("certification.csv", lambda: table)
    assert offered["certification.csv"]() == csv_bytes(table) == b"id,value,lower\nA,24.9583,\n"
