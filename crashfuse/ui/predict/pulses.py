"""The predicted pulses, and those put beside: over time, over displacement, and as energy over crush."""

import plotly.graph_objects as go
import streamlit as st

from crashfuse.ui.beside import choose_curves, without_clicks
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.other_seeds import show_missing
from crashfuse.ui.predict.answer import Answer

_FIGURES = {"Over time": "motion", "Over displacement": "displacement", "Energy over crush": "energy"}


def show(answer: Answer) -> None:
    """Show every approach's prediction, and what was put beside, in the figure that the user picks."""
    condition, display = answer.condition, answer.view.display
    show_missing(answer.campaign)
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        shown = choose("Figure", list(_FIGURES), key="predicted")
        curves = choose_curves(answer.view, answer.predictions, answer.recommended, condition)

    def draw() -> go.Figure:
        drawn = answer.prediction.plot(
            _FIGURES[shown], approaches=curves.approaches, also=curves.also, band=curves.band, display=display
        )
        return without_clicks(drawn)

    said = f"Prediction by {curves.by}" if curves.approaches else "Beside the prediction"
    alt = f"{said} at {display.condition(condition)}: {shown.lower()}"
    name = curves.named(f"{condition.text} {shown.lower()}")
    show_cached_figure(draw, alt, shown, answer.key, curves.key, name=name, beside=curves.also)
