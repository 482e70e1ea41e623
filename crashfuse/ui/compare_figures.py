"""Figures of the page Compare: pulses, and why a rating is what it is."""

from collections.abc import Hashable
from functools import partial

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting import glossary
from crashfuse.reporting.fit_explanations import whole_sentences
from crashfuse.reporting.rating_tables import excursions_table, humps_table
from crashfuse.signals.rating import WEIGHTS
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.study.left_out_account import Account, account
from crashfuse.ui.compare import Comparison
from crashfuse.ui.kit import results
from crashfuse.ui.kit.curves import choose_curves
from crashfuse.ui.kit.editing import edit_notes, notes_of
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain

_MOTION, _RESIDUALS = "Motion", "Residuals"
_CORRIDORS_HELP = (
    "ISO/TS 18571: a curve scores 1 inside the inner corridor about the test and 0 outside the outer one. Their half "
    "widths are 5 % and 50 % of the largest acceleration in the rated window."
)
_CURVES = {
    "Over displacement": (
        "displacement",
        "Acceleration over displacement, up to maximum crush: {}",
        "Marks: maximum crush with its 95 % interval. The area under each curve is the absorbed energy per unit mass, "
        "½ v0²: at one impact speed, a lower deceleration means more crush.",
    ),
    "Energy": (
        "energy",
        "Absorbed energy over crush: {}",
        "All of ½ m v0² is absorbed at maximum crush. The slope is the crush force.",
    ),
    _RESIDUALS: (
        "residuals",
        "Prediction minus what was measured, over time: {}",
        "Where a band leaves zero, the test left that band. RMS: over the rated window.",
    ),
}
"""Figures beside that of the motion: the library's name, the alternative text, and what to see."""


def show_pulses(comparison: Comparison) -> None:
    """Show the test and its prediction in the figure that the user picks."""
    test = comparison.test
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        shown = choose("Figure", [_MOTION, *_CURVES], key="compared")
        corridors = shown == _MOTION and st.toggle(
            "Corridors of the rating", key="corridors", persist_state="session", help=_CORRIDORS_HELP
        )
        curves = choose_curves(comparison.subject, comparison.approach, comparison.predictions)
    figure, alt, caption = _CURVES.get(shown, ("motion", "Acceleration, velocity and displacement over time: {}", ""))
    notes = notes_of(comparison.view)
    notes_here = tuple(note for note in notes if note.test == test.id)
    name = "pulses with corridors" if corridors else "pulses" if shown == _MOTION else shown.lower()
    show_cached_figure(
        lambda: comparison.plot(figure, curves, corridors=corridors, notes=notes_here), alt.format(curves.of(test.id)),
        shown, corridors, notes_here, comparison.key, curves.key, beside=curves.also, name=curves.named(name),
    )  # fmt: skip
    st.caption(caption or "".join(whole_sentences(comparison.fold.estimates)))
    edit_notes(comparison.view, notes)


def show_why(comparison: Comparison) -> None:
    """Show the parts of the ratings, and explain that of one approach."""
    display, test, advice = comparison.view.display, comparison.test, comparison.advice
    approach = comparison.approach
    explanation = comparison.fold.explained(approach, comparison.window_ms)
    said = {part: plain(text) for part, text in rating_sentences(explanation).items()}
    st.markdown(f"**{LABELS[approach]} {said['overall'].partition('. ')[0].removesuffix('.')}.**")
    draw = partial(comparison.study.plot, test.id, display=display)
    bars, words = st.columns(2, gap="medium")
    with bars:
        alt = f"The four scores of every prediction of test {test.id}, as bars"
        show_cached_figure(partial(draw, "scores"), alt, "parts", comparison.key, name="scores")
    parts = sorted(WEIGHTS, key=lambda part: part != explanation.costliest)
    words.markdown("\n".join(f"- {said[part]}" for part in parts), help=glossary.RATING_PARTS)
    if advice is not None:
        test_account = _account(comparison.key, advice.approach, comparison)
        if test_account.disappoints or (test_account.departure is not None and test_account.departure.apart):
            results.show_account(test_account.sentences[1:], missed=test_account.disappoints)
    alt = f"Test {test.id} and its prediction by {LABELS[approach]}: corridors, shifted, warped, and their slopes"
    show_cached_figure(
        partial(draw, "rating", approaches=[approach]), alt, "rated curves", approach, comparison.key,
        name=f"rating of {LABELS[approach]}",
    )  # fmt: skip
    with st.expander("Humps, and stretches outside the corridor, in numbers", icon=":material/table:"):
        show_table(humps_table(explanation, display), "humps")
        st.caption(glossary.HUMPS)
        show_table(excursions_table(explanation, display), "excursions")


@st.cache_resource(max_entries=50, show_spinner="Comparing the test with its neighbours …")
def _account(key: Hashable, approach: str, _comparison: Comparison) -> Account:  # noqa: ARG001
    campaign, config = _comparison.view.campaign, _comparison.config
    return account(campaign, config, _comparison.fold, _comparison.window_ms, approach=approach)
