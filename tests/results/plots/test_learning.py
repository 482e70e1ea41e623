"""Figures of how networks learn show what was reported, that of a learning curve the means that the tables state."""

import numpy as np
import pandas as pd
import pytest

from crashfuse.campaign import Campaign
from crashfuse.results.plots import learning as plots
from crashfuse.results.plots.learning import over_number_of_tests
from crashfuse.study.config import StudyConfig
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import one_more


def test_a_learning_curve_shows_what_was_reported() -> None:
    """Progress along x, the value on a logarithmic axis, unless some are not positive; both axes say what they are."""
    loss = {"loss": [(1, 0.5), (2, 0.25)]}
    figure = plots.learning_curves(loss, value="Mean square error", step="Epoch", total=10).figure()
    assert figure.data[0].x.tolist() == [1, 2]
    assert figure.data[0].y.tolist() == [0.5, 0.25]
    assert figure.layout.yaxis.type == "log"
    assert figure.layout.yaxis.dtick == "D2"  # with powers of ten alone, a loss within a decade had no number beside it
    low, high = 10.0 ** np.array(figure.layout.yaxis.range)
    assert 0.2 < low < 0.25 < 0.5 < high < 0.6  # given: taking another figure's place, Plotly would keep that one's
    assert list(figure.layout.xaxis.range) == [0, 10]
    assert figure.layout.xaxis.title.text == "Epoch"
    assert figure.layout.yaxis.title.text == "Mean square error"
    assert figure.layout.showlegend  # one curve alone is named, too
    figure = plots.learning_curves({"log likelihood": [(1, -20.0), (2, 3.0)]}, value="Log likelihood", total=2).figure()
    assert figure.layout.yaxis.type is None


def test_the_strength_of_the_fine_tuning_is_drawn_with_its_choice() -> None:
    """Errors on tests learned from and left out, in their order, and a line at what was taken that says so."""
    figure = plots.tuning_strength({"0.02": 0.1, "0.06": 0.2}, {"0.02": 0.4, "0.06": 0.3}, "0.06").figure()
    np.testing.assert_allclose(figure.data[0].y, [0.1, 0.2])
    np.testing.assert_allclose(figure.data[1].y, [0.4, 0.3])
    (line,) = figure.layout.shapes
    assert line.x0 == line.x1 == 1
    assert [note.text for note in figure.layout.annotations] == ["chosen"]


def made_up(campaign: Campaign, approaches: tuple[str, ...], sizes: tuple[int, ...] = (1, 2, 3)) -> LearningCurve:
    """A curve of known means: 0.9 − 0.1 / n, with a band of 8 / n g where the approach has one."""
    rows = [
        {
            "n_tests": size, "chosen": "", "choice": choice, "held_out": test, "approach": name, "window_ms": 60.0,
            "overall": 0.6 if name == "cae" else 0.9 - 0.1 / size, "inside": np.nan if name == "cae" else 0.9,
            "half_width_g": np.nan if name == "cae" else 8 / size,
        }
        for size in sizes for choice in ("even", "random") for test in campaign.test_ids for name in approaches
    ]  # fmt: skip
    config = StudyConfig(approaches=approaches, windows_ms=(60.0,))
    return LearningCurve(campaign, config, 1, pd.DataFrame(rows), (), 1.0)


def test_ratings_and_band_are_drawn_over_the_number_of_tests(campaign: Campaign) -> None:
    """Even and random choices, the raw CAE model as a level line from zero tests, the band's half width below."""
    drawn = {trace.name: trace for trace in over_number_of_tests(made_up(campaign, ("cae", "fused"))).figure().data}
    level = drawn["CAE, without any test"]
    assert list(level.x) == [0, 5]
    assert list(level.y) == pytest.approx([0.6, 0.6])
    for way in ("evenly over speed", "at random"):
        assert list(drawn[f"Fused, {way}"].y) == pytest.approx([0.8, 0.85, 0.9 - 0.1 / 3])
    band = drawn["Fused"]
    assert band.yaxis == "y2"
    assert list(band.x) == [1, 2, 3]
    assert list(band.y) == pytest.approx([8, 4, 8 / 3])
    figure = over_number_of_tests(made_up(campaign, ("cae",))).figure()
    assert [trace.name for trace in figure.data] == ["CAE, without any test"]
    assert "yaxis2" not in figure.layout


def test_one_more_test_is_drawn_where_it_can_be_told(campaign: Campaign) -> None:
    name = "Fused, expected with one test more"
    assert name not in [trace.name for trace in over_number_of_tests(made_up(campaign, ("fused",))).figure().data]
    curve = made_up(campaign, ("fused",), (1, 2, 3, 4))
    expected = {trace.name: trace for trace in over_number_of_tests(curve).figure().data}[name]
    more = one_more(curve)
    assert more is not None
    assert expected.x[-1] == len(campaign.tests) + 1
    assert expected.y[-1] == pytest.approx(more.rating)
    assert expected.error_y.array[-1] == pytest.approx(more.upper - more.gain)
    assert expected.error_y.arrayminus[-1] == pytest.approx(more.gain - more.lower)
