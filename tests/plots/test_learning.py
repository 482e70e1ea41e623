"""Figures of how networks learn show what was reported."""

import numpy as np

from crashfuse.plots import learning as plots


def test_a_learning_curve_shows_what_was_reported() -> None:
    """Progress along x, the value on a logarithmic axis."""
    figure = plots.learning_curves({"loss": [(1, 0.5), (2, 0.25)]}, step="Training", total=10)
    assert figure.data[0].x.tolist() == [1, 2]
    assert figure.data[0].y.tolist() == [0.5, 0.25]
    assert figure.layout.yaxis.type == "log"
    assert list(figure.layout.xaxis.range) == [0, 10]


def test_values_that_are_not_positive_get_a_linear_axis() -> None:
    """A logarithm would hide them."""
    figure = plots.learning_curves({"log likelihood": [(1, -20.0), (2, 3.0)]}, step="Fit", total=2)
    assert figure.layout.yaxis.type is None


def test_the_strength_of_the_fine_tuning_is_drawn_with_its_choice() -> None:
    """Errors on tests learned from and left out, in their order, and a line at what was taken."""
    figure = plots.tuning_strength({"0.02": 0.1, "0.06": 0.2}, {"0.02": 0.4, "0.06": 0.3}, "0.06")
    np.testing.assert_allclose(figure.data[0].y, [0.1, 0.2])
    np.testing.assert_allclose(figure.data[1].y, [0.4, 0.3])
    (line,) = figure.layout.shapes
    assert line.x0 == line.x1 == 1
