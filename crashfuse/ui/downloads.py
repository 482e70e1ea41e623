"""Download buttons; each file is made on request."""

from collections.abc import Callable

import pandas as pd
import streamlit as st

from crashfuse.files.csv_output import csv_bytes
from crashfuse.reporting.figure_files import figure_files, figures_of, missing_for
from crashfuse.ui.captions import file_name, settings


def download_table(name: str, table: Callable[[], pd.DataFrame], of: str = "") -> None:
    """Button that downloads a table as CSV, the file of this name that the command line writes.

    ``of`` is what it is about, a campaign and a test, say: it stands before the name of the file, in a folder of many.
    """
    download_bytes(name, lambda: csv_bytes(table()), of, mime="text/csv")


def download_report(write: Callable[[], str], of: str, name: str = "report.html") -> None:
    """Button that downloads a report, which takes seconds to write; one for its figures as slides, if that can be."""
    st.download_button(
        name, lambda: write().encode(), file_name=_named(name, of), mime="text/html", icon=":material/description:",
        on_click="ignore", help="One file, opens without a network, prints on paper.",
    )  # fmt: skip
    if not missing_for(("pptx",)):
        slides = f"{name.removesuffix('.html')}.pptx"
        download_bytes(slides, lambda: figure_files(figures_of(write()), ("pptx",))["figures.pptx"], of)


def download_bytes(name: str, write: Callable[[], bytes], of: str = "", mime: str | None = None) -> None:
    """Button that downloads a file of any kind."""
    st.download_button(
        name, write, file_name=_named(name, of), mime=mime, icon=":material/download:", on_click="ignore"
    )


def _named(name: str, of: str) -> str:
    return f"{file_name(of, *settings())}_{name}" if of else name
