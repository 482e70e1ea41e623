"""Figures on a page: in its theme, with alternative text, drawn once for all, saved by buttons, read by keys."""

import hashlib
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
import plotly.graph_objects as go
import streamlit as st

from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.drawing import Drawing, drawing_table
from crashfuse.results.plots.canvas import room_above, without_links
from crashfuse.ui.kit import address
from crashfuse.ui.kit.files import Caption, caption, export_button
from crashfuse.ui.kit.navigation import component

_DIGITS = 5  # of the largest value of a curve, on a screen of thousands of pixels
_CACHED = 200  # figures of up to half a megabyte
_TOOLS: dict[str, Any] = {"displaylogo": False, "showSendToCloud": False}  # none of those left sends a figure anywhere
T = TypeVar("T")


class SentFigure(go.Figure):  # type: ignore[misc]  # Plotly has no types
    """A drawing for ``st.plotly_chart`` with numbers of few digits, copied once and not whenever it is shown."""

    drawing = Drawing({}, {})
    light: Mapping[str, Any] = {}  # parts that differ on a light page, by name or place: files have its colours

    def __init__(self, drawing: Drawing, *, dark: bool = False, **more: object) -> None:
        super().__init__()
        self._sent, light = (
            dict(zip(("data", "layout"), map(_plain, drawing.parts(dark=look)), strict=True)) for look in (dark, False)
        )
        self.drawing, self.light = drawing, _differences(self._sent, light)
        layout = self._sent["layout"]
        layout |= more
        layout["datarevision"] = hashlib.sha256(repr(self._sent["data"]).encode()).hexdigest()[:16]
        layout["margin"]["t"] = max(layout["margin"]["t"], room_above(drawing))

    def to_dict(self) -> dict[str, Any]:
        """What is sent."""
        return dict(self._sent)


def _plain(part: Any) -> Any:  # noqa: ANN401 - any part of a drawing
    if isinstance(part, np.ndarray) and part.dtype.kind == "f" and part.size:
        largest = np.nanmax(np.abs(part), initial=0.0)
        decimals = _DIGITS - int(np.ceil(np.log10(largest))) if 0 < largest < np.inf else _DIGITS
        rounded = np.round(part.astype(np.float64), decimals).astype(object)
        rounded[~np.isfinite(part)] = None
        return rounded.tolist()
    if isinstance(part, np.ndarray):
        part = part.tolist()
    if isinstance(part, Mapping):
        return {name: _plain(own) for name, own in part.items()}
    if isinstance(part, list | tuple):
        return [_plain(own) for own in part]
    return without_links(part) if isinstance(part, str) else part


def _differences(part: Any, other: Any) -> Any:  # noqa: ANN401 - parts of drawings
    if isinstance(other, list) and isinstance(part[0], dict):
        part, other = dict(enumerate(part)), dict(enumerate(other))
    if isinstance(other, dict):
        return {name: _differences(part[name], own) for name, own in other.items() if part[name] != own}
    return other


@st.fragment
def offer_files(sent: SentFigure, caption: Caption, key: str) -> None:
    """Show the buttons of the figure just above."""
    key = f"files {key}"
    asked = st.session_state.get(key, {}).get("csv")
    data: dict[str, object] = {**caption._asdict(), "light": sent.light}
    if asked:
        table = drawing_table(sent.drawing, [int(place) for place in asked["hidden"]])
        data |= {"at": asked["at"], "csv": csv_bytes(table).decode()}
    component("figure_tools", css="buttons.css")(data=data, key=key, on_csv_change=lambda: None)


def choose(label: str, options: Sequence[str], key: str, label_of: Callable[[str], str] = str) -> str:
    """Let the user choose one of some figures or tasks, at first the first."""
    address.default(key, options[0], options)
    choice: str = st.segmented_control(
        label, options, default=options[0], required=True, key=key, persist_state="session", format_func=label_of,
        label_visibility="collapsed", on_change=address.publish,  # the page's own run would, but not a fragment's
    )  # fmt: skip
    return choice


def show_figure(drawing: Drawing, alt: str, key: str | None = None, name: str = "") -> None:
    """Show a figure; its files have the ``name``, else the alternative text."""
    _show(SentFigure(drawing, dark=_is_dark()), alt, name, key or alt, key=key)


def show_cached_figure(draw: Callable[[], Drawing], alt: str, *key: Hashable, name: str = "") -> None:
    """Like :func:`show_figure`, but drawn once for all sessions; ``key`` holds all that determines the figure."""
    _show(_cached(key, _is_dark(), draw), alt, name, alt)


def show_clickable(
    draw: Callable[[], Drawing], alt: str, on_click: Callable[[str], None], widget: str, *key: Hashable, name: str = ""
) -> bool:
    """Like :func:`show_cached_figure`, and pass the value of a clicked mark to ``on_click``; True if there is one."""

    def take() -> None:
        for point in _points(st.session_state[widget]):
            on_click(point)

    # as Streamlit would set it once the figure is drawn, to be drawn again
    sent = _cached((widget, *key), _is_dark(), draw, clickmode="event+select")
    return bool(_points(_show(sent, alt, name, widget, key=widget, on_select=take, selection_mode="points")))


def _show(sent: SentFigure, alt: str, name: str, place: str, **chart: Any) -> Any:  # noqa: ANN401 - as Streamlit has it
    event = st.plotly_chart(sent, alt=alt, theme=None, config=_TOOLS, **chart)
    offer_files(sent, caption(alt, name), place)
    return event


def _points(event: Any) -> list[str]:  # noqa: ANN401 - Streamlit returns two forms
    return [str(point["customdata"]) for point in event["selection"]["points"] if point.get("customdata")]


def _is_dark() -> bool:
    return bool(st.context.theme.type == "dark")


@st.cache_resource(max_entries=_CACHED, show_spinner=False)
def _cached(
    key: Hashable, dark: bool, _draw: Callable[[], Drawing], **layout: str  # noqa: ARG001 - part of the key
) -> SentFigure:  # fmt: skip
    return SentFigure(_draw(), dark=dark, **layout)


def show_tabs(
    tabs: Mapping[str, Callable[[T], None]], subject: T, key: str, export: Callable[[T], None] | None = None
) -> None:
    """Let the user choose a tab, and compute and show it alone; at the right end of the row, ``export`` its files."""
    with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
        tab = choose("Tab", list(tabs), key=key)
        if export is not None:
            export_button(partial(export, subject))
    tabs[tab](subject)
