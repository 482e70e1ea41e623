"""Figures of the page Compare: pulses, why a rating is what it is, over displacement, networks."""

from collections.abc import Hashable
from functools import partial

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting import glossary
from crashfuse.reporting.fit_explanations import whole_sentences
from crashfuse.reporting.rating_tables import excursions_table, humps_table
from crashfuse.signals.rating import WEIGHTS
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.study.left_out_account import Account, account
from crashfuse.ui.compare import Comparison
from crashfuse.ui.kit import results
from crashfuse.ui.kit.editing import edit_notes, notes_of
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain

_MOTION, _RESIDUALS = "Motion", "Residuals"
_CORRIDORS_HELP = (
    "ISO/TS 18571: a curve scores 1 inside the inner corridor about the test and 0 outside the outer one. Their half "
    "widths are 5 % and 50 % of the largest acceleration in the rated window."
)
_CURVES = "Acceleration"
_OF_CURVES = {
    _CURVES: (
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
}
"""Figures of curves that the user chooses: the library's name, the alternative text, and what to see."""


def _row() -> DeltaGenerator:
    return st.container(horizontal=True, vertical_alignment="center", gap="xsmall")


def show_pulses(comparison: Comparison) -> None:
    """Show acceleration, velocity and displacement over time, or what the predictions miss."""
    test = comparison.test
    with _row():
        shown = choose("Figure", [_MOTION, _RESIDUALS], key="compared")
        corridors = shown == _MOTION and st.toggle(
            "Corridors of the rating", key="corridors", persist_state="session", help=_CORRIDORS_HELP
        )
        curves = comparison.choose_curves()
    notes = notes_of(comparison.view)
    notes_here = tuple(note for note in notes if note.test == test.id)
    alt = f"Acceleration, velocity and displacement over time: {curves.of(test.id)}"
    name = "pulses with corridors" if corridors else "pulses"
    if shown == _RESIDUALS:
        alt, name = (
            f"Prediction of test {test.id} by {curves.by or 'others'} minus what was measured, over time",
            "residuals",
        )
    show_cached_figure(
        lambda: comparison.plot(shown.lower(), curves, corridors=corridors, notes=notes_here), alt, shown, corridors,
        notes_here, comparison.key, curves.key, beside=curves.also, name=curves.named(name, of_test=shown == _MOTION),
    )  # fmt: skip
    st.caption("".join(whole_sentences(comparison.fold.estimates)))
    if shown == _RESIDUALS:
        st.caption("Where a band leaves zero, the test left that band. RMS: over the rated window.")
    edit_notes(comparison.view, notes)


def show_why(comparison: Comparison) -> None:
    """Show the parts of the ratings, and explain that of one approach."""
    display, test, advice = comparison.view.display, comparison.test, comparison.advice
    names = list(comparison.fold.ratings)
    with _row():
        first = comparison.recommended or names[-1]
        approach = choose("Approach", names, key="explained", default=first, label_of=LABELS.__getitem__)
        curves = comparison.choose_curves(offered=())
    explanation = comparison.fold.explained(approach, comparison.window_ms)
    said = {part: plain(text) for part, text in rating_sentences(explanation).items()}
    st.markdown(f"**{LABELS[approach]} {said['overall'].partition('. ')[0].removesuffix('.')}.**")
    draw = partial(comparison.study.plot, test.id, display=display)
    alt = f"The four scores of every prediction of test {test.id}, as bars"
    show_cached_figure(partial(draw, "scores"), alt, "parts", comparison.key, name="scores")
    parts = sorted(WEIGHTS, key=lambda part: part != explanation.costliest)
    st.markdown("\n".join(f"- {said[part]}" for part in parts), help=glossary.RATING_PARTS)
    if advice is not None:
        test_account = _account(comparison.key, advice.approach, comparison)
        if test_account.disappoints or (test_account.departure is not None and test_account.departure.apart):
            results.show_account(test_account.sentences[1:], missed=test_account.disappoints)
    alt = f"Test {test.id} and its prediction by {LABELS[approach]}: corridors, shifted, warped, and their slopes"
    show_cached_figure(
        partial(draw, "rating", approaches=[approach], also=curves.also), alt, "rated curves", approach,
        comparison.key, curves.key, name=f"rating of {LABELS[approach]}", beside=curves.also,
    )  # fmt: skip
    with st.expander("Humps, and stretches outside the corridor, in numbers", icon=":material/table:"):
        show_table(humps_table(explanation, display), "humps")
        st.caption(glossary.HUMPS)
        show_table(excursions_table(explanation, display), "excursions")


@st.cache_resource(max_entries=50, show_spinner="Comparing the test with its neighbours …")
def _account(key: Hashable, approach: str, _comparison: Comparison) -> Account:  # noqa: ARG001
    campaign, config = _comparison.view.campaign, _comparison.config
    return account(campaign, config, _comparison.fold, _comparison.window_ms, approach=approach)


def show_over_displacement(comparison: Comparison) -> None:
    """Show test, CAE model and its correction over displacement, in the figure that the user picks."""
    with _row():
        choice = choose("Figure", list(_OF_CURVES), key="over_displacement")
        curves = comparison.choose_curves()
    figure, alt, caption = _OF_CURVES[choice]
    shown = "acceleration over displacement" if choice == _CURVES else choice.lower()
    draw, alt = partial(comparison.plot, figure, curves), alt.format(curves.of(comparison.test.id))
    name = curves.named(shown)
    show_cached_figure(draw, alt, choice, comparison.key, curves.key, name=name, beside=curves.also)
    st.caption(caption)
