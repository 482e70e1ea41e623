"""Notes on past results, and results taken off the list, for everybody on this machine."""

import streamlit as st

from crashfuse.reporting.past_results import described
from crashfuse.reporting.plots.display import Display
from crashfuse.study.history import LONGEST_NOTE, PastResult, annotate, forget
from crashfuse.ui import journal
from crashfuse.ui.text import show_label
from crashfuse.ui.visitors import visitor


def edit_ticked(ticked: list[PastResult], display: Display) -> None:
    """Offer a note on each result that is ticked, and to take it off the list."""
    for result in ticked:
        key, label = f"note on {result.id}", f"Note on {described(result, display)}"
        show_label(label)
        with st.container(horizontal=True, vertical_alignment="bottom"):
            st.text_input(
                label, result.note, LONGEST_NOTE, key=key, label_visibility="collapsed",
                placeholder="such as: baseline CAE model, before the new rail", on_change=_annotate, args=(result, key),
            )  # fmt: skip
            st.button(
                "Take off the list", icon=":material/playlist_remove:", key=f"forget {result.id}", on_click=_forget,
                args=(result,), help="For everybody on this machine; the result itself stays, and is listed when asked "
                "for again.",
            )  # fmt: skip


def _annotate(result: PastResult, key: str) -> None:
    annotate(result, st.session_state[key])


def _forget(result: PastResult) -> None:
    forget(result)
    journal.note(visitor(), f"took a result of {result.campaign} off the list")
