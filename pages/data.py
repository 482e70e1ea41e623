"""Data: open a campaign and see its content."""

import streamlit as st

from crashfuse.ui import data, import_step
from crashfuse.ui.kit import frame
from crashfuse.ui.kit.figures import choose
from crashfuse.ui.kit.navigation import end_page
from crashfuse.ui.kit.uploads import running_import

TABS = {"Tests": data.show_tests, "Conditions": data.show_conditions, "CAE model": data.show_library}

view = frame.enter()
if (source := running_import()) is not None:
    with st.container(key="import-step"):
        import_step.show_import(source, view)
    end_page()
if view is None:
    st.title("crashfuse")
    st.markdown(
        "crashfuse corrects a CAE crash model with the few full-frontal barrier tests that you have, predicts the "
        "pulse of a crash that was never run, and rates every prediction by ISO/TS 18571."
    )
    frame.offer_sample()
    st.caption("A synthetic car: 11 tests and about a thousand CAE runs, made by a small simulation.")
    st.subheader("Or open a campaign of your own")
    data.show_open_forms()
    end_page()

if (way := st.session_state["opening"]) is not None:
    data.show_opening(way)
    end_page()
data.show_head(view)
with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
    tab = choose("Tab", list(TABS), key="data_tab")
    data.offer_next(view)
TABS[tab](view)
