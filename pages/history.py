"""History: studies and predictions of this machine, to be opened again, and two studies compared."""

import streamlit as st

from crashfuse.reporting.plots.display import DEFAULT
from crashfuse.ui import frame
from crashfuse.ui.history import compare_two, show_results, visible

view = frame.enter()
st.title("History")
results = visible()
if not results:
    st.markdown("Nothing was computed on this machine yet. Studies, and predictions that were pinned, appear here.")
    st.stop()
display = DEFAULT if view is None else view.display
st.caption(
    "What was computed on this machine, by whomever, the latest first; of predictions, those that were pinned or made "
    "by the command. Choose a row to open that result. Certifications are listed on the page Certify, Earlier verdicts."
)
show_results(results, display)
studies = [result for result in results if result.tests]
if len(studies) > 1:
    st.header("Compare two studies")
    compare_two(studies, display)
