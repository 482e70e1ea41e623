"""Pulse metrics of every prediction, what is near the condition, and what the approaches say of themselves."""

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.study.nearest import nearest_sentences
from crashfuse.ui import explanations
from crashfuse.ui.predict.answer import Answer
from crashfuse.ui.text import plain


def show(answer: Answer) -> None:
    """Show metrics, notes and fits."""
    campaign, estimates = answer.campaign, answer.estimates
    explanations.show_metrics([(LABELS[each.approach], each.metrics) for each in estimates], answer.view)
    st.caption("  \n".join(map(plain, nearest_sentences(campaign, answer.condition))))
    explanations.show_notes(estimates, (*answer.advice.sentences, *campaign.cae.extrapolation(answer.condition)))
    explanations.show_fits(estimates)
