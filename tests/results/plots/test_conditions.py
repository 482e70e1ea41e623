"""Figures over conditions: the space of runs and tests, and the sweep over speed."""

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.graph_objects import Figure

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.results.plots.conditions import condition_space
from crashfuse.results.plots.palette import COLOURS
from crashfuse.signals.metrics import Metric
from crashfuse.study.planning import SpeedSweep
from crashfuse.units import LB, MPH

INSIDE, OUTSIDE = "Tests", "Tests outside it: extrapolation"


def traces(figure: go.Figure, group: str) -> list[go.Scatter]:
    return [trace for trace in figure.data if trace.legendgroup == group]


def test_tests_stand_at_their_speeds_and_weights(campaign: Campaign) -> None:
    figure = condition_space(campaign.cae, campaign.tests).figure()
    front, rear = traces(figure, INSIDE)
    assert list(front.text) == list(rear.text) == ["T1", "T2", "T3", "T4"]
    np.testing.assert_allclose(front.x[:3], [15, 25, 26], rtol=1e-6)
    np.testing.assert_allclose(front.y[:3], [2000, 2040, 2080], rtol=1e-6)
    np.testing.assert_allclose(rear.y[:3], [1450, 1500, 1550], rtol=1e-6)
    assert front.marker.symbol == "circle"
    assert not traces(figure, OUTSIDE)


@pytest.mark.parametrize(
    ("front_lb", "rear_lb", "outside", "inside"), [(2400, 1500, "y", "y2"), (2040, 1900, "y2", "y")]
)
def test_a_test_is_drawn_open_only_over_the_weight_that_lies_outside(
    campaign: Campaign, front_lb: float, rear_lb: float, outside: str, inside: str
) -> None:
    """Inside the other box it is drawn as any test inside; the legend names the open mark, in whichever plot it is."""
    condition = Condition.of_vector([25 * MPH, front_lb * LB, rear_lb * LB])
    test = CrashTest("far", condition, campaign.tests[0].pulse)
    figure = condition_space(campaign.cae, [campaign.tests[1], test]).figure()
    (open_mark,) = traces(figure, OUTSIDE)
    assert (open_mark.yaxis, list(open_mark.text)) == (outside, ["far"])
    assert (open_mark.showlegend, open_mark.marker.symbol) == (True, "circle-open")
    assert "<b>Test far</b><br>" in open_mark.hovertext[0]
    assert "Extrapolation: " in open_mark.hovertext[0]
    assert {mark.yaxis: list(mark.text) for mark in traces(figure, INSIDE)} == {outside: ["T2"], inside: ["T2", "far"]}


@pytest.mark.slow
def test_a_large_library_is_thinned_but_counted_whole(campaign: Campaign) -> None:
    """30,000 points would only slow the browser down; the range stays that of all runs."""
    vectors = np.random.default_rng(0).uniform([0, 900, 600], [16, 1000, 800], (30_000, 3))
    conditions = tuple(Condition.of_vector(row) for row in vectors)
    accel = np.zeros((len(conditions), 1), dtype=np.float32)
    library = CaeLibrary(tuple(map(str, range(len(conditions)))), conditions, accel)
    figure = condition_space(library, campaign.tests).figure()
    runs, _ = traces(figure, "runs")
    assert runs.name == "30,000 CAE runs"
    assert len(runs.x) <= 2000
    box, _ = traces(figure, "range")
    np.testing.assert_allclose(max(box.y), vectors[:, 1].max() / LB, rtol=1e-6)


SPEEDS_MPH = np.array([10.0, 20.0, 30.0, 40.0, 50.0])
VALUES = (None, 20.0, 30.0, None, 50.0)
LOWER = (8.0, 18.0, 28.0, None, 45.0)
UPPER = (12.0, 22.0, 32.0, None, None)


@pytest.fixture
def figure(campaign: Campaign) -> Figure:
    """The raw CAE model without a band, the fused approach with one."""
    metrics = {
        "cae": tuple((Metric("olc", value, None, None, "g"),) for value in VALUES),
        "fused": tuple((Metric("olc", *ends, "g"),) for ends in zip(VALUES, LOWER, UPPER, strict=True)),
    }
    condition = Condition.of_vector([1.0, 2050 * LB, 1500 * LB])
    return SpeedSweep(campaign, condition, SPEEDS_MPH * MPH, metrics).plot("olc")


def test_missing_numbers_leave_gaps_and_the_cursor_reads_the_interval(figure: Figure) -> None:
    """Neither a zero nor a line across; one outline of the band from 10 to 30 mph, none beyond or without."""
    (line,) = [own for own in figure.data if own.mode == "lines+markers" and own.legendgroup == "fused"]
    np.testing.assert_allclose(line.x, SPEEDS_MPH)
    np.testing.assert_array_equal(line.y, [np.nan, 20, 30, np.nan, 50])
    assert line.connectgaps is False
    assert line.line.color == COLOURS["fused"]
    (band,) = [trace for trace in figure.data if trace.fill == "toself"]
    np.testing.assert_allclose(band.x, [10, 20, 30, 30, 20, 10])
    np.testing.assert_allclose(band.y, [8, 18, 28, 32, 22, 12])
    assert band.legendgroup == "band of fused"
    assert band.fillcolor == "rgba(0, 158, 115, 0.18)"
    assert line.hovertext[1] == "<b>Fused</b><br>20.0 mph<br>20.0 [18.0, 22.0] g"
    assert line.hovertext[4] == "<b>Fused</b><br>50.0 mph<br>50.0 [≥ 45.0] g"


def test_tests_are_black_points_with_their_id_and_weights(campaign: Campaign, figure: Figure) -> None:
    """At its speed and measured value, with a tick at the foot; shaded is what lies beyond the library."""
    (points,) = [trace for trace in figure.data if trace.mode == "markers"]
    np.testing.assert_allclose(points.x, [15, 25, 26, 35])
    assert points.marker.color == "#000000"
    assert points.hovertext[1].startswith("<b>Test T2</b><br>25.0 mph, front 2040 lb, rear 1500 lb<br>")
    assert "own weights" in points.name
    assert len(points.y) == len(campaign.tests)
    shaded = [shape for shape in figure.layout.shapes if shape.type == "rect"]
    assert shaded[-1].x0 == pytest.approx(campaign.cae.vectors[:, 0].max() / MPH)
    assert shaded[-1].x1 >= 50
    assert [shape.showlegend for shape in shaded].count(True) == 1
    ticks = [shape for shape in figure.layout.shapes if shape.type == "line"]
    np.testing.assert_allclose([tick.x0 for tick in ticks], [15, 25, 26, 35])
    assert max(tick.y1 for tick in ticks) < 0.1
