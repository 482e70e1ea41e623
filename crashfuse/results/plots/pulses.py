"""Figures over time: a test and its predictions, their residuals, all tests, the CAE library."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from crashfuse.approaches.base import WHOLE_S, central_interval
from crashfuse.cae_library import CaeLibrary
from crashfuse.crash_test import CrashTest
from crashfuse.importing.pulse_conversion import Settled
from crashfuse.readers.record import RecordedChannel
from crashfuse.readers.vocabulary import ACCELERATION_UNITS
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing, Look, Sheer, Values
from crashfuse.results.plots import canvas
from crashfuse.results.plots.curves import (
    NONE,
    TEST,
    Band,
    Curve,
    Predictions,
    StyledTests,
    curve_line,
    draw_curves,
    with_filled_band,
)
from crashfuse.results.plots.palette import COLOURS, CORRIDOR, CURSOR
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray, Pulse, kinematics
from crashfuse.signals.rating import INNER_CORRIDOR, OUTER_CORRIDOR
from crashfuse.units import KN, MS, number

_GRID_MS = GRID_S / MS
_MM = 1e-3
_MAX_RUNS = 2000  # more runs do not change the quantiles visibly


def overlay(
    test: CrashTest | None, predictions: Predictions, display: Display = DEFAULT, *, filled: str | None = None
) -> Drawing:
    """Overlay the measured pulse, if any, and predictions by name, with their bands."""
    drawing = canvas.new_drawing(height=460 + canvas.room_for_names(predictions))
    draw_curves(drawing, _accelerations(test, predictions, display, filled), filled=filled)
    drawing.axis("y", *display.accel_axis)
    if test is not None:
        canvas.shade_window(drawing, display.window_ms)
    return drawing


def motion(
    test: CrashTest | None, predictions: Predictions, display: Display = DEFAULT, *, filled: str | None = None
) -> Drawing:
    """Stack acceleration, velocity and displacement over one time axis, with one cursor; see :func:`overlay`."""
    drawing = canvas.new_drawing(height=490 + canvas.room_for_names(predictions))
    accelerations = _accelerations(test, predictions, display, filled)
    draw_curves(drawing, accelerations, filled=filled)
    velocities, displacements = {}, {}
    for name, prediction in predictions.items():
        v_band = s_band = None
        speed = prediction.condition.speed_mps
        if prediction.draws_mps2 is not None:
            drawn = kinematics(prediction.draws_mps2.astype(np.float64), speed, DT_S)
            v_band = _GRID_MS, *central_interval(display.speeds(drawn.velocity_mps))
            s_band = _GRID_MS, *central_interval(drawn.displacement_m / _MM)
        moved = kinematics(prediction.accel_mps2, speed, DT_S)
        velocities[name] = Curve(_GRID_MS, display.speeds(moved.velocity_mps), v_band)
        displacements[name] = Curve(_GRID_MS, moved.displacement_m / _MM, s_band)
    if test is not None:
        moved = test.pulse.kinematics(test.condition.speed_mps)
        velocities[TEST] = Curve(test.pulse.time_s / MS, display.speeds(moved.velocity_mps))
        displacements[TEST] = Curve(test.pulse.time_s / MS, moved.displacement_m / _MM)
    for yaxis, curves in (("y2", velocities), ("y3", displacements)):
        draw_curves(drawing, curves, yaxis, filled, showlegend=False, hovertemplate=None, hoverinfo="none")
    lead = with_filled_band(accelerations, filled)
    _join_hover(drawing, display, {lead: accelerations[lead].band} if lead else {})
    drawing.update(hoversubplots="axis")
    drawing.axis("x", anchor="y3")
    drawing.axis("y", *display.accel_axis, domain=[0.53, 1.0])
    drawing.axis("y2", *display.axis("Velocity", "km/h"), domain=[0.27, 0.5], title_font_size=12)  # else titles touch
    drawing.axis("y3", "Displacement", "mm", domain=[0.0, 0.24], title_font_size=12)
    if test is not None:
        canvas.shade_window(drawing, display.window_ms, rows=3)
    return drawing


def residuals(
    test: CrashTest, predictions: Predictions, display: Display = DEFAULT, *, filled: str | None = None
) -> Drawing:
    """Draw prediction minus test with its 95 % band; the RMS is over the rated window."""
    drawing = canvas.new_drawing(height=460 + canvas.room_for_names(predictions))
    draw_curves(drawing, _accelerations(None, predictions, display, filled, minus=test.pulse), filled=filled)
    drawing.rule("y", 0, colour=CURSOR)
    drawing.axis("y", "Prediction − test", display.unit)
    canvas.shade_window(drawing, display.window_ms)
    return drawing


def add_corridors(drawing: Drawing, measured: Pulse, display: Display = DEFAULT) -> None:
    """Shade both corridors over the rated window of a drawing whose first row is acceleration over time."""
    inside = measured.time_s < display.window_ms * MS
    time, accel = measured.time_s[inside] / MS, measured.accel_mps2[inside] * display.accel_scale
    largest = np.abs(accel).max()
    for name, share, alpha in (("outer", OUTER_CORRIDOR, 0.16), ("inner", INNER_CORRIDOR, 0.36)):
        half = share * largest
        name = f"Corridor of the rating, {name} (± {half:.1f} {display.unit})"
        # below the curves, which were drawn before
        sheer = Sheer(CORRIDOR, alpha)
        drawing.band(time, accel - half, accel + half, colour=CORRIDOR, name=name, fillcolor=sheer, zorder=-1)


def measured_pulses(
    tests: StyledTests, display: Display = DEFAULT, *, cfc: float | None = None, further: Predictions = NONE
) -> Drawing:
    """Draw tests, coloured by speed; with a filter class, the curves as read thin behind."""
    drawing = canvas.new_drawing(canvas.height_under_names(len(tests) + len(further)))
    for test, style in tests:
        time_ms, accel = test.pulse.time_s / MS, test.pulse.accel_mps2
        if cfc is not None:
            line = {**style["line"], "dash": "solid", "width": 1}
            as_read = {**style, "mode": "lines", "line": line, "opacity": 0.6, "showlegend": False, "hoverinfo": "skip"}
            drawing.line(time_ms, accel * display.accel_scale, **as_read)
            accel = cfc_filter(accel, cfc=cfc, dt_s=test.pulse.dt_s)
        drawing.line(time_ms, accel * display.accel_scale, **style)
    return _with_further(drawing, further, display)


def wall_forces(tests: StyledTests) -> Drawing:
    """Draw the barrier's force on tests that have it, and dotted their mass times deceleration."""
    drawing = canvas.new_drawing(canvas.height_under_names(2 * len(tests)))
    for test, style in tests:
        if (wall := test.wall) is not None:
            drawing.line(wall.time_s / MS, wall.force_n / KN, **style)
            force = -test.condition.mass_kg * test.pulse.accel_mps2 / KN
            legend = f"{test.id}, mass × deceleration"
            dotted = {**style, "line": {**style["line"], "dash": "dot"}, "name": f"{style['name']}: {legend}"}
            drawing.line(test.pulse.time_s / MS, force, legend=legend, **dotted)
    drawing.axis("y", "Force", "kN")
    return drawing


def library_band(
    library: CaeLibrary, tests: StyledTests = (), display: Display = DEFAULT, *, further: Predictions = NONE
) -> Drawing:
    """Draw the CAE library's 5, 50 and 95 % quantiles, and on top the runs paired with tests."""
    drawing = canvas.new_drawing(canvas.height_under_names(len(tests) + len(further)))
    some = library.accel_mps2[:: -(-len(library) // _MAX_RUNS)]
    lower, median, upper = np.quantile(some, [0.05, 0.5, 0.95], axis=0) * display.accel_scale
    drawing.band(_GRID_MS, lower, upper, colour=COLOURS["cae"], name=f"5–95 % of {len(library):,} runs")
    drawing.line(_GRID_MS, median, name="Median run", line_color=COLOURS["cae"], line_width=2.5)
    for test, style in tests:
        if (run := library.paired_run(test.condition)) is not None:
            name = f"{library.ids[run]} · {display.speed(test.condition.speed_mps)}"
            drawing.line(_GRID_MS, library.accel_mps2[run] * display.accel_scale, **{**style, "name": name})
    return _with_further(drawing, further, display)


def _with_further(drawing: Drawing, further: Predictions, display: Display) -> Drawing:
    draw_curves(drawing, _accelerations(None, further, display))
    drawing.axis("y", *display.accel_axis)
    canvas.shade_window(drawing, display.window_ms)
    return drawing


def _accelerations(
    test: CrashTest | None,
    predictions: Predictions,
    display: Display,
    filled: str | None = None,
    minus: Pulse | None = None,
) -> dict[str, Curve]:
    curves = {}
    base, scale = np.zeros_like(_GRID_MS) if minus is None else minus.accel_mps2, display.accel_scale

    def ends(band: tuple[FloatArray, FloatArray] | None, until: int = N_SAMPLES) -> Band | None:
        if band is None:
            return None
        lower, upper = ((edge - base)[:until] * scale for edge in band)
        return _GRID_MS[:until], lower, upper

    for name, prediction in predictions.items():
        accel = (prediction.accel_mps2 - base) * scale
        rms = np.sqrt(np.mean(accel[display.window_ms > _GRID_MS] ** 2))
        remark = "" if minus is None else f", RMS {rms:.1f} {display.unit}"
        curves[name] = Curve(_GRID_MS, accel, ends(prediction.band()), remark)
    if (first := with_filled_band(curves, filled)) is not None:
        curves[first] = replace(curves[first], whole=ends(predictions[first].whole_band(), round(WHOLE_S / DT_S)))
    if test is not None:
        curves[TEST] = Curve(test.pulse.time_s / MS, test.pulse.accel_mps2 * scale)
    return curves


def _join_hover(drawing: Drawing, display: Display, bands: Mapping[str, Band | None]) -> None:
    curves = [mark.look for mark in drawing.marks if mark.look.get("hoverinfo") != "skip"]
    speed, unit = display.units.speed, display.unit
    for group in {look["legendgroup"] for look in curves}:
        accel, velocity, displacement = [look for look in curves if look["legendgroup"] == group]
        said = [f"{v} {speed}, {s}" for v, s in zip(_said(velocity["y"], 1), _said(displacement["y"], 0), strict=True)]
        before = f" {unit}, "
        if (band := bands.get(group)) is not None:
            ends = [_said(np.interp(np.asarray(accel["x"]), band[0], end), 1) for end in band[1:]]
            said = [f"{low}, {high}] {unit}, {rest}" for low, high, rest in zip(*ends, said, strict=True)]
            before = " ["
        # one text a point: more values would take longer to copy, write and read, several times each
        accel.update(customdata=np.array(said), hovertemplate=f"%{{y}}{before}%{{customdata}} mm")


def _said(values: Values, digits: int) -> list[str]:
    different, place = np.unique(np.round(values, digits) + 0.0, return_inverse=True)  # each is written once
    texts = [number(own, f".{digits}f") for own in different.tolist()]  # Plotly would write hyphens
    return [texts[own] for own in place.tolist()]


_FROM_S, _TO_S = -0.02, 0.15
_MOST_CHANNELS, _MOST_POINTS = 8, 4000


def imported_pulse(channels: Sequence[RecordedChannel], settled: Settled | None, display: Display = DEFAULT) -> Drawing:
    """Draw a record's pulse over its channels, contact at 0; without one the channels alone."""
    drawing = canvas.new_drawing(height=420)
    scale = display.accel_scale
    factor, zero_s = 1.0, 0.0
    if settled is not None:
        factor = ACCELERATION_UNITS[settled.unit] * (1 if settled.deceleration_sign == "negative" else -1) * scale
        zero_s = settled.time_zero_s
    recorded = Look(name="As recorded", legendgroup="recorded", opacity=0.6, hoverinfo="skip")
    recorded |= Look(line_color=COLOURS["cae"], line_width=1)
    for place, channel in enumerate(channels[:_MOST_CHANNELS]):
        time = channel.time_s - zero_s
        shown = np.flatnonzero((time >= _FROM_S) & (time <= _TO_S)) if settled is not None else np.arange(time.size)
        shown = shown[:: -(-shown.size // _MOST_POINTS) or 1]
        drawing.line(time[shown] / MS, channel.values[shown] * factor, showlegend=place == 0, **recorded)
    if settled is None:
        drawing.axis("x", "Time in the file", "ms", autorange=True, range=None)
        drawing.axis("y", "As in the file")
        return drawing
    pulse = settled.pulse
    inside = (pulse.time_s >= _FROM_S) & (pulse.time_s <= _TO_S)
    drawing.line(pulse.time_s[inside] / MS, pulse.accel_mps2[inside] * scale, line=curve_line(TEST), name=settled.id)
    drawing.axis("x", range=[_FROM_S / MS, _TO_S / MS])
    drawing.axis("y", *display.accel_axis)
    return drawing
