"""The figure of a sweep shows each number where it belongs, and nothing where there is none."""

import numpy as np
import pytest
from plotly.graph_objects import Figure, Scatter

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.reporting.plots.palette import COLOURS
from crashfuse.reporting.plots.sweep import sweep_figure
from crashfuse.signals.metrics import Metric
from crashfuse.study.sweep import Sweep
from crashfuse.units import LB, MPH

SPEEDS_MPH = np.array([10.0, 20.0, 30.0, 40.0, 50.0])
VALUES = (None, 20.0, 30.0, None, 50.0)
LOWER = (8.0, 18.0, 28.0, None, 45.0)
UPPER = (12.0, 22.0, 32.0, None, None)


def _sweep(approach: str, *, band: bool) -> Sweep:
    """An OLC that is missing here and there."""
    none = (None,) * len(VALUES)
    ends = zip(VALUES, LOWER if band else none, UPPER if band else none, strict=True)
    metrics = tuple((Metric("olc", value, lower, upper, "g"),) for value, lower, upper in ends)
    return Sweep(approach, Condition.of_vector([1.0, 2050 * LB, 1500 * LB]), SPEEDS_MPH * MPH, metrics)


@pytest.fixture
def figure(campaign: Campaign) -> Figure:
    """The raw CAE without a band, and fused with one."""
    return sweep_figure([_sweep("cae", band=False), _sweep("fused", band=True)], "olc", campaign)


def _lines(figure: Figure) -> dict[str, Scatter]:
    return {trace.legendgroup: trace for trace in figure.data if trace.mode == "lines+markers"}


def test_missing_numbers_leave_gaps(figure: Figure) -> None:
    """Neither a zero nor a line across; one outline of the band from 10 to 30 mph, none beyond or without."""
    line = _lines(figure)["fused"]
    np.testing.assert_allclose(line.x, SPEEDS_MPH)
    np.testing.assert_array_equal(line.y, [np.nan, 20, 30, np.nan, 50])
    assert line.connectgaps is False
    assert line.line.color == COLOURS["fused"]
    (band,) = [trace for trace in figure.data if trace.fill == "toself"]
    np.testing.assert_allclose(band.x, [10, 20, 30, 30, 20, 10])
    np.testing.assert_allclose(band.y, [8, 18, 28, 32, 22, 12])
    assert band.legendgroup == "band of fused"
    assert band.fillcolor == "rgba(0, 158, 115, 0.18)"


def test_the_cursor_reads_the_speed_and_the_interval(figure: Figure) -> None:
    """Of an open interval the known end is told."""
    texts = _lines(figure)["fused"].customdata
    assert list(texts[1]) == ["20.0 mph", "20.0 [18.0, 22.0] g"]
    assert list(texts[4]) == ["50.0 mph", "50.0 [≥ 45.0] g"]


def test_tests_are_black_points_with_their_id_and_weights(campaign: Campaign, figure: Figure) -> None:
    """At its speed and measured value, with a tick at the foot; shaded is what lies beyond the library."""
    (points,) = [trace for trace in figure.data if trace.mode == "markers"]
    np.testing.assert_allclose(points.x, [15, 25, 26, 35])
    assert points.marker.color == "#000000"
    test_id, condition, _ = points.customdata[1]
    assert (test_id, condition) == ("T2", "25.0 mph, front 2040 lb, rear 1500 lb")
    assert "own weights" in points.name
    assert len(points.y) == len(campaign.tests)
    shaded = [shape for shape in figure.layout.shapes if shape.type == "rect"]
    fastest = campaign.cae.vectors[:, 0].max() / MPH
    assert shaded[-1].x0 == pytest.approx(fastest)
    assert shaded[-1].x1 >= 50
    assert [shape.showlegend for shape in shaded].count(True) == 1
    ticks = [shape for shape in figure.layout.shapes if shape.type == "line"]
    np.testing.assert_allclose([tick.x0 for tick in ticks], [15, 25, 26, 35])
    assert max(tick.y1 for tick in ticks) < 0.1
