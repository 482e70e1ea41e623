"""Figures of learning: of networks while they train, and of approaches over the number of tests."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing, Look
from crashfuse.results.plots.canvas import drawing_of_points, new_drawing
from crashfuse.results.plots.palette import COLOURS, CURSOR, DASHES
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import one_more, summary
from crashfuse.units import signed

_MARKED = Look(mode="lines+markers", line_width=2, marker_size=9)
_SPARE = 0.05  # decades beside the curves
_NAMES = {"train loss": "Training error", "validation loss": "Error on held-back CAE runs"}


def learning_curves(
    curves: Mapping[str, Sequence[tuple[int, float]]], *, value: str, step: str = "Step", total: int
) -> Drawing:
    """Draw values over steps reported during training, ``total`` in the end; logarithmic if all are positive."""
    drawing = new_drawing(height=260)
    for (name, points), colour in zip(curves.items(), ("#0072B2", "#D55E00", "#009E73", "#CC79A7") * 3, strict=False):
        done, values = np.array(points, dtype=np.float64).T
        drawing.points(done, values, name=_NAMES.get(name, name), mode="lines", line_color=colour, line_width=2)
    drawing.update(showlegend=True)
    drawing.axis("x", step, range=[0, total], unifiedhovertitle=None)
    drawing.axis("y", value)
    known = [value for points in curves.values() for _, value in points]
    if known and min(known) > 0:
        # the range is given: Plotly keeps that of the figure before where this one takes its place
        ends = [np.log10(min(known)) - _SPARE, np.log10(max(known)) + _SPARE]
        drawing.axis("y", type="log", tickformat="~g", dtick="D2", range=ends)
    return drawing


def tuning_strength(errors: Mapping[str, float], left_out: Mapping[str, float], chosen: str) -> Drawing:
    """Draw the RMS error for each strength of fine-tuning, on tests learned from and left out."""
    drawing = new_drawing(height=260)
    for name, values, colour in (("Learned from", errors, "#0072B2"), ("Left out", left_out, "#D55E00")):
        look = _MARKED | Look(name=name, line_color=colour, hovertemplate="%{y:.3f}")
        drawing.points(list(values), list(values.values()), **look)
    place = list(errors).index(chosen)
    drawing.rule("x", place, colour=CURSOR, width=None, dash="dot")
    side = "right" if place > len(errors) / 2 else "left"
    drawing.note("chosen", place, 1, "y domain", xanchor=side, yanchor="bottom")
    title = "How far a test may differ from the others (shared part: 1)"
    drawing.axis("x", title, type="category", range=None, unifiedhovertitle=None)
    drawing.axis("y", "Error", "CAE RMS = 1", rangemode="tozero")
    return drawing


_SHIFT = 0.06  # tests, between points of even and of random choices
_RATING = "%{x:.0f} tests: %{y:.3f} ± %{error_y.array:.3f}"


def over_number_of_tests(curve: LearningCurve, display: Display = DEFAULT) -> Drawing:
    """Draw the mean rating, and below it the band's width, over the number of tests learned from.

    Behind the judged approach: the central 80 % of single ratings. Open diamond: expected with one test more.
    """
    table, n, unit = summary(curve), len(curve.campaign.tests), display.unit
    drawing = drawing_of_points(640, "Number of tests learned from", dtick=1 if n < 16 else 5, range=[-0.4, n + 1.5])
    lower: dict[str, tuple[str, str, str]] = {}  # two lines of the title, and the unit
    if table["half_width_g"].notna().any():
        lower["y2"] = "Half width of", "the 95 % band", unit
    if "decided" in table:
        lower["y3"] = "Verdicts", "decided", "%"
    _place_axes(drawing, lower)
    for name in curve.config.approaches:
        rows, colour = table[table["approach"] == name], COLOURS[name]
        if not CLASSES[name].learns_from_tests:
            rating, label = float(curve.by_test(name).iloc[:, -1].mean()), f"{LABELS[name]}, without any test"
            look = _MARKED | Look(name=label, line_color=colour, line_dash=DASHES[name], marker_size=[9, 0.1])
            drawing.points([0, n + 1], [rating, rating], hovertemplate=f"{rating:.3f}<extra>{label}</extra>", **look)
            continue
        even, random = (rows[rows["choice"] == way] for way in ("even", "random"))
        if name == curve.judged:
            sizes, low, high = even[["n_tests", "low", "high"]].to_numpy(dtype=np.float64).T
            drawing.band(sizes, low, high, colour=colour, showlegend=False)
        _ratings(drawing, even, f"{LABELS[name]}, evenly over speed", colour, "circle", -_SHIFT)
        _ratings(drawing, random, f"{LABELS[name]}, at random", colour, "circle-open", _SHIFT)
        half_width, inside = even["half_width_g"] * display.units.factor("g"), 100 * even["inside"].to_numpy()
        hover = f"± %{{y:.1f}} {unit}, %{{customdata:.0f}} % of a(t) inside"
        _below(drawing, even["n_tests"], half_width, name, hover, Look(yaxis="y2", customdata=inside))
        if "decided" in even:
            hover = "%{y:.0f} % of verdicts decided"
            _below(drawing, even["n_tests"], 100 * even["decided"], name, hover, Look(yaxis="y3"))
    _expect(drawing, curve)
    drawing.rule("x", n, colour=CURSOR, dash="dot")
    drawing.note(f"all {n} tests", n, 1, "y domain", xanchor="left", yanchor="bottom")
    return drawing


def _ratings(drawing: Drawing, rows: pd.DataFrame, name: str, colour: str, symbol: str, shift: float) -> None:
    if rows.empty:
        return
    sizes, ratings, errors = rows[["n_tests", "rating", "error"]].fillna({"error": 0.0}).to_numpy(dtype=np.float64).T
    drawing.points(
        sizes + shift, ratings, name=name, numbers={"x": rows["n_tests"].tolist()},
        ends=(ratings - errors, ratings + errors), error_y_width=0, error_y_thickness=1.5, error_y_color=colour,
        line_color=colour, marker_color=colour, marker_symbol=symbol, hovertemplate=f"{_RATING}<extra>{name}</extra>",
        **(_MARKED if symbol == "circle" else {**_MARKED, "mode": "markers"}),
    )  # fmt: skip


def _below(drawing: Drawing, sizes: pd.Series, values: pd.Series, name: str, hover: str, look: Look) -> None:
    if not values.isna().all():
        hover = f"%{{x:.0f}} tests: {hover}<extra>{LABELS[name]}</extra>"
        look |= _MARKED | Look(name=LABELS[name], showlegend=False, line_color=COLOURS[name], hovertemplate=hover)
        drawing.points(sizes.to_numpy(), values.to_numpy(), **look)


def _expect(drawing: Drawing, curve: LearningCurve) -> None:
    name, more = curve.judged, one_more(curve)
    if more is None or not CLASSES[name].learns_from_tests:
        return
    gain, lower, upper = (signed(value, 3) for value in (more.gain, more.lower, more.upper))
    last, colour = curve.by_test(name).iloc[:, -1], COLOURS[name]
    ratings, down, up = np.array([[last.mean(), 0, 0], [more.rating, more.gain - more.lower, more.upper - more.gain]]).T
    drawing.points(
        [last.name, more.n_tests + 1], ratings, mode="lines+markers",
        name=f"{LABELS[name]}, expected with one test more", line_color=colour, line_width=2, line_dash="dot",
        ends=(ratings - down, ratings + up),
        error_y_width=4, error_y_color=colour, marker_color=colour, marker_symbol="diamond-open", marker_size=[0.1, 11],
        hovertemplate=f"{more.n_tests + 1} tests: %{{y:.3f}}; the last one adds {gain} ({lower} to {upper})"
        f"<extra>{LABELS[name]}, expected</extra>",
    )  # fmt: skip


def _place_axes(drawing: Drawing, lower: Mapping[str, tuple[str, str, str]]) -> None:
    drawing.axis("y", "Overall rating, held-out tests")
    drawing.update(margin_t=64)
    share = 0.4 / max(len(lower), 1)
    for number, (axis, (first, second, unit)) in enumerate(lower.items()):
        end, title = 0.4 - number * share, f"{first}<br>{second} ({unit})"
        domain = [end - share + 0.02, end - 0.08]
        drawing.axis(axis, f"{first} {second}", unit, title=title, domain=domain, rangemode="tozero")
        drawing.axis("x", anchor=axis)
    if lower:
        drawing.axis("y", domain=[0.4, 1.0])
        drawing.update(height=520 + 100 * (len(lower) - 1))
