"""History: studies and predictions of this machine, to be opened again, and two of them compared."""

import streamlit as st

from crashfuse.reporting.plots.display import DEFAULT
from crashfuse.ui.history import (
    compare,
    edit_ticked,
    is_suggested,
    of_campaign,
    say_refused,
    show_results,
    ticked,
    visible,
    with_ticked,
)
from crashfuse.ui.kit import frame
from crashfuse.ui.kit.window import end_page

view = frame.enter()
st.title("History")
say_refused()
results = visible()
if not results:
    st.markdown("Nothing was computed on this machine yet. Studies, and predictions that were pinned, appear here.")
    end_page()
display, here = (DEFAULT, "") if view is None else (view.display, view.campaign.name)
st.caption(
    "Studies, tests predicted one by one, and predictions that were pinned or made with the command, by whomever on "
    "this machine, the latest first; those of an upload for whoever has it open. Tick one to write a note on it, two "
    "to compare them. Certifications are listed on the page Certify, Earlier verdicts."
)
listed = of_campaign(results, here)
chosen = ticked(results, listed)
show_results(with_ticked(results, listed, chosen), chosen, display, here)
if not is_suggested():
    edit_ticked(chosen, display)
compare(chosen, display)
