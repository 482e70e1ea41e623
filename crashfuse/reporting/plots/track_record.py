"""Figures of the track record: what left-out tests were predicted to show, and how often probabilities came true."""

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
import plotly.graph_objects as go

from crashfuse.certification.criteria import Criterion
from crashfuse.certification.track_record import TrackRecord, Trial
from crashfuse.certification.verdict import WORDS
from crashfuse.reporting.plots.canvas import new_figure, tick_name
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import AXIS, CURSOR, INK, MEASURED_COLOUR, PAPER, VERDICT_COLOURS
from crashfuse.signals.pulse import FloatArray

_AGREES, _DISAGREES = "#0072B2", "#D55E00"
_INTERVAL = "#868D98"
_NONE = "No test was left out: nothing to compare with."


def reliability(record: TrackRecord) -> go.Figure:
    """Draw the share of left-out tests that met a criterion over the probability that was given, with exact bounds.

    Lines are Clopper and Pearson's 95 % bounds of the share; a bin whose probability lies outside them is drawn open.
    """
    figure = new_figure(height=440)
    if not record.reliability:
        _say(figure, "No left-out test lies inside what the others check." if record.trials else _NONE)
        return figure
    figure.add_scatter(
        x=[0, 1], y=[0, 1], mode="lines", name="As promised", line={"color": AXIS, "dash": "dot"}, hoverinfo="skip"
    )
    for name, colour, symbol, holds in (
        ("Within its bounds", _AGREES, "circle", True),
        ("Outside its bounds", _DISAGREES, "circle-open", False),
    ):
        bins = [each for each in record.reliability if each.holds is holds]
        if not bins:
            continue
        met = np.array([each.met for each in bins], dtype=np.float64)
        figure.add_scatter(
            x=np.array([each.probability for each in bins], dtype=np.float64),
            y=met,
            error_y={
                "array": np.array([each.upper for each in bins]) - met,
                "arrayminus": met - np.array([each.lower for each in bins]),
                "thickness": 1.5,
                "width": 4,
            },
            text=[f"n = {each.n}" for each in bins],
            textposition=["top center" if each.met >= 0.5 else "bottom center" for each in bins],
            mode="markers+text",
            cliponaxis=False,
            name=name,
            marker={"color": colour, "symbol": symbol, "size": 11, "line": {"width": 2, "color": colour}},
            customdata=[
                [each.low, each.high, each.n, round(each.met * each.n), each.lower, each.upper] for each in bins
            ],
            hovertemplate="said %{customdata[0]:.2f} to %{customdata[1]:.2f}, %{x:.3f} on average<br>"
            "%{customdata[3]} of %{customdata[2]} met: %{y:.3f} (95 %: %{customdata[4]:.3f} to %{customdata[5]:.3f})"
            "<extra></extra>",
        )
    figure.update_layout(hovermode="closest", showlegend=True)
    axis = {"range": [-0.09, 1.09], "tickvals": [0, 0.2, 0.4, 0.6, 0.8, 1], "zeroline": False}
    figure.update_xaxes({**axis, "title": "Probability given in advance"})
    figure.update_xaxes(showspikes=False, unifiedhovertitle=None)
    figure.update_yaxes({**axis, "title": "Share of tests that met it"})
    return figure


def record_figure(record: TrackRecord, display: Display = DEFAULT) -> go.Figure:
    """Draw by criterion what left-out tests were predicted to show, with intervals, what they showed, and the limits.

    Tests stand in order of speed. A ring marks a verdict that the test contradicts.
    """
    trials = sorted(record.counted, key=lambda trial: trial.verdict.condition.speed_mps)
    criteria = _in_order(record)
    tests = list(dict.fromkeys(trial.held_out for trial in trials))
    figure = new_figure(height=max(120 + 210 * len(criteria), 330))
    if not criteria:
        _say(figure, _NONE)
        return figure
    x_style, y_style = (axis.to_plotly_json() for axis in (figure.layout.xaxis, figure.layout.yaxis))
    figure.set_subplots(len(criteria), 1, shared_xaxes=True, vertical_spacing=0.24 / (len(criteria) + 0.6))
    figure.update_xaxes({**x_style, "title": None, "showspikes": False, "zeroline": False, "unifiedhovertitle": None})
    names = [tick_name(test) for test in tests]
    figure.update_xaxes(range=[-0.6, len(tests) - 0.4], tickvals=list(range(len(tests))), ticktext=names)
    figure.update_yaxes(y_style)
    for row, criterion in enumerate(criteria, start=1):
        own = [trial for trial in trials if trial.verdict.criterion == criterion]
        _draw_trials(figure, own, criterion, tests, row, display)
    for word in WORDS:
        _legend(figure, f"predicted, {word}", color=VERDICT_COLOURS[word], symbol="square", line_color=INK)
    _legend(figure, "left out with its speed group", color="rgba(0, 0, 0, 0)", symbol="diamond", line_color=INK)
    _legend(figure, "measured", color=MEASURED_COLOUR, symbol="circle", line_color=MEASURED_COLOUR)
    if wrong := any(trial.wrong for trial in trials):
        _legend(figure, "wrong verdict", color=_DISAGREES, symbol="circle-open", line_color=_DISAGREES)
    figure.update_layout(hovermode="closest", hoverlabel={"align": "left"}, margin={"l": 72, "t": 96 if wrong else 72})
    figure.update_xaxes(title="Left-out test, in order of speed", row=len(criteria))
    return figure


def _in_order(record: TrackRecord) -> list[Criterion]:
    """All criteria in their order, although the records of some tests may be too short for some."""
    by_test: dict[tuple[str, str], list[Criterion]] = {}
    for trial in record.trials:
        by_test.setdefault((trial.held_out, trial.left_out), []).append(trial.verdict.criterion)
    fullest_first = sorted(by_test.values(), key=len, reverse=True)
    return list(dict.fromkeys(criterion for some in fullest_first for criterion in some))


def _draw_trials(
    figure: go.Figure, trials: Sequence[Trial], criterion: Criterion, tests: list[str], row: int, display: Display
) -> None:
    """One row of the record: predictions with intervals, measured values, rings around wrong verdicts, limits."""
    factor = display.units.factor(criterion.unit)
    for left_out, symbol in (("test", "square"), ("speed group", "diamond")):
        own = [trial for trial in trials if trial.left_out == left_out and trial.verdict.value is not None]
        value, lower, upper = factor * _numbers([(t.verdict.value, t.verdict.lower, t.verdict.upper) for t in own])
        figure.add_scatter(
            x=[_place(trial, tests) for trial in own],
            meta={"x": [trial.held_out for trial in own]},
            y=value,
            error_y={"array": upper - value, "arrayminus": value - lower, "width": 0, "color": _INTERVAL},
            mode="markers",
            marker={
                "color": [VERDICT_COLOURS[trial.verdict.word] for trial in own],
                "symbol": symbol,
                "size": 10,
                "line": {"width": 1, "color": INK},
            },
            hovertext=[_told(trial, display) for trial in own],
            hovertemplate="%{hovertext}<extra></extra>",
            showlegend=False,
            row=row,
            col=1,
        )
    wrong = [trial for trial in trials if trial.wrong]
    for name, some, marker in (
        ("measured", trials, {"color": MEASURED_COLOUR, "size": 7, "line": {"width": 1, "color": PAPER}}),
        ("wrong", wrong, {"color": _DISAGREES, "symbol": "circle-open", "size": 20, "line": {"width": 2.5}}),
    ):
        figure.add_scatter(
            x=[_place(trial, tests) for trial in some],
            meta={"x": [trial.held_out for trial in some]},
            y=factor * np.array([trial.measured for trial in some], dtype=np.float64),
            mode="markers",
            name=name,
            marker=marker,
            hovertext=[_told(trial, display) for trial in some],
            hovertemplate="%{hovertext}<extra></extra>",
            showlegend=False,
            row=row,
            col=1,
        )
    for limit in (criterion.at_least, criterion.at_most):
        if limit is not None:
            figure.add_hline(y=factor * limit, line={"color": CURSOR, "width": 1.5, "dash": "dash"}, row=row, col=1)
    figure.add_annotation(
        text=f"<b>{criterion.name}</b>: {display.words(criterion.limits)} (dashed)", x=0, xref="x domain",
        xanchor="left", y=1, yref="y domain", yanchor="bottom", showarrow=False, row=row, col=1,
    )  # fmt: skip
    title = "Rating" if criterion.window_ms is not None else display.title(criterion.label, criterion.unit)
    figure.update_yaxes(title={"text": "<br>".join(wrap(title, 24)), "font": {"size": 13}}, row=row)


def _told(trial: Trial, display: Display) -> str:
    verdict, alone = trial.verdict, trial.left_out == "test"

    def shown(value: float | None) -> str:
        return display.words(verdict.criterion.shown(value))

    return "<br>".join(
        [
            f"<b>{trial.held_out}</b>, left out {'alone' if alone else 'with its speed group'}",
            f"predicted {shown(verdict.value)}, 95 % of tests "
            f"{display.words(verdict.criterion.interval(verdict.lower, verdict.upper))}",
            f"measured {shown(trial.measured)}: {'met' if trial.met else 'not met'}",
            f"verdict: {verdict.word}{', wrong' * trial.wrong}",
        ]
    )


def _place(trial: Trial, tests: list[str]) -> float:
    return tests.index(trial.held_out) + (-0.14 if trial.left_out == "test" else 0.14)


def _numbers(rows: Sequence[tuple[float | None, ...]]) -> FloatArray:
    return np.array([[np.nan if each is None else each for each in row] for row in rows]).reshape(-1, 3).T


def _legend(figure: go.Figure, name: str, *, color: str, symbol: str, line_color: str) -> None:
    marker = {"color": color, "symbol": symbol, "size": 10, "line": {"width": 1, "color": line_color}}
    figure.add_scatter(x=[None], y=[None], mode="markers", name=name, marker=marker, hoverinfo="skip", row=1, col=1)


def _say(figure: go.Figure, words: str) -> None:
    figure.add_annotation(text=words, x=0.5, y=0.5, xref="paper", yref="paper", showarrow=False)
    figure.update_layout(showlegend=False, xaxis_visible=False, yaxis_visible=False)
