"""Figures on a page: in its theme, with alternative text, drawn once for all sessions, saved by buttons, read by keys.

A picture that is saved is light, whatever the page is, and says above what it shows. A figure that has the focus is
read with the arrow keys, which move the cursor as a mouse does; Enter clicks, and Escape takes the cursor away.
"""

import hashlib
import json
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

import numpy as np
import plotly.graph_objects as go
import streamlit as st

from crashfuse.files.csv_text import csv_bytes
from crashfuse.reporting.figure_data import figure_table, unpacked
from crashfuse.reporting.figures import Further
from crashfuse.reporting.plots.canvas import AXIS_TITLE, band_points, darkened, room_above, without_links
from crashfuse.reporting.plots.palette import IN_THE_DARK
from crashfuse.signals.pulse import FloatArray
from crashfuse.ui.kit import choices
from crashfuse.ui.kit.files import Caption, caption
from crashfuse.ui.kit.window import component

_DIGITS = 5  # of the largest value of a curve, on a screen of thousands of pixels
_OFF = 1e-4  # share of a curve's range by which it may be off where it is drawn through fewer points
_STRAIGHT = 1e-6  # share of a grid's length by which its points may be off
_BUTTONS = """
<div class=row>
<button type="button" data-format="svg" title="Save this figure as SVG: sharp at any size">SVG</button>
<button type="button" data-format="png" title="Save this figure as PNG: for any document">PNG</button>
<button type="button" data-format="csv" title="Save the numbers of the curves and bands that are visible">CSV</button>
</div>
"""
_LIGHT = json.dumps({dark: light for light, dark in IN_THE_DARK.items()})
_CACHED = 200  # figures of up to half a megabyte
_TOOLS: dict[str, Any] = {"displaylogo": False, "showSendToCloud": False}  # none of those left sends a figure anywhere
_STREAMLITS = Path(st.__file__).parent / "static" / "static" / "js"
T = TypeVar("T")


class SentFigure(go.Figure):  # type: ignore[misc]  # Plotly has no types
    """A figure for ``st.plotly_chart``; its curves are rounded, and drawn through fewer points, where no eye sees it.

    Streamlit writes and reads what is sent four times before Plotly has it. And it copies a figure whenever it is
    shown, which takes longer than all else if there are plain lists: so a copy is made once, here.
    """

    def __init__(self, figure: go.Figure) -> None:
        super().__init__()
        digest, parts = hashlib.sha256(), figure.layout.to_plotly_json()
        traces = [{k: part for k, part in trace.to_plotly_json().items() if k != "meta"} for trace in figure.data]
        data = [_spaced(_fewer(_plain(trace, digest.update))) for trace in traces]
        layout = {name: _plain(part) for name, part in parts.items() if name != "template"}
        for name, axis in layout.items():
            if name[1:5] == "axis" and "title" in axis:
                axis["title"] = {**AXIS_TITLE, **axis["title"]}
        layout["datarevision"] = digest.hexdigest()[:16]
        if "margin" in layout:
            layout["margin"] = {**layout["margin"], "t": max(layout["margin"]["t"], room_above(figure))}
        self._sent = {"data": data, "layout": layout}

    def to_dict(self) -> dict[str, Any]:
        """What is sent."""
        return dict(self._sent)


def _plain(part: Any, take: Callable[[bytes], object] = bytes) -> Any:  # noqa: ANN401 - any part of a figure
    """The same with lists for arrays, packed or not; ``take`` is given all of it, as bytes."""
    if isinstance(part, Mapping) and "bdata" in part:
        part = unpacked(part)
    if isinstance(part, np.ndarray):
        if part.dtype.kind not in "biuf":
            return _plain(part.tolist(), take)
        take(np.ascontiguousarray(part).tobytes() if part.dtype.kind == "f" else repr(part.tolist()).encode())
        return _listed(part)
    if isinstance(part, Mapping):
        take(repr(list(part)).encode())
        return {name: _plain(own, take) for name, own in part.items()}
    if isinstance(part, list | tuple):
        return [_plain(own, take) for own in part]
    take(repr(part).encode())
    return without_links(part) if isinstance(part, str) else part


def _listed(values: np.ndarray[Any, Any]) -> list[Any]:
    """Values as numbers of few digits; None for none, which JSON cannot hold otherwise."""
    if values.dtype.kind != "f" or not values.size:
        return list(values.tolist())
    rounded = np.round(values.astype(np.float64), _decimals(values))
    if not (known := np.isfinite(rounded)).all():
        rounded = rounded.astype(object)
        rounded[~known] = None
    return list(rounded.tolist())


def _decimals(values: FloatArray) -> int:
    largest = np.nanmax(np.abs(values), initial=0.0)
    return _DIGITS - int(np.ceil(np.log10(largest))) if 0 < largest < np.inf else _DIGITS


def _fewer(trace: dict[str, Any]) -> dict[str, Any]:
    """A smooth curve, if the cursor does not read it, through as many points as a band."""
    x, y = trace.get("x"), trace.get("y")
    if trace.get("hoverinfo") != "none" or not (_is_known(x) and _is_known(y)):
        return trace
    (across, up), kept = np.array([x, y]), band_points(len(x))
    if np.abs(np.interp(across, across[kept], up[kept]) - up).max() > _OFF * np.ptp(up):
        return trace
    return {**trace, "x": across[kept].tolist(), "y": up[kept].tolist()}


def _spaced(trace: dict[str, Any]) -> dict[str, Any]:
    """The same curve with first position and step for positions that are evenly spaced: half as much is sent."""
    x = trace.get("x")
    if trace["type"] != "scatter" or not _is_known(x):
        return trace
    step = (x[-1] - x[0]) / (len(x) - 1)
    if step <= 0 or np.abs(np.array(x) - x[0] - step * np.arange(len(x))).max() > _STRAIGHT * (x[-1] - x[0]):
        return trace
    return {name: own for name, own in trace.items() if name != "x"} | {"x0": x[0], "dx": step}


def _is_known(values: object) -> TypeGuard[list[float]]:
    return isinstance(values, list) and len(values) >= 3 and {*map(type, values)} == {float}


@st.fragment
def offer_files(figure: go.Figure, caption: Caption, key: str) -> None:
    """Show the buttons of the figure just above."""
    key = f"files {key}"
    asked = st.session_state.get(key, {}).get("csv")
    data: dict[str, object] = asdict(caption)
    if asked:
        table = figure_table(figure, [int(place) for place in asked["hidden"]])
        data |= {"at": asked["at"], "csv": csv_bytes(table).decode()}
    tools = component("figure_tools", html=_BUTTONS, css="buttons.css", LIGHT=_LIGHT)
    tools(data=data, key=key, on_csv_change=lambda: None)


def choose(
    label: str,
    options: Sequence[str],
    key: str,
    default: str | None = None,
    label_of: Callable[[str], str] = str,
) -> str:
    """Let the user choose one of some figures or tasks, at first the first."""
    default = default or options[0]
    choices.default(key, default, options)
    choice: str = st.segmented_control(
        label, options, default=default, required=True, key=key, persist_state="session", label_visibility="collapsed",
        format_func=label_of, on_change=choices.publish,  # the page's own run would, but not a fragment's
    )  # fmt: skip
    return choice


def show_figure(figure: go.Figure, alt: str, key: str | None = None, name: str = "") -> None:
    """Show a figure; its files are named by what it shows, by ``name`` where the alternative text is too long."""
    sent = SentFigure(darkened(figure) if _is_dark() else figure)
    st.plotly_chart(sent, alt=alt, key=key, theme=None, config=_TOOLS)
    offer_files(figure, caption(figure, alt, name), key or alt)


def show_cached_figure(
    draw: Callable[[], go.Figure], alt: str, *key: Hashable, name: str = "", beside: Sequence[Further] = ()
) -> None:
    """Like :func:`show_figure`, but drawn once for all sessions; ``key`` holds all that determines the figure."""
    figure, sent = _cached(key, _is_dark(), draw)
    st.plotly_chart(sent, alt=alt, theme=None, config=_TOOLS)
    offer_files(figure, caption(figure, alt, name, beside), alt)


def show_clickable(
    draw: Callable[[], go.Figure],
    alt: str,
    on_click: Callable[[str], None],
    widget: str,
    *key: Hashable,
    name: str = "",
) -> bool:
    """Like :func:`show_cached_figure`, and pass the value of a clicked mark to ``on_click``; True if there is one."""

    def take() -> None:
        for point in _points(st.session_state[widget]):
            on_click(point)

    def clickable() -> go.Figure:  # as Streamlit would set it once the figure is drawn, to be drawn again
        return draw().update_layout(clickmode="event+select")

    figure, sent = _cached((widget, *key), _is_dark(), clickable)
    event = st.plotly_chart(
        sent, alt=alt, key=widget, theme=None, config=_TOOLS, on_select=take, selection_mode="points"
    )
    offer_files(figure, caption(figure, alt, name), widget)
    return bool(_points(event))


def load_early() -> None:
    """On a page without figures, let the browser read Plotly, which takes a second."""
    script = next((path.name for path in _STREAMLITS.glob("PlotlyChart.*.js")), "")
    component("figures_early")(key="figures early", data=script)


def _points(event: Any) -> list[str]:  # noqa: ANN401 - Streamlit returns two forms
    return [str(point["customdata"]) for point in event["selection"]["points"] if point.get("customdata")]


def _is_dark() -> bool:
    return bool(st.context.theme.type == "dark")


@st.cache_resource(max_entries=_CACHED, show_spinner=False)
def _cached(key: Hashable, dark: bool, _draw: Callable[[], go.Figure]) -> tuple[go.Figure, SentFigure]:  # noqa: ARG001
    figure = _draw()
    return figure, SentFigure(darkened(figure) if dark else figure)


def show_tabs(tabs: Mapping[str, Callable[[T], None]], subject: T, key: str) -> None:
    """Let the user choose a tab, and compute and show it alone."""
    tabs[choose("Tab", list(tabs), key=key)](subject)
