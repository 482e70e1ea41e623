"""Criteria and planned tests saved: into the folder of the campaign or, where that cannot be written, as files."""

from contextlib import suppress
from pathlib import Path

import streamlit as st

from crashfuse.campaign_folder.history import changing, taking_turns
from crashfuse.certification.criteria import Criteria, criteria_text, read_criteria
from crashfuse.certification.matrix import Matrix
from crashfuse.errors import DataError
from crashfuse.results.certification_tables import csv_as_given, matrix_table
from crashfuse.ui.certify.matrix import read_own
from crashfuse.ui.kit import campaigns
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.editing import can_be_edited, edit, show_refused

_CHOICES = "criteria", "confidence", "cost_test", "cost_wrong", "matrix", "planned", "uploaded"  # session keys


def question_files(criteria: Criteria | None, matrix: Matrix | None) -> dict[str, bytes]:
    """What is asked, as files of a campaign folder."""
    files = {} if criteria is None else {"criteria.toml": criteria_text(criteria).encode()}
    return files if matrix is None else {**files, "matrix.csv": csv_as_given(matrix_table(matrix))}


def offer_saving(view: View, criteria: Criteria | None, matrix: Matrix | None) -> None:
    """Offer to save what is asked, as far as the folder does not have it."""
    folder, known = view.folder, dict[str, bytes]()
    with suppress(DataError):
        known |= question_files(read_criteria(folder / "criteria.toml"), None)
    with suppress(DataError, OSError):
        path = folder / "matrix.csv"
        known |= question_files(None, read_own(path, campaigns.stamp(path), view.campaign))
    asked = question_files(criteria, matrix)
    files = {name: content for name, content in asked.items() if known.get(name) != content}

    def save() -> str:
        what = _save(folder, files)
        st.session_state.update(dict.fromkeys(_CHOICES))  # now those of the folder
        return what

    with st.container(horizontal=True):
        if can_be_edited(folder):
            tip = "Into criteria.toml and matrix.csv of the campaign; Undo on Data takes it back."
            st.button("Save in the campaign", on_click=edit, args=(view, save), disabled=not files, help=tip)
        else:
            for name, content in files.items():
                st.download_button(name, content, file_name=name, icon=":material/download:", on_click="ignore")
    show_refused()


def _save(folder: Path, files: dict[str, bytes]) -> str:
    what = f"Saved: {' and '.join(files)}"
    with taking_turns(folder), changing(folder, what) as new:
        for name, content in files.items():
            new(folder / name).write_bytes(content)
    return what
