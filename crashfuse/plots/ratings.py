"""Figures of ratings, by test and approach."""

from collections.abc import Mapping

import numpy as np
import pandas as pd  # noqa: F401  (before Plotly, which otherwise imports it half-way, in several threads at once)
import plotly.graph_objects as go

from crashfuse.approaches import LABELS
from crashfuse.plots.canvas import new_figure
from crashfuse.plots.palette import GRADE_COLOURS
from crashfuse.rating import GRADES, grade


def rating_heatmap(scores: Mapping[str, Mapping[str, float]]) -> go.Figure:
    """Draw overall ratings as a table of test by approach, coloured by grade, with the mean over the tests at the foot.

    Parameters
    ----------
    scores : mapping of str to mapping of str to float
        Overall rating by test id, then by approach name.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    tests = list(scores)
    approaches = list(scores[tests[0]])
    z = np.array([[scores[test][name] for name in approaches] for test in tests])
    z = np.vstack([z, z.mean(axis=0)])
    rows = [f"Test {test}" for test in tests] + ["<b>Mean</b>"]
    text = [[f"{value:.3f}  {grade(value)}" for value in row] for row in z]
    figure = new_figure(height=48 + 34 * len(rows))
    figure.add_heatmap(
        z=z.astype(np.float32),
        x=[LABELS[name] for name in approaches],
        y=rows,
        text=text,
        texttemplate="%{text}",
        textfont={"color": "#000000"},
        hovertemplate="%{y}, %{x}: %{z:.3f}<extra></extra>",
        colorscale=_grade_scale(),
        zmin=0,
        zmax=1,
        xgap=2,
        ygap=2,
        showscale=False,
    )
    figure.update_layout(
        hovermode="closest",
        dragmode=False,
        margin={"t": 40, "b": 8},
        modebar={"remove": ["zoom2d", "pan2d", "resetScale2d", "toImage"]},
    )
    figure.update_xaxes(side="top", title=None, range=None, ticks="", showline=False, showgrid=False, showspikes=False)
    figure.update_yaxes(autorange="reversed", type="category", ticks="", showline=False, zeroline=False, showgrid=False)
    return figure


def _grade_scale() -> list[tuple[float, str]]:
    """Four flat steps between 0 and 1."""
    limits = [0.0, *sorted(limit for limit, _ in GRADES), 1.0]
    steps = zip(GRADE_COLOURS.values(), limits[:-1], limits[1:], strict=True)
    return [(limit, colour) for colour, lower, upper in steps for limit in (lower, upper)]
