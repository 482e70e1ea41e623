"""What all figures share."""

import numpy as np

from crashfuse.reporting.plots.canvas import add_line, new_figure, room_above, share_y_range


def test_figures_to_be_compared_share_one_range_that_holds_all_curves() -> None:
    """One from -45 to 5, the other up to 20: both are drawn from -45 to 20 and a little more."""
    low, high = new_figure(300), new_figure(300)
    add_line(low, np.array([0.0, 0.1]), np.array([-45.0, 5.0]))
    add_line(high, np.array([0.0, 0.1]), np.array([0.0, 20.0]), name="a name")
    share_y_range([low, high])
    assert low.layout.margin.t == high.layout.margin.t == room_above(high) + 21  # a row to spare in a narrow window
    assert low.layout.yaxis.range == high.layout.yaxis.range
    bottom, top = low.layout.yaxis.range
    assert -50 < bottom < -45
    assert 20 < top < 25


def test_titles_of_axes_are_no_larger_than_text() -> None:
    """By default they are a fifth larger; a title that is set later keeps the size."""
    figure = new_figure(300)
    figure.update_yaxes(title="Velocity (km/h)")
    assert figure.layout.yaxis.title.font.size is None
    axes = figure.layout.template.layout
    assert axes.xaxis.title.font.size == axes.yaxis.title.font.size == figure.layout.font.size
