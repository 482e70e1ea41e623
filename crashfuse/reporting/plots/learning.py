"""Figures of learning: of networks while they train, and of approaches over the number of tests."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.reporting.plots.canvas import add_band, new_figure, points_figure
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS, CURSOR, DASHES
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import one_more, summary
from crashfuse.units import signed

_SPARE = 0.05  # decades beside the curves
_NAMES = {"train loss": "Training error", "validation loss": "Error on held-back CAE runs"}


def learning_curves(
    curves: Mapping[str, Sequence[tuple[int, float]]], *, value: str, step: str = "Step", total: int
) -> go.Figure:
    """Draw values over steps reported during training, ``total`` in the end; logarithmic if all are positive."""
    figure = new_figure(height=260)
    for (name, points), colour in zip(curves.items(), ("#0072B2", "#D55E00", "#009E73", "#CC79A7") * 3, strict=False):
        done, values = np.array(points, dtype=np.float64).T
        figure.add_scatter(x=done, y=values, name=_NAMES.get(name, name), mode="lines", line_color=colour, line_width=2)
    figure.update_layout(showlegend=True)
    figure.update_xaxes(title=step, range=[0, total], unifiedhovertitle=None)
    figure.update_yaxes(title=value)
    known = [value for points in curves.values() for _, value in points]
    if known and min(known) > 0:
        # the range is given: Plotly keeps that of the figure before where this one takes its place
        ends = [np.log10(min(known)) - _SPARE, np.log10(max(known)) + _SPARE]
        figure.update_yaxes(type="log", tickformat="~g", dtick="D2", range=ends)
    return figure


def tuning_strength(errors: Mapping[str, float], left_out: Mapping[str, float], chosen: str) -> go.Figure:
    """Draw the RMS error for each strength of fine-tuning: on tests used for it, and on tests left out in turn."""
    figure = new_figure(height=260)
    for name, values, colour in (("Learned from", errors, "#0072B2"), ("Left out", left_out, "#D55E00")):
        figure.add_scatter(
            x=list(values), y=list(values.values()), name=name, mode="lines+markers",
            line_color=colour, line_width=2, marker_size=9, hovertemplate="%{y:.3f}",
        )  # fmt: skip
    place = list(errors).index(chosen)
    side = "left" if place > len(errors) / 2 else "right"
    figure.add_vline(
        x=place, line_color=CURSOR, line_dash="dot", annotation_text="chosen", annotation_position=f"top {side}"
    )
    title = "How far a test may differ from the others (shared part: 1)"
    figure.update_xaxes(title=title, type="category", range=None, unifiedhovertitle=None)
    figure.update_yaxes(title="Error (CAE RMS = 1)", rangemode="tozero")
    return figure


_SHIFT = 0.06  # tests, between points of even and of random choices
_RATING = "%{x:.0f} tests: %{y:.3f} ± %{error_y.array:.3f}"


def over_number_of_tests(curve: LearningCurve, display: Display = DEFAULT) -> go.Figure:
    """Draw the mean rating, and below it the band's width, over the number of tests learned from.

    Behind the judged approach: the central 80 % of single ratings. Open diamond: expected with one test more.
    """
    table, n, unit = summary(curve), len(curve.campaign.tests), display.unit
    figure = points_figure(640, "Number of tests learned from", range=[-0.4, n + 1.5], dtick=1 if n < 16 else 5)
    for name in curve.config.approaches:
        rows, colour = table[table["approach"] == name], COLOURS[name]
        if not CLASSES[name].learns_from_tests:
            rating, label = float(curve.by_test(name).iloc[:, -1].mean()), f"{LABELS[name]}, without any test"
            hover = f"{rating:.3f}<extra>{label}</extra>"
            figure.add_scatter(
                x=[0, n + 1], y=[rating, rating], mode="lines+markers", name=label, line_color=colour, line_width=2,
                line_dash=DASHES[name], marker_size=[9, 0.1], hovertemplate=hover,
            )  # fmt: skip
            continue
        even, random = (rows[rows["choice"] == way] for way in ("even", "random"))
        if name == curve.judged:
            sizes, low, high = even[["n_tests", "low", "high"]].to_numpy(dtype=np.float64).T
            add_band(figure, sizes, low, high, colour=colour, showlegend=False)
        _ratings(figure, even, f"{LABELS[name]}, evenly over speed", colour, "circle", -_SHIFT)
        _ratings(figure, random, f"{LABELS[name]}, at random", colour, "circle-open", _SHIFT)
        half_width, hover = even["half_width_g"] * display.units.factor("g"), "%{customdata:.0f} % of a(t) inside"
        _below(figure, even, half_width, name, "y2", f"± %{{y:.1f}} {unit}, {hover}", customdata=100 * even["inside"])
        if "decided" in even:
            _below(figure, even, 100 * even["decided"], name, "y3", "%{y:.0f} % of verdicts decided")
    _expect(figure, curve)
    lower = {"y2": display.title("Half width of<br>the 95 % band", "g")} if table["half_width_g"].notna().any() else {}
    if "decided" in table:
        lower["y3"] = "Verdicts<br>decided (%)"
    _label_axes(figure, n, lower)
    return figure


def _ratings(figure: go.Figure, rows: pd.DataFrame, name: str, colour: str, symbol: str, shift: float) -> None:
    if rows.empty:
        return
    figure.add_scatter(
        x=rows["n_tests"] + shift, y=rows["rating"], mode="lines+markers" if symbol == "circle" else "markers",
        name=name, meta={"x": rows["n_tests"].tolist()}, error_y_array=rows["error"].fillna(0.0), error_y_width=0,
        error_y_thickness=1.5, error_y_color=colour, line_color=colour, line_width=2, marker_color=colour,
        marker_symbol=symbol, marker_size=9, hovertemplate=f"{_RATING}<extra>{name}</extra>",
    )  # fmt: skip


def _below(
    figure: go.Figure, rows: pd.DataFrame, values: pd.Series, name: str, yaxis: str, hover: str, **data: object
) -> None:
    if not values.isna().all():
        figure.add_scatter(
            x=rows["n_tests"], y=values, yaxis=yaxis, mode="lines+markers", name=LABELS[name], showlegend=False,
            line_color=COLOURS[name], line_width=2, marker_size=9,
            hovertemplate=f"%{{x:.0f}} tests: {hover}<extra>{LABELS[name]}</extra>", **data,
        )  # fmt: skip


def _expect(figure: go.Figure, curve: LearningCurve) -> None:
    name, more = curve.judged, one_more(curve)
    if more is None or not CLASSES[name].learns_from_tests:
        return
    gain, lower, upper = (signed(value, 3) for value in (more.gain, more.lower, more.upper))
    last, colour = curve.by_test(name).iloc[:, -1], COLOURS[name]
    figure.add_scatter(
        x=[last.name, more.n_tests + 1], y=[last.mean(), more.rating], mode="lines+markers",
        name=f"{LABELS[name]}, expected with one test more", line_color=colour, line_width=2, line_dash="dot",
        error_y_array=[0, more.upper - more.gain], error_y_arrayminus=[0, more.gain - more.lower], error_y_width=4,
        error_y_color=colour,
        marker_color=colour, marker_symbol="diamond-open", marker_size=[0.1, 11],
        hovertemplate=f"{more.n_tests + 1} tests: %{{y:.3f}}; the last one adds {gain} ({lower} to {upper})"
        f"<extra>{LABELS[name]}, expected</extra>",
    )  # fmt: skip


def _label_axes(figure: go.Figure, n: int, lower: dict[str, str]) -> None:
    figure.update_layout(margin_t=64)
    figure.update_yaxes(title="Overall rating, held-out tests")
    look, share = figure.layout.yaxis.to_plotly_json(), 0.4 / max(len(lower), 1)
    for number, (axis, label) in enumerate(lower.items()):
        end = 0.4 - number * share
        panel = {**look, "domain": [end - share + 0.02, end - 0.08], "title": label, "rangemode": "tozero"}
        figure.update_layout({f"yaxis{axis[1:]}": panel, "xaxis": {"anchor": axis}})
    if lower:
        figure.update_layout(yaxis_domain=[0.4, 1.0], height=520 + 100 * (len(lower) - 1))
    figure.add_vline(
        x=n, line_color=CURSOR, line_width=1, line_dash="dot", annotation_text=f"all {n} tests",
        annotation_position="top right",
    )  # fmt: skip
