"""Data: open a campaign and see its content."""

import streamlit as st

from crashfuse.ui import import_step
from crashfuse.ui.data import show_conditions, show_library, show_open_forms, show_summary, show_tests
from crashfuse.ui.kit import frame
from crashfuse.ui.kit.figures import show_tabs
from crashfuse.ui.kit.navigation import end_page
from crashfuse.ui.kit.text import plain
from crashfuse.ui.kit.uploads import running_import

TABS = {
    "Tests": show_tests,
    "Conditions": show_conditions,
    "CAE model": show_library,
    "Open another campaign": lambda _: show_open_forms(),
}

view = frame.enter()
if (source := running_import()) is not None:
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
    show_open_forms()
    end_page()

frame.show_head(view, plain(view.campaign.name))
show_summary(view)
show_tabs(TABS, view, key="data_tab")
