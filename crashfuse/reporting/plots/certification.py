"""Figures of a certification: the matrix of verdicts, and the validated domain."""

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb

from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.track_record import TrackRecord, Trial
from crashfuse.certification.verdict import WORDS, Verdict, Word
from crashfuse.condition import Condition
from crashfuse.reporting.certification_tables import ANSWER, answer_texts
from crashfuse.reporting.figures import WITH_GROUP, how_left_out
from crashfuse.reporting.plots.canvas import fix_cells, make_clickable, marks_of_runs, points_figure, tick_name
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import AXIS, CURSOR, INK, MEASURED_COLOUR, PAPER, VERDICT_COLOURS
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import probability_text, unbroken

MOST_WORDS = 400  # of more conditions only colours are drawn: a browser would take many seconds for the words

_ROW_PX, _ALL_ROWS_PX = 34, 1600
_BELOW_PX = 44  # of the legend
_LETTER_PX, _LINE_PX = 7, 19  # of names beside and above the cells, rather more than they take
_HEADER_CHARACTERS = 45  # of all columns together, on paper
_LETTERS = 130  # size in px, times the columns, with which "not met", or "<0.001" below it, fits into a cell
_WORST_FIRST: tuple[Word, ...] = ("outside", "not met", "open", "met")
_SYMBOLS = {"met": "circle", "not met": "x", "open": "diamond", "outside": "triangle-up"}
_MAX_RUNS = 600  # more points only fill the same cloud
_CHECKED = _AGREES = "#0072B2"
_DISAGREES, _INTERVAL = "#D55E00", "#868D98"
_NONE = "No test was left out: nothing to compare with."


def verdict_matrix(
    certification: Certification, display: Display = DEFAULT, part: slice = slice(None), *, words: bool = True
) -> go.Figure:
    """Draw verdicts as a table of conditions, sorted by speed, by criteria, with the answer beside each row.

    A mark carries ``"<condition> | <criterion>"``. ``part`` takes some of the sorted conditions.
    """
    by_speed = sorted(certification.rows.items(), key=lambda row: row[1][0].condition.speed_mps)  # else as they come
    ids, rows = zip(*by_speed[part], strict=True)
    criteria, confidence = certification.criteria.items, certification.criteria.confidence
    width = min(max(_HEADER_CHARACTERS // len(criteria), 9), 22)
    names = [_header(criterion, width, display) for criterion in criteria]
    speeds = [display.speed(row[0].condition.speed_mps) for row in rows]
    labels, short = ([f"{name(i)} · {v}" for i, v in zip(ids, speeds, strict=True)] for name in (str, tick_name))
    with_words = words and len(rows) <= MOST_WORDS
    above = max(name.count("<br>") + 1 for name in names) * _LINE_PX + 12
    figure = points_figure(above + _BELOW_PX + _ROW_PX * len(rows) if with_words else _ALL_ROWS_PX)
    hover = [[_hover(i, verdict, display) for verdict in row] for i, row in zip(ids, rows, strict=True)]
    answers = answer_texts(certification)
    codes = np.array([[WORDS.index(verdict.word) for verdict in row] for row in rows], dtype=np.int8)
    scale = [(end / len(WORDS), VERDICT_COLOURS[w]) for i, w in enumerate(WORDS) for end in (i, i + 1)]
    figure.add_heatmap(
        z=codes, x=names, y=labels, colorscale=scale, zmin=-0.5, zmax=len(WORDS) - 0.5, showscale=False,
        xgap=2, ygap=2 if with_words else 0, meta={ANSWER: [answers[i] for i in ids]},
    )  # fmt: skip
    if with_words:
        figure.update_traces(
            text=[[_cell(verdict, confidence) for verdict in row] for row in rows],
            texttemplate="%{text}",
            textfont={"color": MEASURED_COLOUR, "size": min(12, max(_LETTERS // len(names), 6))},
            hoverinfo="skip",
        )
        cells = [f"{i} | {verdict.criterion.name}" for i, row in zip(ids, rows, strict=True) for verdict in row]
        make_clickable(figure, names, labels, cells, 20, **_over([text for row in hover for text in row]))
    else:
        figure.update_traces(**_over(hover))
    told = [verdict.word for row in rows for verdict in row]
    for word in WORDS:
        _legend(figure, f"{word} ({told.count(word)})", _marker(VERDICT_COLOURS[word], "square", 13, 1, None))
    fix_cells(figure, len(names), len(rows))
    left = max(map(len, short), default=0) * _LETTER_PX + 6
    figure.update_layout(hoverlabel_align="left", margin_l=left, margin_t=above, margin_b=_BELOW_PX)
    figure.update_layout(legend_y=0, legend_yanchor="bottom")
    if with_words:
        figure.update_yaxes(tickvals=labels, ticktext=short)
        beside = [answers[i] for i in ids]  # at an axis, which is drawn as marks are on it
        right = {"overlaying": "y", "side": "right", "categoryarray": labels, "ticktext": beside}
        axis = {**figure.layout.yaxis.to_plotly_json(), **right, "ticklabelstandoff": 4}
        figure.update_layout(yaxis2=axis, margin_r=max(map(len, [*beside, ANSWER])) * _LETTER_PX + 10)
        figure.update_traces(yaxis="y2", selector={"mode": "markers", "showlegend": False})
        figure.add_annotation(
            text=f"<b>{ANSWER}</b>", x=1, y=1, xref="paper", yref="paper", xanchor="left", yanchor="bottom", xshift=3,
            showarrow=False,
        )  # fmt: skip
    return figure


def _header(criterion: Criterion, width: int, display: Display) -> str:
    name = [f"<b>{line}</b>" for line in wrap(criterion.name, width)]
    return "<br>".join(name + wrap(unbroken(display.words(criterion.limits)), width))


def _cell(verdict: Verdict, confidence: float) -> str:
    if verdict.word == "outside" or verdict.probability is None:
        return verdict.word
    return f"{verdict.word}<br>{probability_text(verdict.probability, confidence)}"


def _hover(condition_id: str, verdict: Verdict, display: Display) -> str:
    lines = [
        f"<b>{condition_id}, {verdict.criterion.name}: {verdict.word}</b>",
        display.condition(verdict.condition),
        *wrap(display.words(verdict.reason), 78),
    ]
    if verdict.word == "outside":  # else the reason has the numbers
        lines.append(display.words(verdict.expected))
    return "<br>".join(lines)


def validated_domain(certification: Certification, display: Display = DEFAULT) -> go.Figure:
    """Draw total mass over speed: the checked region, CAE runs, tests, and conditions by their worst verdict."""
    domain, campaign = certification.domain, certification.campaign
    figure = points_figure(480, display.title("Impact speed", "mph"))
    mass_low, mass_high = map(display.weights, domain.checked_masses_kg)
    for number, ends in enumerate(domain.speed_ranges_mps):
        low, high = map(display.speeds, ends)
        figure.add_scatter(
            x=[low, high, high, low, low], y=[mass_low, mass_low, mass_high, mass_high, mass_low], mode="lines",
            name="Validated domain", legendgroup="checked", showlegend=number == 0, fill="toself",
            fillcolor=f"rgba{(*hex_to_rgb(_CHECKED), 0.18)}", line_color=_CHECKED, line_width=1, line_dash="dash",
            hoverinfo="skip",
        )  # fmt: skip
    runs = campaign.cae.vectors[:: -(-len(campaign.cae) // _MAX_RUNS)]
    figure.add_scatter(
        x=display.speeds(runs[:, 0]), y=display.weights(runs[:, 1:].sum(axis=1)), mode="markers", hoverinfo="skip",
        name=f"{len(campaign.cae):,} CAE runs", marker=marks_of_runs(len(runs)),
    )  # fmt: skip

    def draw(name: str, some: Sequence[tuple[str, Condition, str]], marker: dict[str, object]) -> None:
        figure.add_scatter(
            x=[display.speeds(condition.speed_mps) for _, condition, _ in some],
            y=[display.weights(condition.mass_kg) for _, condition, _ in some], mode="markers", name=name,
            marker=marker, **_over([f"<b>{i}</b><br>{display.condition(at)}{more}" for i, at, more in some]),
        )  # fmt: skip

    rows = certification.rows.items()
    for word in _WORST_FIRST:
        some = [
            (i, row[0].condition, "".join(f"<br>{verdict.criterion.name}: {verdict.word}" for verdict in row))
            for i, row in rows
            if worst(row) == word
        ]
        if some:
            marker = _marker(VERDICT_COLOURS[word], _SYMBOLS[word], 13, 1.5, INK)
            draw(f"Worst verdict: {word} ({len(some)})", some, marker)
    tests = [(f"Test {test.id}", test.condition, "") for test in campaign.tests]
    draw(f"{len(tests)} tests", tests, _marker(None, "cross-thin", 11, 2, MEASURED_COLOUR))
    figure.update_yaxes(title=display.title("Front and rear weight together", "lb"))
    return figure


def worst(verdicts: Sequence[Verdict]) -> Word:
    """The worst word among verdicts on one condition."""
    return min((verdict.word for verdict in verdicts), key=_WORST_FIRST.index)


def reliability(record: TrackRecord) -> go.Figure:
    """Draw the share of left-out tests that met a criterion over the probability given, open if bounds exclude it."""
    axis = {"range": [-0.09, 1.09], "tickvals": [0, 0.2, 0.4, 0.6, 0.8, 1], "zeroline": False}
    figure = points_figure(440, "Probability given in advance", **axis)
    if not record.reliability:
        _say(figure, "No left-out test lies inside what the others check." if record.trials else _NONE)
        return figure
    figure.add_scatter(
        x=[0, 1], y=[0, 1], mode="lines", name="As promised", line_color=AXIS, line_dash="dot", hoverinfo="skip"
    )
    for name, colour, symbol, holds in (
        ("Within its bounds", _AGREES, "circle", True),
        ("Outside its bounds", _DISAGREES, "circle-open", False),
    ):
        if bins := [each for each in record.reliability if each.holds is holds]:
            probability, met, lower, upper = np.array([(b.probability, b.met, b.lower, b.upper) for b in bins]).T
            texts = [
                f"said {b.low:.2f} to {b.high:.2f}, {b.probability:.3f} on average<br>{round(b.met * b.n)} of "
                f"{b.n} met: {b.met:.3f} (95 %: {b.lower:.3f} to {b.upper:.3f})"
                for b in bins
            ]
            figure.add_scatter(
                x=probability, y=met, mode="markers+text", cliponaxis=False, name=name,
                error_y_array=upper - met, error_y_arrayminus=met - lower, error_y_thickness=1.5, error_y_width=4,
                text=[f"n = {each.n}" for each in bins], marker=_marker(colour, symbol, 11, 2, colour),
                textposition=["top center" if each.met >= 0.5 else "bottom center" for each in bins], **_over(texts),
            )  # fmt: skip
    figure.update_layout(showlegend=True)
    figure.update_yaxes(axis, title="Share of tests that met it")
    return figure


def record_figure(record: TrackRecord, criteria: Sequence[Criterion], display: Display = DEFAULT) -> go.Figure:
    """Draw by criterion what left-out tests were predicted to show and showed, in order of speed, and the limits."""
    criteria = [criterion for criterion in criteria if record.of(criterion)]
    trials = [trial for trial in record.counted if trial.verdict.criterion in criteria]
    trials.sort(key=lambda trial: trial.verdict.condition.speed_mps)
    tests = list(dict.fromkeys(trial.held_out for trial in trials))
    figure = points_figure(max(120 + 210 * len(criteria), 330))
    if not criteria:
        _say(figure, _NONE)
        return figure
    x_style, y_style = (axis.to_plotly_json() for axis in (figure.layout.xaxis, figure.layout.yaxis))
    figure.set_subplots(len(criteria), 1, shared_xaxes=True, vertical_spacing=0.24 / (len(criteria) + 0.6))
    names = [tick_name(test) for test in tests]
    figure.update_xaxes(x_style, range=[-0.6, len(tests) - 0.4], tickvals=list(range(len(tests))), ticktext=names)
    figure.update_yaxes(y_style)
    for row, criterion in enumerate(criteria, start=1):
        own = [trial for trial in trials if trial.verdict.criterion == criterion]
        _draw_trials(figure, own, criterion, tests, row, display)
    for word in WORDS:
        _legend(figure, f"predicted, {word}", _marker(VERDICT_COLOURS[word], "square", 10, 1, INK))
    _legend(figure, WITH_GROUP, _marker("rgba(0, 0, 0, 0)", "diamond", 10, 1, INK))
    _legend(figure, "measured", _marker(MEASURED_COLOUR, "circle", 10, 1, MEASURED_COLOUR))
    if wrong := any(trial.wrong for trial in trials):
        _legend(figure, "wrong verdict", _marker(_DISAGREES, "circle-open", 10, 1, _DISAGREES))
    figure.update_layout(hoverlabel_align="left", margin_l=72, margin_t=96 if wrong else 72)
    figure.update_xaxes(title="Left-out test, in order of speed", row=len(criteria))
    return figure


def _draw_trials(
    figure: go.Figure, trials: Sequence[Trial], criterion: Criterion, tests: list[str], row: int, display: Display
) -> None:
    factor = display.units.factor(criterion.unit)

    def draw(some: Sequence[Trial], values: FloatArray, **look: object) -> None:
        figure.add_scatter(
            x=[tests.index(trial.held_out) + (-0.14 if trial.left_out == "test" else 0.14) for trial in some], y=values,
            meta={"x": [trial.held_out for trial in some]}, mode="markers", showlegend=False, row=row, col=1, **look,
            **_over([_told(trial, display) for trial in some]),
        )  # fmt: skip

    for left_out, symbol in (("test", "square"), ("speed group", "diamond")):
        own = [trial for trial in trials if trial.left_out == left_out and trial.verdict.value is not None]
        ends = [(trial.verdict.value, trial.verdict.lower, trial.verdict.upper) for trial in own]
        value, lower, upper = factor * np.array(ends, dtype=np.float64).reshape(-1, 3).T
        bars = {"array": upper - value, "arrayminus": value - lower, "width": 0, "color": _INTERVAL}
        colours = [VERDICT_COLOURS[trial.verdict.word] for trial in own]
        draw(own, value, error_y=bars, marker=_marker(colours, symbol, 10, 1, INK))
    for name, some, marker in (
        ("measured", trials, _marker(MEASURED_COLOUR, "circle", 7, 1, PAPER)),
        ("wrong", [t for t in trials if t.wrong], _marker(_DISAGREES, "circle-open", 20, 2.5, None)),
    ):
        draw(some, factor * np.array([trial.measured for trial in some], dtype=np.float64), name=name, marker=marker)
    for limit in (criterion.at_least, criterion.at_most):
        if limit is not None:
            figure.add_hline(y=factor * limit, line_color=CURSOR, line_width=1.5, line_dash="dash", row=row, col=1)
    figure.add_annotation(
        text=f"<b>{criterion.name}</b>: {display.words(criterion.limits)} (dashed)", x=0, xref="x domain",
        xanchor="left", y=1, yref="y domain", yanchor="bottom", showarrow=False, row=row, col=1,
    )  # fmt: skip
    title = "Rating" if criterion.window_ms is not None else display.title(criterion.label, criterion.unit)
    figure.update_yaxes(title={"text": "<br>".join(wrap(title, 24)), "font": {"size": 13}}, row=row)


def _told(trial: Trial, display: Display) -> str:
    verdict, criterion = trial.verdict, trial.verdict.criterion
    value, measured = (display.words(criterion.shown(value)) for value in (verdict.value, trial.measured))
    interval = display.words(criterion.interval(verdict.lower, verdict.upper))
    return "<br>".join(
        [
            f"<b>{trial.held_out}</b>, {how_left_out(trial.left_out)}",
            f"predicted {value}, 95 % of tests {interval}",
            f"measured {measured}: {'met' if trial.met else 'not met'}",
            f"verdict: {verdict.word}{', wrong' * trial.wrong}",
        ]
    )


def _marker(color: object, symbol: str, size: int, width: float, line: str | None) -> dict[str, object]:
    return {"color": color, "symbol": symbol, "size": size, "line": {"width": width, "color": line}}


def _over(texts: Sequence[object]) -> dict[str, object]:
    return {"hovertext": texts, "hovertemplate": "%{hovertext}<extra></extra>"}


def _legend(figure: go.Figure, name: str, marker: dict[str, object]) -> None:
    figure.add_scatter(x=[None], y=[None], mode="markers", name=name, marker=marker, hoverinfo="skip")


def _say(figure: go.Figure, words: str) -> None:
    figure.add_annotation(text=words, x=0.5, y=0.5, xref="paper", yref="paper", showarrow=False)
    figure.update_layout(showlegend=False, xaxis_visible=False, yaxis_visible=False)
