"""Figures over displacement: the bias of the CAE model, what is made of it, and the way back to time.

A crash is shown from contact to its maximum crush, where over displacement it ends. Signs, units and colours are those
of :mod:`crashfuse.reporting.plots.pulses`.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.displacement_domain.dynamics import replay
from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.canvas import LEGEND_ABOVE, Unit, accel_scale, accel_title, new_figure
from crashfuse.reporting.plots.palette import COLOURS, DASHES, MEASURED_COLOUR
from crashfuse.signals.energy import energy_crush
from crashfuse.signals.loading import LoadingPhase, loading_phase
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.units import MS

_MM, _KJ = 1e-3, 1e3
_STEP_M = 0.004  # of bands: a quarter of what a CFC 60 pulse resolves
_MARK_S = 0.004  # between marks of what was integrated


def over_displacement(
    measured: Pulse | None,
    predictions: Mapping[str, Prediction],
    *,
    speed_mps: float,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Draw acceleration over displacement: the test, the CAE model, and every correction with its 95 % band (Fig. 7).

    A band at some displacement holds the draws that get so far; it ends where half of them have stopped. The mark at a
    curve's end is the maximum dynamic crush, with its 95 % interval.

    Parameters
    ----------
    measured : Pulse or None
        The test's pulse on the study grid, black; None where nothing was measured.
    predictions : mapping of str to Prediction
        By approach name.
    speed_mps : float
        Impact speed in m/s.
    unit : {"g", "m/s²"}
    deceleration : bool
        Flip the sign.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = displacement_figure(height=460)
    scale = accel_scale(unit, deceleration)
    crush: dict[str, tuple[float, float]] = {}
    for name, prediction in predictions.items():
        if prediction.draws_mps2 is not None:
            draws = [loading_phase(draw, speed_mps) for draw in prediction.draws_mps2]
            lower, upper = np.quantile([draw.crush_m for draw in draws], [0.025, 0.975])
            crush[name] = float(lower), float(upper)
            draw_band(figure, *(_band_of(draws)), scale, COLOURS[name], legendgroup=name)
    for name, prediction in predictions.items():
        line = {"color": COLOURS[name], "width": 2, "dash": DASHES[name]}
        label = LABELS[name] + (" (95 % band)" if name in crush else "")
        _curve(figure, loading_phase(prediction.accel_mps2, speed_mps), scale, label, line, crush.get(name), name)
    if measured is not None:
        line = {"color": MEASURED_COLOUR, "width": 2.5}
        _curve(figure, loading_phase(measured.accel_mps2, speed_mps), scale, "Test", line, None, "test")
    figure.update_layout(LEGEND_ABOVE)
    figure.update_yaxes(title=accel_title(unit, deceleration))
    return fit_axis(figure)


def integration_check(measured: Pulse | None, predictions: Mapping[str, Prediction], *, speed_mps: float) -> go.Figure:
    """Check the way over displacement: integrate each pulse's a(s) by Eq. 29, and compare with its own s(t) (Fig. 15).

    Lines are the pulses integrated twice over time, up to t0; marks are what the vehicle's motion over displacement
    gives back. Below is the difference of the two.

    Parameters
    ----------
    measured, predictions, speed_mps
        As in :func:`over_displacement`.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = new_figure(height=520)
    curves = [] if measured is None else [("Test", MEASURED_COLOUR, "solid", measured.accel_mps2)]
    curves += [
        (LABELS[name], COLOURS[name], DASHES[name], prediction.accel_mps2) for name, prediction in predictions.items()
    ]
    end_ms = 0.0
    for label, colour, dash, accel in curves:
        phase = loading_phase(accel, speed_mps)
        again = replay(phase)
        time_ms = phase.time_s / MS
        end_ms = max(end_ms, float(time_ms[-1]))
        marks = np.searchsorted(phase.time_s, np.arange(0.0, phase.end_s, _MARK_S))
        line = {"color": colour, "width": 2, "dash": dash}
        figure.add_scatter(
            x=_single(time_ms), y=_single(phase.displacement_m / _MM), mode="lines", name=label, line=line,
            legendgroup=label, hovertemplate="%{y:.1f} mm",
        )  # fmt: skip
        figure.add_scatter(
            x=_single(time_ms[marks]), y=_single(again[marks] / _MM), mode="markers", name=f"{label}, Eq. 29",
            marker={"color": colour, "symbol": "circle-open", "size": 8, "line": {"width": 1.5}},
            legendgroup=label, showlegend=False, hoverinfo="skip",
        )  # fmt: skip
        figure.add_scatter(
            x=_single(time_ms), y=_single((again - phase.displacement_m) / _MM), mode="lines", yaxis="y2",
            name=f"{label}, difference", line=line, legendgroup=label, showlegend=False, hovertemplate="%{y:.3f} mm",
        )  # fmt: skip
    figure.update_layout(
        LEGEND_ABOVE,
        hoversubplots="axis",
        xaxis={"anchor": "y2", "range": [0, 5 * np.ceil(end_ms / 5 + 0.2)]},
        yaxis={"domain": [0.38, 1.0], "title": "Displacement (mm)"},
        yaxis2={"domain": [0.0, 0.3], "title": "Difference (mm)", "gridcolor": figure.layout.yaxis.gridcolor},
    )
    return figure


def energy_over_crush(
    measured: Pulse | None, predictions: Mapping[str, Prediction], *, speed_mps: float, mass_kg: float
) -> go.Figure:
    """Draw the energy that the vehicle has absorbed over its crush: the test, the CAE model, every correction's band.

    Parameters
    ----------
    measured, predictions, speed_mps :
        As in :func:`over_displacement`.
    mass_kg : float
        Of the vehicle.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = displacement_figure(height=460)
    scale = mass_kg / _KJ
    for name, prediction in predictions.items():
        found = energy_crush(prediction.accel_mps2, speed_mps, draws_mps2=prediction.draws_mps2)
        has_band = found.lower_jpkg is not None and found.upper_jpkg is not None
        if found.lower_jpkg is not None and found.upper_jpkg is not None:
            limits = found.lower_jpkg, found.upper_jpkg
            draw_band(figure, found.crush_m, *limits, scale, COLOURS[name], legendgroup=name)
        line = {"color": COLOURS[name], "width": 2, "dash": DASHES[name]}
        label = LABELS[name] + (" (95 % band)" if has_band else "")
        draw_line(figure, found.crush_m, found.energy_jpkg * scale, name=label, line=line, legendgroup=name)
    if measured is not None:
        found = energy_crush(measured.accel_mps2, speed_mps)
        line = {"color": MEASURED_COLOUR, "width": 2.5}
        draw_line(figure, found.crush_m, found.energy_jpkg * scale, name="Test", line=line, legendrank=1)
    figure.update_layout(LEGEND_ABOVE)
    figure.update_yaxes(title="Absorbed energy (kJ)", rangemode="tozero")
    return fit_axis(figure)


def displacement_figure(height: int) -> go.Figure:
    """An empty figure over displacement in mm."""
    figure = new_figure(height)
    figure.update_xaxes(title="Displacement (mm)", unifiedhovertitle={"text": "%{x:.0f} mm"})
    return figure


def fit_axis(figure: go.Figure) -> go.Figure:
    """The axes begin at contact and leave some room beyond the longest curve."""
    longest = max(float(np.max(trace.x)) for trace in figure.data)
    figure.update_xaxes(range=[0, 1.02 * longest])
    return figure


def draw_line(figure: go.Figure, displacement_m: FloatArray, values: FloatArray, **style: object) -> None:
    """Draw one curve over displacement in mm, as float32."""
    x, y = _single(displacement_m / _MM), _single(values)
    figure.add_scatter(x=x, y=y, mode="lines", hovertemplate="%{y:.1f}", **style)


def _curve(
    figure: go.Figure,
    phase: LoadingPhase,
    scale: float,
    name: str,
    line: Mapping[str, object],
    crush_m: tuple[float, float] | None,
    group: str,
) -> None:
    """One crash up to its maximum crush, which is marked if there is one."""
    rank = 1 if group == "test" else 2
    draw_line(
        figure, phase.displacement_m, phase.accel_mps2 * scale, name=name, line=line, legendgroup=group, legendrank=rank
    )
    if np.isnan(phase.t0_s):
        return
    end = phase.crush_m / _MM
    interval = None if crush_m is None else [bound / _MM for bound in crush_m]
    figure.add_scatter(
        x=[end],
        y=_single(phase.accel_mps2[-1:] * scale),
        error_x=None if interval is None else {"array": [interval[1] - end], "arrayminus": [end - interval[0]]},
        mode="markers",
        marker={"color": line["color"], "size": 8},
        name=f"{name}: maximum crush {end:.0f} mm" + (f" [{interval[0]:.0f}, {interval[1]:.0f}]" if interval else ""),
        legendgroup=group,
        showlegend=False,
        hovertemplate=" ",
    )


def draw_band(
    figure: go.Figure,
    displacement_m: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    scale: float,
    colour: str,
    **style: object,
) -> None:
    """Shade between two curves, as one closed outline."""
    figure.add_scatter(
        x=_single(np.concatenate([displacement_m, displacement_m[::-1]]) / _MM),
        y=_single(np.concatenate([lower, upper[::-1]]) * scale),
        mode="lines",
        line={"width": 0, "color": colour},
        fill="toself",
        fillcolor=f"rgba{(*hex_to_rgb(colour), 0.18)}",
        hoverinfo="skip",
        **{"showlegend": False, **style},
    )


def _band_of(draws: Sequence[LoadingPhase]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Displacements, and the middle 95 % there of the draws that get so far."""
    grid = np.arange(0.0, np.median([draw.crush_m for draw in draws]), _STEP_M)
    accel = np.array([np.interp(grid, d.displacement_m, d.accel_mps2, right=np.nan) for d in draws])
    lower, upper = np.nanquantile(accel, [0.025, 0.975], axis=0)
    return grid, lower, upper


def _single(values: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return values.astype(np.float32)
