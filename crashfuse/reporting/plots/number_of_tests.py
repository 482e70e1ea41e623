"""Figure of a learning curve: rating and width of the band over the number of tests learned from."""

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.reporting.plots.canvas import add_band, new_figure
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS, CURSOR, DASHES
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import OneMore, one_more, summary
from crashfuse.wording import signed

_SHIFT = 0.06  # tests, between points of even and of random choices
_RATING = "%{x:.0f} tests: %{y:.3f} ± %{error_y.array:.3f}"


def over_number_of_tests(curve: LearningCurve, display: Display = DEFAULT) -> go.Figure:
    """Draw the mean rating, and below it the band's width, over the number of tests learned from.

    Points are means over the held-out tests with their standard error: filled and joined for tests chosen evenly over
    speed, open for tests chosen at random. Behind the judged approach lie the central 80 % of its single predictions.
    What learns from no test is a level line from zero tests. The open diamond is the rating expected with one test more
    than the campaign has, with its 95 % interval.
    """
    figure, table = new_figure(height=640), summary(curve)
    n = len(curve.campaign.tests)
    for name in curve.config.approaches:
        own = table[table["approach"] == name]
        if not CLASSES[name].learns_from_tests:
            _level(figure, name, float(curve.by_test(name).iloc[:, -1].mean()), n + 1)
            continue
        even, random = (own[own["choice"] == way] for way in ("even", "random"))
        if name == curve.judged:
            sizes, low, high = even[["n_tests", "low", "high"]].to_numpy(dtype=np.float64).T
            add_band(figure, sizes, low, high, colour=COLOURS[name], showlegend=False)
        _points(figure, name, even, "evenly over speed", "circle", -_SHIFT)
        _points(figure, name, random, "at random", "circle-open", _SHIFT)
        _widths(figure, name, even, display)
        _decided(figure, name, even)
    if CLASSES[curve.judged].learns_from_tests and (more := one_more(curve)) is not None:
        _expected(figure, curve, more)
    lower = {"y2": display.title("Half width of<br>the 95 % band", "g")} if table["half_width_g"].notna().any() else {}
    if "decided" in table:
        lower["y3"] = "Verdicts<br>decided (%)"
    _axes(figure, n, lower)
    return figure


def _level(figure: go.Figure, name: str, rating: float, end: int) -> None:
    figure.add_scatter(
        x=[0, end], y=[rating, rating], mode="lines+markers",
        name=f"{LABELS[name]}, without any test",
        line={"color": COLOURS[name], "width": 2, "dash": DASHES[name]}, marker={"size": [9, 0.1]},
        hovertemplate=f"{rating:.3f}<extra>{LABELS[name]}, without any test</extra>",
    )  # fmt: skip


def _points(figure: go.Figure, name: str, own: pd.DataFrame, way: str, symbol: str, shift: float) -> None:
    if own.empty:
        return
    joined = "lines+markers" if symbol == "circle" else "markers"
    figure.add_scatter(
        x=own["n_tests"] + shift, y=own["rating"], mode=joined, name=f"{LABELS[name]}, {way}",
        meta={"x": own["n_tests"].tolist()},
        error_y={"array": own["error"].fillna(0.0), "width": 0, "thickness": 1.5, "color": COLOURS[name]},
        line={"color": COLOURS[name], "width": 2}, marker={"color": COLOURS[name], "symbol": symbol, "size": 9},
        hovertemplate=f"{_RATING}<extra>{LABELS[name]}, {way}</extra>",
    )  # fmt: skip


def _widths(figure: go.Figure, name: str, even: pd.DataFrame, display: Display) -> None:
    if even["half_width_g"].isna().all():
        return
    figure.add_scatter(
        x=even["n_tests"], y=even["half_width_g"] * display.units.factor("g"), yaxis="y2",
        mode="lines+markers", name=LABELS[name], showlegend=False, line={"color": COLOURS[name], "width": 2},
        marker={"size": 9}, customdata=100 * even["inside"],
        hovertemplate=f"%{{x:.0f}} tests: ± %{{y:.1f}} {display.unit}, %{{customdata:.0f}} % of a(t) inside"
        f"<extra>{LABELS[name]}</extra>",
    )  # fmt: skip


def _decided(figure: go.Figure, name: str, even: pd.DataFrame) -> None:
    if "decided" not in even or even["decided"].isna().all():
        return
    figure.add_scatter(
        x=even["n_tests"], y=100 * even["decided"], yaxis="y3", mode="lines+markers",
        name=LABELS[name], showlegend=False, line={"color": COLOURS[name], "width": 2}, marker={"size": 9},
        hovertemplate=f"%{{x:.0f}} tests: %{{y:.0f}} % of verdicts decided<extra>{LABELS[name]}</extra>",
    )  # fmt: skip


def _expected(figure: go.Figure, curve: LearningCurve, more: OneMore) -> None:
    """Join the last point to the rating expected with one test more than the campaign has."""
    name = curve.judged
    gain, lower, upper = (signed(value, 3) for value in (more.gain, more.lower, more.upper))
    last = curve.by_test(name).iloc[:, -1]
    figure.add_scatter(
        x=[last.name, more.n_tests + 1], y=[last.mean(), more.rating], mode="lines+markers",
        name=f"{LABELS[name]}, expected with one test more", line={"color": COLOURS[name], "width": 2, "dash": "dot"},
        error_y={
            "array": [0, more.upper - more.gain],
            "arrayminus": [0, more.gain - more.lower],
            "width": 4,
            "color": COLOURS[name],
        },
        marker={"color": COLOURS[name], "symbol": "diamond-open", "size": [0.1, 11]},
        hovertemplate=f"{more.n_tests + 1} tests: %{{y:.3f}}; the last one adds {gain} ({lower} to {upper})"
        f"<extra>{LABELS[name]}, expected</extra>",
    )  # fmt: skip


def _axes(figure: go.Figure, n: int, lower: dict[str, str]) -> None:
    """Label the axes; below the ratings lie further panels, by axis with their titles."""
    title = "Number of tests learned from"
    figure.update_layout(hovermode="closest", margin={"t": 64})
    figure.update_xaxes(
        title=title, range=[-0.4, n + 1.5], dtick=1 if n < 16 else 5, showspikes=False, unifiedhovertitle=None,
        zeroline=False,
    )  # fmt: skip
    figure.update_yaxes(title="Overall rating, held-out tests")
    look, share = figure.layout.yaxis.to_plotly_json(), 0.4 / max(len(lower), 1)
    for number, (axis, label) in enumerate(lower.items()):
        end = 0.4 - number * share
        own = {**look, "domain": [end - share + 0.02, end - 0.08], "title": label, "rangemode": "tozero"}
        figure.update_layout({f"yaxis{axis[1:]}": own, "xaxis": {"anchor": axis}})
    if lower:
        figure.update_layout(yaxis={"domain": [0.4, 1.0]}, height=640 + 120 * (len(lower) - 1))
    figure.add_vline(
        x=n, line={"color": CURSOR, "width": 1, "dash": "dot"}, annotation_text=f"all {n} tests",
        annotation_position="top right",
    )  # fmt: skip
