"""Figures of what a rating is made of: its four scores as bars, and the curves that each of them compares."""

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.canvas import add_line, new_figure, room_for_names
from crashfuse.reporting.plots.curves import TEST, curve_line, curve_lines
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS, INK
from crashfuse.reporting.plots.pulses import add_corridors
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import WEIGHTS, Rating
from crashfuse.signals.rating_explanation import Compared, RatingExplanation
from crashfuse.units import MS

_OUTSIDE, _BEYOND = "#E69F00", "#C1121F"  # of a curve outside the inner and the outer corridor
_LAST = 2000  # in the legend, where 1000 is usual
_DOMAINS = ((0.67, 0.985), (0.45, 0.62), (0.225, 0.395), (0.0, 0.17))
"""Of the rows, from the top, as shares of the height."""


def rating_parts(ratings: Mapping[str, Rating]) -> go.Figure:
    """Draw the four scores of each approach as bars, beside each other."""
    figure = new_figure(height=280)
    parts = [f"{part.capitalize()} ({100 * weight:.0f} %)" for part, weight in WEIGHTS.items()]
    for name, rating in ratings.items():
        scores = [getattr(rating, part) for part in WEIGHTS]
        figure.add_bar(
            x=parts, y=scores, name=LABELS[name], marker={"color": COLOURS[name]},
            text=[f"{score:.2f}" for score in scores], textposition="outside", textangle=0, textfont={"size": 11},
            constraintext="none", cliponaxis=False, hovertemplate="%{y:.3f}",
        )  # fmt: skip
    figure.update_layout(barmode="group", bargap=0.25, hovermode="closest", margin={"b": 36})  # without a title below
    figure.update_xaxes(
        title=None, range=None, type="category", ticks="", zeroline=False, showspikes=False, showgrid=False,
        unifiedhovertitle=None,
    )  # fmt: skip
    figure.update_yaxes(title="Score", range=[0, 1.2], tickvals=[0, 0.2, 0.4, 0.6, 0.8, 1])
    return figure


def rated_curves(
    explanation: RatingExplanation,
    approach: str,
    display: Display = DEFAULT,
    further: Mapping[str, Prediction] | None = None,
) -> go.Figure:
    """Stack what the four scores compare over one time axis: as it stands, shifted, warped, and the slopes.

    In the first row the corridors are shaded, the prediction is marked where it leaves them, and humps have their
    numbers: at the test, and at the prediction where it has the same hump. Further pulses, by their labels, stand there
    as well.
    """
    further = further or {}
    figure = new_figure(height=980 + room_for_names([TEST, approach, *further]))
    curves, scale = explanation.compared, display.accel_scale
    add_corridors(figure, Pulse(curves.time_s, curves.reference), display)
    grid_ms = GRID_S / MS
    lines, rated = curve_lines(further), grid_ms < explanation.window_ms
    for name, pulse in further.items():  # behind what is rated
        accel = pulse.accel_mps2[rated] * scale
        add_line(figure, grid_ms[rated], accel, name=name, line=lines[name], legendrank=_LAST)
    distance = np.abs(curves.comparison - curves.reference)
    for name, colour, half_mps2 in (
        ("Outside the inner corridor", _OUTSIDE, explanation.inner_mps2),
        ("Outside the outer corridor", _BEYOND, explanation.outer_mps2),
    ):
        if (outside := distance > half_mps2).any():
            marked = np.where(outside, curves.comparison * scale, np.nan)
            line = {"color": colour, "width": 7}  # behind the curve, whose colour it would change
            add_line(
                figure, curves.time_s / MS, marked, name=name, line=line, opacity=0.6, hoverinfo="skip",
                legendrank=_LAST - 1,
            )  # fmt: skip
    _draw(figure, curves, approach, scale, row=1)
    _number_humps(figure, explanation, approach, scale)
    _draw(figure, explanation.shifted, approach, scale, row=2)
    _draw(figure, explanation.warped, approach, scale, row=3)
    _draw(figure, explanation.slopes, approach, scale * MS, row=4)
    look, layout = figure.layout.yaxis.to_plotly_json(), {}
    for number, (part, how, (bottom, top)) in enumerate(zip(WEIGHTS, _hows(explanation), _DOMAINS, strict=True), 1):
        unit = f"{display.unit}/ms" if number == len(_DOMAINS) else display.unit
        layout[f"yaxis{number}"] = {**look, "domain": [bottom, top], "title": unit}
        figure.add_annotation(
            x=0, xref="paper", xanchor="left", y=top, yref="paper", yanchor="bottom", showarrow=False,
            text=f"<b>{part.capitalize()} {getattr(explanation.rating, part):.3f}</b>: {how}",
        )  # fmt: skip
    figure.update_layout(
        **layout,
        hoversubplots="axis",
        xaxis={"anchor": f"y{len(_DOMAINS)}", "range": [0, explanation.window_ms]},
        margin={"t": 96},
    )
    return figure


def _hows(explanation: RatingExplanation) -> tuple[str, str, str, str]:
    """What each part compares."""
    shift_ms = explanation.shift_s / MS
    moved = f"moved {abs(shift_ms):.1f} ms {'earlier' if shift_ms > 0 else 'later'}" if shift_ms else "not moved"
    return "curves as they stand", moved, f"{moved}, and warped", f"slopes, {moved}"


def _draw(figure: go.Figure, curves: Compared, approach: str, scale: float, row: int) -> None:
    for name, label, values in ((TEST, "Test", curves.reference), (approach, LABELS[approach], curves.comparison)):
        place = {} if row == 1 else {"yaxis": f"y{row}", "showlegend": False}
        add_line(
            figure, curves.time_s / MS, values * scale, name=label, legendgroup=name, line=curve_line(name),
            yhoverformat=".2f" if row == len(_DOMAINS) else ".1f", **place,
        )  # fmt: skip


def _number_humps(figure: go.Figure, explanation: RatingExplanation, approach: str, scale: float) -> None:
    """Number the test's humps outside its curve, and the same humps of the prediction on the other side."""
    curves = explanation.compared
    outwards = -np.sign(curves.reference.sum() * scale)  # of the screen, where y runs down
    for number, hump in enumerate(explanation.humps, start=1):
        marks = [(hump.peak_s, curves.reference, outwards, INK)]
        if hump.counterpart_s is not None:
            marks.append((hump.counterpart_s, curves.comparison, -outwards, COLOURS[approach]))
        for time_s, values, side, colour in marks:
            figure.add_annotation(
                x=time_s / MS, y=float(np.interp(time_s, curves.time_s, values)) * scale, text=f"{number}", ax=0,
                ay=24 * side, showarrow=True, arrowhead=0, arrowcolor=colour, font={"color": INK, "size": 13},
            )  # fmt: skip
