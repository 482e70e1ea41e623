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
from crashfuse.reporting.certification_tables import ANSWER, answer_texts
from crashfuse.reporting.plots.canvas import fix_cells, make_clickable, marks_of_runs, new_figure, tick_name
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import AXIS, CURSOR, INK, MEASURED_COLOUR, PAPER, VERDICT_COLOURS
from crashfuse.signals.pulse import FloatArray
from crashfuse.wording import probability_text, unbroken

FEW_CONDITIONS = 40
"""More rows than these are drawn narrower."""
MOST_WORDS = 400
"""Of more conditions than these only colours are drawn: a browser would take many seconds for the words."""

_FEW_CRITERIA = 5  # of more, the probability stands below the word
_ROW_PX, _NARROW_ROW_PX, _ALL_ROWS_PX = 34, 22, 1600
_BELOW_PX = 44  # of the legend
_LETTER_PX, _LINE_PX = 7, 19  # of names beside and above the cells, rather more than they take
_HEADER_CHARACTERS = 65  # of all columns together, on paper
_LETTERS = 130  # size in px, times the columns, with which "not met", or "<0.001" below it, fits into a cell
_WORST_FIRST: tuple[Word, ...] = ("outside", "not met", "open", "met")
_SYMBOLS = {"met": "circle", "not met": "x", "open": "diamond", "outside": "triangle-up"}
_MAX_RUNS = 600  # more points only fill the same cloud
_CHECKED = "#0072B2"


def verdict_matrix(
    certification: Certification, display: Display = DEFAULT, part: slice = slice(None), *, words: bool = True
) -> go.Figure:
    """Draw verdicts as a table of conditions, sorted by speed, by criteria: colour, word and probability of being met.

    Beside each row stands the answer at the condition. A cell's mark carries ``"<condition> | <criterion>"``. Without
    ``words``, and beyond 400 conditions, only colours are drawn. ``part`` takes some of the sorted conditions.
    """
    ids, rows = _by_speed(certification, part)
    width = min(max(_HEADER_CHARACTERS // len(certification.criteria.items), 9), 22)
    names = [_header(criterion, width, display) for criterion in certification.criteria.items]
    speeds = [display.speed(row[0].condition.speed_mps) for row in rows]
    labels = [f"{i} · {own}" for i, own in zip(ids, speeds, strict=True)]
    short = [f"{tick_name(i)} · {own}" for i, own in zip(ids, speeds, strict=True)]
    answers, cut = answer_texts(certification), answer_texts(certification, short=True)
    with_words, confidence = words and len(rows) <= MOST_WORDS, certification.criteria.confidence
    in_a_line = len(names) <= _FEW_CRITERIA
    row_px = _NARROW_ROW_PX if in_a_line and len(rows) > FEW_CONDITIONS else _ROW_PX
    above = max(name.count("<br>") + 1 for name in names) * _LINE_PX + 12
    figure = new_figure(height=above + _BELOW_PX + row_px * len(rows) if with_words else _ALL_ROWS_PX)
    hover = [[_hover(i, verdict, display) for verdict in row] for i, row in zip(ids, rows, strict=True)]
    figure.add_heatmap(
        z=np.array([[WORDS.index(verdict.word) for verdict in row] for row in rows], dtype=np.int8),
        x=names,
        y=labels,
        colorscale=_verdict_scale(),
        zmin=-0.5,
        zmax=len(WORDS) - 0.5,
        xgap=2,
        ygap=2 if with_words else 0,
        showscale=False,
        meta={ANSWER: [answers[i] for i in ids]},
    )
    if with_words:
        figure.update_traces(
            text=[[_cell(verdict, confidence, " " if in_a_line else "<br>") for verdict in row] for row in rows],
            texttemplate="%{text}",
            textfont={"color": MEASURED_COLOUR, "size": min(12, max(_LETTERS // len(names), 6))},
            hoverinfo="skip",
        )
        cells = [cell_name(i, verdict) for i, row in zip(ids, rows, strict=True) for verdict in row]
        over = [text for row in hover for text in row]
        make_clickable(figure, names, labels, cells, 20, hovertext=over, hovertemplate="%{hovertext}<extra></extra>")
    else:
        figure.update_traces(hovertext=hover, hovertemplate="%{hovertext}<extra></extra>")
    told = [verdict.word for row in rows for verdict in row]
    for word in WORDS:
        figure.add_scatter(
            x=[None], y=[None], mode="markers", name=f"{word} ({told.count(word)})", hoverinfo="skip",
            marker={"color": VERDICT_COLOURS[word], "symbol": "square", "size": 13, "line": {"width": 1}},
        )  # fmt: skip
    fix_cells(figure)
    margin = {"l": max(map(len, short), default=0) * _LETTER_PX + 6, "t": above, "b": _BELOW_PX}
    figure.update_layout(hoverlabel={"align": "left"}, margin=margin, legend={"y": 0, "yanchor": "bottom"})
    plain = {"type": "category", "title": None, "ticks": "", "showline": False, "zeroline": False, "showgrid": False}
    figure.update_xaxes(**plain, side="top", tickangle=0, range=[-0.5, len(names) - 0.5], showspikes=False)
    figure.update_yaxes(**plain, range=[len(rows) - 0.5, -0.5])  # the marks would widen it
    if with_words:
        figure.update_yaxes(tickvals=labels, ticktext=short)
        _write_beside(figure, labels, [cut[i] for i in ids])
    return figure


def cell_name(condition_id: str, verdict: Verdict) -> str:
    """Name of a cell of the matrix."""
    return f"{condition_id} | {verdict.criterion.name}"


def validated_domain(certification: Certification, display: Display = DEFAULT) -> go.Figure:
    """Draw total mass over speed: the checked region, CAE runs, tests, and conditions by their worst verdict."""
    figure, domain, campaign = new_figure(height=480), certification.domain, certification.campaign
    run_masses = campaign.cae.vectors[:, 1:].sum(axis=1)
    mass_low, mass_high = map(display.weights, domain.checked_masses_kg)
    for number, (low, high) in enumerate(domain.speed_ranges_mps):
        low, high = display.speeds(low), display.speeds(high)
        figure.add_scatter(
            x=[low, high, high, low, low], y=[mass_low, mass_low, mass_high, mass_high, mass_low], mode="lines",
            name="Checked by leaving tests out", legendgroup="checked", showlegend=number == 0, fill="toself",
            fillcolor=f"rgba{(*hex_to_rgb(_CHECKED), 0.18)}", line={"color": _CHECKED, "width": 1, "dash": "dash"},
            hoverinfo="skip",
        )  # fmt: skip
    some = slice(None, None, -(-len(campaign.cae) // _MAX_RUNS))
    figure.add_scatter(
        x=display.speeds(campaign.cae.vectors[some, 0]), y=display.weights(run_masses[some]),
        mode="markers", hoverinfo="skip",
        name=f"{len(campaign.cae):,} CAE runs", marker=marks_of_runs(len(run_masses[some])),
    )  # fmt: skip
    rows = list(certification.rows.items())
    for word in _WORST_FIRST:
        own = [(i, row) for i, row in rows if worst(row) == word]
        if own:
            figure.add_scatter(
                x=[display.speeds(row[0].condition.speed_mps) for _, row in own],
                y=[display.weights(row[0].condition.mass_kg) for _, row in own],
                mode="markers",
                name=f"Worst verdict: {word} ({len(own)})",
                marker=_marker(VERDICT_COLOURS[word], _SYMBOLS[word], 13, 1.5, INK),
                customdata=[
                    [i, display.condition(row[0].condition), "<br>".join(f"{v.criterion.name}: {v.word}" for v in row)]
                    for i, row in own
                ],
                hovertemplate="<b>%{customdata[0]}</b><br>%{customdata[1]}<br>%{customdata[2]}<extra></extra>",
            )
    figure.add_scatter(
        x=[display.speeds(test.condition.speed_mps) for test in campaign.tests],
        y=[display.weights(test.condition.mass_kg) for test in campaign.tests],
        mode="markers",
        name=f"{len(campaign.tests)} tests",
        marker={"symbol": "cross-thin", "size": 11, "line": {"width": 2, "color": MEASURED_COLOUR}},
        customdata=[[test.id, display.condition(test.condition)] for test in campaign.tests],
        hovertemplate="<b>Test %{customdata[0]}</b><br>%{customdata[1]}<extra></extra>",
    )
    figure.update_layout(hovermode="closest")
    title = display.title("Impact speed", "mph")
    figure.update_xaxes(title=title, range=None, zeroline=False, showspikes=False, unifiedhovertitle=None)
    figure.update_yaxes(title=display.title("Front and rear weight together", "lb"))
    return figure


def worst(verdicts: Sequence[Verdict]) -> Word:
    """The worst word among verdicts on one condition."""
    return min((verdict.word for verdict in verdicts), key=_WORST_FIRST.index)


def _by_speed(certification: Certification, part: slice) -> tuple[list[str], list[tuple[Verdict, ...]]]:
    """Ids of some conditions and their verdicts, slow before fast, in the order of the matrix where as fast."""
    rows = certification.rows.items()
    ids, verdicts = zip(*sorted(rows, key=lambda row: row[1][0].condition.speed_mps)[part], strict=True)
    return list(ids), list(verdicts)


def _write_beside(figure: go.Figure, rows: list[str], beside: list[str]) -> None:
    """Write a text beside each row of a heat map, at its right: at an axis, which is drawn as marks are on it."""
    left = figure.layout.yaxis.to_plotly_json()
    right = {"overlaying": "y", "side": "right", "categoryarray": rows, "ticktext": beside, "ticklabelstandoff": 4}
    figure.update_layout(yaxis2={**left, **right})
    figure.update_traces(yaxis="y2", selector={"mode": "markers", "showlegend": False})
    figure.add_annotation(
        text=f"<b>{ANSWER}</b>", x=1, y=1, xref="paper", yref="paper", xanchor="left", yanchor="bottom", xshift=3,
        showarrow=False,
    )  # fmt: skip
    figure.update_layout(margin={"r": max(map(len, [*beside, ANSWER])) * _LETTER_PX + 10})


def _header(criterion: Criterion, width: int, display: Display) -> str:
    name = [f"<b>{line}</b>" for line in wrap(criterion.name, width)]
    return "<br>".join(name + wrap(unbroken(display.words(criterion.limits)), width))


def _cell(verdict: Verdict, confidence: float, between: str) -> str:
    if verdict.word == "outside" or verdict.probability is None:
        return verdict.word
    return f"{verdict.word}{between}{probability_text(verdict.probability, confidence)}"


def _hover(condition_id: str, verdict: Verdict, display: Display) -> str:
    criterion = verdict.criterion
    lines = [
        f"<b>{condition_id}, {criterion.name}: {verdict.word}</b>",
        display.condition(verdict.condition),
        *wrap(display.words(verdict.reason), 78),
    ]
    if verdict.word == "outside":  # else the reason has the numbers
        lines.append(display.words(verdict.expected))
    return "<br>".join(lines)


def _verdict_scale() -> list[tuple[float, str]]:
    """Colour scale of one flat step a word."""
    n = len(WORDS)
    return [(end / n, VERDICT_COLOURS[word]) for i, word in enumerate(WORDS) for end in (i, i + 1)]


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
            marker=_marker(colour, symbol, 11, 2, colour),
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

    def draw(some: Sequence[Trial], values: FloatArray, **look: object) -> None:
        figure.add_scatter(
            x=[tests.index(trial.held_out) + (-0.14 if trial.left_out == "test" else 0.14) for trial in some],
            meta={"x": [trial.held_out for trial in some]},
            y=values,
            mode="markers",
            hovertext=[_told(trial, display) for trial in some],
            hovertemplate="%{hovertext}<extra></extra>",
            showlegend=False,
            row=row,
            col=1,
            **look,
        )

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


def _marker(color: object, symbol: str, size: int, width: float, line: str | None) -> dict[str, object]:
    return {"color": color, "symbol": symbol, "size": size, "line": {"width": width, "color": line}}


def _legend(figure: go.Figure, name: str, *, color: str, symbol: str, line_color: str) -> None:
    marker = _marker(color, symbol, 10, 1, line_color)
    figure.add_scatter(x=[None], y=[None], mode="markers", name=name, marker=marker, hoverinfo="skip", row=1, col=1)


def _say(figure: go.Figure, words: str) -> None:
    figure.add_annotation(text=words, x=0.5, y=0.5, xref="paper", yref="paper", showarrow=False)
    figure.update_layout(showlegend=False, xaxis_visible=False, yaxis_visible=False)
