"""Figures of a certification: how close each planned test is to its limits, verdicts, record, validated domain."""

from collections.abc import Sequence
from dataclasses import replace
from textwrap import wrap
from typing import Any

import numpy as np

from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.track_record import TrackRecord, Trial
from crashfuse.certification.verdict import WORDS, Verdict, Word
from crashfuse.condition import Condition
from crashfuse.results.certification_tables import planned
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing, Look, Sheer
from crashfuse.results.figures import WITH_GROUP, how_left_out
from crashfuse.results.plots import canvas
from crashfuse.results.plots.canvas import drawing_of_points, marker, telling, tick_name
from crashfuse.results.plots.palette import CURSOR, INK, MEASURED_COLOUR, PAPER, VERDICT_COLOURS
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
_ANSWER = "A test there"
_BARS = {"met": _AGREES, "not met": _DISAGREES, "open": "#C29200", "outside": _INTERVAL}  # on a page of either theme
_HEAD_PX, _FOOT_PX, _LETTERS_OF_HEADS = 88, 30, 55  # the page has its rows below a head of that height
_MET_SIDE, _MISSED_SIDE = 3.0, 1.5  # of a scale, in usual widths of an interval from the limit


def verdict_matrix(
    certification: Certification, display: Display = DEFAULT, part: slice = slice(None), *, words: bool = True
) -> Drawing:
    """Draw verdicts as a table of conditions, sorted by speed, by criteria, with the answer beside each row.

    A mark carries ``"<condition> | <criterion>"``. ``part`` takes some of the sorted conditions.
    """
    asked = planned(certification)[part]
    ids, rows = [own.id for own in asked], [certification.rows[own.id] for own in asked]
    criteria, confidence = certification.criteria.items, certification.criteria.confidence
    width = min(max(_HEADER_CHARACTERS // len(criteria), 9), 22)
    names = [_header(criterion, width, display) for criterion in criteria]
    speeds = [display.speed(row[0].condition.speed_mps) for row in rows]
    labels, short = ([f"{name(i)} · {v}" for i, v in zip(ids, speeds, strict=True)] for name in (str, tick_name))
    with_words = words and len(rows) <= MOST_WORDS
    above = max(name.count("<br>") + 1 for name in names) * _LINE_PX + 12
    drawing = drawing_of_points(above + _BELOW_PX + _ROW_PX * len(rows) if with_words else _ALL_ROWS_PX)
    hover = [[_hover(i, verdict, display) for verdict in row] for i, row in zip(ids, rows, strict=True)]
    alike = {i: f", as {tick_name(other)}" for i, other in certification.counted_once.items()}
    answers = [own.word + f": {own.brief}" * (own.word == "was run") + alike.get(own.id, "") for own in asked]
    codes = np.array([[WORDS.index(verdict.word) for verdict in row] for row in rows], dtype=np.int8)
    scale = [(end / len(WORDS), VERDICT_COLOURS[w]) for i, w in enumerate(WORDS) for end in (i, i + 1)]
    texts, cells = ([[_cell(own, confidence, between) for own in row] for row in rows] for between in ("<br>", " "))
    heads = (" ".join(f"{own.name} {display.words(own.limits)}".split()) for own in criteria)
    table = {"Row": labels, **dict(zip(heads, zip(*cells, strict=True), strict=True)), _ANSWER: answers}
    look, clicked = Look(z=codes, colorscale=scale, zmin=-0.5, zmax=len(WORDS) - 0.5), list[str]()
    if with_words:
        size = min(12, max(_LETTERS // len(names), 6))
        look |= Look(text=texts, texttemplate="%{text}", textfont={"color": MEASURED_COLOUR, "size": size})
        clicked = [f"{i} | {verdict.criterion.name}" for i, row in zip(ids, rows, strict=True) for verdict in row]
    else:
        look["ygap"] = 0
    canvas.draw_cells(drawing, names, labels, look, table, hover, clicked=clicked, marker_size=20, yaxis="y2")
    told = [verdict.word for row in rows for verdict in row]
    for word in WORDS:
        look = marker(VERDICT_COLOURS[word], "square", 13, 1)
        drawing.entry(f"{word} ({told.count(word)})", **look, hoverinfo="skip")
    left = max(map(len, short), default=0) * _LETTER_PX + 6
    drawing.update(hoverlabel_align="left", margin_l=left, margin_t=above, margin_b=_BELOW_PX)
    drawing.update(legend_y=0, legend_yanchor="bottom")
    if with_words:
        drawing.axis("y", tickvals=labels, ticktext=short)
        drawing.axis("y2", **drawing.axes["y"].look)  # at an axis, which is drawn as marks are on it
        drawing.axis("y2", overlaying="y", side="right", categoryarray=labels, ticktext=answers, ticklabelstandoff=4)
        drawing.update(margin_r=max(map(len, [*answers, _ANSWER])) * _LETTER_PX + 10)
        drawing.note(f"<b>{_ANSWER}</b>", 1, 1, xanchor="left", yanchor="bottom", xshift=3)
    return drawing


def planned_scales(
    certification: Certification, display: Display = DEFAULT, part: slice = slice(None), *, names: bool = True
) -> Drawing:
    """Draw by planned test and criterion the interval of a test there, or what one measured, beside the limits.

    What lies beyond a scale is moved to its end; marks are those of :func:`verdict_matrix`.
    """
    rows, criteria = planned(certification)[part], certification.criteria.items
    drawing = drawing_of_points(_HEAD_PX + _ROW_PX * len(rows) + _FOOT_PX)
    labels = [f"<b>{row.word}</b> {tick_name(row.id)} · {display.speed(row.condition.speed_mps)}" for row in rows]
    left = max(map(len, labels)) * _LETTER_PX if names else 6
    width, gap = 1 / len(criteria), 0.012
    for number, criterion in enumerate(criteria):
        verdicts = [certification.rows[row.id][number] for row in rows]
        x, y = (name + f"{number + 1}" * (number > 0) for name in "xy")
        start, end = number * width + gap * (number > 0), (number + 1) * width
        drawing.axis(x, anchor=y, domain=[start, end], nticks=3, showgrid=False, tickfont={"size": 11}, ticks="outside")
        drawing.axis(x, criterion.label, display.units.unit(criterion.unit), title="")
        look = Look(tickvals=[*range(len(rows))], ticktext=labels, showticklabels=names and not number, zeroline=False)
        drawing.axis(y, "Planned test", title="", anchor=x, range=[len(rows) - 0.5, -0.5], fixedrange=True, **look)
        head = _header(criterion, max(_LETTERS_OF_HEADS // len(criteria), 11), display)
        drawing.note(head, (start + end) / 2, 1, font_size=12, xanchor="center", yanchor="bottom", yshift=4)
        _draw_scale(drawing, [row.id for row in rows], verdicts, x, y, display)
    drawing.update(showlegend=False, margin={"l": left, "r": 8, "t": _HEAD_PX, "b": _FOOT_PX}, dragmode=False)
    drawing.update(hoverdistance=-1, hoverlabel_align="left")
    return drawing


def _draw_scale(
    drawing: Drawing, ids: Sequence[str], verdicts: Sequence[Verdict], x: str, y: str, display: Display
) -> None:
    criterion = verdicts[0].criterion
    factor, at = display.units.factor(criterion.unit), {"xaxis": x, "yaxis": y}
    ends = np.array([(own.value, own.lower, own.upper) for own in verdicts], dtype=np.float64) * factor
    measured = [(row, factor * v) for row, own in enumerate(verdicts) for v in own.run.values() if v is not None]
    low, high = _ends_of_scale(criterion, factor, ends, [value for _, value in measured])
    first, last = low - 0.03 * (high - low), high + 0.03 * (high - low)  # what is moved to an end is seen whole
    drawing.axis(x, range=[first, last], fixedrange=True)
    for limit, missed in ((criterion.at_least, first), (criterion.at_most, last)):
        if limit is not None:
            start, end = sorted((factor * limit, missed))
            drawing.shade(start, end, y, xref=x, fillcolor=Sheer(_DISAGREES, 0.13))
            drawing.rule(x, factor * limit, INK, width=1.5)
    shown = np.clip(np.where(np.isnan(ends), [[np.nan, low, high]], ends), low, high)
    shown[np.isnan(ends).all(axis=1)] = np.nan
    shown[[row for row, _ in measured]] = np.nan  # what was measured stands in its place
    for word, colour in _BARS.items():
        some = [row for row, own in enumerate(verdicts) if own.word == word]
        bars = np.column_stack([shown[some, 1:], np.full(len(some), np.nan)]).ravel()
        look = Look(mode="lines", line_color=colour, line_width=9, hoverinfo="skip")
        if some:
            drawing.add(look | Look(x=bars, y=np.repeat(some, 3), name=word, **at))
    numbers = {"label": ids, "x": ends[:, 0], "x_lower": ends[:, 1], "x_upper": ends[:, 2]}
    tick = marker(INK, "line-ns", 13, 2, INK) | Look(name=f"{criterion.title}: expected", hoverinfo="skip")
    drawing.add(tick | Look(x=shown[:, 0], y=[*range(len(ids))], **at), numbers)
    if measured:
        places, values = zip(*measured, strict=True)
        drawn = np.clip(values, low, high)
        sides = ["middle right" if value < (low + high) / 2 else "middle left" for value in drawn]
        look = marker(MEASURED_COLOUR, "circle", 8) | Look(mode="markers+text", hoverinfo="skip", textfont_size=11)
        texts = [f" {replace(criterion.shown(v / factor), values=(v,), unit='')} " for v in values]
        look |= Look(text=texts, textposition=sides, textfont_shadow="auto", name=f"{criterion.title}: measured")
        drawing.add(look | Look(x=drawn, y=places, **at), {"label": [ids[row] for row in places], "x": values})
    cells = Look(x=[(low + high) / 2] * len(ids), y=[*range(len(ids))], marker_opacity=0, marker_size=_ROW_PX - 8)
    told = [_hover(i, verdict, display) for i, verdict in zip(ids, verdicts, strict=True)]
    drawing.add(cells | Look(customdata=[f"{i} | {criterion.name}" for i in ids], **at) | telling(told))


def _ends_of_scale(
    criterion: Criterion, factor: float, ends: FloatArray, measured: Sequence[float]
) -> tuple[float, float]:
    """Some usual intervals around the limits, no further than there are values."""
    limits = [factor * limit for limit in (criterion.at_least, criterion.at_most) if limit is not None]
    widths = (ends[:, 2] - ends[:, 1])[np.isfinite(ends).all(axis=1)]
    usual = float(np.median(widths)) if widths.size else 0.1 * max(map(abs, limits))
    sides = [_MISSED_SIDE if limit is not None else _MET_SIDE for limit in (criterion.at_least, criterion.at_most)]
    known = [*ends[np.isfinite(ends)], *measured, *limits]
    low = max(min(limits) - sides[0] * usual, min(min(known), min(limits) - usual / 2) - usual / 5)
    return low, min(max(limits) + sides[1] * usual, max(max(known), max(limits) + usual / 2) + usual / 5)


def _header(criterion: Criterion, width: int, display: Display) -> str:
    asked = wrap(unbroken(display.words(criterion.limits_by("≥", "≤"))), width, break_long_words=False)
    return "<br>".join([*(f"<b>{line}</b>" for line in wrap(criterion.title, width, break_long_words=False)), *asked])


def _cell(verdict: Verdict, confidence: float, between: str) -> str:
    if verdict.word == "outside" or verdict.probability is None:
        return verdict.word
    return f"{verdict.word}{between}{probability_text(verdict.probability, confidence)}"


def _hover(condition_id: str, verdict: Verdict, display: Display) -> str:
    head = f"<b>{condition_id}, {verdict.criterion.title}: {verdict.word}</b>"
    lines = [head, display.condition(verdict.condition), *wrap(display.words(verdict.reason), 78)]
    if verdict.word == "outside":  # else the reason has the numbers
        lines.append(display.words(verdict.expected))
    return "<br>".join(lines)


def validated_domain(certification: Certification, display: Display = DEFAULT) -> Drawing:
    """Draw total mass over speed: the checked region, CAE runs, tests, and conditions by their worst verdict."""
    domain, campaign = certification.domain, certification.campaign
    drawing = drawing_of_points(480, *display.axis("Impact speed", "mph"))
    mass_low, mass_high = map(display.weights, domain.checked_masses_kg)
    for number, ends in enumerate(domain.speed_ranges_mps):
        low, high = map(display.speeds, ends)
        drawing.points(
            [low, high, high, low, low], [mass_low, mass_low, mass_high, mass_high, mass_low], mode="lines",
            name="Validated domain", legendgroup="checked", showlegend=number == 0, fill="toself",
            fillcolor=Sheer(_CHECKED), line_color=_CHECKED, line_width=1, line_dash="dash", hoverinfo="skip",
        )  # fmt: skip
    runs = campaign.cae.vectors[:: -(-len(campaign.cae) // _MAX_RUNS)]
    speeds, weights = display.speeds(runs[:, 0]), display.weights(runs[:, 1:].sum(axis=1))
    name = f"{len(campaign.cae):,} CAE runs"
    drawing.points(speeds, weights, name=name, hoverinfo="skip", marker=canvas.marks_of_runs(len(runs)))

    def draw(name: str, some: Sequence[tuple[str, Condition, str]], look: Look) -> None:
        speeds = [display.speeds(condition.speed_mps) for _, condition, _ in some]
        weights = [display.weights(condition.mass_kg) for _, condition, _ in some]
        over = telling([f"<b>{i}</b><br>{display.condition(at)}{more}" for i, at, more in some])
        drawing.points(speeds, weights, name=name, **look, **over)

    rows = certification.rows.items()
    for word in _WORST_FIRST:
        some = [
            (i, row[0].condition, "".join(f"<br>{verdict.criterion.name}: {verdict.word}" for verdict in row))
            for i, row in rows
            if worst(row) == word
        ]
        if some:
            look = marker(VERDICT_COLOURS[word], _SYMBOLS[word], 13, 1.5, INK)
            draw(f"Worst verdict: {word} ({len(some)})", some, look)
    tests = [(f"Test {test.id}", test.condition, "") for test in campaign.tests]
    draw(f"{len(tests)} tests", tests, marker(None, "cross-thin", 11, 2, MEASURED_COLOUR))
    drawing.axis("y", *display.axis("Front and rear weight together", "lb"))
    return drawing


def worst(verdicts: Sequence[Verdict]) -> Word:
    """The worst word among verdicts on one condition."""
    return min((verdict.word for verdict in verdicts), key=_WORST_FIRST.index)


def reliability(record: TrackRecord) -> Drawing:
    """Draw the share of left-out tests that met a criterion over the probability given, open if bounds exclude it."""
    axis = Look(range=[-0.09, 1.09], tickvals=[0, 0.2, 0.4, 0.6, 0.8, 1], zeroline=False)
    drawing = drawing_of_points(440, "Probability given in advance", **axis)
    if not record.reliability:
        drawing.note("No left-out test lies inside what the others check.", 0.5, 0.5)
        drawing.update(showlegend=False)
        for name in "xy":
            drawing.axis(name, visible=False)
        return drawing
    drawing.points([0, 1], [0, 1], **canvas.PROMISED)
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
            drawing.points(
                probability, met, name=name, mode="markers+text", cliponaxis=False, ends=(lower, upper),
                error_y_thickness=1.5, error_y_width=4, text=[f"n = {each.n}" for each in bins],
                textposition=["top center" if each.met >= 0.5 else "bottom center" for each in bins],
                **marker(colour, symbol, 11, 2, colour), **telling(texts),
            )  # fmt: skip
    drawing.update(showlegend=True)
    drawing.axis("y", "Share of tests that met it", **axis)
    return drawing


def record_figure(record: TrackRecord, criteria: Sequence[Criterion], display: Display = DEFAULT) -> Drawing:
    """Draw by criterion what left-out tests were predicted to show and showed, by speed, and the limits."""
    criteria = [criterion for criterion in criteria if record.of(criterion)]
    trials = [trial for trial in record.counted if trial.verdict.criterion in criteria]
    trials.sort(key=lambda trial: trial.verdict.condition.speed_mps)
    tests = list(dict.fromkeys(trial.held_out for trial in trials))
    places = Look(range=[-0.6, len(tests) - 0.4], tickvals=list(range(len(tests))), ticktext=[*map(tick_name, tests)])
    drawing = drawing_of_points(max(120 + 210 * len(criteria), 330), **places)
    canvas.stack(drawing, len(criteria), 0.24 / (len(criteria) + 0.6))
    for row, criterion in enumerate(criteria, start=1):
        own = [trial for trial in trials if trial.verdict.criterion == criterion]
        number = "" if row == 1 else f"{row}"
        drawing.axis(f"x{number}", "Left-out test, in order of speed", title=None if row == len(criteria) else "")
        _draw_trials(drawing, own, criterion, tests, number, display)
    wrong = any(trial.wrong for trial in trials)
    for name, colour, symbol, line in (
        *((f"predicted, {word}", VERDICT_COLOURS[word], "square", INK) for word in WORDS),
        (WITH_GROUP, Sheer(MEASURED_COLOUR, 0), "diamond", INK),
        ("measured", MEASURED_COLOUR, "circle", MEASURED_COLOUR),
        *([("wrong verdict", _DISAGREES, "circle-open", _DISAGREES)] if wrong else []),
    ):
        drawing.entry(name, **marker(colour, symbol, 10, 1, line), hoverinfo="skip")
    drawing.update(hoverlabel_align="left", margin_l=72, margin_t=96 if wrong else 72)
    return drawing


def _draw_trials(
    drawing: Drawing, trials: Sequence[Trial], criterion: Criterion, tests: list[str], number: str, display: Display
) -> None:
    factor, x, y = display.units.factor(criterion.unit), f"x{number}", f"y{number}"

    def draw(some: Sequence[Trial], values: FloatArray, **look: Any) -> None:  # noqa: ANN401 - as Plotly takes it
        at = [tests.index(trial.held_out) + (-0.14 if trial.left_out == "test" else 0.14) for trial in some]
        over = telling([_told(trial, display) for trial in some])
        places = {"x": [trial.held_out for trial in some]}
        drawing.points(at, values, numbers=places, showlegend=False, xaxis=x, yaxis=y, **look, **over)

    for left_out, symbol in (("test", "square"), ("speed group", "diamond")):
        own = [trial for trial in trials if trial.left_out == left_out and trial.verdict.value is not None]
        ends = [(trial.verdict.value, trial.verdict.lower, trial.verdict.upper) for trial in own]
        value, lower, upper = factor * np.array(ends, dtype=np.float64).reshape(-1, 3).T
        colours = [VERDICT_COLOURS[trial.verdict.word] for trial in own]
        look = marker(colours, symbol, 10, 1, INK)
        draw(own, value, ends=(lower, upper), error_y_width=0, error_y_color=_INTERVAL, **look)
    for name, some, look in (
        ("measured", trials, marker(MEASURED_COLOUR, "circle", 7, 1, PAPER)),
        ("wrong", [t for t in trials if t.wrong], marker(_DISAGREES, "circle-open", 20, 2.5)),
    ):
        draw(some, factor * np.array([trial.measured for trial in some], dtype=np.float64), name=name, **look)
    for limit in (criterion.at_least, criterion.at_most):
        if limit is not None:
            drawing.rule(y, factor * limit, colour=CURSOR, width=1.5, dash="dash")
    words = f"<b>{criterion.title}</b>: {display.words(criterion.limits)} (dashed)"
    drawing.note(words, 0, 1, f"{y} domain", xref=f"{x} domain", xanchor="left", yanchor="bottom")
    shows = ("Rating",) if criterion.window_ms is not None else display.axis(criterion.label, criterion.unit)
    drawing.axis(y, *shows)
    drawing.axis(y, title_text="<br>".join(wrap(drawing.axes[y].heading(), 24)), title_font_size=13)


def _told(trial: Trial, display: Display) -> str:
    verdict, criterion = trial.verdict, trial.verdict.criterion
    value, measured = (display.words(criterion.shown(value)) for value in (verdict.value, trial.measured))
    interval = display.words(criterion.interval(verdict.lower, verdict.upper))
    lines = (
        f"<b>{trial.held_out}</b>, {how_left_out(trial.left_out)}",
        f"predicted {value}, 95 % of tests {interval}",
        f"measured {measured}: {'met' if trial.met else 'not met'}",
        f"verdict: {verdict.word}{', wrong' * trial.wrong}",
    )
    return "<br>".join(lines)
