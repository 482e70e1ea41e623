"""Figures of pulses over time: a test and its predictions, all tests, the CAE library."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import CaeLibrary, CrashTest
from crashfuse.reporting.plots.canvas import (
    LEGEND_ABOVE,
    Unit,
    accel_scale,
    accel_title,
    add_band,
    add_line,
    height_under_names,
    new_figure,
    shade_window,
)
from crashfuse.reporting.plots.palette import COLOURS, DASHES, MEASURED_COLOUR, speed_lines
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import GRID_S, FloatArray, Kinematics, Pulse, kinematics
from crashfuse.units import KPH, MPH

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
    look = figure.layout.yaxis.to_plotly_json()
    figure.update_layout(
        hoversubplots="axis",
        **LEGEND_ABOVE,
        xaxis={"anchor": "y3"},
        yaxis={"domain": [0.62, 1.0], "title": accel_title(unit, deceleration)},
        yaxis2={**look, "domain": [0.31, 0.58], "title": "Velocity (km/h)"},
        yaxis3={**look, "domain": [0.0, 0.27], "title": "Displacement (mm)"},
    )
    shade_window(figure, window_ms, rows=3)
    return figure


def measured_pulses(
    tests: Sequence[CrashTest],
    *,
    highlight: str | None = None,
    cfc: float | None = None,
    window_ms: float | None = None,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Draw all tests, coloured by speed; filtered, if asked for, over the thin curves of what was read.

    Parameters
    ----------
    tests : sequence of CrashTest
    highlight : str, optional
        Id of the test to draw thick (the held-out one).
    cfc : float, optional
        Channel filter class (CFC) to filter to (SAE J211-1), at most 1000.
    window_ms, unit, deceleration
        As in :func:`overlay`.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height_under_names(len(tests)))
    scale = accel_scale(unit, deceleration)
    lines = speed_lines(tests)
    for test in sorted(tests, key=lambda test: test.condition.speed_mps):
        thick, accel = test.id == highlight, test.pulse.accel_mps2
        if cfc is not None:
            as_read = {"color": lines[test.id]["color"], "width": 1}
            add_line(
                figure, test.pulse.time_s, accel * scale, line=as_read, opacity=0.6, legendgroup=test.id,
                showlegend=False, hoverinfo="skip",
            )  # fmt: skip
            accel = cfc_filter(accel, cfc=cfc, dt_s=test.pulse.dt_s)
        add_line(
            figure,
            test.pulse.time_s,
            accel * scale,
            name=f"{test.id} · {test.condition.speed_mps / MPH:.1f} mph" + (" (held out)" if thick else ""),
            line={**lines[test.id], "width": 4 if thick else 1.7},
            legendgroup=test.id,
        )
    figure.update_layout(LEGEND_ABOVE)
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
    figure = new_figure(height_under_names(len(tests)))
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
    figure.update_layout(LEGEND_ABOVE)
    figure.update_yaxes(title=accel_title(unit, deceleration))
    shade_window(figure, window_ms)
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
