"""Figures of the track record: probabilities against what came true, predictions against what was measured."""

import numpy as np
import pytest

from crashfuse.certification.criteria import Criterion
from crashfuse.certification.track_record import LeftOut, TrackRecord, Trial, share_bounds
from crashfuse.certification.verdict import Verdict, Word
from crashfuse.condition import Condition
from crashfuse.reporting.plots.palette import VERDICT_COLOURS
from crashfuse.reporting.plots.track_record import record_figure, reliability

CRUSH = Criterion("crush", "max_crush", at_most=500.0)
RATING = Criterion("rating", "rating", at_least=0.8, window_ms=60.0)


def trial(
    held_out: str,
    measured: float,
    probability: float = 0.99,
    *,
    word: Word = "met",
    speed_mps: float = 10.0,
    left_out: LeftOut = "test",
    criterion: Criterion = CRUSH,
    said: tuple[float, float, float] = (450.0, 420.0, 490.0),
) -> Trial:
    """A left-out test that got a verdict."""
    verdict = Verdict(Condition.of_vector([speed_mps, 1000.0, 700.0]), criterion, *said, probability, word, "")
    return Trial(held_out, left_out, verdict, measured, None)


def test_shares_that_met_stand_over_the_probability_with_exact_bounds() -> None:
    """One of four where 0.8 was said, and all of two at 0.99; the lengths of the lines reach the bounds."""
    trials = [trial(f"A{i}", 400.0 if i == 0 else 600.0, 0.8) for i in range(4)]
    trials += [trial(f"B{i}", 400.0, 0.99) for i in range(2)]
    promised, agrees = reliability(TrackRecord(tuple(trials))).data
    assert (list(promised.x), list(promised.y)) == ([0, 1], [0, 1])
    bounds = np.array([share_bounds(1, 4), share_bounds(2, 2)])
    np.testing.assert_allclose(agrees.x, [0.8, 0.99])
    np.testing.assert_allclose(agrees.y, [0.25, 1.0])
    np.testing.assert_allclose(agrees.y - agrees.error_y.arrayminus, bounds[:, 0])
    np.testing.assert_allclose(agrees.y + agrees.error_y.array, bounds[:, 1])
    assert list(agrees.text) == ["n = 4", "n = 2"]


def test_a_bin_whose_probability_is_beyond_its_bounds_is_drawn_open() -> None:
    """None of twenty met what was said with 0.9 to be met."""
    _, agrees, disagrees = reliability(
        TrackRecord((*(trial(f"A{i}", 600.0, 0.9) for i in range(20)), trial("B", 400.0, 0.3)))
    ).data
    assert (agrees.name, disagrees.name) == ("Within its bounds", "Outside its bounds")
    assert (list(agrees.x), list(disagrees.x)) == ([0.3], [pytest.approx(0.9)])
    assert (agrees.marker.symbol, disagrees.marker.symbol) == ("circle", "circle-open")


def test_predictions_have_intervals_and_verdicts_measured_values_and_limits() -> None:
    """By test in order of speed, left out alone on the left of its speed group; a wrong verdict has a ring."""
    record = TrackRecord(
        (
            trial("fast", 510.0, speed_mps=15.0),
            trial("slow", 440.0, speed_mps=5.0),
            trial("slow", 440.0, word="open", speed_mps=5.0, left_out="speed group", said=(480.0, 400.0, 560.0)),
        )
    )
    figure = record_figure(record)
    alone, group, measured, wrong = figure.data[:4]
    assert list(figure.layout.xaxis.ticktext) == ["slow", "fast"]
    assert alone.x[0] < 0 < group.x[0] < 0.5 < alone.x[1] < 1
    np.testing.assert_allclose(alone.y, [450.0, 450.0])
    np.testing.assert_allclose(
        [group.y[0] - group.error_y.arrayminus[0], group.y[0] + group.error_y.array[0]], [400, 560]
    )
    assert list(group.marker.color) == [VERDICT_COLOURS["open"]]
    np.testing.assert_allclose(sorted(measured.y), [440.0, 440.0, 510.0])
    np.testing.assert_allclose([*wrong.x, *wrong.y], [alone.x[1], 510.0])
    assert [(shape.y0, shape.y1) for shape in figure.layout.shapes] == [(500.0, 500.0)]
    assert "wrong verdict" in [trace.name for trace in figure.data]
    assert figure.layout.yaxis.title.text == "Maximum dynamic crush<br>(mm)"


def test_criteria_keep_their_order_where_one_test_lacks_the_first() -> None:
    """The record of a slow test is too short for a metric; the others give the order."""
    rating = {"criterion": RATING, "said": (0.9, 0.8, 0.95)}
    record = TrackRecord((trial("A", 0.9, **rating), trial("B", 440.0), trial("B", 0.85, **rating)))  # type: ignore[arg-type]
    assert [note.text for note in record_figure(record).layout.annotations] == [
        "<b>crush</b>: at most 500 mm (dashed)",
        "<b>rating</b>: at least 0.80 (dashed)",
    ]


def test_without_a_wrong_verdict_no_ring_is_explained() -> None:
    """The legend explains what is drawn."""
    names = [trace.name for trace in record_figure(TrackRecord((trial("A", 440.0),))).data]
    assert "measured" in names
    assert "wrong verdict" not in names


@pytest.mark.parametrize("draw", [reliability, record_figure])
def test_a_campaign_of_one_test_has_nothing_to_compare_with(draw: object) -> None:
    """The figure says so, without axes."""
    figure = draw(TrackRecord(()))  # type: ignore[operator]
    assert [note.text for note in figure.layout.annotations] == ["No test was left out: nothing to compare with."]
    assert (figure.layout.xaxis.visible, figure.layout.yaxis.visible) == (False, False)


def test_where_every_left_out_test_is_outside_no_probability_is_compared() -> None:
    """None was vouched for, which is said in place of the figure."""
    figure = reliability(TrackRecord((trial("A", 440.0, word="outside"),)))
    assert [note.text for note in figure.layout.annotations] == ["No left-out test lies inside what the others check."]
    assert not figure.data
