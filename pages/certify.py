"""Certify: a verdict for every condition and criterion, and how often such verdicts were wrong."""

from dataclasses import replace

import streamlit as st

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.certification.certify import APPROACH
from crashfuse.certification.criteria_file import criteria_text
from crashfuse.reporting.certification_tables import matrix_table
from crashfuse.reporting.report import certification_report
from crashfuse.ui import address, explanations, frame
from crashfuse.ui.certify.criteria import choose_criteria
from crashfuse.ui.certify.matrix import choose_matrix
from crashfuse.ui.certify.record import show_domain, show_exceptions, show_record
from crashfuse.ui.certify.request import CertificationRequest
from crashfuse.ui.certify.results import show_table, show_verdicts
from crashfuse.ui.computation import chosen_config
from crashfuse.ui.downloads import download_bytes, download_report, download_table
from crashfuse.ui.panel import result_of

view = frame.enter_with_campaign("Certify", lambda view: f"from {len(view.campaign.tests)} tests")
campaign = view.campaign
st.markdown(
    "Which of the planned tests need not be run, and how often is that answer wrong? Each criterion gets a verdict at "
    "each condition: met, not met, open, or outside what the tests check."
)
st.subheader("Criteria")
criteria = choose_criteria(view)
st.subheader("Conditions")
matrix = choose_matrix(view)
address.default("approach", APPROACH, APPROACHES)
approach = st.columns(3)[0].selectbox(
    "Approach that is judged", APPROACHES, format_func=LABELS.__getitem__, key="approach", persist_state="session"
)
if criteria is None or matrix is None:
    st.stop()

st.header("Verdicts")
config = replace(chosen_config(), approaches=(approach,), leave_out="test")
request = CertificationRequest(campaign, criteria, matrix, config)
verdicts = result_of(
    request,
    invitation="These conditions have not been judged yet. "
    + explanations.patience(
        config,
        "Every test is left out in turn, which takes several minutes the first time; after that, other limits and "
        "another confidence are answered at once.",
    ),
    button="Certify",
)
certification = verdicts.certification
show_verdicts(verdicts, view.display, request.key)
with st.expander("All verdicts as a table", icon=":material/table:"):
    show_table(certification, view.display)

st.header("Track record")
show_record(verdicts, view.display, request.key)
st.header("Validated domain")
show_domain(verdicts, view.display, request.key)
st.header("Exceptions")
show_exceptions(certification)
explanations.show_terms(config)
with st.container(horizontal=True):
    download_table("certification.csv", lambda: verdicts.table)
    download_table("track_record.csv", lambda: verdicts.track_record)
    download_bytes("criteria.toml", lambda: criteria_text(certification.criteria).encode())
    download_table("matrix.csv", lambda: matrix_table(certification.matrix))
    download_report(lambda: certification_report(certification, view.display))
