"""Figures of how networks learn show what was reported."""

import numpy as np

from crashfuse.reporting.plots import learning as plots


def test_a_learning_curve_shows_what_was_reported() -> None:
    """Progress along x, the value on a logarithmic axis; both axes say what they are."""
    figure = plots.learning_curves({"loss": [(1, 0.5), (2, 0.25)]}, value="Mean square error", step="Epoch", total=10)
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


def test_values_that_are_not_positive_get_a_linear_axis() -> None:
    """A logarithm would hide them."""
    figure = plots.learning_curves({"log likelihood": [(1, -20.0), (2, 3.0)]}, value="Log likelihood", total=2)
    assert figure.layout.yaxis.type is None


def test_the_strength_of_the_fine_tuning_is_drawn_with_its_choice() -> None:
    """Errors on tests learned from and left out, in their order, and a line at what was taken that says so."""
    figure = plots.tuning_strength({"0.02": 0.1, "0.06": 0.2}, {"0.02": 0.4, "0.06": 0.3}, "0.06")
    np.testing.assert_allclose(figure.data[0].y, [0.1, 0.2])
    np.testing.assert_allclose(figure.data[1].y, [0.4, 0.3])
    (line,) = figure.layout.shapes
    assert line.x0 == line.x1 == 1
    assert [note.text for note in figure.layout.annotations] == ["chosen"]
