"""Figures of the page Compare: pulses, why a rating is what it is, over displacement, networks."""

from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import cache, partial

import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.reporting import glossary
from crashfuse.reporting.figures import ONE_PROCESS
from crashfuse.reporting.fit_explanations import whole_sentences
from crashfuse.reporting.plots.canvas import share_y_range
from crashfuse.reporting.plots.curves import TEST
from crashfuse.reporting.rating_tables import excursions_table, humps_table
from crashfuse.signals.rating import WEIGHTS
from crashfuse.signals.rating_sentences import rating_sentences
from crashfuse.study.left_out_account import Account, account
from crashfuse.ui.compare import Comparison
from crashfuse.ui.kit import results
from crashfuse.ui.kit.curves import Shown
from crashfuse.ui.kit.editing import edit_notes, notes_of
from crashfuse.ui.kit.figures import choose, show_cached_figure, show_figure
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain

_MOTION, _RESIDUALS = "Motion", "Residuals"
_CORRIDORS_HELP = (
    "ISO/TS 18571: a curve scores 1 inside the inner corridor about the test and 0 outside the outer one. Their half "
    "widths are 5 % and 50 % of the largest acceleration in the rated window."
)
_CURVES, _BIAS, _PARTS = "Acceleration", "Bias by speed", "Parts of the bias"
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
    "Check of the integration": (
        "integration",
        "Displacement over time, integrated over time and recovered from a(s), and their difference",
        "Lines: integrated twice over time, up to zero velocity. Circles: recovered from a(s) (Eq. 29 of the paper). "
        "Where they agree, the conversion is lossless.",
    ),
}
"""Figures of curves that the user chooses: the library's name, the alternative text, and what to see."""
_BEFORE_AND_AFTER, _LEARNING = "Before and after the tests", "Learning curves"
_NETWORKS = {
    "lf_tcn": (
        "Before: trained on CAE runs only",
        "The networks should reproduce the CAE model; the remaining difference from the test is what no CAE run can "
        "tell them.",
    ),
    "time_domain": ("After: fine-tuned on tests", "What the other tests add to the networks."),
}
_EXACT_TUNING = (
    "The fine-tuning has an exact solution. Chosen is how far each test may differ from what all share: the least "
    "whose error on left-out tests is within one standard error of the lowest."
)


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
        energy, check = list(_OF_CURVES)[1:]
        figures = [_CURVES, energy, _BIAS, _PARTS, check]
        choice = choose("Figure", figures, key="over_displacement")
        curves = comparison.choose_curves() if choice in _OF_CURVES else None
    if curves is None:
        (_show_bias if choice == _BIAS else _show_parts)(comparison)
        return
    figure, alt, caption = _OF_CURVES[choice]
    shown = "acceleration over displacement" if choice == _CURVES else choice.lower()
    draw, alt = partial(comparison.plot, figure, curves), alt.format(curves.of(comparison.test.id))
    name = curves.named(shown)
    show_cached_figure(draw, alt, choice, comparison.key, curves.key, name=name, beside=curves.also)
    st.caption(caption)


def _show_bias(comparison: Comparison) -> None:
    test = comparison.test.id
    draw = partial(comparison.view.campaign.plot, "bias", held_out=test, display=comparison.view.display)
    alt = "What the CAE model got wrong in each test, over displacement, coloured by speed"
    show_cached_figure(draw, alt, _BIAS, comparison.key, name="bias by speed")
    st.caption(
        f"What has to be added to the CAE model to get each test. The displacement domain is fitted to these, but not "
        f"to {plain(test)}, which is held out. The steep ends are at zero velocity."
    )


def _show_parts(comparison: Comparison) -> None:
    if comparison.config.preset == "paper":
        st.info(ONE_PROCESS)
        return
    test = comparison.test.id
    draw = partial(comparison.study.plot, test, "bias parts", display=comparison.view.display)
    alt = f"Parts of the bias that is expected in test {test}, over displacement, each with its 95 % band"
    show_cached_figure(draw, alt, _PARTS, comparison.key, name="parts of the bias")
    st.caption(
        f"What the other {len(comparison.others.tests)} tests predict of the bias in {plain(test)}. Shared: the same "
        "in every test. Ratio: the CAE model's pulse, its trend and its humps, times a factor. Parts can cancel each "
        "other: their sum is better known than each. Of the test's own part, its repeatability, only the size can be "
        "predicted."
    )


def show_networks(comparison: Comparison) -> None:
    """Show the networks before and after fine-tuning (Figs. 12 and 13), or how they were trained."""
    states = {own.approach: own.state for own in comparison.fold.estimates if own.approach in _NETWORKS}
    if not states:
        st.info("No approach with a network is known here yet.", icon=":material/info:")
        return
    with _row():
        choice = choose("Figure", [_BEFORE_AND_AFTER, _LEARNING], key="networks")
        if choice == _BEFORE_AND_AFTER:
            curves = comparison.choose_curves([TEST, *({BASELINE} & {*comparison.predictions})])
    columns = st.columns(2, gap="medium")
    if choice == _BEFORE_AND_AFTER:
        drawn = cache(partial(_before_and_after, comparison, curves))  # once for both columns
        for column, name in zip(columns, states, strict=False):
            with column:
                _show_network(comparison, name, curves, drawn)
        return
    name = "time_domain" if "time_domain" in states else "lf_tcn"
    network, plot = states[name], partial(comparison.study.plot, comparison.fold.held_out, approaches=[name])
    with columns[0]:
        st.markdown("**Training on CAE runs**")
        show_figure(plot("training"), alt="Mean square error over epochs", name="training")
        st.caption(
            f"Mean square error, averaged over the networks ({network['members']}); validation is on the tenth of the "
            "runs that is not trained on."
        )
    exact = "left_out_rmse" in network
    if exact or "tuning_curve" in network:
        with columns[1]:
            st.markdown("**Fine-tuning on tests**")
            alt = "Error on tests fitted to, and on tests left out, by strength" if exact else "Loss over steps"
            show_figure(plot("fine-tuning"), alt, name="fine-tuning")
            if exact:
                st.caption(_EXACT_TUNING)


def _show_network(comparison: Comparison, name: str, curves: Shown, drawn: Callable[[], dict[str, go.Figure]]) -> None:
    title, meaning = _NETWORKS[name]
    rating = comparison.fold.ratings[name][comparison.window_ms]
    st.markdown(f"**{title}** · {LABELS[name]} {rating.overall:.3f} ({rating.grade})")
    alt = f"Acceleration over time: {_with(curves, name).of(comparison.fold.held_out)}"
    key, file_name = (name, comparison.key, curves.key), curves.named(LABELS[name])
    show_cached_figure(lambda: drawn()[name], alt, key, name=file_name, beside=curves.also)
    st.caption(meaning)


def _before_and_after(comparison: Comparison, curves: Shown) -> dict[str, go.Figure]:
    names = [name for name in _NETWORKS if name in comparison.predictions]
    figures = {name: comparison.plot("acceleration", _with(curves, name)) for name in names}
    share_y_range(figures.values())
    return figures


def _with(curves: Shown, name: str) -> Shown:
    return replace(curves, approaches=(*curves.approaches, name), band=name)
