"""The corridors of ISO/TS 18571 around a test, drawn under what is rated by them."""

import numpy as np
import plotly.graph_objects as go

from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.signals.pulse import Pulse
from crashfuse.signals.rating_scores import INNER_CORRIDOR, OUTER_CORRIDOR
from crashfuse.units import MS


def add_corridors(figure: go.Figure, measured: Pulse, display: Display = DEFAULT) -> go.Figure:
    """Shade both corridors over the rated window of a figure whose first row is acceleration over time.

    A curve scores 1 inside the inner corridor, 0 outside the outer. Both are as wide as the test's largest acceleration
    in the window decides. Returns the same figure.
    """
    inside = measured.time_s < display.window_ms * MS
    time, accel = measured.time_s[inside] / MS, measured.accel_mps2[inside] * display.accel_scale
    largest = np.abs(accel).max()
    outline = np.concatenate([time, time[::-1]]).astype(np.float32)
    for name, share, colour in (("outer", OUTER_CORRIDOR, 0.10), ("inner", INNER_CORRIDOR, 0.30)):
        half = share * largest
        figure.add_scatter(
            x=outline, y=np.concatenate([accel - half, (accel + half)[::-1]]).astype(np.float32), mode="lines",
            line={"width": 0, "color": "#7A5AB5"}, fill="toself", fillcolor=f"rgba(122, 90, 181, {colour})",
            name=f"Corridor of the rating, {name} (± {half:.1f} {display.unit})", hoverinfo="skip",
        )  # fmt: skip
    return figure
