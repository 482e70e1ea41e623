"""The test and every prediction of it over time, or their differences."""

import plotly.graph_objects as go
import streamlit as st

from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.notes import edit_notes, notes_of

_MOTION, _RESIDUALS = "Motion", "Residuals"
_CORRIDORS_HELP = (
    "ISO/TS 18571: a curve scores 1 inside the inner corridor about the test and 0 outside the outer one. Their half "
    "widths are 5 % and 50 % of the largest acceleration in the rated window."
)


def show(comparison: Comparison) -> None:
    """Show acceleration, velocity and displacement over time, or what the predictions miss."""
    test = comparison.test
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        shown = choose("Figure", [_MOTION, _RESIDUALS], key="compared")
        corridors = shown == _MOTION and st.toggle(
            "Corridors of the rating", key="corridors", persist_state="session", help=_CORRIDORS_HELP
        )
        curves = comparison.choose_curves()
    notes = notes_of(comparison.view)
    own = tuple(note for note in notes if note.test == test.id)

    def draw() -> go.Figure:
        return comparison.plot(shown.lower(), curves, corridors=corridors, notes=own)

    alt = {
        _MOTION: f"Acceleration, velocity and displacement over time: {curves.of(test.id)}",
        _RESIDUALS: f"Prediction of test {test.id} by {curves.by or 'others'} minus what was measured, over time",
    }
    name = "residuals" if shown == _RESIDUALS else "pulses with corridors" if corridors else "pulses"
    show_cached_figure(
        draw, alt[shown], shown, corridors, own, comparison.key, curves.key, beside=curves.also,
        name=curves.named(name, of_test=shown == _MOTION),
    )  # fmt: skip
    if shown == _RESIDUALS:
        st.caption("Where a band leaves zero, the test left that band. RMS: over the rated window.")
    edit_notes(comparison.view, notes)
