"""Ways to open the user's own campaign: a folder, dropped files, or files that can be imported."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import streamlit as st

from crashfuse.campaign_folder.condition_tables import has_table
from crashfuse.errors import DataError, Problem
from crashfuse.readers.formats import all_formats
from crashfuse.ui import campaigns, recent
from crashfuse.ui.chosen import REFUSED, choose_campaign
from crashfuse.ui.importing import step as importing
from crashfuse.ui.importing.session import Source, begin, leave, source_at
from crashfuse.ui.problems import show_problems
from crashfuse.ui.text import plain
from crashfuse.ui.uploads import open_uploads

_ROUND = "uploads so far"


def show_open_forms() -> None:
    """Show both ways to open the user's own campaign, and what was wrong with the last attempt."""
    folder, upload = st.columns(2, gap="large")
    with folder.form("open folder", border=False):
        st.text_input(
            "A campaign folder on this computer",
            key="folder",
            placeholder="the folder that holds tests.csv and cae.csv",
            help="On the computer that crashfuse runs on. Nothing is copied or sent anywhere. Files and folders of "
            "other formats are taken, too, to be imported.",
        )
        st.form_submit_button("Open folder", icon=":material/folder_open:", on_click=_open_folder)
    if folders := recent.recent_folders():
        with folder.container(horizontal=True, vertical_alignment="center", gap="small"):
            st.caption("Opened before:", width="content")
            for place, label in zip(folders, recent.labels(folders), strict=True):
                st.button(
                    plain(label), help=plain(str(place)), key=f"recent {place}", type="tertiary",
                    icon=":material/folder:", on_click=_attempt, args=(partial(_campaign_or_source, place),),
                )  # fmt: skip
    with upload.form("open upload", border=False):
        st.file_uploader(
            "Or a zip of one, its files together, or test and CAE files to import",
            accept_multiple_files=True,
            key=f"files {st.session_state.get(_ROUND, 0)}",
            help=f"A campaign is CSV and Parquet. Formats that can be imported: {all_formats()}; how they are read is "
            "shown first. Files go to the computer that crashfuse runs on, no further, and are deleted when it ends. "
            "Open what is larger than the limit as a folder.",
        )
        st.form_submit_button("Open upload", icon=":material/upload_file:", on_click=_open_upload)
    if problems := st.session_state.get(REFUSED):
        show_problems(problems, place="open")
    importing.show_unfinished()
    with st.expander("What does a campaign folder look like?", icon=":material/help:"):
        st.html(  # st.code would make the browser read 1.5 MB that colours programs
            "<pre>tests.csv            one row a test: id, speed_mph, front_weight_lb, rear_weight_lb\n"
            "tests/&lt;id&gt;.csv       its pulse: time_ms, acceleration_g\n"
            "cae.csv              one row a CAE run: id, speed_mph, front_weight_lb, rear_weight_lb\n"
            "cae_pulses.parquet   all CAE pulses: id, time_ms, acceleration_g</pre>"
        )
        st.markdown(
            "Speeds may be in mph, km/h or m/s (`_mph`, `_kph`, `_mps`), weights in lb or kg, time in ms or s, and "
            "accelerations in g or m/s² (`_g`, `_mps2`): the end of a column's name tells. Pulses of either source "
            "may be single files or one table, CSV or Parquet."
        )


def _attempt(open_it: Callable[[], str | Source]) -> None:
    """Open a campaign and switch to it, or start an import; errors are kept for the page to show."""
    st.session_state.pop(REFUSED, None)
    try:
        opened = open_it()
        st.session_state["data_tab"] = None  # what was opened is to be seen
        if isinstance(opened, Source):
            begin(opened)
        else:
            leave()
            choose_campaign(opened)
    except DataError as error:
        st.session_state[REFUSED] = error.problems


def _open_folder() -> None:
    """Open the folder that was typed in."""
    if text := campaigns.unquoted(st.session_state["folder"]):
        _attempt(lambda: _campaign_or_source(Path(text)))


def _campaign_or_source(path: Path) -> str | Source:
    """Open a campaign folder; a folder that is not a campaign, but can be imported, is a source."""
    path = campaigns.allowed(path)
    if path.is_file():
        return _source_or_advice(path)
    try:
        name = campaigns.open_folder(path)
    except DataError:
        if has_table(path):
            raise
        with suppress(DataError, OSError):
            return source_at(path)
        raise
    recent.remember(campaigns.folder_of(name))
    return name


def _source_or_advice(file: Path) -> Source:
    """Start the import of a file; if it cannot be imported, it may be a campaign that has to be opened another way."""
    try:
        return source_at(file)
    except (DataError, OSError) as error:
        expected, found = "a campaign folder, or a file that can be imported", "a file of another kind"
        advice = "name the folder that holds tests.csv and cae.csv"
        if file.suffix.lower() == ".zip":
            found = error.problems[0].found if isinstance(error, DataError) else str(error)
            advice = "upload it if it is a campaign, or unpack it and name its folder"
        raise DataError(Problem(str(file), expected, found, advice)) from error


def _open_upload() -> None:
    """Open the dropped files, and empty the field if they were valid."""
    files = st.session_state[f"files {st.session_state.get(_ROUND, 0)}"]
    _attempt(lambda: open_uploads(files))
    if REFUSED not in st.session_state:
        st.session_state[_ROUND] = st.session_state.get(_ROUND, 0) + 1
