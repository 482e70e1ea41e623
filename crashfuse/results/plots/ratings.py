"""Figures of ratings by test and approach, of two studies beside each other, and of the calibration of bands."""

from collections.abc import Mapping

import numpy as np

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import CLASSES, LABELS, label_of
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing, Look
from crashfuse.results.plots import canvas
from crashfuse.results.plots.canvas import drawing_of_points, drawing_over_tests, new_drawing, tick_name
from crashfuse.results.plots.curves import TEST, curve_line, curve_lines, label
from crashfuse.results.plots.palette import AXIS, COLOURS, GRADE_COLOURS, INK, MEASURED_COLOUR
from crashfuse.results.plots.pulses import add_corridors
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import GRADES, WEIGHTS, Rating, graded
from crashfuse.signals.rating_explanation import RatingExplanation
from crashfuse.study.history import StudyComparison
from crashfuse.units import MS, difference

_FEW = 3  # approaches with room for their scores
_ROW_PX, _NAMES_PX, _BELOW_PX = 29, 52, 8  # of a heat map: a row, the names of its columns above, the margin below


def rating_heatmap(scores: Mapping[str, Mapping[str, float]]) -> Drawing:
    """Draw overall ratings by test and approach, coloured by grade, with their mean."""
    tests = list(scores)
    approaches = max((list(own) for own in scores.values()), key=len)
    heads = [LABELS[name] for name in approaches]
    z = np.array([[scores[test].get(name, np.nan) for name in approaches] for test in tests])
    mean = ["Mean"] if len(tests) > 1 else []
    if mean:
        z = np.vstack([z, z.mean(axis=0)])
    names = [head.replace(" domain", "<br>domain") for head in heads]
    rows, ticks = ([f"Test {own(test)}" for test in tests] + [f"<b>{m}</b>" for m in mean] for own in (str, tick_name))
    text = [["" if np.isnan(value) else graded(value) for value in row] for row in z]
    limits = [0.0, *sorted(limit for limit, _ in GRADES), 1.0]
    steps = zip(GRADE_COLOURS.values(), limits[:-1], limits[1:], strict=True)
    scale = [(limit, colour) for colour, lower, upper in steps for limit in (lower, upper)]
    drawing = drawing_of_points(_NAMES_PX + _ROW_PX * len(rows) + _BELOW_PX)
    table = {"Row": [*(f"Test {test}" for test in tests), *mean], **dict(zip(heads, z.T, strict=True))}
    look = Look(z=z, colorscale=scale, zmin=0, zmax=1, text=text, texttemplate="%{text}")
    look["textfont"] = {"color": MEASURED_COLOUR, "size": 12}  # without a size, words would shrink with their cells
    clicked = [test and f"{test}:{name}" for test in [*tests, ""][: len(rows)] for name in approaches]  # the mean: none
    told = [[f"{row}, {head}: {text[i][j]}" for j, head in enumerate(heads)] for i, row in enumerate(rows)]
    canvas.draw_cells(drawing, names, rows, look, table, told, clicked=clicked, marker_size=26)
    drawing.update(margin_t=_NAMES_PX, margin_b=_BELOW_PX)
    drawing.axis("x", tickfont_size=12)
    drawing.axis("y", tickvals=rows, ticktext=ticks)
    return drawing


def rating_spread(ratings: Mapping[str, Mapping[str, tuple[float, float, float]]]) -> Drawing:
    """Draw each test's rating by approach, with the interval of single draws."""
    tests = list(ratings)
    drawing = drawing_over_tests(420, [*map(tick_name, tests)])
    approaches = [name for name in CLASSES.declared if any(name in own for own in ratings.values())]
    for place, name in enumerate(approaches):
        own = [(i, *ratings[test][name]) for i, test in enumerate(tests) if name in ratings[test]]
        number, overall, lower, upper = np.array(own).T
        drawing.points(
            number + 0.18 * (place - (len(approaches) - 1) / 2), overall, name=LABELS[name],
            numbers={"x": [tests[i] for i, *_ in own]}, ends=(lower, upper), error_y_width=0, error_y_thickness=1.5,
            marker_color=COLOURS[name], marker_size=9, customdata=np.column_stack([lower, upper]),
            hovertemplate="%{y:.3f}, single draws %{customdata[0]:.3f} to %{customdata[1]:.3f}",
        )  # fmt: skip
    for limit, _ in GRADES:
        drawing.rule("y", limit, colour=AXIS, dash="dot")
    drawing.axis("y", "Overall rating", "dotted: limits of the grades", range=[0, 1.01])
    return drawing


def calibration_curves(levels: FloatArray, observed: Mapping[str, FloatArray]) -> Drawing:
    """Draw the coverage of left-out tests at each nominal level, by approach; calibrated is the diagonal."""
    drawing = new_drawing(height=440)
    drawing.points([0, 100], [0, 100], **canvas.PROMISED)
    for name, shares in observed.items():
        drawing.points(
            100 * levels, 100 * shares, mode="lines+markers", name=LABELS[name], line_color=COLOURS[name], line_width=2,
            marker_size=5, hovertemplate="%{y:.0f} %",
        )  # fmt: skip
    drawing.axis("x", "Level of the band", "%", range=[0, 100], dtick=20, unifiedhovertitle_text="%{x:.0f} % band")
    drawing.axis("y", "a(t) up to TTZV inside", "%", range=[0, 102], dtick=20)
    return drawing


_OUTSIDE, _BEYOND = "#E69F00", "#C1121F"  # of a curve outside the inner and the outer corridor
_LAST = 2000  # in the legend, where 1000 is usual
_DOMAINS = ((0.67, 0.985), (0.45, 0.6), (0.225, 0.375), (0.0, 0.15))  # of the rows, as shares of the height


def rating_parts(ratings: Mapping[str, Rating]) -> Drawing:
    """Draw the four scores of each approach as bars, beside each other."""
    drawing = drawing_of_points(300, type="category", ticks="", showgrid=False)
    parts = [f"{part.capitalize()} ({100 * weight:.0f} %)" for part, weight in WEIGHTS.items()]
    for name, rating in ratings.items():
        scores = [getattr(rating, part) for part in WEIGHTS]
        drawing.points(
            parts, scores, type="bar", name=LABELS[name], marker_color=COLOURS[name], hovertemplate="%{y:.3f}",
            text=[f"{score:.2f}" for score in scores], textposition="outside", textfont_size=11,
            textangle=-90 if len(ratings) > _FEW else 0,  # beside each other they would overlap
            constraintext="none", cliponaxis=False,
        )  # fmt: skip
    drawing.update(barmode="group", bargap=0.25, margin_b=36)  # without a title below
    drawing.axis("y", "Score", range=[0, 1.4], tickvals=[0, 0.2, 0.4, 0.6, 0.8, 1])
    return drawing


def rated_curves(
    explanation: RatingExplanation, approach: str, display: Display = DEFAULT, further: Mapping[str, Prediction] = {}
) -> Drawing:
    """Stack what the four scores compare over one time axis, with corridors, and humps numbered."""
    drawing = new_drawing(height=555 + canvas.room_for_names([TEST, approach, *further]))
    curves, scale = explanation.compared, display.accel_scale
    add_corridors(drawing, Pulse(curves.time_s, curves.reference), display)
    grid_ms = GRID_S / MS
    lines, rated = curve_lines(further), grid_ms < explanation.window_ms
    for name, pulse in further.items():  # behind what is rated
        drawing.line(grid_ms[rated], pulse.accel_mps2[rated] * scale, name=name, line=lines[name], legendrank=_LAST)
    distance = np.abs(curves.comparison - curves.reference)
    for name, colour, half_mps2 in (
        ("Outside the inner corridor", _OUTSIDE, explanation.inner_mps2),
        ("Outside the outer corridor", _BEYOND, explanation.outer_mps2),
    ):
        if (outside := distance > half_mps2).any():
            marked = np.where(outside, curves.comparison * scale, np.nan)
            drawing.line(
                curves.time_s / MS, marked, name=name, line_color=colour, line_width=7,  # behind the curve, which it
                opacity=0.6, hoverinfo="skip", legendrank=_LAST - 1,  # would colour
            )  # fmt: skip
    _number_humps(drawing, explanation, approach, scale)
    shift_ms = explanation.shift_s / MS
    moved = f"moved {abs(shift_ms):.1f} ms {'earlier' if shift_ms > 0 else 'later'}" if shift_ms else "not moved"
    rows = (
        (curves, "curves as they stand"), (explanation.shifted, moved), (explanation.warped, f"{moved}, and warped"),
        (explanation.slopes, f"slopes, {moved}"),
    )  # fmt: skip
    for number, (part, (drawn, how), (bottom, top)) in enumerate(zip(WEIGHTS, rows, _DOMAINS, strict=True), 1):
        is_first, is_last, axis = number == 1, number == len(_DOMAINS), "y" if number == 1 else f"y{number}"
        heading = f"{part.capitalize()} {getattr(explanation.rating, part):.3f}"
        unit = f"{display.unit}/ms" if is_last else display.unit
        drawing.axis(axis, unit, domain=[bottom, top])
        drawing.axes[axis].plot = f"{heading}: {how}"
        drawing.note(f"<b>{heading}</b>: {how}", 0, top, xanchor="left", yanchor="bottom")
        key = Look() if is_first else Look(yaxis=axis, showlegend=False)
        key["yhoverformat"] = ".2f" if is_last else ".1f"
        factor = scale * MS if is_last else scale
        for name, values in ((TEST, drawn.reference), (approach, drawn.comparison)):
            y = values * factor
            drawing.line(drawn.time_s / MS, y, name=label(name), legendgroup=name, line=curve_line(name), **key)
    drawing.update(hoversubplots="axis", margin_t=96)
    drawing.axis("x", anchor=f"y{len(_DOMAINS)}", range=[0, explanation.window_ms])
    return drawing


def _number_humps(drawing: Drawing, explanation: RatingExplanation, approach: str, scale: float) -> None:
    curves = explanation.compared
    outwards = -np.sign(curves.reference.sum() * scale)  # of the screen, where y runs down
    for number, hump in enumerate(explanation.humps, start=1):
        marks = [(hump.peak_s, curves.reference, outwards, INK)]
        if hump.counterpart_s is not None:
            marks.append((hump.counterpart_s, curves.comparison, -outwards, COLOURS[approach]))
        for time_s, values, side, colour in marks:
            y = float(np.interp(time_s, curves.time_s, values)) * scale
            drawing.note(
                f"{number}", time_s / MS, y, "y", ax=0, ay=24 * side, showarrow=True, arrowhead=0, arrowcolor=colour,
                font_color=INK, font_size=13,
            )  # fmt: skip


_APART = 0.14  # of the distance between two tests
_SMALL, _NONE = 0.01, 5e-4  # differences: no axis is drawn narrower, and none is shown


def rating_differences(compared: StudyComparison, window_ms: float, left_out: str) -> Drawing:
    """Draw by how much the second study rates each test higher, by approach; last their mean ± 2 standard errors."""
    table = compared.over(window_ms, left_out)
    tests, means = list(table["held_out"].unique()), compared.means(window_ms, left_out).set_index("approach")
    drawing = drawing_over_tests(380, [*map(tick_name, tests), "<b>Mean</b>"])
    for place, name in enumerate(means.index):
        own, mean = table[table["approach"] == name].set_index("held_out"), means.loc[name]
        gains = own["difference"]
        pairs = [*own[["second", "first"]].values.tolist(), mean[["second", "first"]].tolist()]
        shift = _APART * (place - (len(means) - 1) / 2)
        values = np.array([*gains, mean["difference"]])
        error = np.array([0.0] * gains.size + [0.0 if np.isnan(mean["standard_error"]) else 2 * mean["standard_error"]])
        drawing.points(
            [*(tests.index(test) + shift for test in gains.index), len(tests) + shift], values, name=label_of(name),
            numbers={"x": [*gains.index, "Mean"]}, ends=(values - error, values + error),
            error_y_width=0, error_y_thickness=1.5, marker_color=COLOURS.get(name, AXIS), marker_size=8,
            marker_symbol=["circle"] * gains.size + ["diamond"],
            hovertemplate=[difference(second, first, 3) for second, first in pairs],
        )  # fmt: skip
    drawing.rule("y", 0, colour=AXIS)
    drawing.rule("x", len(tests) - 0.5, colour=AXIS, dash="dot")
    drawing.axis("y", "Rating, second minus first")
    largest = float(table["difference"].abs().max())
    if largest < _SMALL:
        drawing.axis("y", range=[-_SMALL, _SMALL])
    if largest < _NONE:
        drawing.note("Every test is rated the same in both studies.", 0.25, 0.88)
    return drawing
