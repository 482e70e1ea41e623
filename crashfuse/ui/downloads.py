"""Download buttons; each file is made on request."""

from collections.abc import Callable

import pandas as pd
import streamlit as st

from crashfuse.files.csv_output import csv_bytes
from crashfuse.reporting.figure_files import figure_files, figures_of, missing_for


def download_table(name: str, table: Callable[[], pd.DataFrame]) -> None:
    """Button that downloads a table as a CSV file of this name: the file that the command line writes."""
    download_bytes(name, lambda: csv_bytes(table()), mime="text/csv")


def download_report(write: Callable[[], str], name: str = "report.html") -> None:
    """Button that downloads a report, which takes seconds to write; one for its figures as slides, if that can be."""
    st.download_button(
        name, lambda: write().encode(), file_name=name, mime="text/html", icon=":material/description:",
        on_click="ignore", help="One file, opens without a network, prints on paper.",
    )  # fmt: skip
    if not missing_for(("pptx",)):
        slides = f"{name.removesuffix('.html')}.pptx"
        download_bytes(slides, lambda: figure_files(figures_of(write()), ("pptx",))["figures.pptx"])


def download_bytes(name: str, write: Callable[[], bytes], mime: str | None = None) -> None:
    """Button that downloads a file of any kind."""
    st.download_button(name, write, file_name=name, mime=mime, icon=":material/download:", on_click="ignore")
