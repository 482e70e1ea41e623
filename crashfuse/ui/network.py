"""The networks on the page Compare: before and after they have seen tests, and how they learned."""

from collections.abc import Hashable
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.canvas import share_y_range
from crashfuse.reporting.plots.learning import learning_curves, tuning_strength
from crashfuse.reporting.plots.pulses import overlay
from crashfuse.study.fold import Fold
from crashfuse.ui import evidence
from crashfuse.ui.frame import View

_BEFORE_AND_AFTER, _LEARNING = "Before and after the tests", "Learning curves"
_TITLES = {
    "lf_tcn": "Before: learned from CAE runs alone",
    "time_domain": "After: fine-tuned on the other tests",
}
_MEANING = {
    "lf_tcn": "The networks should repeat the CAE model; what is left between them and the test is what CAE alone "
    "cannot know.",
    "time_domain": "What the other tests add to the networks.",
}


@st.fragment
def show(view: View, fold: Fold, about: Hashable) -> None:
    """Show what the tests made of the networks (Figs. 12 and 13), or how they learned; a choice says which.

    ``about`` stands for fold and view where figures are kept.
    """
    states: dict[str, dict[str, Any]] = {
        estimate.approach: estimate.state for estimate in fold.estimates if estimate.approach in _TITLES
    }
    if not states:
        return
    st.subheader("Networks in time")
    choice = st.segmented_control(
        "Figure", [_BEFORE_AND_AFTER, _LEARNING], default=_BEFORE_AND_AFTER, required=True, key="networks",
        persist_state="session", label_visibility="collapsed",
    )  # fmt: skip
    columns = st.columns(2, gap="medium")
    if choice == _BEFORE_AND_AFTER:
        for column, name in zip(columns, states, strict=False):
            with column:
                _show_beside_the_cae(view, fold, name, about)
        return
    st.caption("How both trainings went is kept with the predictions, and written to study.json.")
    network = states.get("time_domain", states.get("lf_tcn", {}))
    with columns[0]:
        st.markdown("**Learning from CAE runs**")
        _show_curve(network["learning_curve"], "Mean square error", "Epoch")
        st.caption(
            f"Mean square error, mean of {network['members']} network{'s' if network['members'] != 1 else ''}; for "
            "validation on the tenth of the runs that a network does not learn from."
        )
    with columns[1]:
        if "left_out_rmse" in network:
            st.markdown("**Learning from tests**")
            evidence.show_figure(
                tuning_strength(network["rmse"], network["left_out_rmse"], str(network["penalty"])),
                alt="Error on tests for each strength of the fine-tuning, on tests learned from and left out in turn",
            )
            st.caption(
                "The fine-tuning has an exact solution, so there are no epochs: what is chosen is its strength. The "
                "weakest is taken whose error on left-out tests is within one standard error of the least."
            )
        elif "tuning_curve" in network:
            st.markdown("**Learning from tests**")
            _show_curve(network["tuning_curve"], "Loss", "Step")


def _show_beside_the_cae(view: View, fold: Fold, name: str, about: Hashable) -> None:
    rating = fold.ratings[name][view.window_ms]
    st.markdown(f"**{_TITLES[name]}** · {LABELS[name]} {rating.overall:.3f}, {rating.grade.lower()}")
    evidence.show_kept_figure(
        lambda: _beside_the_cae(view, fold)[name],
        f"Acceleration over time: test {fold.held_out}, the CAE model and {LABELS[name]}",
        name,
        about,
    )
    st.caption(_MEANING[name])


def _beside_the_cae(view: View, fold: Fold) -> dict[str, go.Figure]:
    """The figures before and after the tests, all with one y range."""
    predictions = {estimate.approach: estimate.prediction for estimate in fold.estimates}
    figures = {
        name: overlay(
            view.held_out.pulse,
            {shown: prediction for shown, prediction in predictions.items() if shown in ("cae", name)},
            window_ms=view.window_ms,
            unit=view.unit,
            deceleration=view.deceleration,
        )
        for name in _TITLES
        if name in predictions
    }
    share_y_range(figures.values())
    return figures


def _show_curve(curve: dict[str, list[float]], value: str, step: str) -> None:
    epochs = [int(epoch) for epoch in curve["epoch"]]
    losses = {name.replace("_", " "): list(zip(epochs, curve[name], strict=True)) for name in curve if name != "epoch"}
    evidence.show_figure(
        learning_curves(losses, value=value, step=step, total=epochs[-1]), alt=f"{value} over {step.lower()}s"
    )
