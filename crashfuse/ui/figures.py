"""Figures on a page: in its theme, with alternative text, drawn once for all sessions."""

from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from crashfuse.reporting.figures import Further
from crashfuse.reporting.plots.canvas import darkened
from crashfuse.ui import address
from crashfuse.ui.captions import caption
from crashfuse.ui.figure_tools import offer_files
from crashfuse.ui.sent_figure import SentFigure

_CACHED = 200  # figures of up to half a megabyte
_TOOLS: dict[str, Any] = {"displaylogo": False, "showSendToCloud": False}  # none of those left sends a figure anywhere
_STREAMLITS = Path(st.__file__).parent / "static" / "static" / "js"
_EARLY_JS = """
export default ({ data }) => {
  const streamlit = document.querySelector('script[src*="static/js/"]');
  const load = () => import(new URL(data, streamlit.src)).catch(() => {});
  if (data && streamlit) (window.requestIdleCallback ?? setTimeout)(load);
};
"""
_early = st.components.v2.component("crashfuse_figures_early", js=_EARLY_JS)


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


def show_figure(figure: go.Figure, alt: str, key: str | None = None, name: str = "") -> None:
    """Show a figure with the tools that are useful on a curve; its files are named by all that it shows.

    ``name`` says what is drawn in few words, where the alternative text would be too long for that.
    """
    sent = SentFigure(darkened(figure) if _is_dark() else figure)
    st.plotly_chart(sent, alt=alt, key=key, theme=None, config=_TOOLS)
    offer_files(figure, caption(figure, alt, name), key or alt)


def show_cached_figure(
    draw: Callable[[], go.Figure], alt: str, *key: Hashable, name: str = "", beside: Sequence[Further] = ()
) -> None:
    """Like :func:`show_figure`, but drawn once for all sessions; ``key`` holds all that determines the figure.

    ``beside`` is what was put beside what it always shows.
    """
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
    """Like :func:`show_cached_figure`, and pass the value of a clicked mark to ``on_click``; True if one was clicked.

    ``widget`` is the key of the clicks.
    """

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
    """On a page without figures, let the browser read Plotly while someone reads the page: it takes a second."""
    _early(key="figures early", data=next((path.name for path in _STREAMLITS.glob("PlotlyChart.*.js")), ""))


def _points(event: Any) -> list[str]:  # noqa: ANN401 - Streamlit returns two forms
    return [str(point["customdata"]) for point in event["selection"]["points"] if point.get("customdata")]


def _is_dark() -> bool:
    return bool(st.context.theme.type == "dark")


@st.cache_resource(max_entries=_CACHED, show_spinner=False)
def _cached(
    key: tuple[Hashable, ...],  # noqa: ARG001
    dark: bool,
    _draw: Callable[[], go.Figure],
) -> tuple[go.Figure, SentFigure]:
    """A figure as it is drawn, of which files are made, and as it is sent."""
    figure = _draw()
    return figure, SentFigure(darkened(figure) if dark else figure)
