"""Figures as pages send them: what the eye sees is that of the library, and nothing makes Plotly draw it twice."""

import json
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from crashfuse import Campaign
from crashfuse.reporting.plots.canvas import add_band, add_line, new_figure
from crashfuse.reporting.plots.pulses import motion
from crashfuse.ui.sent_figure import SentFigure


def sent(figure: go.Figure) -> dict[str, Any]:
    """What the browser gets."""
    drawn: dict[str, Any] = json.loads(SentFigure(figure).to_json())
    return drawn


def test_curves_are_those_of_the_figure_to_a_twenty_thousandth_of_their_largest_value(campaign: Campaign) -> None:
    """Plain numbers, evenly spaced positions as a first one and a step, the same titles of axes and names."""
    figure = campaign.plot()
    drawn = sent(figure)
    assert "bdata" not in json.dumps(drawn)
    for curve, own in zip(figure.data, drawn["data"], strict=True):
        at = own["x0"] + own["dx"] * np.arange(len(own["y"]))
        np.testing.assert_allclose(at, curve.x, atol=1e-4)
        np.testing.assert_allclose(own["y"], curve.y, atol=5e-5 * np.abs(curve.y).max())
        assert own["name"] == curve.name
    assert drawn["layout"]["xaxis"]["title"] == {"text": "Time (ms)", "font": {"size": 14}}


def test_a_smooth_curve_that_the_cursor_does_not_read_is_sent_through_fewer_points(campaign: Campaign) -> None:
    """Velocity and displacement under an acceleration: the lines between the points lie on the curve, ends included."""
    test = campaign.tests[0]
    figure = motion(test.pulse, {}, test.condition.speed_mps)
    for curve, own in zip(figure.data, sent(figure)["data"], strict=True):
        assert (len(own["y"]) < len(curve.y) / 3) == (curve.hoverinfo == "none")
        if "x" in own:
            np.testing.assert_allclose(np.interp(curve.x, own["x"], own["y"]), curve.y, atol=2e-4 * np.ptp(curve.y))
            assert own["x"][-1] == pytest.approx(curve.x[-1], abs=1e-3)


def test_a_curve_that_fewer_points_would_cut_is_sent_whole() -> None:
    """Though the cursor does not read it."""
    figure, at = new_figure(400), np.arange(1000.0)
    add_line(figure, at, at % 7, hoverinfo="none", hovertemplate=None)
    (own,) = sent(figure)["data"]
    assert own["y"] == (at % 7).tolist()


def test_a_gap_in_a_band_stays_a_gap() -> None:
    """What is unknown is no number, and the positions of an outline are kept as they are."""
    figure, at = new_figure(400), np.arange(5.0)
    add_band(figure, at, np.array([0, 1, np.nan, 1, 0]), at + 3, colour="#000000")
    (band,) = sent(figure)["data"]
    assert band["x"] == [0, 1, 1, 0, None, 3, 4, 4, 3]
    assert band["y"] == [0, 1, 4, 3, None, 1, 0, 7, 6]


def test_a_revision_stands_for_the_data(campaign: Campaign) -> None:
    """The same data, the same revision; one value changed, another."""
    other = campaign.plot()
    other.data[0].y = other.data[0].y + 0.5
    revisions = [sent(figure)["layout"]["datarevision"] for figure in (campaign.plot(), campaign.plot(), other)]
    assert revisions[0] == revisions[1] != revisions[2]


def test_many_names_have_room_above_the_figure() -> None:
    """Two rows where one does not suffice; a figure that needs more keeps what it has."""
    few, many, roomy = (new_figure(400) for _ in range(3))
    for figure, count in ((few, 3), (many, 12), (roomy, 3)):
        for number in range(count):
            figure.add_scatter(x=[0, 1], y=[0, 1], name=f"T{number} · 35.2 mph")
    roomy.update_layout(margin_t=96)
    few_px, many_px, roomy_px = (sent(figure)["layout"]["margin"]["t"] for figure in (few, many, roomy))
    assert (few_px, many_px, roomy_px) == (44, 65, 96)
