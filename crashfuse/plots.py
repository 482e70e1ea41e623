"""Figures of pulses and ratings: data in, Plotly figure out, one colour for each approach everywhere.

Data stay in SI up to here; figures show ms, mm, km/h and g (or m/s²). A curve has one point a sample and is handed over
as float32; many pulses are shown as a band, never one by one.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd  # noqa: F401  (before Plotly, which otherwise imports it half-way, in several threads at once)
import plotly.graph_objects as go
from plotly.colors import sample_colorscale

from crashfuse.approaches import LABELS, Prediction
from crashfuse.campaign import CaeLibrary, CrashTest
from crashfuse.canvas import (
    LEGEND_ABOVE,
    Unit,
    accel_scale,
    accel_title,
    add_band,
    add_line,
    new_figure,
    shade_window,
)
from crashfuse.pulse import GRID_S, FloatArray, Kinematics, Pulse, kinematics
from crashfuse.rating import GRADES, grade
from crashfuse.units import KPH, MPH

MEASURED_COLOUR = "#000000"
COLOURS: Mapping[str, str] = {  # Okabe & Ito's palette, which colour-blind readers can tell apart
    "cae": "#7f7f7f",
    "lf_tcn": "#CC79A7",
    "time_domain": "#0072B2",
    "displacement_domain": "#D55E00",
    "fused": "#009E73",
}
DASHES: Mapping[str, str] = {"cae": "dash", "lf_tcn": "dot"}  # what has not seen a test is not drawn solid

GRADE_COLOURS: Mapping[str, str] = {
    "Poor": "#F4B183",
    "Fair": "#FBE3D0",
    "Good": "#CFE3F2",
    "Excellent": "#7FB6DC",
}
"""Colour behind each grade word of ISO/TS 18571; black text reads on all of them."""

_MAX_RUNS = 2000  # quantiles of that many runs don't move visibly when more are taken


def overlay(
    measured: Pulse | None,
    predictions: Mapping[str, Prediction],
    *,
    window_ms: float | None = None,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Draw the measured pulse, every approach's prediction and its 95 % band over each other.

    Parameters
    ----------
    measured : Pulse or None
        The test's pulse, black; None where nothing was measured.
    predictions : mapping of str to Prediction
        By approach name.
    window_ms : float, optional
        Shade the rated window [0, window_ms).
    unit : {"g", "m/s²"}
    deceleration : bool
        Flip the sign.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=460)
    scale = accel_scale(unit, deceleration)
    for name, prediction in predictions.items():
        _band(figure, name, prediction.band(), scale)
    for name, prediction in predictions.items():
        _curve(figure, name, prediction.accel_mps2 * scale, has_band=prediction.draws_mps2 is not None)
    if measured is not None:
        _measured(figure, measured.time_s, measured.accel_mps2 * scale)
    figure.update_layout(LEGEND_ABOVE)
    figure.update_yaxes(title=accel_title(unit, deceleration))
    shade_window(figure, window_ms)
    return figure


def motion(
    measured: Pulse | None,
    predictions: Mapping[str, Prediction],
    *,
    speed_mps: float,
    window_ms: float | None = None,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Stack acceleration, velocity and displacement over one time axis, with one cursor through all three.

    Parameters
    ----------
    measured, predictions, window_ms, unit, deceleration
        As in :func:`overlay`.
    speed_mps : float
        Impact speed in m/s, from which both integrals start.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=820)
    scale = accel_scale(unit, deceleration)
    for name, prediction in predictions.items():
        _band(figure, name, prediction.band(), scale)
        if prediction.draws_mps2 is not None:
            moved = kinematics(prediction.draws_mps2, speed_mps, GRID_S[1])
            _band(figure, name, _central(moved.velocity_mps), 1 / KPH, row=2)
            _band(figure, name, _central(moved.displacement_m), 1000, row=3)
    for name, prediction in predictions.items():
        _curve(figure, name, prediction.accel_mps2 * scale, has_band=prediction.draws_mps2 is not None)
        for row, values in _motion_rows(kinematics(prediction.accel_mps2, speed_mps, GRID_S[1])):
            _curve(figure, name, values, row=row)
    if measured is not None:
        _measured(figure, measured.time_s, measured.accel_mps2 * scale)
        for row, values in _motion_rows(measured.kinematics(speed_mps)):
            _measured(figure, measured.time_s, values, row=row)
    _join_hover(figure, unit)
    figure.update_layout(
        hoversubplots="axis",
        **LEGEND_ABOVE,
        xaxis={"anchor": "y3"},
        yaxis={"domain": [0.62, 1.0], "title": accel_title(unit, deceleration)},
        yaxis2={"domain": [0.31, 0.58], "title": "Velocity (km/h)"},
        yaxis3={"domain": [0.0, 0.27], "title": "Displacement (mm)"},
    )
    shade_window(figure, window_ms, rows=3)
    return figure


def measured_pulses(
    tests: Sequence[CrashTest],
    *,
    highlight: str | None = None,
    window_ms: float | None = None,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Draw all tests, coloured by speed.

    Parameters
    ----------
    tests : sequence of CrashTest
    highlight : str, optional
        Id of the test to draw thick (the held-out one).
    window_ms, unit, deceleration
        As in :func:`overlay`.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=460)
    scale = accel_scale(unit, deceleration)
    lines = speed_lines(tests)
    for test in sorted(tests, key=lambda test: test.condition.speed_mps):
        thick = test.id == highlight
        add_line(
            figure,
            test.pulse.time_s,
            test.pulse.accel_mps2 * scale,
            name=f"{test.id} · {test.condition.speed_mps / MPH:.1f} mph" + (" (held out)" if thick else ""),
            line={**lines[test.id], "width": 4 if thick else 1.7},
        )
    figure.update_layout(legend={"title": "Test · speed"})
    figure.update_yaxes(title=accel_title(unit, deceleration))
    shade_window(figure, window_ms)
    return figure


def library_band(
    library: CaeLibrary,
    tests: Sequence[CrashTest] = (),
    *,
    window_ms: float | None = None,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Draw the CAE library as its 5, 50 and 95 % quantiles at each time, with the runs paired to tests on top.

    Parameters
    ----------
    library : CaeLibrary
    tests : sequence of CrashTest
        Tests whose paired runs are drawn, coloured by speed.
    window_ms, unit, deceleration
        As in :func:`overlay`.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=460)
    scale = accel_scale(unit, deceleration)
    some = library.accel_mps2[:: -(-len(library) // _MAX_RUNS)]
    lower, median, upper = np.quantile(some, [0.05, 0.5, 0.95], axis=0) * scale
    add_band(figure, lower, upper, colour=COLOURS["cae"], name=f"5–95 % of {len(library):,} runs", showlegend=True)
    add_line(figure, GRID_S, median, name="Median run", line={"color": COLOURS["cae"], "width": 2.5})
    lines = speed_lines(tests)
    for test in sorted(tests, key=lambda test: test.condition.speed_mps):
        if (run := library.paired_run(test.condition)) is not None:
            add_line(
                figure,
                GRID_S,
                library.accel_mps2[run] * scale,
                name=f"{library.ids[run]} · {test.condition.speed_mps / MPH:.1f} mph",
                line={**lines[test.id], "width": 1.7},
            )
    figure.update_yaxes(title=accel_title(unit, deceleration))
    shade_window(figure, window_ms)
    return figure


def rating_heatmap(scores: Mapping[str, Mapping[str, float]]) -> go.Figure:
    """Draw overall ratings as a table of test by approach, coloured by grade, with the mean over the tests at the foot.

    Parameters
    ----------
    scores : mapping of str to mapping of str to float
        Overall rating by test id, then by approach name.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    tests = list(scores)
    approaches = list(scores[tests[0]])
    z = np.array([[scores[test][name] for name in approaches] for test in tests])
    z = np.vstack([z, z.mean(axis=0)])
    rows = [f"Test {test}" for test in tests] + ["<b>Mean</b>"]
    text = [[f"{value:.3f}  {grade(value)}" for value in row] for row in z]
    figure = new_figure(height=48 + 34 * len(rows))
    figure.add_heatmap(
        z=z.astype(np.float32),
        x=[LABELS[name] for name in approaches],
        y=rows,
        text=text,
        texttemplate="%{text}",
        textfont={"color": "#000000"},
        hovertemplate="%{y}, %{x}: %{z:.3f}<extra></extra>",
        colorscale=_grade_scale(),
        zmin=0,
        zmax=1,
        xgap=2,
        ygap=2,
        showscale=False,
    )
    figure.update_layout(
        hovermode="closest",
        dragmode=False,
        margin={"t": 40, "b": 8},
        modebar={"remove": ["zoom2d", "pan2d", "resetScale2d", "toImage"]},
    )
    figure.update_xaxes(side="top", title=None, range=None, ticks="", showline=False, showgrid=False, showspikes=False)
    figure.update_yaxes(autorange="reversed", type="category", ticks="", showline=False, zeroline=False, showgrid=False)
    return figure


def learning_curves(curves: Mapping[str, Sequence[tuple[int, float]]], *, step: str, total: int) -> go.Figure:
    """Draw what a training reports as it goes (losses, say); on a logarithmic axis where all is positive.

    Parameters
    ----------
    curves : mapping of str to sequence of (int, float)
        By the value's name: how far the step was, and the value.
    step : str
        What is being done.
    total : int
        How far it will go.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=260)
    for (name, points), colour in zip(curves.items(), ("#0072B2", "#D55E00", "#009E73", "#CC79A7") * 3, strict=False):
        done, values = np.array(points, dtype=np.float32).T
        figure.add_scatter(x=done, y=values, name=name, mode="lines", line={"color": colour, "width": 2})
    figure.update_xaxes(title=step, range=[0, total], unifiedhovertitle=None)
    if all(value > 0 for points in curves.values() for _, value in points):
        figure.update_yaxes(type="log", exponentformat="power", dtick=1)
    return figure


def tuning_strength(errors: Mapping[str, float], left_out: Mapping[str, float], chosen: str) -> go.Figure:
    """Draw how far tests are missed for each strength of the fine-tuning: learned from, and left out in turn.

    Parameters
    ----------
    errors, left_out : mapping of str to float
        Root mean square error by the share that each test has to itself, strongest last; on tests that were learned
        from, and on each as predicted from the others.
    chosen : str
        The share that was taken.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=260)
    for name, values, colour in (("Tests learned from", errors, "#0072B2"), ("Tests left out", left_out, "#D55E00")):
        figure.add_scatter(
            x=list(values), y=np.array(list(values.values()), dtype=np.float32), name=name, mode="lines+markers",
            line={"color": colour, "width": 2}, marker={"size": 9}, hovertemplate="%{y:.3f}",
        )  # fmt: skip
    figure.add_vline(x=list(errors).index(chosen), line={"color": "#5B6270", "dash": "dot"})
    figure.update_layout(LEGEND_ABOVE)
    figure.update_xaxes(
        title="Share of the increments that a test has to itself (dotted: chosen)", type="category", range=None,
        unifiedhovertitle=None,
    )  # fmt: skip
    figure.update_yaxes(title="Error (CAE RMS = 1)", rangemode="tozero")
    return figure


def _curve(figure: go.Figure, approach: str, values: FloatArray, *, row: int = 1, has_band: bool = False) -> None:
    line = {"color": COLOURS[approach], "width": 2, "dash": DASHES.get(approach, "solid")}
    name = LABELS[approach] + (" (95 % band)" if has_band else "")
    rank = 2 + list(LABELS).index(approach)
    add_line(
        figure, GRID_S, values, row=row, name=name, line=line, legendgroup=approach, legendrank=rank,
        showlegend=row == 1,
    )  # fmt: skip


def _measured(figure: go.Figure, time_s: FloatArray, values: FloatArray, *, row: int = 1) -> None:
    line = {"color": MEASURED_COLOUR, "width": 2.5}
    add_line(
        figure, time_s, values, row=row, name="Test", line=line, legendgroup="test", legendrank=1, showlegend=row == 1
    )


def _band(
    figure: go.Figure, approach: str, band: tuple[FloatArray, FloatArray] | None, scale: float, *, row: int = 1
) -> None:
    if band is None:
        return
    name, lower, upper = f"{LABELS[approach]} (95 % band)", band[0] * scale, band[1] * scale
    add_band(figure, lower, upper, colour=COLOURS[approach], name=name, row=row, legendgroup=approach, showlegend=False)


def _join_hover(figure: go.Figure, unit: Unit) -> None:
    """Let the cursor tell a, v and s of a curve on one line instead of three."""
    curves = [trace for trace in figure.data if trace.hoverinfo != "skip"]
    for group in {trace.legendgroup for trace in curves}:
        accel, velocity, displacement = [trace for trace in curves if trace.legendgroup == group]
        accel.customdata = np.column_stack([velocity.y, displacement.y])
        accel.hovertemplate = f"%{{y:.1f}} {unit}, %{{customdata[0]:.1f}} km/h, %{{customdata[1]:.0f}} mm"
        velocity.update(hovertemplate=None, hoverinfo="none")
        displacement.update(hovertemplate=None, hoverinfo="none")


def _motion_rows(moved: Kinematics) -> tuple[tuple[int, FloatArray], ...]:
    """Velocity in km/h and displacement in mm, with the rows they are drawn in."""
    return (2, moved.velocity_mps / KPH), (3, moved.displacement_m * 1000)


def _central(draws: FloatArray) -> tuple[FloatArray, FloatArray]:
    lower, upper = np.quantile(draws, [0.025, 0.975], axis=0)
    return lower, upper


def speed_lines(tests: Sequence[CrashTest]) -> dict[str, dict[str, str]]:
    """A line for each test: dark for slow, on a scale for colour-blind readers too; dashes tell repeats apart."""
    if not tests:
        return {}
    speeds = np.array([test.condition.speed_mps for test in tests])
    share = (speeds - speeds.min()) / max(float(np.ptp(speeds)), 1e-9)
    colours = sample_colorscale("Viridis", (0.88 * share).tolist())  # the bright end is lost on white
    rounded = np.round(speeds / MPH)
    repeats = [int((rounded[:i] == rounded[i]).sum()) for i in range(len(tests))]
    return {
        test.id: {"color": colour, "dash": ("solid", "dash", "dot", "dashdot")[repeat % 4]}
        for test, colour, repeat in zip(tests, colours, repeats, strict=True)
    }


def _grade_scale() -> list[tuple[float, str]]:
    """Four flat steps between 0 and 1."""
    limits = [0.0, *sorted(limit for limit, _ in GRADES), 1.0]
    steps = zip(GRADE_COLOURS.values(), limits[:-1], limits[1:], strict=True)
    return [(limit, colour) for colour, lower, upper in steps for limit in (lower, upper)]
