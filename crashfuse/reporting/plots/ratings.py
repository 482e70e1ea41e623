"""Figures of ratings by test and approach, and of the calibration of bands."""

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.canvas import fix_cells, make_clickable, name_tests, new_figure, tick_name
from crashfuse.reporting.plots.palette import AXIS, COLOURS, GRADE_COLOURS, MEASURED_COLOUR
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.rating import GRADES, graded
from crashfuse.study.repeatability import Repeatability

_ROW_PX, _NAMES_PX, _BELOW_PX = 31, 52, 8  # of a heat map: a row, the names of its columns above, the margin below


def rating_heatmap(
    scores: Mapping[str, Mapping[str, float]], repeats: Mapping[str, Repeatability] | None = None
) -> go.Figure:
    """Draw overall ratings by test id and approach as a table coloured by grade, below several their mean.

    Ratings that are not known yet, and their mean, are left empty. What a repeat of each test would rate is the last
    column, if it is known for all.
    """
    tests = list(scores)
    approaches = max((list(own) for own in scores.values()), key=len)
    names = [LABELS[name].replace(" domain", "<br>domain") for name in approaches]
    z = np.array([[scores[test].get(name, np.nan) for name in approaches] for test in tests])
    if repeats and set(repeats) == set(tests):
        names.append("<i>A repeat</i>")
        z = np.column_stack([z, [repeats[test].value for test in tests]])
    mean = ["<b>Mean</b>"] if len(tests) > 1 else []
    if mean:
        z = np.vstack([z, z.mean(axis=0)])
    rows = [f"Test {test}" for test in tests] + mean
    text = [["" if np.isnan(value) else graded(value) for value in row] for row in z]
    figure = new_figure(height=_NAMES_PX + _ROW_PX * len(rows) + _BELOW_PX)
    figure.add_heatmap(
        z=z,
        x=names,
        y=rows,
        text=text,
        texttemplate="%{text}",
        textfont={"color": MEASURED_COLOUR, "size": 12},  # without a size, words shrink with their cells
        hoverinfo="skip",
        colorscale=_grade_scale(),
        zmin=0,
        zmax=1,
        xgap=2,
        ygap=2,
        showscale=False,
    )
    columns = [*(f":{name}" for name in approaches), ""][: len(names)]  # a repeat is by no approach
    clicked = [test and test + name for test in [*tests, ""][: len(rows)] for name in columns]  # the mean is of no test
    heads = [name.replace("<br>", " ") for name in names]
    told = [f"{row}, {head}: {text[i][j]}" for i, row in enumerate(rows) for j, head in enumerate(heads)]
    make_clickable(figure, names, rows, clicked, 26, hovertext=told, hovertemplate="%{hovertext}<extra></extra>")
    fix_cells(figure)
    figure.update_layout(margin={"t": _NAMES_PX, "b": _BELOW_PX})
    figure.update_xaxes(
        side="top", title=None, range=[-0.5, len(names) - 0.5], tickfont={"size": 12}, ticks="", showline=False,
        showgrid=False, showspikes=False,
    )  # fmt: skip
    ends = [len(rows) - 0.5, -0.5]  # the marks would widen it
    figure.update_yaxes(
        range=ends, type="category", tickvals=rows, ticktext=[f"Test {tick_name(test)}" for test in tests] + mean,
        ticks="", showline=False, zeroline=False, showgrid=False,
    )  # fmt: skip
    return figure


def rating_spread(
    ratings: Mapping[str, Mapping[str, tuple[float, float, float]]], repeats: Mapping[str, Repeatability] | None = None
) -> go.Figure:
    """Draw each test's rating by approach, with the interval of the ratings of single draws.

    ``ratings`` by test id, then approach: overall rating, and lower and upper end of the interval. The interval of what
    a repeat of each test would rate is drawn behind them.
    """
    figure = new_figure(height=420)
    tests = list(ratings)
    if known := [(i, repeats[test]) for i, test in enumerate(tests) if repeats and test in repeats]:
        figure.add_bar(
            x=[i for i, _ in known],
            meta={"x": [tests[i] for i, _ in known]},
            base=[repeat.lower for _, repeat in known],
            y=[repeat.upper - repeat.lower for _, repeat in known],
            width=0.7,
            name="A repeat (95 %)",
            marker={"color": AXIS, "opacity": 0.25, "line": {"width": 0}},
            customdata=[(repeat.value, repeat.lower, repeat.upper) for _, repeat in known],
            hovertemplate="%{customdata[0]:.3f}, %{customdata[1]:.3f} to %{customdata[2]:.3f}",
        )
    approaches = [name for name in LABELS if any(name in own for own in ratings.values())]
    for place, name in enumerate(approaches):
        own = [(i, *ratings[test][name]) for i, test in enumerate(tests) if name in ratings[test]]
        number, overall, lower, upper = np.array(own).T
        figure.add_scatter(
            x=number + 0.18 * (place - (len(approaches) - 1) / 2),
            meta={"x": [tests[i] for i, *_ in own]},
            y=overall,
            error_y={"array": upper - overall, "arrayminus": overall - lower, "width": 0, "thickness": 1.5},
            mode="markers",
            name=LABELS[name],
            marker={"color": COLOURS[name], "size": 9},
            customdata=np.column_stack([lower, upper]),
            hovertemplate="%{y:.3f}, single draws %{customdata[0]:.3f} to %{customdata[1]:.3f}",
        )
    for limit, _ in GRADES:
        figure.add_hline(y=limit, line={"color": AXIS, "width": 1, "dash": "dot"})
    name_tests(figure, [*map(tick_name, tests)])
    figure.update_yaxes(title="Overall rating (dotted: limits of the grades)", range=[0, 1.01])
    return figure


def calibration_curves(levels: FloatArray, observed: Mapping[str, FloatArray]) -> go.Figure:
    """Draw how much of the left-out tests lies inside bands of each level; on the diagonal a band is calibrated.

    Parameters
    ----------
    levels : ndarray, shape (n,)
        Nominal levels of the bands, from 0 to 1.
    observed : mapping of str to ndarray, shape (n,)
        Observed coverage by approach.
    """
    figure = new_figure(height=440)
    figure.add_scatter(
        x=[0, 100], y=[0, 100], mode="lines", name="As promised", line={"color": AXIS, "dash": "dot"},
        hoverinfo="skip",
    )  # fmt: skip
    for name, shares in observed.items():
        figure.add_scatter(
            x=100 * levels, y=100 * shares, mode="lines+markers", name=LABELS[name],
            line={"color": COLOURS[name], "width": 2}, marker={"size": 5}, hovertemplate="%{y:.0f} %",
        )  # fmt: skip
    figure.update_xaxes(
        title="Level of the band (%)", range=[0, 100], dtick=20, unifiedhovertitle={"text": "%{x:.0f} % band"}
    )
    figure.update_yaxes(title="a(t) up to TTZV inside (%)", range=[0, 102], dtick=20)
    return figure


def _grade_scale() -> list[tuple[float, str]]:
    """Colour scale of four flat steps between 0 and 1."""
    limits = [0.0, *sorted(limit for limit, _ in GRADES), 1.0]
    steps = zip(GRADE_COLOURS.values(), limits[:-1], limits[1:], strict=True)
    return [(limit, colour) for colour, lower, upper in steps for limit in (lower, upper)]
