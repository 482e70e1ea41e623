"""History: studies and predictions of this machine, to be opened again, and two of them compared."""

import streamlit as st

from crashfuse.reporting.plots.display import DEFAULT
from crashfuse.ui import history
from crashfuse.ui.kit import frame
from crashfuse.ui.kit.navigation import end_page

view = frame.enter()
st.title("History")
history.say_refused()
results = history.visible()
if not results:
    st.markdown("Nothing was computed on this machine yet. Studies, and predictions that were pinned, appear here.")
    end_page()
display, here = (DEFAULT, "") if view is None else (view.display, view.campaign.name)
st.caption(
    "Studies, tests predicted one by one, and predictions that were pinned or made with the command, by anybody on "
    "this machine. Tick one to write a note on it, two to compare them. Certifications are on the page Certify."
)
listed = history.choose_listed(results, here)
chosen = history.ticked(results, listed)
history.show_results([result for result in results if result in listed or result in chosen], chosen, display, here)
if not history.is_suggested():
    history.edit_ticked(chosen, display)
history.compare(chosen, display)
