"""Certify: a verdict for every condition and criterion, and how often such verdicts were wrong."""

from dataclasses import replace

import streamlit as st

from crashfuse.approaches.registry import APPROACHES, LABELS
from crashfuse.certification.certify import APPROACH
from crashfuse.ui.certify import earlier, results
from crashfuse.ui.certify.criteria import choose_criteria
from crashfuse.ui.certify.matrix import JUDGED, choose_matrix
from crashfuse.ui.certify.results import Judgement, judge
from crashfuse.ui.kit import address, frame
from crashfuse.ui.kit.address import chosen_config
from crashfuse.ui.kit.editing import notes_of
from crashfuse.ui.kit.figures import show_tabs
from crashfuse.ui.kit.navigation import end_page
from crashfuse.ui.kit.progress import patience, result_or_none

TABS = {
    "Verdicts": results.show,
    "Track record": results.show_record,
    "Earlier verdicts": earlier.show,
    "Validated domain": results.show_domain,
    "Exceptions": results.show_exceptions,
    "Files and report": results.show_files,
}

view = frame.enter_with_campaign("Certify", lambda view: f"from {len(view.campaign.tests)} tests")
campaign = view.campaign
with st.expander("Criteria and conditions", icon=":material/tune:", expanded=not st.session_state.get(JUDGED)):
    st.caption(
        "Which of the planned tests need not be run, and how often is that answer wrong? Each criterion gets a verdict "
        "at each condition: met, not met, open, or outside what the tests check."
    )
    table = st.container()
    left, middle, right = st.columns([1, 1, 2], vertical_alignment="bottom")
    with table:
        criteria = choose_criteria(view, left, right)
    address.default("approach", APPROACH, APPROACHES)
    approach = middle.selectbox(
        "Approach that is judged", APPROACHES, format_func=LABELS.__getitem__, key="approach", persist_state="session"
    )
    matrix = choose_matrix(view)
verdicts = None
if criteria is not None and matrix is not None:
    config = replace(chosen_config(), approaches=(approach,), leave_out="test")
    request = judge(campaign, criteria, matrix, config)
    verdicts = result_or_none(
        request,
        invitation="These conditions have not been judged yet. "
        + patience(config, "Leaving out every test in turn takes a minute or more; then other limits take no time."),
        button="Certify",
    )
if (verdicts is not None) != st.session_state.get(JUDGED, False):  # the choices above fold away, or unfold
    st.session_state[JUDGED] = verdicts is not None
    st.rerun()
if verdicts is None:
    end_page()
verdicts = earlier.beside(verdicts, request.key)
since = verdicts.certification.since
key = request.key, None if since is None else since.earlier.digest
show_tabs(TABS, Judgement(verdicts, config, view.display, notes_of(view), key), key="certify_tab")
