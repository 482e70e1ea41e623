"""Pulse metrics of every prediction, what is near the condition, and what the approaches say of themselves."""

import streamlit as st

from crashfuse.approaches.nearness import nearest_sentences
from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.side_by_side import by_one, cautions, side_by_side
from crashfuse.ui import explanations
from crashfuse.ui.beside import leading
from crashfuse.ui.other_seeds import show_missing
from crashfuse.ui.predict.answer import Answer
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain


def show(answer: Answer) -> None:
    """Show metrics, notes and fits."""
    campaign, estimates = answer.campaign, answer.estimates
    show_missing(campaign)
    _show_beside(answer)
    explanations.show_metrics([(LABELS[each.approach], each.metrics) for each in estimates], answer.view)
    weight = f"{answer.view.display.weight(answer.condition.mass_kg)} in all."
    st.caption("  \n".join(map(plain, [weight, *nearest_sentences(campaign, answer.condition)])))
    said = () if answer.advice is None else answer.advice.sentences
    explanations.show_notes(estimates, (*said, *campaign.cae.extrapolation(answer.condition)))
    explanations.show_fits(estimates)


def _show_beside(answer: Answer) -> None:
    """Compare one approach's metrics by other seeds and presets, and at the pinned conditions, with those here."""
    if not answer.beside:
        return
    approach = leading(answer.predictions, answer.recommended)
    shown, display = by_one(approach, [answer.prediction, *answer.beside]), answer.view.display
    st.subheader(f"Beside other predictions: {LABELS[approach]}")
    show_table(side_by_side(shown, display), "beside")
    for sentence in cautions(shown, display):
        st.caption(plain(sentence))
    of = display.briefly(answer.condition)
    st.caption(f"Differences are from the first column, {plain(of)}, of values before they are rounded.")
