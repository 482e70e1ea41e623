"""Figure of the condition space: where the CAE runs and the tests lie, and which tests are outside."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from crashfuse.cae_library import CaeLibrary
from crashfuse.crash_test import CrashTest
from crashfuse.reporting.plots.canvas import marks_of_runs, points_figure
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import CURSOR, MEASURED_COLOUR
from crashfuse.signals.pulse import FloatArray

_MAX_RUNS = 600  # more points only fill the same cloud, and browsers draw each one separately
_LABEL = np.array([0.07, 0.08])  # size of a test's label, as a fraction of the axis
_SIDES = {
    "top center": np.array([0.0, 0.9]),
    "bottom center": np.array([0.0, -0.9]),
    "middle right": np.array([0.9, 0.0]),
    "middle left": np.array([-0.9, 0.0]),
}
_WEIGHTS = ("front weight", "rear weight")


def condition_space(
    library: CaeLibrary, tests: Sequence[CrashTest], *, held_out: str | None = None, display: Display = DEFAULT
) -> go.Figure:
    """Draw front and rear weight over speed: CAE runs, their range, and the tests, open where that is extrapolation."""
    figure = points_figure(640)
    style, other_style = (axis.to_plotly_json() for axis in (figure.layout.xaxis, figure.layout.yaxis))
    figure.set_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.06)
    figure.update_xaxes(style)
    figure.update_xaxes(title=display.title("Impact speed", "mph"), row=2)
    figure.update_yaxes(other_style)
    runs = display.vectors(library.vectors)
    some = runs[:: -(-len(runs) // _MAX_RUNS)]
    low, high = map(display.vectors, library.range)
    points = display.vectors(np.array([test.condition.vector for test in tests]).reshape(-1, 3))
    everything = np.vstack([runs, points])
    bottom, top = everything.min(axis=0), everything.max(axis=0)
    margin = 0.09 * (top - bottom) + 1e-6
    figure.update_xaxes(range=[max(bottom[0] - margin[0], 0), top[0] + margin[0]])
    for row, weight in enumerate(_WEIGHTS, start=1):  # the row is also the weight's index in a condition's vector
        place: dict[str, object] = {"row": row, "col": 1, "showlegend": row == 1}
        figure.add_scatter(
            x=some[:, 0], y=some[:, row], mode="markers", name=f"{len(runs):,} CAE runs", legendgroup="runs",
            hoverinfo="skip", marker=marks_of_runs(len(some)), **place,
        )  # fmt: skip
        figure.add_scatter(
            x=[low[0], high[0], high[0], low[0], low[0]], y=[low[row], low[row], high[row], high[row], low[row]],
            mode="lines", name="Their range", legendgroup="range", hoverinfo="skip", line_color=CURSOR, line_width=1.5,
            line_dash="dash", **place,
        )  # fmt: skip
        sides = _label_sides(points[:, [0, row]], (top - bottom + 2 * margin)[[0, row]])
        notes = [library.extrapolation(test.condition) for test in tests]
        elsewhere = _WEIGHTS[2 - row]  # an axis of the other plot
        outside = [any(elsewhere not in note for note in own) for own in notes]
        for name, symbol, chosen in (
            ("Tests", "circle", [i for i, is_out in enumerate(outside) if not is_out]),
            ("Tests outside it: extrapolation", "circle-open", [i for i, is_out in enumerate(outside) if is_out]),
        ):
            if chosen:
                figure.add_scatter(
                    x=points[chosen, 0], y=points[chosen, row], mode="markers+text", cliponaxis=False,
                    text=[tests[i].id for i in chosen], textposition=[sides[i] for i in chosen], name=name,
                    marker_color=MEASURED_COLOUR, marker_symbol=symbol, marker_size=10, marker_line_width=2,
                    customdata=[["<br>".join(map(display.words, (tests[i].condition, *notes[i])))] for i in chosen],
                    hovertemplate="<b>Test %{text}</b><br>%{customdata[0]}<extra></extra>", legendgroup=name,
                    **{**place, "showlegend": name not in {trace.name for trace in figure.data}},
                )  # fmt: skip
        for i in [i for i, test in enumerate(tests) if test.id == held_out]:
            figure.add_scatter(
                x=points[[i], 0], y=points[[i], row], mode="markers", name=f"{held_out}: held out",
                legendgroup="held out", hoverinfo="skip", marker_color=MEASURED_COLOUR, marker_symbol="circle-open",
                marker_size=17, marker_line_width=1.5, **place,
            )  # fmt: skip
        figure.update_yaxes(
            title={"text": display.title(weight.capitalize(), "lb"), "standoff": 8},
            range=[bottom[row] - margin[row], top[row] + margin[row]],
            row=row,
        )
    figure.update_layout(margin_l=72)
    return figure


def _label_sides(points: FloatArray, span: FloatArray) -> list[str]:
    """Side of each point on which its label least obstructs the points and the labels before it."""
    places = points / span / _LABEL
    taken = list(places)
    chosen = []
    for i, place in enumerate(places):
        others = np.array(taken[:i] + taken[i + 1 :]).reshape(-1, 2)
        room = {side: np.abs(others - place - off).max(axis=1).min(initial=9.0) for side, off in _SIDES.items()}
        chosen.append(max(room, key=lambda side: min(room[side], 1.2)))  # beyond this distance the first side wins
        taken.append(place + _SIDES[chosen[-1]])
    return chosen
