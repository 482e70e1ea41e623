"""The figure of the condition space shows every test where it is, and says which lie outside the CAE runs."""

import numpy as np
import plotly.graph_objects as go
import pytest

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.reporting.plots.conditions import condition_space
from crashfuse.units import LB, MPH

INSIDE, OUTSIDE = "Tests", "Tests outside it: extrapolation"


def traces(figure: go.Figure, group: str) -> list[go.Scatter]:
    """The traces of this kind, front weight first."""
    return [trace for trace in figure.data if trace.legendgroup == group]


def test_tests_stand_at_their_speeds_and_weights(campaign: Campaign) -> None:
    """In mph and lb, each under its id, against front weight and against rear weight."""
    figure = condition_space(campaign.cae, campaign.tests)
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
    figure = condition_space(campaign.cae, [campaign.tests[1], test])
    (open_mark,) = traces(figure, OUTSIDE)
    assert (open_mark.yaxis, list(open_mark.text)) == (outside, ["far"])
    assert (open_mark.showlegend, open_mark.marker.symbol) == (True, "circle-open")
    assert "Extrapolation: " in open_mark.customdata[0][0]
    assert {mark.yaxis: list(mark.text) for mark in traces(figure, INSIDE)} == {outside: ["T2"], inside: ["T2", "far"]}


@pytest.mark.slow
def test_a_large_library_is_thinned_but_counted_whole(campaign: Campaign) -> None:
    """30,000 points would only slow the browser down; the range stays that of all runs."""
    vectors = np.random.default_rng(0).uniform([0, 900, 600], [16, 1000, 800], (30_000, 3))
    conditions = tuple(Condition.of_vector(row) for row in vectors)
    accel = np.zeros((len(conditions), 1), dtype=np.float32)
    library = CaeLibrary(tuple(map(str, range(len(conditions)))), conditions, accel)
    figure = condition_space(library, campaign.tests)
    runs, _ = traces(figure, "runs")
    assert runs.name == "30,000 CAE runs"
    assert len(runs.x) <= 2000
    box, _ = traces(figure, "range")
    np.testing.assert_allclose(max(box.y), vectors[:, 1].max() / LB, rtol=1e-6)
