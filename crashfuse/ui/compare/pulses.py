"""The test and every prediction of it over time, or their differences."""

import plotly.graph_objects as go
import streamlit as st

from crashfuse.reporting.plots.pulses import add_corridors, motion, residuals
from crashfuse.ui.beside import without_clicks
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.figures import choose, show_cached_figure

_MOTION, _RESIDUALS = "Motion", "Residuals"
_CORRIDORS_HELP = (
    "ISO/TS 18571: a curve scores 1 inside the inner corridor about the test and 0 outside the outer one. Their half "
    "widths are 5 % and 50 % of the largest acceleration in the rated window."
)


def show(comparison: Comparison) -> None:
    """Show acceleration, velocity and displacement over time, or what the predictions miss."""
    test, display = comparison.test, comparison.view.display
    with st.container(horizontal=True, vertical_alignment="center"):
        shown = choose("Figure", [_MOTION, _RESIDUALS], key="compared")
        corridors = shown == _MOTION and st.toggle(
            "Corridors of the rating", key="corridors", persist_state="session", help=_CORRIDORS_HELP
        )

    curves = comparison.choose_curves()

    def draw() -> go.Figure:
        if shown == _RESIDUALS:
            return without_clicks(residuals(test.pulse, curves.predictions, display, filled=curves.filled))
        measured = test.pulse if curves.test else None
        speed = test.condition.speed_mps
        figure = without_clicks(motion(measured, curves.predictions, speed, display, filled=curves.filled))
        return add_corridors(figure, test.pulse, display) if corridors else figure

    alt = {
        _MOTION: f"Acceleration, velocity and displacement over time: test {test.id} and every prediction of it",
        _RESIDUALS: f"Every prediction of test {test.id} minus what was measured, over time",
    }
    show_cached_figure(draw, alt[shown], shown, corridors, comparison.key, curves.key)
    if shown == _RESIDUALS:
        st.caption("Where a band leaves zero, the test left that band. RMS: over the rated window.")
