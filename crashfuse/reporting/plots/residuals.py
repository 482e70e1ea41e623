"""Figure of what predictions miss: prediction minus test, over time."""

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.canvas import (
    LEGEND_ABOVE,
    Unit,
    accel_scale,
    add_band,
    add_line,
    new_figure,
    shade_window,
)
from crashfuse.reporting.plots.palette import COLOURS, DASHES
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse


def residuals(
    measured: Pulse,
    predictions: Mapping[str, Prediction],
    *,
    window_ms: float | None = None,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Draw prediction minus test, with the 95 % band about it: where the band leaves zero, the test left the band.

    Parameters
    ----------
    measured : Pulse
        The test's pulse on the study grid.
    predictions, window_ms, unit, deceleration
        As in :func:`crashfuse.reporting.plots.pulses.overlay`.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=460)
    scale = accel_scale(unit, deceleration)

    def missed(accel_mps2: FloatArray) -> FloatArray:
        return (accel_mps2 - measured.accel_mps2) * scale

    for name, prediction in predictions.items():
        if (band := prediction.band()) is not None:
            bounds = [missed(bound) for bound in band]
            add_band(figure, *bounds, colour=COLOURS[name], name=LABELS[name], legendgroup=name, showlegend=False)
    for name, prediction in predictions.items():
        values = missed(prediction.accel_mps2)
        rms = np.sqrt(np.mean(values[(window_ms or np.inf) / 1e3 > GRID_S] ** 2))
        line = {"color": COLOURS[name], "width": 2, "dash": DASHES[name]}
        add_line(figure, GRID_S, values, name=f"{LABELS[name]}, RMS {rms:.1f} {unit}", line=line, legendgroup=name)
    figure.add_hline(y=0, line={"color": "#5B6270", "width": 1})
    figure.update_layout(LEGEND_ABOVE)
    figure.update_yaxes(title=f"Prediction − test ({unit})")
    shade_window(figure, window_ms)
    return figure
