"""The predicted pulses, and those pinned before: over time, over displacement, and as energy over crush."""

import plotly.graph_objects as go
import streamlit as st

from crashfuse.reporting.plots.displacement import energy_over_crush, over_displacement
from crashfuse.reporting.plots.pulses import motion
from crashfuse.ui.beside import choose_curves, without_clicks
from crashfuse.ui.figure_tools import file_name
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.predict.answer import Answer


def show(answer: Answer) -> None:
    """Show every approach's prediction, and what was put beside, in the figure that the user picks."""
    condition, display = answer.condition, answer.view.display
    with st.container(horizontal=True, vertical_alignment="center"):
        shown = choose("Figure", ["Over time", "Over displacement", "Energy over crush"], key="predicted")
        curves = choose_curves(answer.view, answer.predictions, answer.recommended, condition)

    def draw() -> go.Figure:
        pulses = None, curves.predictions, condition.speed_mps
        if shown == "Over time":
            figure = motion(*pulses, display, filled=curves.filled)
        elif shown == "Over displacement":
            figure = over_displacement(*pulses, display, filled=curves.filled)
        else:
            figure = energy_over_crush(*pulses, condition.mass_kg, filled=curves.filled)
        return without_clicks(figure)

    alt = f"Prediction by every approach at {display.condition(condition)}: {shown.lower()}"
    name = file_name("prediction", display.speed(condition.speed_mps), shown, *display.in_names[1:])
    show_cached_figure(draw, alt, shown, answer.key, curves.key, name=name)
