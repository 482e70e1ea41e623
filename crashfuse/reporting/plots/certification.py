"""Figures of a certification: the matrix of verdicts, and the validated domain."""

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb

from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.verdict import WORDS, Verdict, Word
from crashfuse.reporting.certification_tables import ANSWER, answer_texts
from crashfuse.reporting.plots.canvas import fix_cells, make_clickable, marks_of_runs, new_figure, tick_name
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import INK, MEASURED_COLOUR, VERDICT_COLOURS
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
    answers, cut, run = answer_texts(certification), answer_texts(certification, tick_name), certification.run
    beside = [f"run: {len(run[i])} tests" if len(run.get(i, ())) > 1 else cut[i] for i in ids]
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
    figure.update_layout(
        hoverlabel={"align": "left"},
        margin={
            "l": max(map(len, short), default=0) * _LETTER_PX + 6,
            "t": above,
            "b": _BELOW_PX,
        },
        legend={"y": 0, "yanchor": "bottom"},
    )
    plain = {"type": "category", "title": None, "ticks": "", "showline": False, "zeroline": False, "showgrid": False}
    figure.update_xaxes(**plain, side="top", tickangle=0, range=[-0.5, len(names) - 0.5], showspikes=False)
    figure.update_yaxes(**plain, range=[len(rows) - 0.5, -0.5])  # the marks would widen it
    if with_words:
        figure.update_yaxes(tickvals=labels, ticktext=short)
        _write_beside(figure, labels, beside)
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
                marker={
                    "color": VERDICT_COLOURS[word],
                    "symbol": _SYMBOLS[word],
                    "size": 13,
                    "line": {"width": 1.5, "color": INK},
                },
                customdata=[[i, display.condition(row[0].condition), _summary(row)] for i, row in own],
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
    figure.update_xaxes(
        title=display.title("Impact speed", "mph"),
        range=None,
        zeroline=False,
        showspikes=False,
        unifiedhovertitle=None,
    )
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


def _summary(row: Sequence[Verdict]) -> str:
    return "<br>".join(f"{verdict.criterion.name}: {verdict.word}" for verdict in row[:12]) + "<br>…" * (len(row) > 12)


def _verdict_scale() -> list[tuple[float, str]]:
    """Colour scale of one flat step a word."""
    n = len(WORDS)
    return [(end / n, VERDICT_COLOURS[word]) for i, word in enumerate(WORDS) for end in (i, i + 1)]
