"""The look that all figures share: axes, units, lines, bands; how, not what."""

import re
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go

from crashfuse.reporting.plots.palette import AXIS, CURSOR, GRID, IN_THE_DARK, INK, PAPER, WINDOW, WINDOW_INK
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.units import MS, G

Unit = Literal["g", "m/s²"]

_FONT = '"Source Sans", "Source Sans 3", "Source Sans Pro", "Segoe UI", system-ui, sans-serif'
_SHEER = re.compile(r"rgba\((\d+), (\d+), (\d+), ([\d.]+)\)")
_BAND_STEP = 4  # samples, 0.32 ms: a pixel or three
_BAND_ALPHA, _BAND_ALPHA_IN_THE_DARK = 0.18, 0.25

LEGEND_ABOVE: dict[str, Any] = {
    "legend": {"orientation": "h", "x": 0, "y": 1.02, "xanchor": "left", "yanchor": "bottom"},
    "modebar": {"orientation": "v"},
    "margin": {"l": 64, "r": 44, "t": 40, "b": 52},
}
"""Layout of a figure with wide curves: the legend above them, the tools beside them."""


def new_figure(height: int) -> go.Figure:
    """An empty figure over time in ms, in the one look that all figures share."""
    axis = {"gridcolor": GRID, "zerolinecolor": AXIS, "linecolor": AXIS, "automargin": True}
    figure = go.Figure()
    figure.update_layout(
        template="none",
        height=height,
        font={"family": _FONT, "size": 14, "color": INK},
        paper_bgcolor=PAPER,
        plot_bgcolor=PAPER,
        margin={"l": 64, "r": 16, "t": 32, "b": 52},
        hovermode="x unified",
        hoverlabel={"namelength": -1, "bgcolor": "rgba(255, 255, 255, 0.92)"},
        legend={"orientation": "v", "x": 1.01, "y": 1, "xanchor": "left"},
    )
    figure.update_xaxes(
        **axis,
        title="Time (ms)",
        range=[0, 100],
        unifiedhovertitle={"text": "%{x:.1f} ms"},
        ticks="outside",
        showspikes=True,
        spikemode="across",
        spikesnap="cursor",
        spikethickness=1,
        spikecolor=CURSOR,
    )
    figure.update_yaxes(**axis)
    return figure


def height_under_names(count: int) -> int:
    """Height of a figure with so many names in a legend above it, which take rows from its curves."""
    return 440 + 6 * count


def darkened(figure: go.Figure) -> go.Figure:
    """The same figure in the colours of a dark page; a report, which is printed, stays light.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
        In the look of :func:`new_figure`; it is left as it is.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    drawn = figure.to_plotly_json()
    # a heat map brings its own ground, on which its dark text reads
    traces = [trace if trace["type"] == "heatmap" else _in_the_dark(trace) for trace in drawn["data"]]
    return go.Figure(traces, _in_the_dark(drawn["layout"]))


def accel_scale(unit: Unit, deceleration: bool) -> float:
    """Factor from signed m/s² to what the axis shows."""
    return (1 / G if unit == "g" else 1.0) * (-1 if deceleration else 1)


def accel_title(unit: Unit, deceleration: bool) -> str:
    """Label of the axis, with its unit."""
    return f"{'Deceleration' if deceleration else 'Acceleration'} ({unit})"


def add_line(figure: go.Figure, time_s: FloatArray, values: FloatArray, *, row: int = 1, **style: object) -> None:
    """Draw one curve over time in ms, in the first or a lower row, as float32."""
    x, y = (time_s / MS).astype(np.float32), values.astype(np.float32)
    # one x axis for all rows: that is what makes one cursor run through all of them
    figure.add_scatter(x=x, y=y, mode="lines", yaxis=_y_axis(row), hovertemplate="%{y:.1f}", **style)


def add_band(
    figure: go.Figure, lower: FloatArray, upper: FloatArray, *, colour: str, name: str, row: int = 1, **style: object
) -> None:
    """Shade between two curves on the study grid, as one closed outline; its edges are smooth, so a few points do."""
    some = np.append(np.arange(0, len(GRID_S) - 1, _BAND_STEP), len(GRID_S) - 1)
    time_ms, lower, upper = GRID_S[some] / MS, lower[some], upper[some]
    figure.add_scatter(
        x=np.concatenate([time_ms, time_ms[::-1]]).astype(np.float32),
        y=np.concatenate([lower, upper[::-1]]).astype(np.float32),
        name=name,
        mode="lines",
        line={"width": 0, "color": colour},
        fill="toself",
        fillcolor=f"rgba({', '.join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5))}, {_BAND_ALPHA})",
        hoverinfo="skip",
        yaxis=_y_axis(row),
        **style,
    )


def shade_window(figure: go.Figure, window_ms: float | None, *, rows: int = 1) -> None:
    """Shade the rated window [0, window_ms) in every row, and name it."""
    if window_ms is None:
        return
    for row in range(1, rows + 1):
        figure.add_shape(
            type="rect", xref="x", yref=f"{_y_axis(row)} domain", x0=0, x1=window_ms, y0=0, y1=1, layer="below",
            fillcolor=WINDOW, opacity=0.55, line_width=0,
        )  # fmt: skip
    figure.add_annotation(
        x=window_ms, xref="x", y=1, yref="y domain", xanchor="right", yanchor="top", showarrow=False,
        text=f"rated: 0–{window_ms:g} ms", font={"size": 12, "color": WINDOW_INK},
    )  # fmt: skip


def share_y_range(figures: Iterable[go.Figure]) -> None:
    """Give figures of one row the same y range, so that one can be compared with the other beside it."""
    figures = list(figures)
    values = np.concatenate([trace.y for figure in figures for trace in figure.data])
    margin = 0.05 * np.ptp(values)
    for figure in figures:
        figure.update_yaxes(range=[values.min() - margin, values.max() + margin])


def _y_axis(row: int) -> str:
    return "y" if row == 1 else f"y{row}"


def _in_the_dark(part: dict[str, Any]) -> dict[str, Any]:
    """A part of a figure with every colour in it exchanged."""
    return {key: _exchanged(value, is_colour=key.endswith("color")) for key, value in part.items()}


def _exchanged(value: object, *, is_colour: bool) -> object:
    if isinstance(value, dict):
        return _in_the_dark(value)
    if isinstance(value, list | tuple):
        return [_exchanged(item, is_colour=is_colour) for item in value]
    return _dark(value) if is_colour and isinstance(value, str) else value


def _dark(colour: str) -> str:
    if sheer := _SHEER.fullmatch(colour):
        solid = "#{:02X}{:02X}{:02X}".format(*map(int, sheer.groups()[:3]))
        red, green, blue = (int(_dark(solid)[i : i + 2], 16) for i in (1, 3, 5))
        alpha = float(sheer[4])
        return f"rgba({red}, {green}, {blue}, {_BAND_ALPHA_IN_THE_DARK if alpha == _BAND_ALPHA else alpha:g})"
    return IN_THE_DARK.get(colour, colour)
