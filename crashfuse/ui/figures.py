"""Figures on a page: in its theme, with alternative text, drawn once for all sessions."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from crashfuse.reporting.plots.canvas import darkened
from crashfuse.ui import address

_CACHED = 200  # figures of up to half a megabyte
_IMAGE = "image"  # session key: the format in which the camera saves a figure
_DENSITY = 3  # pixels of a PNG for each on the page


def choose_image_format() -> None:
    """Let the user choose how the camera above a figure saves it."""
    st.segmented_control(
        "Save figures as", ["SVG", "PNG"], default="SVG", required=True, key=_IMAGE, persist_state="session",
        help="With the camera at the right of a figure. SVG stays sharp at any size; PNG goes into any document.",
    )  # fmt: skip


def _tools() -> dict[str, Any]:
    """The tools that are useful on a curve; none of them sends it anywhere."""
    form = st.session_state.get(_IMAGE, "SVG").lower()
    return {
        "displaylogo": False,
        "showSendToCloud": False,
        "modeBarButtonsToRemove": ["lasso2d", "select2d", "zoomIn2d", "zoomOut2d", "autoScale2d"],
        "toImageButtonOptions": {"format": form, "filename": "crashfuse", "scale": _DENSITY if form == "png" else 1},
    }


def choose(
    label: str,
    options: Sequence[str],
    key: str,
    default: str | None = None,
    label_of: Callable[[str], str] = str,
) -> str:
    """Let the user choose one of some figures or tasks, the first by default; the choice stands in the address."""
    default = default or options[0]
    address.default(key, default, options)
    choice: str = st.segmented_control(
        label, options, default=default, required=True, key=key, persist_state="session", label_visibility="collapsed",
        format_func=label_of, on_change=address.publish,  # the page's own run would, but not a fragment's
    )  # fmt: skip
    return choice


def show_figure(figure: go.Figure, alt: str, key: str | None = None) -> None:
    """Show a figure with the tools that are useful on a curve; ``alt`` is its alternative text."""
    st.plotly_chart(_in_theme(figure), alt=alt, key=key, theme=None, config=_tools())


def show_cached_figure(draw: Callable[[], go.Figure], alt: str, *key: Hashable) -> None:
    """Like :func:`show_figure`, but drawn once for all sessions; ``key`` holds all that determines the figure."""
    st.plotly_chart(_cached(key, st.context.theme.type == "dark", draw), alt=alt, theme=None, config=_tools())


def show_clickable(figure: go.Figure, alt: str, key: str, on_click: Callable[[str], None]) -> bool:
    """Show a figure and pass the value of a clicked mark to ``on_click``; returns True if one was clicked."""

    def take() -> None:
        for point in _points(st.session_state[key]):
            on_click(point)

    event = st.plotly_chart(
        _in_theme(figure), alt=alt, key=key, theme=None, config=_tools(), on_select=take, selection_mode="points"
    )
    return bool(_points(event))


def _points(event: Any) -> list[str]:  # noqa: ANN401 - Streamlit returns two forms
    return [str(point["customdata"]) for point in event["selection"]["points"] if point.get("customdata")]


def _in_theme(figure: go.Figure) -> go.Figure:
    return darkened(figure) if st.context.theme.type == "dark" else figure


@st.cache_resource(max_entries=_CACHED, show_spinner=False)
def _cached(key: tuple[Hashable, ...], dark: bool, _draw: Callable[[], go.Figure]) -> go.Figure:  # noqa: ARG001
    figure = _draw()
    return darkened(figure) if dark else figure
