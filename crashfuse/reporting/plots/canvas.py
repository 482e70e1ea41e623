"""Common style of all figures: axes, units, lines and bands, independent of their content."""

import re
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb

from crashfuse.errors import require_a
from crashfuse.reporting.plots.palette import AXIS, COLOURS, CURSOR, GRID, INK, PAPER, WINDOW, WINDOW_INK, in_the_dark
from crashfuse.signals.pulse import FloatArray

_FONT = '"Source Sans", "Source Sans 3", "Source Sans Pro", "Segoe UI", system-ui, sans-serif'
_FONT_PX = 14
AXIS_TITLE = {"font": {"size": _FONT_PX}}  # by default a fifth larger than all other words
_TEMPLATE = go.layout.Template(layout={"xaxis": {"title": AXIS_TITLE}, "yaxis": {"title": AXIS_TITLE}})
_SHEER = re.compile(r"rgba\((\d+), (\d+), (\d+), ([\d.]+)\)")
_LINK = re.compile(r"(?:<|\\u003c)(?=/?\s*a\b)", re.IGNORECASE)
_BAND_POINTS = 320  # 0.32 ms apart: one to three pixels
_BAND_ALPHA, _BAND_ALPHA_IN_THE_DARK = 0.18, 0.25
_USUAL_NAMES = 6  # of the approaches and the test
_ROW_PX, _ROW_MARGIN_PX = 21, 23  # of names above a figure, and the room that ticks and Plotly's own spaces take
_LETTER_PX, _SYMBOL_PX = 6.4, 46  # of a name, on average, with the symbol and the space beside it
_NAMES_PX = 915  # in a window of 1440 px
_TICK_NAME = 24  # characters
_FEW_RUNS = 150  # more are a cloud, in which tests have to be seen

# tools that Plotly puts beside a figure: one would upload its pulses to somebody's cloud, the others are of no use
_UNWANTED_TOOLS = ["sendChartToCloud", "lasso2d", "select2d", "zoomIn2d", "zoomOut2d", "autoScale2d"]


def tick_name(name: str) -> str:
    """A test's or condition's name at an axis: of a long one its beginning and end."""
    return name if len(name) <= _TICK_NAME else f"{name[: _TICK_NAME // 2]}…{name[1 - _TICK_NAME // 2 :]}"


def marks_of_runs(count: int) -> dict[str, object]:
    """Marks of so many CAE runs behind tests: a few are seen one by one, many as a cloud."""
    few = count <= _FEW_RUNS
    return {"color": COLOURS["cae"], "size": 6 if few else 4, "opacity": 0.7 if few else 0.35}


def new_figure(height: int) -> go.Figure:
    """An empty figure over time in ms, in the common style: legend above it, tools beside it."""
    axis = {"gridcolor": GRID, "zerolinecolor": AXIS, "linecolor": AXIS, "automargin": True}
    over_time = {
        "title": "Time (ms)",
        "range": [0, 100],
        "unifiedhovertitle": {"text": "%{x:.1f} ms"},
        "ticks": "outside",
        "showspikes": True,
        "spikemode": "across",
        "spikesnap": "cursor",
        "spikethickness": 1,
        "spikecolor": CURSOR,
    }
    legend = go.layout.Legend(x=0, y=1, yref="container", xanchor="left", yanchor="top", orientation="h")
    legend.tracegroupgap = 0  # between rows
    # with room for ticks, their title and a row of names: found too small, Plotly draws everything once more
    margin = go.layout.Margin(l=64, r=44, t=44, b=56)
    return go.Figure(
        layout=go.Layout(  # all at once: each update is checked anew
            template=_TEMPLATE,
            height=height,
            font=go.layout.Font(family=_FONT, size=_FONT_PX, color=INK),
            paper_bgcolor=PAPER,
            plot_bgcolor=PAPER,
            margin=margin,
            modebar=go.layout.Modebar(orientation="v", remove=_UNWANTED_TOOLS, color=CURSOR, activecolor=INK),
            hovermode="x unified",
            hoverlabel=go.layout.Hoverlabel(namelength=-1, bgcolor="rgba(255, 255, 255, 0.92)"),
            legend=legend,
            xaxis={**axis, **over_time},
            yaxis={**axis, "automargin": "left"},  # the names above leave half a line for the uppermost tick
        )
    )


def points_figure(height: int, title: str | None = None, **x_axis: object) -> go.Figure:
    """An empty figure of points over anything but time, each of which tells what it is."""
    look = {"range": None, "zeroline": False, "showspikes": False, "unifiedhovertitle": None}
    return new_figure(height).update_layout(hovermode="closest").update_xaxes({**look, "title": title, **x_axis})


def figure_over_tests(height: int, ticks: Sequence[str]) -> go.Figure:
    """An empty figure of points over held-out tests, which stand at 0, 1, 2 …, by the texts of their ticks."""
    return points_figure(
        height, "Held-out test", tickvals=list(range(len(ticks))), ticktext=ticks, range=[-0.6, len(ticks) - 0.4],
        showgrid=False,
    )  # fmt: skip


def make_clickable(
    figure: go.Figure, columns: list[str], rows: list[str], values: list[str], size: int, **hover: object
) -> None:
    """Put invisible marks on the cells of a heat map, row by row: cells can't be clicked."""
    figure.add_scatter(
        x=columns * len(rows), y=[row for row in rows for _ in columns], customdata=values, mode="markers",
        marker_size=size, marker_opacity=0, showlegend=False, **hover,
    )  # fmt: skip


def fix_cells(figure: go.Figure, columns: int, rows: int) -> None:
    """Let a heat map with names above stay where it is, and the mark of a cell be the nearest anywhere in it."""
    tools = [*_UNWANTED_TOOLS, "zoom2d", "pan2d", "resetScale2d"]
    figure.update_layout(hoverdistance=-1, dragmode=False, modebar_remove=tools)
    plain = {"type": "category", "ticks": "", "showline": False, "zeroline": False, "showgrid": False}
    figure.update_xaxes(plain, side="top", tickangle=0, range=[-0.5, columns - 0.5])
    figure.update_yaxes(plain, range=[rows - 0.5, -0.5])  # the marks would widen it


def height_under_names(count: int) -> int:
    """Height of a figure with this many names in the legend above it."""
    return 440 + 6 * count


def room_for_names(names: Collection[str]) -> int:
    """Height that a figure needs beyond its usual one if the legend above it names more than the approaches."""
    return 7 * max(len(names) - _USUAL_NAMES, 0)


def room_above(figure: go.Figure) -> int:
    """Margin in pixels for the rows of names above a figure; with less, Plotly draws it all once more."""
    if figure.layout.showlegend is False:
        return 0
    rows, used = 1, 0.0
    for name in dict.fromkeys(trace.name for trace in figure.data if trace.name and trace.showlegend is not False):
        width = _LETTER_PX * len(name) + _SYMBOL_PX
        rows, used = (rows, used + width) if used + width <= _NAMES_PX else (rows + 1, width)
    return _ROW_PX * rows + _ROW_MARGIN_PX


def darkened(figure: go.Figure) -> go.Figure:
    """The same figure in the colours of a dark page, or notebook; a report, which is meant for print, stays light."""
    require_a(go.Figure, figure, "campaign.plot(), say")
    drawn = figure.to_plotly_json()
    return go.Figure([_in_the_dark(trace) for trace in drawn["data"]], _in_the_dark(drawn["layout"]))


def without_links(text: str) -> str:
    """Words of a figure, or all of it as JSON, in which Plotly makes no link of what a laboratory wrote."""
    return _LINK.sub("&lt;", text)


def add_line(figure: go.Figure, x: FloatArray, y: FloatArray, **style: object) -> None:
    """Draw one curve; a lower row of stacked plots is selected by its ``yaxis``, such as ``"y2"``."""
    # a template's own format, not yhoverformat, would write negative numbers with a hyphen
    _add(figure, x, y, {"hovertemplate": "%{y}", "yhoverformat": ".1f", **style})


def add_band(
    figure: go.Figure,
    x: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    *,
    colour: str,
    filled: bool = True,
    whose: str = "",
    **style: object,
) -> None:
    """Shade between two curves, or draw their edges, with a gap where either is unknown; ``meta`` has all points."""
    lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)  # deceleration turns them over
    is_finite = np.isfinite(lower) & np.isfinite(upper)
    meta: dict[str, Any] = {"x": x[is_finite], "lower": lower[is_finite], "upper": upper[is_finite]}
    meta |= {"name": whose} if whose else {}
    some = np.append(np.arange(0, x.size - 1, -(-x.size // _BAND_POINTS)), x.size - 1)  # drawn, with both ends
    x, lower, upper, known = x[some], lower[some], upper[some], np.flatnonzero(is_finite[some])
    if not known.size:
        return
    outline: list[FloatArray] = []
    gap = np.full((2, 1), np.nan)
    for stretch in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        forth, back = (np.array([x[stretch], end[stretch]]) for end in (lower, upper))
        outline += [forth, *([] if filled else [gap]), back[:, ::-1], gap]  # edges are joined by no line
    across, up = np.hstack(outline[:-1])
    look: dict[str, Any] = {"line": {"width": 1, "color": colour}}
    if filled:
        alpha = f"rgba{(*hex_to_rgb(colour), _BAND_ALPHA)}"
        look = {"line": {"width": 0, "color": colour}, "fill": "toself", "fillcolor": alpha}
    _add(figure, across.astype(np.float32), up.astype(np.float32), {"hoverinfo": "skip", "meta": meta, **look, **style})


def shade_window(figure: go.Figure, window_ms: float, *, rows: int = 1) -> None:
    """Shade the rated window [0, window_ms) in every row, and label it."""
    for row in range(1, rows + 1):
        figure.add_shape(
            type="rect", xref="x", yref=f"y{row if row > 1 else ''} domain", x0=0, x1=window_ms, y0=0, y1=1,
            layer="below", fillcolor=WINDOW, opacity=0.55, line_width=0,
        )  # fmt: skip
    figure.add_annotation(
        x=window_ms, xref="x", y=1, yref="y domain", xanchor="right", yanchor="top", showarrow=False,
        text=f"rated: 0–{window_ms:g} ms", font_size=12, font_color=WINDOW_INK,
    )  # fmt: skip


def _add(figure: go.Figure, x: FloatArray, y: FloatArray, style: dict[str, Any]) -> None:
    panel = {name: style.pop(name) for name in ("row", "col") if name in style}
    # a dict is checked once, by ``add_scatter`` twice
    figure.add_trace({"type": "scatter", "mode": "lines", "x": x, "y": y, **style}, **panel)


def _in_the_dark(part: dict[str, Any]) -> dict[str, Any]:
    return {key: _exchanged(value, is_colour=key.endswith(("color", "colorscale"))) for key, value in part.items()}


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
    return in_the_dark().get(colour, colour)
