"""Download buttons; each file is made on request."""

from collections.abc import Callable

import pandas as pd
import streamlit as st

from crashfuse.files.csv_text import csv_bytes
from crashfuse.reporting.figure_files import figure_files, figures_of, missing_for
from crashfuse.ui.captions import file_name, settings

_HOLDS = {
    "certification.csv": "Every verdict, one row a condition and criterion, with its limits, probability and reason.",
    "track_record.csv": "Every verdict on a left-out test beside what it measured.",
    "changes.csv": "Every verdict beside that of the earlier certification, and what tests run since measured.",
    "criteria.toml": "The criteria as judged: put it into the campaign folder to judge by them again.",
    "matrix.csv": "The conditions as judged: put it into the campaign folder to judge them again.",
    "certification.json": "The whole certification for programs, and to hold a later one against it.",
    "comparison.csv": "The ratings of both studies, and by how much they differ.",
    "learning_curve.csv": "The mean ratings by number of tests, with their errors.",
    "metrics.csv": "The pulse metrics with their 95 % intervals.",
    "models.zip": "The fitted approaches: unpack it for crashfuse predict --models.",
    "next_tests.csv": "Every test that could be run next, with what it would gain.",
    "pulses.csv": "The predicted pulses over time, with the ends of their 95 % bands.",
    "pulses.parquet": "The same as pulses.csv, for programs that read Parquet.",
    "scores.csv": "The ratings, and the four scores of each, by test, approach and window.",
    "side_by_side.csv": "The metrics of this prediction and of those beside it, with their differences.",
    "speed_groups.csv": "As scores.csv, of tests left out with all at about their speed.",
    "sweep.csv": "The pulse metrics over impact speed, with their 95 % intervals.",
}


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
    """Button that downloads a file of any kind, and says what a known one holds."""
    slides = "The figures of the report, one a slide." if name.endswith(".pptx") else None
    st.download_button(
        name, write, file_name=_named(name, of), mime=mime, icon=":material/download:", on_click="ignore",
        help=_HOLDS.get(name, slides),
    )  # fmt: skip


def _named(name: str, of: str) -> str:
    return f"{file_name(of, *settings())}_{name}" if of else name
