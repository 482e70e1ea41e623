"""Why a prediction is rated as it is: the four parts, the curves that they compare, and what is odd about the test."""

from collections.abc import Hashable

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting import glossary
from crashfuse.reporting.rating_tables import excursions_table, humps_table
from crashfuse.signals.rating import WEIGHTS
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.study.account import Account, account
from crashfuse.ui import explanations
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain


def show(comparison: Comparison) -> None:
    """Show the parts of the ratings, and explain that of one approach, at first of the recommended one."""
    display, test = comparison.view.display, comparison.test
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        approach = _choose_approach(comparison)
        curves = comparison.choose_curves(offered=())
    explanation = comparison.fold.explained(approach, comparison.window_ms)
    said = {part: plain(text) for part, text in rating_sentences(explanation).items()}
    st.markdown(f"**{LABELS[approach]} {said['overall'].partition('. ')[0].removesuffix('.')}.**")
    alt = f"The four scores of every prediction of test {test.id}, as bars"
    show_cached_figure(
        lambda: comparison.study.plot(test.id, "scores", display=display), alt, "parts", comparison.key,
        name="scores",
    )  # fmt: skip
    parts = sorted(WEIGHTS, key=lambda part: part != explanation.costliest)
    st.markdown("\n".join(f"- {said[part]}" for part in parts), help=glossary.RATING_PARTS)
    if comparison.advice is not None:
        found = _account(comparison.key, comparison.advice.approach, comparison)
        if found.disappoints or (found.departure is not None and found.departure.apart):
            explanations.show_account(found.sentences[1:], missed=found.disappoints)
    show_cached_figure(
        lambda: comparison.study.plot(test.id, "rating", approaches=[approach], also=curves.also, display=display),
        f"Test {test.id} and its prediction by {LABELS[approach]}: in the corridors, shifted, warped, and their slopes",
        "rated curves", approach, comparison.key, curves.key,
        name=f"rating of {LABELS[approach]}", beside=curves.also,
    )  # fmt: skip
    with st.expander("Humps, and stretches outside the corridor, in numbers", icon=":material/table:"):
        show_table(humps_table(explanation, display), "humps")
        st.caption(glossary.HUMPS)
        show_table(excursions_table(explanation, display), "excursions")


def _choose_approach(comparison: Comparison) -> str:
    names = list(comparison.fold.ratings)
    first = comparison.recommended or names[-1]
    return choose("Approach", names, key="explained", default=first, label_of=LABELS.__getitem__)


@st.cache_resource(max_entries=50, show_spinner="Comparing the test with its neighbours …")
def _account(key: Hashable, approach: str, _comparison: Comparison) -> Account:  # noqa: ARG001
    campaign, config = _comparison.view.campaign, _comparison.config
    return account(campaign, config, _comparison.fold, _comparison.window_ms, approach=approach)
