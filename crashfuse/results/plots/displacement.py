"""Figures over displacement, to the maximum crush: the CAE model's bias, corrected pulses, and their integration."""

from collections.abc import Mapping, Sequence

import numpy as np

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.displacement_domain.bias import BiasPart, BiasPoints
from crashfuse.approaches.displacement_domain.dynamics import replay
from crashfuse.approaches.displacement_domain.events import CaeEvents
from crashfuse.crash_test import CrashTest
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing, Look
from crashfuse.results.plots.canvas import height_under_names, new_drawing, room_for_names, rows_of_plots
from crashfuse.results.plots.curves import (
    TEST,
    Curve,
    Predictions,
    StyledTests,
    by_speed,
    curve_line,
    curve_lines,
    draw_curves,
    label,
)
from crashfuse.results.plots.palette import COLOURS
from crashfuse.signals.loading_phase import LoadingPhase, energy_crush, loading_phase
from crashfuse.signals.metrics import Metric
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MS

_MM, _KJ, _KN = 1e-3, 1e3, 1e3
_BIAS = "Bias, test − CAE"
_STEP_M = 0.004  # of bands: a quarter of the resolution of a CFC 60 pulse
_MARK_S = 0.004  # between marks of the integrated motion


def over_displacement(
    test: CrashTest | None,
    predictions: Predictions,
    display: Display = DEFAULT,
    *,
    filled: str | None = None,
    crush: Mapping[str, Metric] = {},
) -> Drawing:
    """Draw acceleration over displacement, up to maximum crush with its interval in ``crush`` (Fig. 7).

    A band covers the draws that get so far, and ends where half of them have stopped.
    """
    drawing = _over_displacement(height=460 + room_for_names(predictions))
    scale = display.accel_scale
    phases = _loading_phases(test, predictions)
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
    draw_curves(drawing, curves, filled=filled)
    lines = curve_lines(curves)
    for name, curve in curves.items():
        if np.isfinite(phases[name].t0_s):
            _mark_crush(drawing, name, curve, lines[name]["color"], crush.get(name))
    drawing.axis("y", *display.accel_axis)
    return _fitted(drawing)


def integration_check(test: CrashTest | None, predictions: Predictions) -> Drawing:
    """Compare each pulse's s(t) with that integrated over displacement by Eq. 29, which is drawn as marks (Fig. 15)."""
    drawing = new_drawing(height=520)
    phases = _loading_phases(test, predictions)
    again = {name: replay(phase) for name, phase in phases.items()}
    travelled = {name: Curve(phase.time_s / MS, phase.displacement_m / _MM) for name, phase in phases.items()}
    missed = {
        name: Curve(phase.time_s / MS, (again[name] - phase.displacement_m) / _MM, remark=", difference")
        for name, phase in phases.items()
    }
    draw_curves(drawing, travelled, hovertemplate="%{y} mm")
    lines = curve_lines(phases)
    for name, phase in phases.items():
        marks = np.searchsorted(phase.time_s, np.arange(0.0, phase.end_s, _MARK_S))
        x, y = phase.time_s[marks] / MS, again[name][marks] / _MM
        drawing.points(
            x, y, name=f"{label(name)}: Eq. 29", legend="Eq. 29", legendgroup=name, showlegend=False, hoverinfo="skip",
            marker_color=lines[name]["color"], marker_symbol="circle-open", marker_size=8, marker_line_width=1.5,
            hovertemplate="%{y}", yhoverformat=".1f",
        )  # fmt: skip
    draw_curves(drawing, missed, yaxis="y2", showlegend=False, hovertemplate="%{y} mm", yhoverformat=".3f")
    end_ms = max(phase.time_s[-1] for phase in phases.values()) / MS
    drawing.update(hoversubplots="axis")
    drawing.axis("x", anchor="y2", range=[0, 5 * np.ceil(end_ms / 5 + 0.2)])
    drawing.axis("y", "Displacement", "mm", domain=[0.38, 1.0])
    drawing.axis("y2", "Difference", "mm", domain=[0.0, 0.3])
    return drawing


def energy_over_crush(test: CrashTest | None, predictions: Predictions, *, filled: str | None = None) -> Drawing:
    """Draw the energy absorbed by the vehicle over its crush, in the test and by predictions."""
    drawing = _over_displacement(height=460 + room_for_names(predictions))
    curves = {}
    for name, pulse in _with_test(test, predictions).items():
        absorbed = energy_crush(pulse.accel_mps2, pulse.condition.speed_mps, pulse.draws_mps2)
        band, scale = None, pulse.condition.mass_kg / _KJ
        if absorbed.lower_jpkg is not None and absorbed.upper_jpkg is not None:
            band = absorbed.crush_m / _MM, absorbed.lower_jpkg * scale, absorbed.upper_jpkg * scale
        curves[name] = Curve(absorbed.crush_m / _MM, absorbed.energy_jpkg * scale, band)
    draw_curves(drawing, curves, filled=filled)
    drawing.axis("y", "Absorbed energy", "kJ", rangemode="tozero")
    return _fitted(drawing)


def _over_displacement(height: int) -> Drawing:
    return new_drawing(height, "Displacement", "mm", unifiedhovertitle_text="%{x:.0f} mm")


def _fitted(drawing: Drawing) -> Drawing:
    ends = (end for mark in drawing.marks for end in (*mark.look["x"], *mark.numbers.get("x_upper", ())))
    longest = max(float(end) for end in ends if end is not None and np.isfinite(end))
    for axis in [name for name in drawing.axes if name.startswith("x")]:
        drawing.axis(axis, range=[0, 1.02 * longest])
    return drawing


def _with_test(test: CrashTest | None, predictions: Predictions) -> Predictions:
    return predictions if test is None else {**predictions, TEST: Prediction(test.condition, test.pulse.accel_mps2)}


def _loading_phases(test: CrashTest | None, predictions: Predictions) -> dict[str, LoadingPhase]:
    pulses = _with_test(test, predictions).items()
    return {name: loading_phase(pulse.accel_mps2, pulse.condition.speed_mps) for name, pulse in pulses}


def _mark_crush(drawing: Drawing, name: str, curve: Curve, colour: str, crush: Metric | None) -> None:
    end, interval = float(curve.x[-1]), Look()
    if crush is not None and (crush.lower is not None or crush.upper is not None):
        interval["error_x_array"] = [None if crush.upper is None else crush.upper - end]
        interval["error_x_arrayminus"] = [None if crush.lower is None else end - crush.lower]
        interval["numbers"] = {"x_lower": [crush.lower], "x_upper": [crush.upper]}
    legend = f"Maximum crush {f'{end:.1f} mm' if crush is None else crush.text_with_unit}"
    drawing.line(
        curve.x[-1:], curve.y[-1:], name=f"{label(name)}: {legend}", legend=legend, legendgroup=name, showlegend=False,
        mode="markers", marker_color=colour, marker_size=8, hovertemplate=" ", **interval,
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


def bias_by_speed(tests: StyledTests, biases: Mapping[str, BiasPoints], display: Display = DEFAULT) -> Drawing:
    """Draw the CAE model's error in each test, over displacement and coloured by speed among all tests (Fig. 16)."""
    drawing = _over_displacement(height_under_names(len(tests)))
    for test, style in tests:
        bias = biases[test.id]
        drawing.line(bias.displacement_m / _MM, bias.bias_mps2 * display.accel_scale, **style)
    drawing.axis("y", _BIAS, display.unit)
    return _fitted(drawing)


def missing_force(found: CaeEvents, display: Display = DEFAULT, highlight: str | None = None) -> Drawing:
    """Draw the force that the CAE model lacks in each test, coloured by speed, and its events with their ranks."""
    drawing, colour = _over_displacement(height_under_names(len(found.tests))), COLOURS["displacement_domain"]
    for rank, event in enumerate(found.events, start=1):
        ends_mm, force_kn = np.array([event.from_m, event.to_m]) / _MM, np.full(2, event.force_n / _KN)
        drawing.band(
            ends_mm, 0 * force_kn, force_kn, name=f"Event {rank}", legend="Events by rank", legendgroup="events",
            showlegend=rank == 1, colour=colour,
        )  # fmt: skip
        drawing.note(f"<b>{rank}</b>", ends_mm.mean(), 1, "y domain", yanchor="bottom")  # above all curves
    forces = dict(zip(found.tests, found.force_n / _KN, strict=True))
    for test, style in by_speed(found.tests, display, highlight=highlight):
        drawing.line(found.displacement_m / _MM, forces[test], **style)
    drawing.axis("y", "Force, test − CAE", "kN")
    return _fitted(drawing)


def bias_parts(
    parts: Sequence[BiasPart],
    displacement_m: FloatArray,
    measured: BiasPoints | None = None,
    display: Display = DEFAULT,
) -> Drawing:
    """Draw the expected parts of a bias and, last, their total, each with its 95 % band."""
    *some, total = parts
    rows = -(-len(some) // _IN_A_ROW)
    drawing = _over_displacement(height=400 + 200 * rows)
    at_mm, scale, colour = displacement_m / _MM, display.accel_scale, COLOURS["displacement_domain"]
    before = np.full(displacement_m.size, True) if measured is None else displacement_m <= measured.displacement_m.max()
    bounds = np.array([[part.lower_mps2[before], part.upper_mps2[before]] for part in some])
    shown = [total.lower_mps2[before], total.upper_mps2[before]] + ([measured.bias_mps2] if measured else [])
    ranges = {True: _with_margin(scale * np.concatenate(shown)), False: _with_margin(scale * bounds)}
    domains = rows_of_plots(0.24 / (1 + rows), [1.7, *[1.0] * rows])
    above = _IN_A_ROW * (rows - 1)
    lowest = above + min(2, len(some) - above)  # the middle one, if any
    for number, part in enumerate((total, *some)):
        is_total, (row, column) = part is total, divmod(number - 1, _IN_A_ROW)
        x, y = (name if is_total else f"{name}{number + 1}" for name in "xy")
        left, right = (0.0, 1.0) if is_total else (0.35 * column, 0.35 * column + 0.3)
        heading = _PARTS.get(part.name, part.name[:1].upper() + part.name[1:])
        bottom, top = domains[row + 1]
        drawing.note(heading, (left + right) / 2, top, xanchor="center", yanchor="bottom", font_size=14)
        title = None if number == lowest else ""
        drawing.axis(x, "Displacement", "mm", title=title, anchor=y, domain=[left, right], nticks=4)
        first = is_total or column == 0
        title = None if is_total else f"Bias ({display.unit})" if first else ""
        drawing.axis(y, _BIAS, display.unit, title=title, anchor=x, domain=[bottom, top])
        drawing.axis(y, range=ranges[is_total], showticklabels=first)  # so that the parts can be compared
        drawing.axes[y].plot = heading
        style = Look(showlegend=is_total, xaxis=x, yaxis=y)
        ends = part.lower_mps2 * scale, part.upper_mps2 * scale
        drawing.band(at_mm, *ends, name="95 % band", legendgroup="band", colour=colour, **style)
        style |= Look(name="Expected", legendgroup="mean", line_color=colour, line_width=2)
        drawing.line(at_mm, part.mean_mps2 * scale, **style)
    if measured is not None:
        at_mm, bias = measured.displacement_m / _MM, measured.bias_mps2 * scale
        drawing.line(at_mm, bias, name="Measured in this test", line=curve_line(TEST), xaxis="x", yaxis="y")
    drawing.update(margin_t=64)
    return _fitted(drawing)


def _with_margin(values: FloatArray) -> list[float]:
    low, high = min(values.min(), 0.0), max(values.max(), 0.0)
    margin = 0.05 * (high - low)
    return [low - margin, high + margin]
