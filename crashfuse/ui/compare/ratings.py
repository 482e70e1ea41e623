"""Ratings by window with their parts, and the pulse metrics of the test and every prediction."""

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting import glossary
from crashfuse.study.study import Fold
from crashfuse.ui import explanations, page_tables
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.tables import show_table

_DRAWS_HELP = (
    "Single draws are pulses drawn from the band, each rated against the test: 95 % of the ratings lie in this "
    "interval. A single pulse has oscillations of its own, so it rates lower than the expected pulse."
)


def show(comparison: Comparison) -> None:
    """Show ratings, metrics, and what the approaches say of themselves."""
    campaign, fold = comparison.view.campaign, comparison.fold
    st.subheader("Rating by approach and window", help=f"By {campaign.rating_basis}. {_DRAWS_HELP} {glossary.REPEAT}")
    draws = {name: fold.rating_interval(name, comparison.window_ms) for name in fold.with_band}
    rated, beside = dict(fold.ratings), dict(each.curve(comparison.view.display) for each in comparison.earlier)
    for name, estimate in beside.items():
        own = Fold.of(comparison.test, [estimate], comparison.config.windows_ms)
        rated[name] = own.ratings[estimate.approach]
        if own.with_band:
            draws[name] = own.rating_interval(estimate.approach, comparison.window_ms)
    show_table(page_tables.ratings(rated, comparison.window_ms, comparison.repeats, draws), "ratings")
    st.caption(
        f"Corridor, phase, magnitude, slope and single draws: over {page_tables.window_label(comparison.window_ms)}."
    )
    explanations.show_terms(comparison.config)
    columns = [
        (page_tables.TEST_COLUMN, campaign.metrics_of(comparison.test)),
        *((LABELS[estimate.approach], estimate.metrics) for estimate in fold.estimates),
        *((name, estimate.metrics) for name, estimate in beside.items()),
    ]
    explanations.show_metrics(columns, comparison.view)
    said = () if comparison.advice is None else comparison.advice.sentences
    explanations.show_notes(fold.estimates, said)
    explanations.show_fits(fold.estimates)
