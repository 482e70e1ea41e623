"""Figure of what bands are worth."""

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.canvas import new_figure
from crashfuse.reporting.plots.palette import AXIS, COLOURS
from crashfuse.signals.pulse import FloatArray


def calibration_curves(levels: FloatArray, observed: Mapping[str, FloatArray]) -> go.Figure:
    """Draw how much of the left-out tests lies inside bands of each level; on the diagonal a band holds what it says.

    Parameters
    ----------
    levels : ndarray, shape (n,)
        What bands promise, from 0 to 1.
    observed : mapping of str to ndarray, shape (n,)
        What they held, by approach.
    """
    figure = new_figure(height=440)
    figure.add_scatter(
        x=[0, 100], y=[0, 100], mode="lines", name="As promised", line={"color": AXIS, "dash": "dot"},
        hoverinfo="skip",
    )  # fmt: skip
    for name, shares in observed.items():
        figure.add_scatter(
            x=np.float32(100 * levels), y=np.float32(100 * shares), mode="lines+markers", name=LABELS[name],
            line={"color": COLOURS[name], "width": 2}, marker={"size": 5}, hovertemplate="%{y:.0f} %",
        )  # fmt: skip
    figure.update_xaxes(
        title="Level of the band (%)", range=[0, 100], dtick=20, unifiedhovertitle={"text": "%{x:.0f} % band"}
    )
    figure.update_yaxes(title="a(t) up to TTZV inside (%)", range=[0, 102], dtick=20)
    return figure
