"""Figures of ratings show their grades, that of calibration what bands promise against what they held."""

import numpy as np
import pytest

from crashfuse.results.display import Display
from crashfuse.results.plots import ratings as plots
from crashfuse.results.plots.palette import GRADE_COLOURS
from crashfuse.results.plots.ratings import rated_curves, rating_parts
from crashfuse.signals.rating import Rating
from crashfuse.signals.rating_explanation import RatingExplanation, explain_rating
from crashfuse.units import G
from tests.signals.test_rating_explanation import TEST, bump, pulse


def test_the_heat_map_names_every_grade_and_ends_with_the_mean() -> None:
    """Grades and their colours hold above 0.94, 0.80 and 0.58 (ISO/TS 18571), not at them."""
    scores = {"A": {"cae": 0.58, "lf_tcn": 0.81}, "B": {"cae": 0.80, "lf_tcn": 0.95}}
    heat, _ = plots.rating_heatmap(scores).figure().data
    graded = [["0.580 Poor", "0.810 Good"], ["0.800 Fair", "0.950 Excellent"], ["0.690 Fair", "0.880 Good"]]
    assert [list(row) for row in heat.text] == graded
    np.testing.assert_allclose(heat.z[-1], [0.69, 0.88], rtol=1e-6)
    heat, _ = plots.rating_heatmap({"A": {"cae": 0.5}}).figure().data
    spans = {colour: [limit for limit, c in heat.colorscale if c == colour] for _, colour in heat.colorscale}
    assert list(spans.values()) == [[0, 0.58], [0.58, 0.8], [0.8, 0.94], [0.94, 1]]
    assert list(spans) == list(GRADE_COLOURS.values())


def test_every_cell_of_the_heat_map_but_the_mean_can_be_clicked() -> None:
    """An invisible mark in it names its test and approach, is found from anywhere in it, and says which it is."""
    figure = plots.rating_heatmap({"A": {"cae": 0.5, "fused": 0.9}, "B": {"cae": 0.6, "fused": 0.8}}).figure()
    heat, marks = figure.data
    assert list(marks.customdata) == ["A:cae", "A:fused", "B:cae", "B:fused", "", ""]
    assert list(marks.y) == [row for row in heat.y for _ in range(2)]
    assert list(marks.x) == list(heat.x) * 3
    template = "%{hovertext}<extra></extra>"
    assert (figure.layout.hoverdistance, heat.hoverinfo, marks.hovertemplate) == (-1, "skip", template)
    assert marks.hovertext[:2] == ("Test A, CAE: 0.500 Poor", "Test A, Fused: 0.900 Good")


def test_the_spread_of_ratings_reaches_from_the_lowest_to_the_highest_draw() -> None:
    ratings = {"A": {"fused": (0.9, 0.7, 0.95)}, "B": {"fused": (0.8, 0.6, 0.8), "lf_tcn": (0.5, 0.4, 0.6)}}
    figure = plots.rating_spread(ratings).figure()
    network, fused = figure.data
    assert (network.name, fused.name) == ("LF TCN", "Fused")
    assert len(network.x) == 1
    np.testing.assert_allclose(fused.y, [0.9, 0.8])
    np.testing.assert_allclose(fused.error_y.array, [0.05, 0.0], atol=1e-6)
    np.testing.assert_allclose(fused.error_y.arrayminus, [0.2, 0.2], rtol=1e-6)
    assert list(figure.layout.xaxis.ticktext) == ["A", "B"]


def test_levels_run_along_x_and_shares_along_y_in_percent() -> None:
    """Half the time inside the 90 % band is drawn at (90, 50); the diagonal is there to compare."""
    figure = plots.calibration_curves(np.array([0.5, 0.9]), {"fused": np.array([0.4, 0.5])}).figure()
    promised, fused = figure.data
    assert (list(promised.x), list(promised.y)) == ([0, 100], [0, 100])
    np.testing.assert_allclose(fused.x, [50, 90])
    np.testing.assert_allclose(fused.y, [40, 50])
    assert fused.name == "Fused"


@pytest.fixture(scope="module")
def explanation() -> RatingExplanation:
    """Three humps, the third 4 ms late and all of it 10 % too strong."""
    late = 1.1 * (bump(15, 200) + bump(33, 250) + bump(54, 220))
    return explain_rating(pulse(TEST), pulse(late), 70.0)


def test_the_bars_are_the_four_scores_of_each_approach() -> None:
    ratings = {"cae": Rating(0.6, 0.7, 0.3, 0.73, 0.6, "Fair"), "fused": Rating(0.9, 0.9, 1.0, 0.8, 0.75, "Good")}
    raw, fused = rating_parts(ratings).figure().data
    assert list(raw.x) == ["Corridor (40 %)", "Phase (20 %)", "Magnitude (20 %)", "Slope (20 %)"]
    np.testing.assert_allclose(fused.y, [0.9, 1.0, 0.8, 0.75], rtol=1e-6)
    assert list(raw.text) == ["0.70", "0.30", "0.73", "0.60"]


def test_each_row_draws_what_its_score_compares(explanation: RatingExplanation) -> None:
    figure = rated_curves(explanation, "fused").figure()
    rows = {"y2": (explanation.shifted, 1 / G), "y3": (explanation.warped, 1 / G), "y4": (explanation.slopes, 1e-3 / G)}
    for axis, (curves, scale) in rows.items():
        test, fused = (trace for trace in figure.data if trace.yaxis == axis and trace.name in ("Test", "Fused"))
        np.testing.assert_allclose(test.y, curves.reference * scale, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(fused.y, curves.comparison * scale, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(test.x, curves.time_s * 1e3, rtol=1e-5, atol=1e-4)
    assert (figure.layout.yaxis.title.text, figure.layout.yaxis4.title.text) == ("g", "g/ms")


def test_the_prediction_is_marked_only_where_it_leaves_the_corridor(explanation: RatingExplanation) -> None:
    figure = rated_curves(explanation, "fused", Display(window_ms=70.0, unit="m/s²")).figure()
    (marked,) = [trace for trace in figure.data if trace.name == "Outside the inner corridor"]
    curves = explanation.compared
    outside = np.abs(curves.comparison - curves.reference) > explanation.inner_mps2
    np.testing.assert_array_equal(np.isfinite(marked.y), outside)
    names = [trace.name for trace in figure.data]
    assert names.index(marked.name) < names.index("Fused")
    beyond = any(own.beyond_outer for own in explanation.excursions)
    assert any(trace.name == "Outside the outer corridor" for trace in figure.data) == beyond


def test_the_same_hump_has_the_same_number_in_both_curves(explanation: RatingExplanation) -> None:
    marks = [(a.text, a.x) for a in rated_curves(explanation, "fused").figure().layout.annotations if a.showarrow]
    assert [text for text, _ in marks] == ["1", "1", "2", "2", "3", "3"]
    assert [at for _, at in marks] == pytest.approx([15, 15, 33, 33, 50, 54], abs=0.3)
