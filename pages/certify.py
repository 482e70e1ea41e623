"""Certify: which planned tests need not be run, and how often such an answer was wrong."""

from functools import partial

import streamlit as st

from crashfuse.approaches.registry import APPROACHES
from crashfuse.certification.certify import APPROACH
from crashfuse.ui.certify import results
from crashfuse.ui.certify.criteria import choose_criteria
from crashfuse.ui.certify.matrix import JUDGED, choose_matrix, offer_saving
from crashfuse.ui.certify.results import judge
from crashfuse.ui.kit import address, frame
from crashfuse.ui.kit.figures import show_tabs
from crashfuse.ui.kit.navigation import end_page
from crashfuse.ui.kit.progress import result_or_none

TABS = {"Answer": results.show_answer, "Track record": results.show_record, "Validated domain": results.show_domain}

view = frame.enter_with_campaign("Certify", lambda _: "")
address.default("approach", APPROACH, APPROACHES)
asked = st.session_state.get(JUDGED, "")
place = "question_answered" if asked else "question"  # which opens over its answer
with st.expander(asked or "Criteria and planned tests", expanded=not asked, key=place):
    criteria = choose_criteria(view)
    matrix = choose_matrix(view)
    offer_saving(view, criteria, matrix)
verdicts, question = None, ""
if criteria is not None and matrix is not None:
    request = judge(view.campaign, criteria, matrix)
    verdicts = result_or_none(request, invitation="No answer yet.", button="Certify")
    question = "" if verdicts is None else results.question(criteria, matrix)
if question != asked:  # the choices above fold away into it, or unfold
    st.session_state[JUDGED] = question
    st.rerun()
if verdicts is None:
    end_page()
results.keep_past(request.key, verdicts)
verdicts = results.beside_earlier(verdicts, request.key)
tabs = {name: partial(show, view) for name, show in TABS.items()}
show_tabs(tabs, verdicts, key="certify_tab", export=partial(results.show_files, view))
