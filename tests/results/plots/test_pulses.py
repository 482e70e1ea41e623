"""Figures show the numbers they were given, in the units they name."""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.importing import settle
from crashfuse.results.display import Display
from crashfuse.results.plots import pulses as plots
from crashfuse.results.plots.canvas import new_drawing
from crashfuse.results.plots.curves import WHOLE, Predictions, by_speed
from crashfuse.results.plots.pulses import imported_pulse
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, motion
from crashfuse.units import MPH, G
from tests.importing.crashes import CONDITION, PEAK_MPS2, channel, record


def trace(figure: go.Figure, name: str, row: int = 1) -> go.Scatter:
    axis = None if row == 1 else f"y{row}"
    (found,) = [t for t in figure.data if t.name == name and (t.yaxis or "y") == (axis or "y")]
    return found


def test_the_overlay_shows_the_measured_pulse_in_ms_and_g(test: CrashTest, predictions: Predictions) -> None:
    """A pulse of -9.80665 m/s² is drawn at -1."""
    measured = trace(plots.overlay(test, predictions).figure(), "Test")
    np.testing.assert_allclose(measured.x, GRID_S * 1000, rtol=1e-6)
    np.testing.assert_allclose(measured.y, test.pulse.accel_mps2 / G, rtol=1e-6)
    assert measured.line.color == "#000000"


def test_deceleration_in_si_is_the_negative_of_the_signed_data(test: CrashTest, predictions: Predictions) -> None:
    """The sign and the unit are the plot's own; the axis says so, and the rated window is shaded and named."""
    figure = plots.overlay(test, predictions, Display(40.0, unit="m/s²", deceleration=True)).figure()
    np.testing.assert_allclose(trace(figure, "CAE").y, -predictions["cae"].accel_mps2, rtol=1e-6)
    assert figure.layout.yaxis.title.text == "Deceleration (m/s²)"
    (shape,) = figure.layout.shapes
    assert (shape.x0, shape.x1) == (0, 40)
    assert figure.layout.annotations[0].text == "rated: 0–40 ms"


def test_the_band_is_the_central_95_percent_of_the_draws(test: CrashTest, predictions: Predictions) -> None:
    """Of 101 evenly spaced draws from -50 to +50 the interval is -47.5 to +47.5."""
    figure = plots.overlay(test, predictions, Display(unit="m/s²")).figure()
    (band, _) = [t for t in figure.data if t.fill == "toself"]  # and that of whole curves
    half = band.x.size // 2
    lower, upper = band.y[:half], band.y[half:][::-1]
    np.testing.assert_array_equal(band.x[:half], band.x[half:][::-1])
    accel = np.interp(band.x[:half], GRID_S * 1e3, predictions["fused"].accel_mps2)
    np.testing.assert_allclose(lower, accel - 47.5, atol=1e-3)
    np.testing.assert_allclose(upper, accel + 47.5, atol=1e-3)


def test_each_curve_has_one_point_a_sample_and_bands_fewer(test: CrashTest, predictions: Predictions) -> None:
    for curve in plots.motion(test, predictions).figure().data:
        assert curve.x.size == curve.y.size
        assert curve.x.size < N_SAMPLES if curve.hoverinfo == "skip" else curve.x.size == N_SAMPLES
        end = pytest.approx(60 if curve.name == WHOLE else 100, abs=0.1)
        assert (np.nanmin(curve.x), np.nanmax(curve.x)) == (0, end)


def test_velocity_and_displacement_are_those_of_the_closed_form(test: CrashTest, predictions: Predictions) -> None:
    """A half sine that stops the car and throws it back at a tenth of v0: v(t) = v0 (0.45 + 0.55 cos(π t / T))."""
    v0 = test.condition.speed_mps
    figure = plots.motion(test, predictions).figure()
    duration = 0.07 * test.condition.mass_kg / 1700
    time = np.minimum(GRID_S, duration)
    velocity = v0 * (0.45 + 0.55 * np.cos(np.pi * time / duration))
    moved = v0 * (0.45 * time + 0.55 * duration / np.pi * np.sin(np.pi * time / duration)) - 0.1 * v0 * (GRID_S - time)
    np.testing.assert_allclose(trace(figure, "Test", 2).y, velocity / MPH, atol=0.02)
    np.testing.assert_allclose(trace(figure, "Test", 3).y, moved * 1000, atol=0.5)


def test_a_further_pulse_moves_at_its_own_speed(campaign: Campaign, predictions: Predictions) -> None:
    """A test at 35 mph beside one at 25: its velocity begins at 35 mph, its displacement ends where its own does."""
    test, other = campaign.test("T2"), campaign.test("T4")
    beside = {"T4 · 35 mph": Prediction(other.condition, other.pulse.accel_mps2)}
    figure = plots.motion(test, {**predictions, **beside}).figure()
    assert trace(figure, "T4 · 35 mph", 2).y[0] == pytest.approx(other.condition.speed_mps / MPH)
    own = other.pulse.kinematics(other.condition.speed_mps)
    assert trace(figure, "T4 · 35 mph", 3).y[-1] == pytest.approx(own.displacement_m[-1] * 1000)
    assert trace(figure, "CAE", 2).y[0] == pytest.approx(test.condition.speed_mps / MPH)


def test_the_cursor_tells_a_v_and_s_of_a_curve_together(test: CrashTest, predictions: Predictions) -> None:
    """Where the acceleration is, with the ends of the filled band; numbers have a minus sign, not a hyphen."""
    figure = plots.motion(test, predictions).figure()
    accel = trace(figure, "CAE")
    told = np.array([text.replace("\N{MINUS SIGN}", "-").split(" mph, ") for text in accel.customdata], float)
    np.testing.assert_array_equal(told[:, 0], np.round(trace(figure, "CAE", 2).y.astype(float), 1))
    np.testing.assert_array_equal(told[:, 1], np.round(trace(figure, "CAE", 3).y))
    assert told.min() < 0
    assert accel.hovertemplate == "%{y} g, %{customdata} mm"
    assert "-" not in "".join(accel.customdata)
    assert ":" not in accel.hovertemplate  # the formats of templates know hyphens only
    assert trace(figure, "CAE", 2).hoverinfo == "none"
    figure = plots.motion(test, predictions, filled="fused").figure()
    (banded,) = [own for own in figure.data if own.hovertemplate == "%{y} [%{customdata} mm"]
    assert banded.legendgroup == "fused"
    prediction = predictions["fused"]
    assert prediction.draws_mps2 is not None
    ends = np.quantile(prediction.draws_mps2[:, 400] / G, [0.025, 0.975])
    said, rest = banded.customdata[400].replace("\N{MINUS SIGN}", "-").split("] g, ")
    assert [float(end) for end in said.split(", ")] == pytest.approx(ends, abs=0.06)
    below = [own.y[400] for own in figure.data if own.legendgroup == banded.legendgroup and own.hoverinfo == "none"]
    assert rest == f"{below[0]:.1f} mph, {below[1]:.0f}"


def test_the_library_band_shows_its_quantiles(campaign: Campaign) -> None:
    """Of 101 constant pulses of 0 to -100 m/s²: -5, -50 and -95; a test without a paired run adds nothing."""
    levels = np.repeat(-np.arange(101.0)[:, None], N_SAMPLES, axis=1).astype(np.float32)
    library = CaeLibrary(tuple(map(str, range(101))), campaign.cae.conditions[:1] * 101, levels)
    band, median = plots.library_band(library, display=Display(unit="m/s²")).figure().data
    assert (band.y.min(), band.y.max(), median.y.max()) == (-95, -5, -50)
    assert band.name == "5–95 % of 101 runs"
    stray = CrashTest("stray", campaign.cae.conditions[0], campaign.tests[0].pulse)
    alone = CaeLibrary(("C",), campaign.cae.conditions[1:2], campaign.cae.accel_mps2[1:2])
    assert len(plots.library_band(alone, by_speed([stray])).figure().data) == 2
    figure = plots.library_band(campaign.cae, by_speed(campaign.tests)).figure()
    assert len(figure.data) == 2 + len(campaign.tests)
    assert figure.data[2].name == f"C20 · {campaign.tests[0].condition.speed_mps / MPH:.1f} mph"


def test_filtered_tests_are_drawn_over_what_was_read(campaign: Campaign) -> None:
    """Two curves a test of one colour: the thin one as read, the named one filtered to the class."""
    plain = plots.measured_pulses(by_speed(campaign.tests)).figure()
    figure = plots.measured_pulses(by_speed(campaign.tests), Display(unit="m/s²"), cfc=180).figure()
    assert (len(plain.data), len(figure.data)) == (4, 8)
    for test in campaign.tests:
        read, filtered = (trace for trace in figure.data if trace.legendgroup == test.id)
        np.testing.assert_allclose(read.y, test.pulse.accel_mps2, rtol=1e-6, atol=1e-6)
        expected = cfc_filter(test.pulse.accel_mps2, cfc=180, dt_s=test.pulse.dt_s)
        np.testing.assert_allclose(filtered.y, expected, rtol=1e-5, atol=1e-3)
        assert read.line.color == filtered.line.color
        assert read.line.width < filtered.line.width
        assert not read.showlegend


def test_a_constant_miss_is_a_horizontal_line_with_its_rms(campaign: Campaign) -> None:
    """A prediction that is 2 g off all the time, with a band of 1 g to either side."""
    test = campaign.tests[1]
    accel = test.pulse.accel_mps2 - 2 * G
    draws = accel + np.linspace(-1, 1, 401)[:, None] * G / 0.95
    figure = plots.residuals(test, {"fused": Prediction(test.condition, accel, draws)}).figure()
    band, _, line = figure.data
    assert line.name == "Fused, RMS 2.0 g"
    np.testing.assert_allclose(line.y, -2.0, atol=1e-4)
    assert (band.y.min(), band.y.max()) == pytest.approx((-3.0, -1.0), abs=1e-4)


def test_corridors_are_5_and_50_percent_of_the_largest_acceleration_wide(campaign: Campaign) -> None:
    pulse = campaign.tests[1].pulse
    drawing = new_drawing(400)
    plots.add_corridors(drawing, pulse, Display(window_ms=40.0))
    outer, inner = (mark.numbers for mark in drawing.marks)
    largest = np.abs(pulse.accel_mps2[GRID_S < 0.04]).max() / G
    for corridor, share in ((outer, 0.5), (inner, 0.05)):
        lower, upper = corridor["lower"], corridor["upper"]
        np.testing.assert_allclose(upper - lower, 2 * share * largest, rtol=1e-4)
        np.testing.assert_allclose((upper + lower) / 2, pulse.accel_mps2[GRID_S < 0.04] / G, atol=1e-4)
        assert corridor["x"].max() == pytest.approx(39.92)


def test_bands_of_velocity_and_displacement_are_those_of_the_integrated_draws(test: CrashTest) -> None:
    """Each draw integrated over all of its samples, then the central 95 % at each point of the band."""
    draws, speed = np.random.default_rng(0).normal(-150, 80, (40, N_SAMPLES)), test.condition.speed_mps
    drawing = plots.motion(None, {"fused": Prediction(test.condition, draws.mean(axis=0), draws)})
    _, _, *bands = [own.numbers for own in drawing.marks if "lower" in own.numbers]
    for band, drawn, unit in zip(bands, motion(draws, speed, DT_S), (MPH, 1e-3), strict=True):
        lower, upper = np.quantile(drawn, [0.025, 0.975], axis=0) / unit
        np.testing.assert_allclose(band["lower"], lower)
        np.testing.assert_allclose(band["upper"], upper)


def test_the_recording_lies_under_its_pulse() -> None:
    raw = replace(channel(scale=-9.80665, unit="m/s²"), time_s=channel().time_s + 0.3)
    source = replace(record(raw, condition=CONDITION), own_time_zero="")
    found = settle(source)
    recorded, pulse = imported_pulse([raw], found, Display(unit="m/s²")).figure().data
    assert recorded.y.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    assert pulse.y.min() == pytest.approx(-PEAK_MPS2, rel=0.01)
    assert recorded.x[recorded.y.argmin()] == pytest.approx(pulse.x[pulse.y.argmin()], abs=0.5)
    flipped, _ = imported_pulse([raw], found, Display(unit="m/s²", deceleration=True)).figure().data
    assert flipped.y.max() == pytest.approx(PEAK_MPS2, rel=1e-3)
    channels = [channel(str(number), scale=2.0) for number in range(12)]
    figure = imported_pulse(channels, None).figure()
    assert len(figure.data) == 8
    assert figure.data[0].x[0] == pytest.approx(1000 * channels[0].time_s[0])
    assert np.abs(figure.data[0].y).max() == pytest.approx(2 * np.abs(channel().values).max(), rel=1e-3)
    assert figure.layout.yaxis.title.text == "As in the file"
