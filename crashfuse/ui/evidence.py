"""What a page shows for its claims: figures, remarks of the approaches, and the numbers to take away."""

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from typing import Any

import pandas as pd
import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.fit_explanations import fit_sentences, fit_table
from crashfuse.reporting.plots.canvas import darkened
from crashfuse.reporting.plots.palette import GRADE_COLOURS
from crashfuse.signals.metrics import Metric, missing_sentences
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.ui.text import plain

_KEPT_FIGURES = 200  # of up to half a megabyte
_TOOLS = {
    "displaylogo": False,
    "modeBarButtonsToRemove": ["lasso2d", "select2d", "zoomIn2d", "zoomOut2d", "autoScale2d"],
    "toImageButtonOptions": {"format": "svg", "filename": "crashfuse"},
}


def show_figure(figure: go.Figure, alt: str, key: str | None = None) -> None:
    """Show a figure as it is, with the tools of use on a curve; ``alt`` tells those who can't see it what it shows."""
    st.plotly_chart(_in_theme(figure), alt=alt, key=key, theme=None, config=_TOOLS)


def show_kept_figure(draw: Callable[[], go.Figure], alt: str, *about: Hashable) -> None:
    """As :func:`show_figure`, but drawn once for all sessions; ``about`` is all that decides what is drawn."""
    st.plotly_chart(_kept(about, st.context.theme.type == "dark", draw), alt=alt, theme=None, config=_TOOLS)


def clickable(figure: go.Figure, alt: str, key: str, on_click: Callable[[str], None]) -> bool:
    """Show a figure whose marks stand for something, and tell ``on_click`` which; whether one has been clicked."""

    def take() -> None:
        for point in _points(st.session_state[key]):
            on_click(point)

    event = st.plotly_chart(
        _in_theme(figure), alt=alt, key=key, theme=None, config=_TOOLS, on_select=take, selection_mode="points"
    )
    return bool(_points(event))


def _points(event: Any) -> list[str]:  # noqa: ANN401 - Streamlit gives it two forms
    return [str(point["customdata"]) for point in event["selection"]["points"] if point.get("customdata")]


def _in_theme(figure: go.Figure) -> go.Figure:
    return darkened(figure) if st.context.theme.type == "dark" else figure


@st.cache_resource(max_entries=_KEPT_FIGURES, show_spinner=False)
def _kept(about: tuple[Hashable, ...], dark: bool, _draw: Callable[[], go.Figure]) -> go.Figure:  # noqa: ARG001 - key
    figure = _draw()
    return darkened(figure) if dark else figure


def show_grade(grade: str) -> None:
    """Show a grade word on the colour it has in every table and figure."""
    st.html(
        f'<span style="background: {GRADE_COLOURS[grade]}; color: #000; padding: 0.1rem 0.6rem; border-radius: 4px">'
        f"{grade}</span>"
    )


def show_notes(predictions: Mapping[str, Prediction], said: Collection[str] = ()) -> None:
    """List what the approaches want the reader to know, each remark once with those who make it.

    What the page has ``said`` already is left out.
    """
    makers: dict[str, list[str]] = {}
    for name, prediction in predictions.items():
        for note in prediction.notes:
            if note not in said:
                makers.setdefault(note, []).append(LABELS[name])
    if makers:
        st.subheader("Notes")
        st.markdown("\n".join(f"- {', '.join(names)}: {plain(note)}" for note, names in makers.items()))


def show_settings(config: StudyConfig, *, left_out: bool = False) -> None:
    """Say under which settings the numbers came about."""
    beside = ""
    if left_out and config.leave_out == "speed group":
        beside = " With a test all tests at about its speed are left out, too."
    st.caption(f"{config.preset.capitalize()} settings, seed {config.seed}, as chosen on the page Train.{beside}")


def patience(config: StudyConfig, usually: str) -> str:
    """How long a computation takes: as usual, unless the settings are the paper's."""
    return usually if config.preset == "fast" else "With the paper's settings that takes many hours without a GPU."


def show_fits(estimates: Iterable[Estimate]) -> None:
    """Tell how the fits of models with hyperparameters went, folded away: few ask, but who asks needs it all."""
    for estimate in estimates:
        if sentences := fit_sentences(estimate.state):
            with st.expander(f"How the fit went: {LABELS[estimate.approach].lower()}"):
                st.markdown("\n\n".join(plain(sentence) for sentence in sentences))
                if not (table := fit_table(estimate.state)).empty:
                    st.table(table.style.hide(axis="index"), border="horizontal")


def show_missing(columns: Sequence[tuple[str, Sequence[Metric]]]) -> None:
    """Say why numbers are missing in a table of pulse metrics."""
    for sentence in missing_sentences(columns):
        st.caption(plain(sentence))


def download(name: str, table: Callable[[], pd.DataFrame]) -> None:
    """Button that saves a table as a CSV file of this name, made when it is asked for."""
    st.download_button(
        name, lambda: table().to_csv(index=False).encode(), file_name=name, mime="text/csv",
        icon=":material/download:", on_click="ignore",
    )  # fmt: skip


def download_report(write: Callable[[], str], name: str = "report.html") -> None:
    """Button that saves a report; it takes seconds to write, so that is done when it is asked for."""
    st.download_button(
        name, lambda: write().encode(), file_name=name, mime="text/html", icon=":material/description:",
        on_click="ignore", help="One file, opens without a network, prints on paper.",
    )  # fmt: skip


def download_bytes(name: str, write: Callable[[], bytes]) -> None:
    """Button that saves a file of another kind, made when it is asked for."""
    st.download_button(name, write, file_name=name, icon=":material/download:", on_click="ignore")


def show_recommendation(sentences: Sequence[str]) -> None:
    """Show what is recommended and why."""
    st.info("\n\n".join(plain(sentence) for sentence in sentences), icon=":material/lightbulb:")
