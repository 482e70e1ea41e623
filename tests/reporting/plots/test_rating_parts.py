"""Figures of what a rating is made of draw the numbers that make it."""

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.condition import Condition
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.rating_parts import rated_curves, rating_parts
from crashfuse.signals.pulse import GRID_S
from crashfuse.signals.rating import Rating
from crashfuse.signals.rating_explanation import RatingExplanation, explain_rating
from crashfuse.units import G
from tests.signals.test_rating_explanation import TEST, TIME_S, bump, pulse


@pytest.fixture(scope="module")
def explanation() -> RatingExplanation:
    """Three humps, the third 4 ms late and all of it 10 % too strong."""
    late = 1.1 * (bump(15, 200) + bump(33, 250) + bump(54, 220))
    return explain_rating(pulse(TEST), pulse(late), 70.0)


def test_the_bars_are_the_four_scores_of_each_approach() -> None:
    """With their weights in the overall rating, and two digits above each bar."""
    ratings = {"cae": Rating(0.6, 0.7, 0.3, 0.73, 0.6, "Fair"), "fused": Rating(0.9, 0.9, 1.0, 0.8, 0.75, "Good")}
    raw, fused = rating_parts(ratings).data
    assert list(raw.x) == ["Corridor (40 %)", "Phase (20 %)", "Magnitude (20 %)", "Slope (20 %)"]
    np.testing.assert_allclose(fused.y, [0.9, 1.0, 0.8, 0.75], rtol=1e-6)
    assert list(raw.text) == ["0.70", "0.30", "0.73", "0.60"]


def test_each_row_draws_what_its_score_compares(explanation: RatingExplanation) -> None:
    """As they stand, shifted, warped, and the slopes in g/ms, over one axis of time."""
    figure = rated_curves(explanation, "fused")
    rows = {
        axis: [trace for trace in figure.data if trace.yaxis == axis and trace.name in ("Test", "Fused")]
        for axis in ("y2", "y3", "y4")
    }
    for axis, curves, scale in (
        ("y2", explanation.shifted, 1 / G),
        ("y3", explanation.warped, 1 / G),
        ("y4", explanation.slopes, 1e-3 / G),
    ):
        test, fused = rows[axis]
        np.testing.assert_allclose(test.y, curves.reference * scale, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(fused.y, curves.comparison * scale, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(test.x, curves.time_s * 1e3, rtol=1e-5, atol=1e-4)
    assert (figure.layout.yaxis.title.text, figure.layout.yaxis4.title.text) == ("g", "g/ms")


def test_the_prediction_is_marked_only_where_it_leaves_the_corridor(explanation: RatingExplanation) -> None:
    """In the first row, behind the curve; the outer corridor's mark stands only if that is left."""
    figure = rated_curves(explanation, "fused", Display(window_ms=70.0, unit="m/s²"))
    (marked,) = [trace for trace in figure.data if trace.name == "Outside the inner corridor"]
    curves = explanation.compared
    outside = np.abs(curves.comparison - curves.reference) > explanation.inner_mps2
    np.testing.assert_array_equal(np.isfinite(marked.y), outside)
    names = [trace.name for trace in figure.data]
    assert names.index(marked.name) < names.index("Fused")
    beyond = any(own.beyond_outer for own in explanation.excursions)
    assert any(trace.name == "Outside the outer corridor" for trace in figure.data) == beyond


def test_further_pulses_stand_behind_the_first_row(explanation: RatingExplanation) -> None:
    """Over the rated window, named last."""
    further = {
        "T03 · 26.0 mph": Prediction(
            Condition.of_vector([11.0, 900.0, 700.0]), np.linspace(0.0, -20.0 * G, GRID_S.size)
        )
    }
    plain, figure = rated_curves(explanation, "fused"), rated_curves(explanation, "fused", further=further)
    assert len(figure.data) == len(plain.data) + 1
    names = [trace.name for trace in figure.data]
    added = figure.data[names.index("T03 · 26.0 mph")]
    assert names.index(added.name) < names.index("Test")
    assert added.legendrank > 1000
    assert added.x.max() < 70.0
    np.testing.assert_allclose(added.y, -20.0 * added.x / (GRID_S[-1] * 1e3), rtol=1e-5, atol=1e-6)


def test_the_same_hump_has_the_same_number_in_both_curves(explanation: RatingExplanation) -> None:
    """At the time of its peak in each."""
    marks = [(a.text, a.x) for a in rated_curves(explanation, "fused").layout.annotations if a.showarrow]
    assert [text for text, _ in marks] == ["1", "1", "2", "2", "3", "3"]
    assert [at for _, at in marks] == pytest.approx([15, 15, 33, 33, 50, 54], abs=0.3)


def test_the_rows_say_their_scores_and_how_far_the_curve_was_moved() -> None:
    """3 ms late is moved 3 ms earlier; what fits is not moved."""
    late = np.interp(TIME_S - 0.003, TIME_S, TEST)
    titles = [a.text for a in rated_curves(explain_rating(pulse(TEST), pulse(late), 70.0), "fused").layout.annotations]
    assert "<b>Phase 0.786</b>: moved 3.0 ms earlier" in titles
    same = rated_curves(explain_rating(pulse(TEST), pulse(TEST), 70.0), "fused")
    assert "<b>Phase 1.000</b>: not moved" in [a.text for a in same.layout.annotations]
