"""What a figure shows comes out as numbers: exactly the visible curves and bands, in the figure's units."""

import copy
import io

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.display import Display
from crashfuse.results.drawing import Drawing, drawing_table, figure_table
from crashfuse.results.plots.canvas import new_drawing
from crashfuse.results.plots.curves import WHOLE, Predictions
from crashfuse.results.plots.displacement import over_displacement
from crashfuse.results.plots.pulses import add_corridors, motion, overlay
from crashfuse.results.plots.ratings import rated_curves, rating_heatmap, rating_spread
from crashfuse.results.result_tables import pulses_table
from crashfuse.signals.metrics import Metric
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, Pulse, kinematics
from crashfuse.signals.rating_explanation import explain_rating
from crashfuse.study.estimate import Estimate
from crashfuse.units import MPH, MS, G


def table(drawing: Drawing, hidden: tuple[int, ...] = ()) -> pd.DataFrame:
    """The numbers of a drawing, written as CSV and read by pandas."""
    return pd.read_csv(io.BytesIO(csv_bytes(drawing_table(drawing, hidden))))


def test_curves_over_time_stand_side_by_side_in_the_units_of_the_figure(
    test: CrashTest, predictions: Predictions
) -> None:
    """One row a sample; test, approaches and the ends of the band are what the library holds, scaled by hand."""
    shown = table(motion(test, predictions, Display(unit="m/s²", deceleration=True)))
    assert len(shown) == N_SAMPLES
    np.testing.assert_allclose(shown["Time (ms)"], GRID_S / MS, rtol=1e-5)
    np.testing.assert_allclose(shown["Test: Deceleration (m/s²)"], -test.pulse.accel_mps2, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(shown["CAE: Deceleration (m/s²)"], -predictions["cae"].accel_mps2, rtol=1e-5, atol=1e-6)
    moved = test.pulse.kinematics(test.condition.speed_mps)
    np.testing.assert_allclose(shown["Test: Velocity (mph)"], moved.velocity_mps / MPH, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(shown["Test: Displacement (mm)"], moved.displacement_m / MS, rtol=1e-5, atol=1e-6)


@given(st.integers(2, 60), st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_table_of_a_drawing_is_its_data(campaign: Campaign, draws: int, seed: int) -> None:
    """Whatever was drawn, page and report give the digits of pulses.csv: expected pulse and both ends of the band."""
    test = campaign.test("T2")
    drawn = np.random.default_rng(seed).normal(-150.0, 80.0, (draws, N_SAMPLES))
    prediction = Prediction(test.condition, drawn.mean(axis=0), drawn)
    shown = drawing_table(motion(test, {"fused": prediction}))
    names = [f"Fused: Acceleration{end} (g)" for end in ("", ", lower", ", upper")]
    whole = [f"Fused, {WHOLE}: Acceleration, {end} (g)" for end in ("lower", "upper")]
    written = pulses_table([Estimate(**vars(prediction), approach="fused")])
    np.testing.assert_allclose(shown[whole][:750], written[["whole_lower_g", "whole_upper_g"]][:750])
    assert shown[whole][750:].isna().all(axis=None)
    both = shown[["Time (ms)", *names]], written[["time_ms", "acceleration_g", "lower_g", "upper_g"]]
    one, other = (csv_bytes(own).splitlines()[1:] for own in both)
    assert one == other


def test_of_plots_above_each_other_the_table_says_which_is_meant(test: CrashTest) -> None:
    later = Pulse(test.pulse.time_s, np.roll(test.pulse.accel_mps2, 20))
    shown = table(rated_curves(explain_rating(test.pulse, later), "fused"))
    curves = shown[shown["Curve"] == "Fused"]
    parts = [plot.partition(" ")[0] for plot in dict.fromkeys(curves["Plot"])]
    assert parts == ["Corridor", "Phase", "Magnitude", "Slope"]


def test_what_is_hidden_is_not_in_the_table(test: CrashTest, predictions: Predictions) -> None:
    """By the reader, with a click in the legend, or by whoever drew it; corridors count once they are added."""
    drawing = overlay(test, predictions)
    places = [place for place, mark in enumerate(drawing.marks) if mark.look.get("legendgroup") == "cae"]
    assert any(name.startswith("CAE") for name in table(drawing))
    assert not any(name.startswith("CAE") for name in table(drawing, tuple(places)))
    figure = drawing.figure()
    figure.for_each_trace(lambda own: own.update(visible="legendonly") if "fused" in own.legendgroup else None)
    assert set(figure_table(figure)) == {"Time (ms)", "CAE: Acceleration (g)", "Test: Acceleration (g)"}
    drawing = overlay(test, {})
    add_corridors(drawing, test.pulse)
    corridors = table(drawing)
    half = 0.05 * np.abs(test.pulse.accel_mps2[GRID_S < 60 * MS]).max() / G
    inner = [name for name in corridors if "inner" in name]
    known = corridors[inner[0]].notna()
    np.testing.assert_allclose(corridors[inner[1]][known] - corridors[inner[0]][known], 2 * half, rtol=1e-4)


def test_curves_with_positions_of_their_own_stand_below_each_other(test: CrashTest, predictions: Predictions) -> None:
    interval = {"fused": Metric("max_crush", 500.0, 100.0, None, "mm")}
    shown = table(over_displacement(test, predictions, crush=interval))
    assert set(shown["Curve"]) > {"Test", "CAE", "Fused"}
    own = shown[shown["Curve"] == "CAE"]
    travelled = predictions["cae"]
    motion_of = kinematics(travelled.accel_mps2, test.condition.speed_mps, DT_S)
    loading = motion_of.velocity_mps > 0
    at_mm, accel_g = motion_of.displacement_m[loading] / MS, travelled.accel_mps2[loading] / G
    expected = np.interp(own["Displacement (mm)"], at_mm, accel_g)
    np.testing.assert_allclose(own["Acceleration (g)"], expected, atol=0.05)
    (crush,) = shown[shown["Curve"].str.startswith("Fused: Maximum crush")].to_dict("records")
    assert crush["Displacement, lower (mm)"] == pytest.approx(100.0, rel=1e-5)
    assert np.isnan(crush["Displacement, upper (mm)"])  # left open


def test_points_with_intervals_and_cells_of_a_heat_map() -> None:
    spread = table(rating_spread({"T1": {"cae": (0.7, 0.6, 0.75)}, "T2": {"cae": (0.8, 0.75, 0.9)}}))
    assert spread.iloc[:, :2].to_numpy().tolist() == [["CAE", "T1"], ["CAE", "T2"]]
    np.testing.assert_allclose(spread.iloc[1, 2:].to_numpy(float), [0.8, 0.75, 0.9], rtol=1e-6)
    cells = table(rating_heatmap({"T1": {"cae": 0.7, "fused": 0.9}, "T2": {"cae": 0.5, "fused": 0.8}}))
    assert list(cells)[1:] == ["CAE", "Fused"]
    assert cells.iloc[:, 0].tolist() == ["Test T1", "Test T2", "Mean"]
    np.testing.assert_allclose(cells["Fused"], [0.9, 0.8, 0.85], rtol=1e-6)


def test_a_copy_has_the_numbers_and_a_figure_from_elsewhere_has_none(test: CrashTest) -> None:
    figure = overlay(test, {}).figure()
    pd.testing.assert_frame_equal(figure_table(copy.deepcopy(figure)), figure_table(figure))
    with pytest.raises(UsageError, match="was not drawn by"):
        figure_table(go.Figure(figure))


def test_a_name_is_no_formula() -> None:
    drawing = new_drawing(300)
    drawing.line([0.0, 1.0], [2.0, 3.0], name="=cmd|x")
    drawing.axis("y", "Acceleration", "g")
    assert csv_bytes(drawing_table(drawing)).startswith(b"Time (ms),'=cmd|x: Acceleration (g)\n")
