"""Figure of two studies beside each other."""

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.canvas import name_tests, new_figure, tick_name
from crashfuse.reporting.plots.palette import AXIS, COLOURS
from crashfuse.study.comparison import StudyComparison
from crashfuse.wording import difference

_APART = 0.14  # of the distance between two tests
_SMALL, _NONE = 0.01, 5e-4  # differences: no axis is drawn narrower, and none is shown


def rating_differences(compared: StudyComparison, window_ms: float, left_out: str) -> go.Figure:
    """Draw by how much the second study rates each test higher, by approach; last their mean ± 2 standard errors."""
    table = compared.over(window_ms, left_out)
    tests, means = list(table["held_out"].unique()), compared.means(window_ms, left_out).set_index("approach")
    figure = new_figure(height=380)
    for place, name in enumerate(means.index):
        own, mean = table[table["approach"] == name].set_index("held_out"), means.loc[name]
        gains = own["difference"]
        pairs = [*own[["second", "first"]].values.tolist(), mean[["second", "first"]].tolist()]
        shift = _APART * (place - (len(means) - 1) / 2)
        error = [0.0] * gains.size + [0.0 if np.isnan(mean["standard_error"]) else 2 * mean["standard_error"]]
        colour = COLOURS.get(name, AXIS)
        figure.add_scatter(
            x=[*(tests.index(test) + shift for test in gains.index), len(tests) + shift],
            meta={"x": [*gains.index, "Mean"]},
            y=[*gains, mean["difference"]],
            error_y={"array": error, "width": 0, "thickness": 1.5},
            mode="markers",
            name=LABELS.get(name, name),
            marker={"color": colour, "size": 8, "symbol": ["circle"] * gains.size + ["diamond"]},
            hovertemplate=[difference(second, first, 3) for second, first in pairs],
        )
    figure.add_hline(y=0, line={"color": AXIS, "width": 1})
    figure.add_vline(x=len(tests) - 0.5, line={"color": AXIS, "width": 1, "dash": "dot"})
    name_tests(figure, [*map(tick_name, tests), "<b>Mean</b>"])
    figure.update_yaxes(title="Rating, second minus first")
    largest = float(table["difference"].abs().max())
    if largest < _SMALL:
        figure.update_yaxes(range=[-_SMALL, _SMALL])
    if largest < _NONE:
        words = "Every test is rated the same in both studies."
        figure.add_annotation(text=words, x=0.25, y=0.88, xref="paper", yref="paper", showarrow=False)
    return figure
