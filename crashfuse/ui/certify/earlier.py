"""An earlier certification beside the verdicts on the Certify page: what became of what it said."""

import streamlit as st

from crashfuse.certification.changes import Changes
from crashfuse.certification.earlier import FILE, Earlier
from crashfuse.errors import CrashfuseError
from crashfuse.reporting.certification_changes import change_sentences, shown_changes
from crashfuse.ui.certify.judgement import Judgement
from crashfuse.ui.certify.results import coloured
from crashfuse.ui.certify.uploaded import choose_kept, find_kept, show_wrong
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain

_CHOICE = "earlier"


def show(judgement: Judgement) -> None:
    """Ask for an earlier certification; show whether it came true, and what is said otherwise today."""
    key = f"earlier file {judgement.certification.campaign.fingerprint[:8]}"
    label = f"Upload the {FILE} of an earlier certification: its verdicts are held against what was tested since"
    try:
        earlier = choose_kept(label, FILE, _CHOICE, key, Earlier.parse)
        changes = None if earlier is None else Changes.of(earlier, judgement.certification)
    except CrashfuseError as error:
        show_wrong(error)
        return
    if changes is None:
        st.caption(f"{FILE} is among the files of every certification. What became of it is in the report, too.")
        return
    st.button("Take it away", icon=":material/close:", on_click=lambda: st.session_state.update({_CHOICE: None}))
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in change_sentences(changes)))
    table = shown_changes(changes, judgement.display)
    if not table.empty:
        show_table(coloured(table, "Then", "Now").hide(axis="index"), key="earlier verdicts")


def changes_of(judgement: Judgement) -> Changes | None:
    """What became of the earlier certification that was chosen; None if none was, or it cannot be read any more."""
    try:
        earlier = find_kept(FILE, _CHOICE, Earlier.parse)
        return None if earlier is None else Changes.of(earlier, judgement.certification)
    except CrashfuseError:  # which is said beside the verdicts
        return None
