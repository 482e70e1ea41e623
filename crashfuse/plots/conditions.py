"""Figure of the condition space: where the CAE runs lie, where the tests, and which of these lie outside."""

from collections.abc import Sequence

import numpy as np
import pandas as pd  # noqa: F401  (before Plotly, which otherwise imports it half-way, in several threads at once)
import plotly.graph_objects as go

from crashfuse.campaign import CaeLibrary, CrashTest
from crashfuse.plots.canvas import LEGEND_ABOVE, new_figure
from crashfuse.plots.palette import COLOURS, CURSOR, MEASURED_COLOUR
from crashfuse.pulse import FloatArray
from crashfuse.units import LB, MPH

_MAX_RUNS = 2000  # points; more only fill the same cloud
_WEIGHTS = ("Front weight (lb)", "Rear weight (lb)")


def condition_space(library: CaeLibrary, tests: Sequence[CrashTest], *, held_out: str | None = None) -> go.Figure:
    """Draw speed against front and against rear weight: CAE runs, their range, and the tests.

    A test outside the range of the CAE runs, its own paired run left aside, is drawn open: predicting it is
    extrapolation. The range shown is that of the runs that are paired with no test.

    Parameters
    ----------
    library : CaeLibrary
    tests : sequence of CrashTest
    held_out : str, optional
        Id of the test to mark by a ring.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=460)
    style, other_style = (axis.to_plotly_json() for axis in (figure.layout.xaxis, figure.layout.yaxis))
    figure.set_subplots(1, 2, horizontal_spacing=0.09)
    figure.update_xaxes({**style, "title": "Impact speed (mph)", "range": None, "showspikes": False})
    figure.update_xaxes(unifiedhovertitle=None, rangemode="tozero")
    figure.update_yaxes(other_style)
    runs = library.vectors / [MPH, LB, LB]
    low, high = _range(library, tests)
    points = np.array([test.condition.vector for test in tests]).reshape(-1, 3) / [MPH, LB, LB]
    for col, title in enumerate(_WEIGHTS, start=1):
        place = {"row": 1, "col": col, "showlegend": col == 1}
        _draw_runs(figure, runs[:: -(-len(runs) // _MAX_RUNS)], col, len(runs), place)
        _draw_range(figure, low, high, col, place)
        _draw_tests(figure, library, tests, points, held_out, col, place)
        figure.update_yaxes(title=title, row=1, col=col)
    figure.update_layout(LEGEND_ABOVE, hovermode="closest")
    return figure


def _range(library: CaeLibrary, tests: Sequence[CrashTest]) -> tuple[FloatArray, FloatArray]:
    """Least and greatest speed (mph) and weights (lb) of the runs that are paired with no test."""
    paired = {library.paired_run(test.condition) for test in tests}
    free = [run for run in range(len(library)) if run not in paired] or list(range(len(library)))
    vectors = library.vectors[free] / [MPH, LB, LB]
    return vectors.min(axis=0), vectors.max(axis=0)


def _draw_runs(figure: go.Figure, runs: FloatArray, col: int, count: int, place: dict[str, object]) -> None:
    figure.add_scatter(
        x=runs[:, 0].astype(np.float32), y=runs[:, col].astype(np.float32), mode="markers",
        name=f"{count:,} CAE runs", legendgroup="runs", hoverinfo="skip",
        marker={"color": COLOURS["cae"], "size": 4, "opacity": 0.45}, **place,
    )  # fmt: skip


def _draw_range(figure: go.Figure, low: FloatArray, high: FloatArray, col: int, place: dict[str, object]) -> None:
    figure.add_scatter(
        x=np.array([low[0], high[0], high[0], low[0], low[0]], dtype=np.float32),
        y=np.array([low[col], low[col], high[col], high[col], low[col]], dtype=np.float32),
        mode="lines", name="Their range", legendgroup="range", hoverinfo="skip",
        line={"color": CURSOR, "width": 1.5, "dash": "dash"}, **place,
    )  # fmt: skip


def _draw_tests(
    figure: go.Figure,
    library: CaeLibrary,
    tests: Sequence[CrashTest],
    points: FloatArray,
    held_out: str | None,
    col: int,
    place: dict[str, object],
) -> None:
    outside = [library.extrapolation(test.condition) for test in tests]
    for name, symbol, chosen in (
        ("Tests", "circle", [i for i, notes in enumerate(outside) if not notes]),
        ("Tests outside it: extrapolation", "circle-open", [i for i, notes in enumerate(outside) if notes]),
    ):
        if chosen:
            figure.add_scatter(
                x=points[chosen, 0].astype(np.float32),
                y=points[chosen, col].astype(np.float32),
                mode="markers+text",
                name=name,
                legendgroup=name,
                text=[tests[i].id for i in chosen],
                textposition=[_free_side(points[:, [0, col]], i) for i in chosen],
                marker={"color": MEASURED_COLOUR, "symbol": symbol, "size": 10, "line": {"width": 2}},
                customdata=[["<br>".join([str(tests[i].condition), *outside[i]])] for i in chosen],
                hovertemplate="<b>Test %{text}</b><br>%{customdata[0]}<extra></extra>",
                **place,
            )
    for i in [i for i, test in enumerate(tests) if test.id == held_out]:
        figure.add_scatter(
            x=points[[i], 0].astype(np.float32), y=points[[i], col].astype(np.float32), mode="markers",
            name=f"{held_out}: held out", legendgroup="held out", hoverinfo="skip",
            marker={"color": MEASURED_COLOUR, "symbol": "circle-open", "size": 20, "line": {"width": 2}},
            **place,
        )  # fmt: skip


def _free_side(points: FloatArray, i: int) -> str:
    """Where a point's label is least in the way of its neighbours."""
    spread = np.maximum(np.ptp(points, axis=0), 1e-9)
    others = np.delete((points - points[i]) / spread, i, axis=0)
    sides = {
        "top center": (0.0, 1.0),
        "bottom center": (0.0, -1.0),
        "middle right": (0.6, 0.0),
        "middle left": (-0.6, 0.0),
    }
    return max(sides, key=lambda side: np.abs(others - 0.09 * np.array(sides[side])).max(axis=1).min(initial=1.0))
