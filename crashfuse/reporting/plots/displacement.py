"""Figures over displacement, to the maximum crush: the CAE model's bias, corrected pulses, and their integration."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.displacement_domain.bias import BiasPart, BiasPoints
from crashfuse.approaches.displacement_domain.dynamics import replay
from crashfuse.approaches.displacement_domain.events import CaeEvents
from crashfuse.crash_test import CrashTest
from crashfuse.reporting.plots.canvas import add_band, add_line, height_under_names, new_figure, room_for_names
from crashfuse.reporting.plots.curves import TEST, Curve, by_speed, curve_line, curve_lines, draw_curves
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS
from crashfuse.signals.loading_phase import LoadingPhase, energy_crush, loading_phase
from crashfuse.signals.metrics import Metric
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.units import MS

_MM, _KJ, _KN = 1e-3, 1e3, 1e3
_BIAS = "Bias, test − CAE ({})"
_STEP_M = 0.004  # of bands: a quarter of the resolution of a CFC 60 pulse
_MARK_S = 0.004  # between marks of the integrated motion


def over_displacement(
    measured: Pulse | None,
    predictions: Mapping[str, Prediction],
    speed_mps: float,
    display: Display = DEFAULT,
    *,
    filled: str | None = None,
    crush: Mapping[str, Metric] = {},
) -> go.Figure:
    """Draw acceleration over displacement, up to maximum crush with its interval in ``crush`` (Fig. 7).

    A band covers the draws that get so far, and ends where half of them have stopped.
    """
    figure = _new_figure(height=460 + room_for_names(predictions))
    scale = display.accel_scale
    phases = _loading_phases(measured, predictions, speed_mps)
    curves: dict[str, Curve] = {}
    for name, phase in phases.items():
        band = None
        if name != TEST and (all_draws := predictions[name].draws_mps2) is not None:
            draws = [loading_phase(draw, predictions[name].condition.speed_mps) for draw in all_draws]
            at_m = np.arange(0.0, np.median([draw.crush_m for draw in draws]), _STEP_M)
            accel = np.array([np.interp(at_m, d.displacement_m, d.accel_mps2, right=np.nan) for d in draws])
            lower, upper = np.nanquantile(accel, [0.025, 0.975], axis=0)
            band = at_m / _MM, lower * scale, upper * scale
        curves[name] = Curve(phase.displacement_m / _MM, phase.accel_mps2 * scale, band)
    draw_curves(figure, curves, filled=filled)
    lines = curve_lines(curves)
    for name, curve in curves.items():
        if np.isfinite(phases[name].t0_s):
            _mark_crush(figure, name, curve, lines[name]["color"], crush.get(name))
    figure.update_yaxes(title=display.accel_title)
    return _fit_axis(figure)


def integration_check(measured: Pulse | None, predictions: Mapping[str, Prediction], speed_mps: float) -> go.Figure:
    """Compare each pulse's s(t) with that integrated over displacement by Eq. 29, which is drawn as marks (Fig. 15)."""
    figure = new_figure(height=520)
    phases = _loading_phases(measured, predictions, speed_mps)
    again = {name: replay(phase) for name, phase in phases.items()}
    travelled = {name: Curve(phase.time_s / MS, phase.displacement_m / _MM) for name, phase in phases.items()}
    missed = {
        name: Curve(phase.time_s / MS, (again[name] - phase.displacement_m) / _MM, remark=", difference")
        for name, phase in phases.items()
    }
    draw_curves(figure, travelled, hovertemplate="%{y} mm")
    lines = curve_lines(phases)
    for name, phase in phases.items():
        marks = np.searchsorted(phase.time_s, np.arange(0.0, phase.end_s, _MARK_S))
        symbol = {"color": lines[name]["color"], "symbol": "circle-open", "size": 8, "line": {"width": 1.5}}
        add_line(
            figure, phase.time_s[marks] / MS, again[name][marks] / _MM, mode="markers", marker=symbol,
            name="Eq. 29", legendgroup=name, showlegend=False, hoverinfo="skip",
        )  # fmt: skip
    draw_curves(figure, missed, yaxis="y2", showlegend=False, hovertemplate="%{y} mm", yhoverformat=".3f")
    end_ms = max(phase.time_s[-1] for phase in phases.values()) / MS
    figure.update_layout(
        hoversubplots="axis",
        xaxis={"anchor": "y2", "range": [0, 5 * np.ceil(end_ms / 5 + 0.2)]},
        yaxis={"domain": [0.38, 1.0], "title": "Displacement (mm)"},
        yaxis2={"domain": [0.0, 0.3], "title": "Difference (mm)", "gridcolor": figure.layout.yaxis.gridcolor},
    )
    return figure


def energy_over_crush(
    measured: Pulse | None,
    predictions: Mapping[str, Prediction],
    speed_mps: float,
    mass_kg: float,
    *,
    filled: str | None = None,
) -> go.Figure:
    """Draw the energy absorbed by the vehicle over its crush: the test, of this speed and mass, and predictions."""
    figure = _new_figure(height=460 + room_for_names(predictions))
    pulses = {
        name: (energy_crush(own.accel_mps2, own.condition.speed_mps, own.draws_mps2), own.condition.mass_kg)
        for name, own in predictions.items()
    }
    if measured is not None:
        pulses[TEST] = energy_crush(measured.accel_mps2, speed_mps), mass_kg
    curves = {}
    for name, (found, own_mass_kg) in pulses.items():
        band, scale = None, own_mass_kg / _KJ
        if found.lower_jpkg is not None and found.upper_jpkg is not None:
            band = found.crush_m / _MM, found.lower_jpkg * scale, found.upper_jpkg * scale
        curves[name] = Curve(found.crush_m / _MM, found.energy_jpkg * scale, band)
    draw_curves(figure, curves, filled=filled)
    figure.update_yaxes(title="Absorbed energy (kJ)", rangemode="tozero")
    return _fit_axis(figure)


def _new_figure(height: int) -> go.Figure:
    figure = new_figure(height)
    figure.update_xaxes(title="Displacement (mm)", unifiedhovertitle={"text": "%{x:.0f} mm"})
    return figure


def _fit_axis(figure: go.Figure) -> go.Figure:
    ends = [(float(np.max(trace.x)), trace.error_x.array) for trace in figure.data]
    longest = max(end + max((length or 0.0 for length in error or ()), default=0.0) for end, error in ends)
    figure.update_xaxes(range=[0, 1.02 * longest])
    return figure


def _loading_phases(
    measured: Pulse | None, predictions: Mapping[str, Prediction], speed_mps: float
) -> dict[str, LoadingPhase]:
    pulses = {name: (own.accel_mps2, own.condition.speed_mps) for name, own in predictions.items()}
    if measured is not None:
        pulses[TEST] = measured.accel_mps2, speed_mps
    return {name: loading_phase(*pulse) for name, pulse in pulses.items()}


def _mark_crush(figure: go.Figure, name: str, curve: Curve, colour: str, crush: Metric | None) -> None:
    end, error = float(curve.x[-1]), None
    if crush is not None and (crush.lower is not None or crush.upper is not None):
        error = {
            "array": [None if crush.upper is None else crush.upper - end],
            "arrayminus": [None if crush.lower is None else end - crush.lower],
        }
    told = f"{end:.1f}" if crush is None else crush.text
    add_line(
        figure, curve.x[-1:], curve.y[-1:], mode="markers", error_x=error, marker={"color": colour, "size": 8},
        name=f"Maximum crush {told} mm", legendgroup=name, showlegend=False, hovertemplate=" ",
    )  # fmt: skip


_PARTS: Mapping[str, str] = {
    "shared": "Shared",
    "by speed": "By speed",
    "by weight": "By weight",
    "ratio": "Ratio × CAE trend",
    "humps": "Ratio × CAE humps",
    "own": "The test's own",
    "total": "Total, the sum of the parts below",
}
_IN_A_ROW = 3  # with more, the titles overlap on a narrow page


def bias_by_speed(
    tests: Sequence[CrashTest],
    biases: Sequence[BiasPoints],
    *,
    speeds_mps: Mapping[str, float] | None = None,
    highlight: str | None = None,
    display: Display = DEFAULT,
) -> go.Figure:
    """Draw the CAE model's error in each test, over displacement and coloured by speed among all tests (Fig. 16)."""
    figure = _new_figure(height_under_names(len(tests)))
    of_test = {test.id: bias for test, bias in zip(tests, biases, strict=True)}
    for test, style in by_speed(tests, highlight, display, speeds_mps):
        bias = of_test[test.id]
        add_line(figure, bias.displacement_m / _MM, bias.bias_mps2 * display.accel_scale, **style)
    figure.update_yaxes(title=_BIAS.format(display.unit))
    return _fit_axis(figure)


def missing_force(found: CaeEvents, display: Display = DEFAULT, highlight: str | None = None) -> go.Figure:
    """Draw the force that the CAE model lacks in each test, coloured by speed, and its events with their ranks."""
    figure, colour = _new_figure(height_under_names(len(found.tests))), COLOURS["displacement_domain"]
    for rank, event in enumerate(found.events, start=1):
        ends_mm, force_kn = np.array([event.from_m, event.to_m]) / _MM, np.full(2, event.force_n / _KN)
        key: dict[str, Any] = {"name": "Events by rank", "legendgroup": "events", "whose": f"Event {rank}"}
        add_band(figure, ends_mm, 0 * force_kn, force_kn, colour=colour, showlegend=rank == 1, **key)
        mark = {"text": f"<b>{rank}</b>", "showarrow": False, "yshift": 10 * np.sign(event.force_n)}
        figure.add_annotation(x=ends_mm.mean(), y=force_kn[0], **mark)
    forces = dict(zip(found.tests, found.force_n / _KN, strict=True))
    for test, style in by_speed(found.tests, highlight, display):
        add_line(figure, found.displacement_m / _MM, forces[test], **style)
    figure.update_yaxes(title="Force, test − CAE (kN)")
    return _fit_axis(figure)


def bias_parts(
    parts: Sequence[BiasPart],
    displacement_m: FloatArray,
    measured: BiasPoints | None = None,
    display: Display = DEFAULT,
) -> go.Figure:
    """Draw the parts of the bias expected at a condition, and their total, the last, each with its 95 % band."""
    *some, total = parts
    rows = -(-len(some) // _IN_A_ROW)
    figure = _new_figure(height=400 + 200 * rows)
    x_style, y_style = (axis.to_plotly_json() for axis in (figure.layout.xaxis, figure.layout.yaxis))
    places = [{"row": 1, "col": 1}]
    places += [{"row": 2 + number // _IN_A_ROW, "col": 1 + number % _IN_A_ROW} for number in range(len(some))]
    specs: list[list[dict[str, int] | None]] = [[None] * _IN_A_ROW for _ in range(1 + rows)]
    for place in places:
        specs[place["row"] - 1][place["col"] - 1] = {"colspan": _IN_A_ROW if place["row"] == 1 else 1}
    figure.set_subplots(
        1 + rows, _IN_A_ROW, specs=specs, row_heights=[1.7, *[1.0] * rows], horizontal_spacing=0.05,
        vertical_spacing=0.24 / (1 + rows),
        subplot_titles=[_PARTS.get(part.name, part.name[:1].upper() + part.name[1:]) for part in (total, *some)],
    )  # fmt: skip
    figure.update_annotations(font_size=14)
    figure.update_xaxes(x_style)
    figure.update_yaxes(y_style)
    at_mm = displacement_m / _MM
    scale, colour = display.accel_scale, COLOURS["displacement_domain"]
    for part, place in zip((total, *some), places, strict=True):
        style: dict[str, Any] = {"showlegend": part is total, **place}
        ends = part.lower_mps2 * scale, part.upper_mps2 * scale
        add_band(figure, at_mm, *ends, colour=colour, name="95 % band", legendgroup="band", **style)
        line = {"color": colour, "width": 2}
        add_line(figure, at_mm, part.mean_mps2 * scale, name="Expected", line=line, legendgroup="mean", **style)
    if measured is not None:
        add_line(
            figure, measured.displacement_m / _MM, measured.bias_mps2 * scale, name="Measured in this test",
            line=curve_line(TEST), **places[0],
        )  # fmt: skip
    figure.update_layout(margin_t=64)
    figure.update_xaxes(title=None, nticks=4)
    figure.update_xaxes(title="Displacement (mm)", row=1 + rows, col=min(2, len(some) - _IN_A_ROW * (rows - 1)))
    before = np.full(displacement_m.size, True) if measured is None else displacement_m <= measured.displacement_m.max()
    bounds = scale * np.array([[part.lower_mps2[before], part.upper_mps2[before]] for part in some])
    figure.update_yaxes(range=_with_margin(bounds), showticklabels=False)  # so that the parts can be compared
    figure.update_yaxes(title=f"Bias ({display.unit})", showticklabels=True, col=1)
    shown = [total.lower_mps2[before], total.upper_mps2[before]] + ([measured.bias_mps2] if measured else [])
    figure.update_yaxes(
        title=_BIAS.format(display.unit), range=_with_margin(scale * np.concatenate(shown)), row=1, col=1
    )
    return _fit_axis(figure)


def _with_margin(values: FloatArray) -> list[float]:
    low, high = min(values.min(), 0.0), max(values.max(), 0.0)
    margin = 0.05 * (high - low)
    return [low - margin, high + margin]
