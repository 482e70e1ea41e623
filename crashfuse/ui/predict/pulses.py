"""The predicted pulses: over time, over displacement, and as energy over crush."""

import plotly.graph_objects as go

from crashfuse.reporting.plots.displacement import energy_over_crush, over_displacement
from crashfuse.reporting.plots.pulses import motion
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.predict.answer import Answer


def show(answer: Answer) -> None:
    """Show every approach's prediction, in the figure that the user picks."""
    shown = choose("Figure", ["Over time", "Over displacement", "Energy over crush"], key="predicted")
    predictions, condition, display = answer.predictions, answer.condition, answer.view.display

    def draw() -> go.Figure:
        if shown == "Over time":
            return motion(None, predictions, condition.speed_mps, display)
        if shown == "Over displacement":
            return over_displacement(None, predictions, condition.speed_mps, display)
        return energy_over_crush(None, predictions, condition.speed_mps, condition.mass_kg)

    alt = f"Prediction by every approach at {display.condition(condition)}: {shown.lower()}"
    show_cached_figure(draw, alt, shown, answer.key)
