"""Notes on past results, and results taken off the list, for everybody on this machine."""

import streamlit as st

from crashfuse.errors import DataError
from crashfuse.reporting.past_results import described
from crashfuse.reporting.plots.display import Display
from crashfuse.study.history import LONGEST_NOTE, PastResult, annotate, forget
from crashfuse.ui import journal
from crashfuse.ui.text import plain, show_label
from crashfuse.ui.visitors import visitor


def edit_ticked(ticked: list[PastResult], display: Display) -> None:
    """Offer a note on each result that is ticked, and to take it off the list."""
    for result in ticked:
        key, label = f"note on {result.id}", f"Note on {described(result, display)}"
        refused = st.session_state.pop(f"{key} refused", "")
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
        if refused:
            st.warning(plain(refused), icon=":material/warning:")


def _annotate(result: PastResult, key: str) -> None:
    """Keep the note; what is refused stays in its field, and why is shown below it."""
    try:
        annotate(result, st.session_state[key])
    except DataError as error:
        st.session_state[f"{key} refused"] = str(error.problems[0])
    except OSError as error:
        st.session_state[f"{key} refused"] = f"The note was not kept: {error.strerror or error}."


def _forget(result: PastResult) -> None:
    forget(result)
    journal.note(visitor(), f"took a result of {result.campaign} off the list")
