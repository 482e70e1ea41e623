"""Ratings by window with their parts, and the pulse metrics of the test and every prediction."""

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.ui import explanations, page_tables
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.tables import show_table


def show(comparison: Comparison) -> None:
    """Show ratings, metrics, and what the approaches say of themselves."""
    campaign, fold = comparison.view.campaign, comparison.fold
    st.subheader("Rating by approach and window", help=f"By {campaign.rating_basis}.")
    show_table(page_tables.ratings(fold.ratings, comparison.window_ms, comparison.repeats), "ratings")
    columns = [
        ("Test", campaign.metrics_of(comparison.test)),
        *((LABELS[estimate.approach], estimate.metrics) for estimate in fold.estimates),
    ]
    explanations.show_metrics(columns, comparison.view)
    said = () if comparison.advice is None else comparison.advice.sentences
    explanations.show_notes(fold.estimates, said)
    explanations.show_fits(fold.estimates)
