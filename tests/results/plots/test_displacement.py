"""Figures over displacement show crashes whose motion is known in closed form."""

import numpy as np
import plotly.graph_objects as go
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.displacement_domain.approach import measured_bias
from crashfuse.approaches.displacement_domain.bias import BiasPart, BiasPoints, CaeForce
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.results.display import Display
from crashfuse.results.plots import displacement as plots
from crashfuse.results.plots.curves import Predictions, by_speed
from crashfuse.signals.metrics import Metric
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.units import MS, G

S = np.linspace(0.0, 0.5, 51)


@pytest.fixture(scope="module")
def model(campaign: Campaign) -> CaeModel:
    return CaeModel().fit(campaign.cae)


@pytest.fixture
def predictions(test: CrashTest) -> Predictions:
    """Constant decelerations: 250 m/s², and 201 draws from 150 to 350 m/s²."""
    draws = np.repeat(-np.linspace(150.0, 350.0, 201)[:, None], GRID_S.size, axis=1)
    return {
        "cae": Prediction(test.condition, np.full(GRID_S.size, -200.0)),
        "displacement_domain": Prediction(test.condition, np.full(GRID_S.size, -250.0), draws),
    }


def motion(test: CrashTest) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, displacement and acceleration of a test: v(t) = v0 (0.45 + 0.55 cos(π t / T)), up to where it stops."""
    v0, duration = test.condition.speed_mps, 70 * MS * test.condition.mass_kg / 1700
    time = np.linspace(0, duration * np.arccos(-0.45 / 0.55) / np.pi, 2001)
    displacement = v0 * (0.45 * time + 0.55 * duration / np.pi * np.sin(np.pi * time / duration))
    return time, displacement, -0.55 * v0 * np.pi / duration * np.sin(np.pi * time / duration)


def trace(figure: go.Figure, name: str, axis: str = "y") -> go.Scatter:
    wanted = name, "lines", None, axis
    (found,) = [t for t in figure.data if (t.name, t.mode, t.fill, t.yaxis or "y") == wanted]
    return found


def band(figure: go.Figure) -> tuple[FloatArray, FloatArray, FloatArray]:
    (found,) = [t for t in figure.data if t.fill == "toself"]
    n = len(found.x) // 2
    return found.x[:n], found.y[:n], found.y[n:][::-1]


def test_a_half_sine_over_displacement_is_that_of_the_closed_form(test: CrashTest, predictions: Predictions) -> None:
    curve = trace(plots.over_displacement(test, predictions).figure(), "Test")
    _, displacement, accel = motion(test)
    np.testing.assert_allclose(curve.y, np.interp(curve.x / 1000, displacement, accel) / G, atol=0.05)
    assert curve.x[-1] == pytest.approx(displacement[-1] * 1000, abs=0.1)


def test_every_curve_holds_the_same_energy(test: CrashTest, predictions: Predictions) -> None:
    speed = test.condition.speed_mps
    figure = plots.over_displacement(test, predictions, Display(unit="m/s²", deceleration=True)).figure()
    for name in ("Test", "CAE", "Displacement domain"):
        curve = trace(figure, name)
        x, y = curve.x.astype(float) / 1000, curve.y.astype(float)
        assert np.sum(np.diff(x) * (y[1:] + y[:-1]) / 2) == pytest.approx(0.5 * speed**2, rel=1e-3)


def test_the_band_holds_95_percent_of_the_draws_that_get_so_far(test: CrashTest, predictions: Predictions) -> None:
    """From 155 to 345 m/s² until the hardest have stopped, after v0² / 2a, and no further than half of them get."""
    energy = 0.5 * test.condition.speed_mps**2
    figure = plots.over_displacement(None, predictions, Display(unit="m/s²")).figure()
    x, lower, upper = band(figure)
    early = x < 1000 * energy / 350
    np.testing.assert_allclose(lower[early], -345, rtol=1e-5)
    np.testing.assert_allclose(upper[early], -155, rtol=1e-5)
    assert lower[-1] > -255  # those that brake harder have stopped
    assert x[-1] == pytest.approx(1000 * energy / 250, abs=4.5)


def test_the_mark_is_the_maximum_crush_with_the_interval_of_the_tables(
    test: CrashTest, predictions: Predictions
) -> None:
    """v0² / 2a at 250 m/s²; an end that the record leaves open has no bar, a vehicle that never stops no mark."""
    crush = 1000 * 0.5 * test.condition.speed_mps**2 / 250
    low, high = crush - 30, crush + 40
    for upper, bar, told in ((high, 40, f"[{low:.1f}, {high:.1f}]"), (None, None, f"[≥ {low:.1f}]")):
        known = {"displacement_domain": Metric("max_crush", crush, low, upper, "mm")}
        figure = plots.over_displacement(None, predictions, crush=known).figure()
        (mark,) = [t for t in figure.data if t.mode == "markers" and t.legendgroup == "displacement_domain"]
        assert mark.x[0] == pytest.approx(crush, rel=1e-4)
        assert mark.error_x.arrayminus[0] == pytest.approx(30, abs=0.1)
        assert mark.error_x.array[0] == (bar if bar is None else pytest.approx(bar, abs=0.1))
        assert mark.name == f"Maximum crush {crush:.1f} {told} mm"
    gentle = Prediction(test.condition, np.full(GRID_S.size, -10.0))
    figure = plots.over_displacement(None, {"cae": gentle}).figure()
    assert [t.name for t in figure.data] == ["CAE"]


def test_the_bias_added_to_the_cae_model_is_the_test(campaign: Campaign, model: CaeModel) -> None:
    biases = {test.id: measured_bias(test, model) for test in campaign.tests}
    display = Display(unit="m/s²", deceleration=True)
    figure = plots.bias_by_speed(by_speed(campaign.tests), biases, display).figure()
    for test, bias, curve in zip(campaign.tests, biases.values(), figure.data, strict=True):
        _, displacement, accel = motion(test)
        expected = np.interp(curve.x / 1000, displacement, accel)
        np.testing.assert_allclose(bias.cae.accel_mps2 - curve.y, expected, atol=0.01 * np.abs(accel).max())
        assert curve.x[-1] == pytest.approx(displacement[-1] * 1000, abs=0.1)


def test_the_way_over_displacement_gives_the_closed_form(test: CrashTest, predictions: Predictions) -> None:
    """Line and circles are the displacement of the closed form, and their difference is below 0.1 mm."""
    figure = plots.integration_check(test, predictions).figure()
    time, displacement, _ = motion(test)
    circles = next(t for t in figure.data if t.name == "Eq. 29" and t.legendgroup == "test")
    for shown in (trace(figure, "Test"), circles):
        np.testing.assert_allclose(shown.y, np.interp(shown.x * MS, time, displacement) * 1000, atol=0.1)
    for name in ("Test", "CAE", "Displacement domain"):
        assert np.abs(trace(figure, f"{name}, difference", "y2").y).max() < 0.1


def part(name: str, level: float) -> BiasPart:
    """A part that is the same everywhere, give or take 1 m/s²."""
    mean = np.full(S.size, level)
    return BiasPart(name, mean, mean - 1, mean + 1)


def test_the_parts_stand_below_their_total(test: CrashTest) -> None:
    parts = [part("shared", -3.0), part("by speed", 2.0), part("own", 0.0), part("total", -1.0)]
    measured = BiasPoints(test.condition, S, np.linspace(1, 0, S.size), CaeForce(0 * S, 0 * S), np.full(S.size, -2.0))
    figure = plots.bias_parts(parts, S, measured, Display(unit="m/s²")).figure()
    expected = [t for t in figure.data if t.name == "Expected"]
    assert [t.y[0] for t in expected] == [-1, -3, 2, 0]
    assert len({t.xaxis for t in expected}) == 4
    limits = [(t.y.min(), t.y.max()) for t in figure.data if t.fill == "toself"]
    assert limits == [(-2, 0), (-4, -2), (1, 3), (-1, 1)]
    assert trace(figure, "Measured in this test").xaxis == expected[0].xaxis
    assert [a.text for a in figure.layout.annotations][1:] == ["Shared", "By speed", "The test's own"]


def test_energy_over_crush_is_in_kilojoules_up_to_all(test: CrashTest, predictions: Predictions) -> None:
    """Constant braking: m a s, a straight line to ½ m v0² at v0²/2a; the test ends at the same energy."""
    speed, mass = test.condition.speed_mps, test.condition.mass_kg
    figure = plots.energy_over_crush(test, predictions).figure()
    cae = trace(figure, "CAE")
    np.testing.assert_allclose(cae.y, mass * 200.0 * np.asarray(cae.x, dtype=float) / 1e6, rtol=1e-3, atol=0.05)
    assert cae.x[-1] == pytest.approx(1000 * speed**2 / 400, rel=1e-3)
    for name in ("CAE", "Test", "Displacement domain"):
        assert trace(figure, name).y[-1] == pytest.approx(mass * speed**2 / 2000, rel=1e-3)
    assert figure.layout.yaxis.title.text == "Absorbed energy (kJ)"


def test_a_further_pulse_absorbs_the_energy_of_its_own_crash(
    campaign: Campaign, test: CrashTest, predictions: Predictions
) -> None:
    """½ m v0² of a faster, heavier crash, up to its own maximum crush."""
    other = campaign.test("T4")
    beside = {"T4": Prediction(other.condition, other.pulse.accel_mps2)}
    figure = plots.energy_over_crush(test, {**predictions, **beside}).figure()
    energy = other.condition.mass_kg * other.condition.speed_mps**2 / 2000
    assert trace(figure, "T4").y[-1] == pytest.approx(energy, rel=1e-3)
    crush = other.pulse.kinematics(other.condition.speed_mps).displacement_m.max()
    over = plots.over_displacement(test, {**predictions, **beside}).figure()
    assert trace(over, "T4").x[-1] == pytest.approx(1000 * crush, rel=1e-3)
