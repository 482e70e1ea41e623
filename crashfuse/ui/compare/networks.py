"""The networks before and after fine-tuning on tests, and how they were trained."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.reporting.plots.canvas import share_y_range
from crashfuse.reporting.plots.curves import TEST
from crashfuse.ui.beside import Shown
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.figures import choose, show_cached_figure, show_figure

_BEFORE_AND_AFTER, _LEARNING = "Before and after the tests", "Learning curves"
_TITLES = {"lf_tcn": "Before: trained on CAE runs only", "time_domain": "After: fine-tuned on tests"}
_MEANING = {
    "lf_tcn": "The networks should reproduce the CAE model; the remaining difference from the test is what no CAE run "
    "can tell them.",
    "time_domain": "What the other tests add to the networks.",
}


def show(comparison: Comparison) -> None:
    """Show the networks before and after fine-tuning (Figs. 12 and 13), or how they were trained, as the user picks."""
    fold = comparison.fold
    states: dict[str, dict[str, Any]] = {
        estimate.approach: estimate.state for estimate in fold.estimates if estimate.approach in _TITLES
    }
    if not states:
        st.info("No approach with a network is known here yet.", icon=":material/info:")
        return
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        choice = choose("Figure", [_BEFORE_AND_AFTER, _LEARNING], key="networks")
        if choice == _BEFORE_AND_AFTER:
            curves = comparison.choose_curves([TEST, *({BASELINE} & {*comparison.predictions})])
    columns = st.columns(2, gap="medium")
    if choice == _BEFORE_AND_AFTER:
        drawn = cache(partial(_beside_the_cae, comparison, curves))  # once for both columns
        for column, name in zip(columns, states, strict=False):
            with column:
                _show_beside_the_cae(comparison, name, curves, drawn)
        return
    st.caption("Both learning curves are kept with the predictions, and written to study.json.")
    name = "time_domain" if "time_domain" in states else "lf_tcn"
    network, plot = states[name], partial(comparison.study.plot, fold.held_out, approaches=[name])
    with columns[0]:
        st.markdown("**Training on CAE runs**")
        show_figure(plot("training"), alt="Mean square error over epochs", name="training")
        st.caption(
            f"Mean square error, averaged over {network['members']} network{'s' if network['members'] != 1 else ''}; "
            "validation is on the tenth of the runs that is not trained on."
        )
    with columns[1]:
        if "left_out_rmse" in network:
            st.markdown("**Fine-tuning on tests**")
            show_figure(
                plot("fine-tuning"),
                alt="Error for each strength of the fine-tuning, on tests fitted to and on tests left out in turn",
                name="fine-tuning",
            )
            st.caption(
                "The fine-tuning has an exact solution, so there are no epochs, only one choice: how far each test may "
                "differ from what all share. Taken is the least whose error on left-out tests is within one standard "
                "error of the lowest."
            )
        elif "tuning_curve" in network:
            st.markdown("**Fine-tuning on tests**")
            show_figure(plot("fine-tuning"), alt="Loss over steps", name="fine-tuning")


def _show_beside_the_cae(
    comparison: Comparison, name: str, curves: Shown, drawn: Callable[[], dict[str, go.Figure]]
) -> None:
    fold = comparison.fold
    rating = fold.ratings[name][comparison.window_ms]
    st.markdown(f"**{_TITLES[name]}** · {LABELS[name]} {rating.overall:.3f} ({rating.grade})")
    show_cached_figure(
        lambda: drawn()[name],
        f"Acceleration over time: {_with(curves, name).of(fold.held_out)}",
        name,
        comparison.key,
        curves.key,
        name=curves.named(LABELS[name]),
        beside=curves.also,
    )
    st.caption(_MEANING[name])


def _beside_the_cae(comparison: Comparison, curves: Shown) -> dict[str, go.Figure]:
    """The figures before and after fine-tuning, with a common y range."""
    figures = {
        name: comparison.plot("acceleration", _with(curves, name)) for name in _TITLES if name in comparison.predictions
    }
    share_y_range(figures.values())
    return figures


def _with(curves: Shown, name: str) -> Shown:
    """What was chosen, and the network that is always shown."""
    return replace(curves, approaches=(*curves.approaches, name), band=name)
