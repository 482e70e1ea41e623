"""Figures of ratings by test and approach, of two studies beside each other, and of the calibration of bands."""

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import CLASSES, LABELS, label_of
from crashfuse.reporting.plots import canvas
from crashfuse.reporting.plots.canvas import add_line, figure_over_tests, new_figure, points_figure, tick_name
from crashfuse.reporting.plots.curves import TEST, curve_line, curve_lines
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import AXIS, COLOURS, GRADE_COLOURS, INK, MEASURED_COLOUR
from crashfuse.reporting.plots.pulses import add_corridors
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import GRADES, WEIGHTS, Rating, graded
from crashfuse.signals.rating_explanation import Compared, RatingExplanation
from crashfuse.study.comparison import StudyComparison
from crashfuse.study.repeatability import Repeatability
from crashfuse.units import MS, difference

_FEW = 3  # approaches with room for their scores
_ROW_PX, _NAMES_PX, _BELOW_PX = 29, 52, 8  # of a heat map: a row, the names of its columns above, the margin below


def rating_heatmap(
    scores: Mapping[str, Mapping[str, float]], repeats: Mapping[str, Repeatability] | None = None
) -> go.Figure:
    """Draw overall ratings by test and approach, coloured by grade, with their mean and a repeat's."""
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
    limits = [0.0, *sorted(limit for limit, _ in GRADES), 1.0]
    steps = zip(GRADE_COLOURS.values(), limits[:-1], limits[1:], strict=True)
    scale = [(limit, colour) for colour, lower, upper in steps for limit in (lower, upper)]
    figure = points_figure(_NAMES_PX + _ROW_PX * len(rows) + _BELOW_PX)
    figure.add_heatmap(
        z=z, x=names, y=rows, text=text, texttemplate="%{text}", hoverinfo="skip", colorscale=scale,
        zmin=0, zmax=1, xgap=2, ygap=2, showscale=False,
        textfont_color=MEASURED_COLOUR, textfont_size=12,  # without a size, words shrink with their cells
    )  # fmt: skip
    columns = [*(f":{name}" for name in approaches), ""][: len(names)]  # a repeat is by no approach
    clicked = [test and test + name for test in [*tests, ""][: len(rows)] for name in columns]  # the mean is of no test
    heads = [name.replace("<br>", " ") for name in names]
    told = [f"{row}, {head}: {text[i][j]}" for i, row in enumerate(rows) for j, head in enumerate(heads)]
    canvas.make_clickable(figure, names, rows, clicked, 26, hovertext=told, hovertemplate="%{hovertext}<extra></extra>")
    canvas.fix_cells(figure, len(names), len(rows))
    figure.update_layout(margin_t=_NAMES_PX, margin_b=_BELOW_PX)
    figure.update_xaxes(tickfont_size=12)
    figure.update_yaxes(tickvals=rows, ticktext=[f"Test {tick_name(test)}" for test in tests] + mean)
    return figure


def rating_spread(
    ratings: Mapping[str, Mapping[str, tuple[float, float, float]]], repeats: Mapping[str, Repeatability] | None = None
) -> go.Figure:
    """Draw each test's rating by approach, with the interval of those of single draws, before that of a repeat."""
    tests = list(ratings)
    figure = figure_over_tests(420, [*map(tick_name, tests)])
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
    approaches = [name for name in CLASSES.declared if any(name in own for own in ratings.values())]
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
        figure.add_hline(y=limit, line_color=AXIS, line_width=1, line_dash="dot")
    figure.update_yaxes(title="Overall rating (dotted: limits of the grades)", range=[0, 1.01])
    return figure


def calibration_curves(levels: FloatArray, observed: Mapping[str, FloatArray]) -> go.Figure:
    """Draw the coverage of left-out tests by approach at each nominal level; on the diagonal a band is calibrated."""
    figure = new_figure(height=440)
    figure.add_scatter(
        x=[0, 100], y=[0, 100], mode="lines", name="As promised", line_color=AXIS, line_dash="dot", hoverinfo="skip"
    )
    for name, shares in observed.items():
        figure.add_scatter(
            x=100 * levels, y=100 * shares, mode="lines+markers", name=LABELS[name],
            line_color=COLOURS[name], line_width=2, marker_size=5, hovertemplate="%{y:.0f} %",
        )  # fmt: skip
    figure.update_xaxes(
        title="Level of the band (%)", range=[0, 100], dtick=20, unifiedhovertitle={"text": "%{x:.0f} % band"}
    )
    figure.update_yaxes(title="a(t) up to TTZV inside (%)", range=[0, 102], dtick=20)
    return figure


_OUTSIDE, _BEYOND = "#E69F00", "#C1121F"  # of a curve outside the inner and the outer corridor
_LAST = 2000  # in the legend, where 1000 is usual
_DOMAINS = ((0.67, 0.985), (0.45, 0.6), (0.225, 0.375), (0.0, 0.15))  # of the rows, as shares of the height


def rating_parts(ratings: Mapping[str, Rating]) -> go.Figure:
    """Draw the four scores of each approach as bars, beside each other."""
    figure = points_figure(250, type="category", ticks="", showgrid=False)
    parts = [f"{part.capitalize()} ({100 * weight:.0f} %)" for part, weight in WEIGHTS.items()]
    for name, rating in ratings.items():
        scores = [getattr(rating, part) for part in WEIGHTS]
        figure.add_bar(
            x=parts, y=scores, name=LABELS[name], marker_color=COLOURS[name],
            text=[f"{score:.2f}" for score in scores], textposition="outside", textfont_size=11,
            textangle=-90 if len(ratings) > _FEW else 0,  # beside each other they would overlap
            constraintext="none", cliponaxis=False, hovertemplate="%{y:.3f}",
        )  # fmt: skip
    figure.update_layout(barmode="group", bargap=0.25, margin_b=36)  # without a title below
    figure.update_yaxes(title="Score", range=[0, 1.4], tickvals=[0, 0.2, 0.4, 0.6, 0.8, 1])
    return figure


def rated_curves(
    explanation: RatingExplanation, approach: str, display: Display = DEFAULT, further: Mapping[str, Prediction] = {}
) -> go.Figure:
    """Stack what the four scores compare over one time axis, with corridors, and humps numbered."""
    figure = new_figure(height=555 + canvas.room_for_names([TEST, approach, *further]))
    curves, scale = explanation.compared, display.accel_scale
    add_corridors(figure, Pulse(curves.time_s, curves.reference), display)
    grid_ms = GRID_S / MS
    lines, rated = curve_lines(further), grid_ms < explanation.window_ms
    for name, pulse in further.items():  # behind what is rated
        accel = pulse.accel_mps2[rated] * scale
        add_line(figure, grid_ms[rated], accel, name=name, line=lines[name], legendrank=_LAST)
    distance = np.abs(curves.comparison - curves.reference)
    for name, colour, half_mps2 in (
        ("Outside the inner corridor", _OUTSIDE, explanation.inner_mps2),
        ("Outside the outer corridor", _BEYOND, explanation.outer_mps2),
    ):
        if (outside := distance > half_mps2).any():
            marked = np.where(outside, curves.comparison * scale, np.nan)
            line = {"color": colour, "width": 7}  # behind the curve, whose colour it would change
            add_line(
                figure, curves.time_s / MS, marked, name=name, line=line, opacity=0.6, hoverinfo="skip",
                legendrank=_LAST - 1,
            )  # fmt: skip
    _draw(figure, curves, approach, scale, row=1)
    _number_humps(figure, explanation, approach, scale)
    _draw(figure, explanation.shifted, approach, scale, row=2)
    _draw(figure, explanation.warped, approach, scale, row=3)
    _draw(figure, explanation.slopes, approach, scale * MS, row=4)
    look, layout, shift_ms = figure.layout.yaxis.to_plotly_json(), {}, explanation.shift_s / MS
    moved = f"moved {abs(shift_ms):.1f} ms {'earlier' if shift_ms > 0 else 'later'}" if shift_ms else "not moved"
    hows = "curves as they stand", moved, f"{moved}, and warped", f"slopes, {moved}"
    for number, (part, how, (bottom, top)) in enumerate(zip(WEIGHTS, hows, _DOMAINS, strict=True), 1):
        unit = f"{display.unit}/ms" if number == len(_DOMAINS) else display.unit
        layout[f"yaxis{number}"] = {**look, "domain": [bottom, top], "title": unit}
        figure.add_annotation(
            x=0, xref="paper", xanchor="left", y=top, yref="paper", yanchor="bottom", showarrow=False,
            text=f"<b>{part.capitalize()} {getattr(explanation.rating, part):.3f}</b>: {how}",
        )  # fmt: skip
    figure.update_layout(
        **layout,
        hoversubplots="axis",
        xaxis={"anchor": f"y{len(_DOMAINS)}", "range": [0, explanation.window_ms]},
        margin_t=96,
    )
    return figure


def _draw(figure: go.Figure, curves: Compared, approach: str, scale: float, row: int) -> None:
    for name, label, values in ((TEST, "Test", curves.reference), (approach, LABELS[approach], curves.comparison)):
        place = {} if row == 1 else {"yaxis": f"y{row}", "showlegend": False}
        add_line(
            figure, curves.time_s / MS, values * scale, name=label, legendgroup=name, line=curve_line(name),
            yhoverformat=".2f" if row == len(_DOMAINS) else ".1f", **place,
        )  # fmt: skip


def _number_humps(figure: go.Figure, explanation: RatingExplanation, approach: str, scale: float) -> None:
    curves = explanation.compared
    outwards = -np.sign(curves.reference.sum() * scale)  # of the screen, where y runs down
    for number, hump in enumerate(explanation.humps, start=1):
        marks = [(hump.peak_s, curves.reference, outwards, INK)]
        if hump.counterpart_s is not None:
            marks.append((hump.counterpart_s, curves.comparison, -outwards, COLOURS[approach]))
        for time_s, values, side, colour in marks:
            figure.add_annotation(
                x=time_s / MS, y=float(np.interp(time_s, curves.time_s, values)) * scale, text=f"{number}", ax=0,
                ay=24 * side, showarrow=True, arrowhead=0, arrowcolor=colour, font_color=INK, font_size=13,
            )  # fmt: skip


_APART = 0.14  # of the distance between two tests
_SMALL, _NONE = 0.01, 5e-4  # differences: no axis is drawn narrower, and none is shown


def rating_differences(compared: StudyComparison, window_ms: float, left_out: str) -> go.Figure:
    """Draw by how much the second study rates each test higher, by approach; last their mean ± 2 standard errors."""
    table = compared.over(window_ms, left_out)
    tests, means = list(table["held_out"].unique()), compared.means(window_ms, left_out).set_index("approach")
    figure = figure_over_tests(380, [*map(tick_name, tests), "<b>Mean</b>"])
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
            name=label_of(name),
            marker={"color": colour, "size": 8, "symbol": ["circle"] * gains.size + ["diamond"]},
            hovertemplate=[difference(second, first, 3) for second, first in pairs],
        )
    figure.add_hline(y=0, line_color=AXIS, line_width=1)
    figure.add_vline(x=len(tests) - 0.5, line_color=AXIS, line_width=1, line_dash="dot")
    figure.update_yaxes(title="Rating, second minus first")
    largest = float(table["difference"].abs().max())
    if largest < _SMALL:
        figure.update_yaxes(range=[-_SMALL, _SMALL])
    if largest < _NONE:
        words = "Every test is rated the same in both studies."
        figure.add_annotation(text=words, x=0.25, y=0.88, xref="paper", yref="paper", showarrow=False)
    return figure
