"""How each approach rates, and which one was to be used: the head of the Compare page."""

import streamlit as st

from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.reporting import glossary
from crashfuse.ui import explanations, page_tables
from crashfuse.ui.compare.comparison import Comparison

_DRAWS_HELP = (
    "Single pulses drawn from the band, each rated against the test: 95 % of the ratings lie in this interval. A "
    "single pulse has oscillations of its own, so it rates lower than the expected pulse."
)
_CARD_PX = 176  # five fit side by side on a wide page
_NO_CHANGE = 0.005  # in rating


def show(comparison: Comparison) -> None:
    """Show the ratings in a row, and the recommendation."""
    fold, window_ms = comparison.fold, comparison.window_ms
    raw = fold.ratings[BASELINE][window_ms].overall if BASELINE in fold.ratings else None
    beside = "" if raw is None else ", and its change from the raw CAE model"
    explanations.show_settings(comparison.config, left_out=True)
    st.markdown(f"Rating over {page_tables.window_label(window_ms)} ({comparison.view.campaign.rating_basis}){beside}")
    cards = st.container(horizontal=True, gap="small")
    for name, by_window in fold.ratings.items():
        rating = by_window[window_ms]
        gain = None if raw is None or name == BASELINE else rating.overall - raw
        with cards.container(border=True, width=_CARD_PX):
            st.metric(
                LABELS[name], f"{rating.overall:.3f}", None if gain is None else f"{gain:+.3f}",
                delta_color="off" if gain is None or abs(gain) < _NO_CHANGE else "normal",
            )  # fmt: skip
            explanations.show_grade(rating.grade)
            if name in fold.with_band:
                low, high = fold.rating_interval(name, window_ms)
                st.caption(f"Draws: {low:.2f}–{high:.2f}", help=_DRAWS_HELP)
    if (advice := comparison.advice) is None:
        return
    explanations.show_recommendation(advice.sentences)
    if window_ms in comparison.repeats:
        rated = fold.ratings[advice.approach][window_ms].overall
        repeat = comparison.repeats[window_ms]
        st.markdown(repeat.sentence(rated, LABELS[advice.approach]), help=glossary.REPEAT)
