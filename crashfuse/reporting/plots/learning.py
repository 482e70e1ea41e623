"""Figures of network training."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from crashfuse.reporting.plots.canvas import new_figure
from crashfuse.reporting.plots.palette import CURSOR

_SPARE = 0.05  # decades beside the curves
_NAMES = {"train loss": "Training error", "validation loss": "Error on held-back CAE runs"}


def learning_curves(
    curves: Mapping[str, Sequence[tuple[int, float]]], *, value: str, step: str = "Step", total: int
) -> go.Figure:
    """Draw values reported during training (losses, say); on a logarithmic axis if all are positive.

    ``curves`` are positions within the step and values, by name; ``total`` is the final position.
    """
    figure = new_figure(height=260)
    for (name, points), colour in zip(curves.items(), ("#0072B2", "#D55E00", "#009E73", "#CC79A7") * 3, strict=False):
        done, values = np.array(points, dtype=np.float64).T
        figure.add_scatter(
            x=done, y=values, name=_NAMES.get(name, name), mode="lines", line={"color": colour, "width": 2}
        )
    figure.update_layout(showlegend=True)
    figure.update_xaxes(title=step, range=[0, total], unifiedhovertitle=None)
    figure.update_yaxes(title=value)
    known = [value for points in curves.values() for _, value in points]
    if known and min(known) > 0:
        # the range is given: Plotly keeps that of the figure before where this one takes its place
        ends = [np.log10(min(known)) - _SPARE, np.log10(max(known)) + _SPARE]
        figure.update_yaxes(type="log", tickformat="~g", dtick="D2", range=ends)
    return figure


def tuning_strength(errors: Mapping[str, float], left_out: Mapping[str, float], chosen: str) -> go.Figure:
    """Draw the RMS error for each strength of fine-tuning: on tests used for it, and on tests left out in turn."""
    figure = new_figure(height=260)
    for name, values, colour in (("Learned from", errors, "#0072B2"), ("Left out", left_out, "#D55E00")):
        figure.add_scatter(
            x=list(values), y=list(values.values()), name=name, mode="lines+markers",
            line={"color": colour, "width": 2}, marker={"size": 9}, hovertemplate="%{y:.3f}",
        )  # fmt: skip
    place = list(errors).index(chosen)
    side = "left" if place > len(errors) / 2 else "right"
    figure.add_vline(
        x=place, line={"color": CURSOR, "dash": "dot"}, annotation_text="chosen", annotation_position=f"top {side}"
    )
    title = "How far a test may differ from the others (shared part: 1)"
    figure.update_xaxes(title=title, type="category", range=None, unifiedhovertitle=None)
    figure.update_yaxes(title="Error (CAE RMS = 1)", rangemode="tozero")
    return figure
