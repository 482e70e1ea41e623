"""What pages show of results: tables, problems in data, recommendation, notes; the numbers come from the library."""

import re
import string
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import groupby

import pandas as pd
import streamlit as st
from pandas.io.formats.style import Styler

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.files.csv_text import csv_bytes
from crashfuse.reporting import glossary, rating_tables
from crashfuse.reporting.exports import spreadsheet_text
from crashfuse.reporting.fit_explanations import fit_sentences, fit_table, metric_remarks, notes_by_makers
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.palette import GRADE_COLOURS, IN_THE_DARK, MEASURED_COLOUR
from crashfuse.reporting.rating_tables import REPEAT, best, rating_table
from crashfuse.reporting.result_tables import next_tests_table
from crashfuse.signals.metrics import MAIN_METRICS, Metric
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import WEIGHTS, Rating, graded, rate_windows
from crashfuse.study.config import WINDOWS_MS, StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.next_test import NextTest
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Study
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.text import advice_on_page, as_read, chosen_units, plain
from crashfuse.ui.kit.window import component
from crashfuse.wording import UnitSystem

_RIGHT = "text-align: right !important"
_DIGIT_WIDE, _POINT_WIDE, _BRACKET_WIDE = "\u2007", "\u2008", "\u2004"
_BLANKS = {
    **{ord(char): _DIGIT_WIDE for char in string.printable + "≤≥"},
    **{ord(char): _POINT_WIDE for char in ".,"},
    **{ord(char): _BRACKET_WIDE for char in "[]()"},
    ord(" "): "\N{NO-BREAK SPACE}",
}
_COPY = '<button type="button" title="Copy this table for a spreadsheet">Copy</button>'
_NUMBER = re.compile(r"((?:[≤≥] )?[+−-]?[\d.,]+(?:–[\d.,]+| ± [\d.,]+| %| of \d+)?|–|)( \[.*\]| \(.*\))?")
"""A cell with a number, perhaps with its interval or a remark, or without one."""
_GRADED = re.compile(rf"\d\.\d+ ({'|'.join(GRADE_COLOURS)})")
_MOST_ROWS = 50  # shown; the downloaded file has all
TEST_COLUMN = "Test"
"""Heading of what was measured, beside the approaches."""


def show_table(table: Styler | pd.DataFrame, key: str) -> None:
    """Show a table with a button that copies it; the key is unique on the page."""
    styler = aligned(table if isinstance(table, Styler) else literal(table))
    st.table(styler, border="horizontal")
    copy = component("copy_table", html=_COPY, css="buttons.css")
    copy(data=spreadsheet_text(styler.data.rename(columns=as_read)), key=f"copy {key}")


def literal(table: pd.DataFrame) -> Styler:
    """A table without its index, whose headings are shown literally: they may be a laboratory's."""
    return table.rename(columns=plain).style.hide(axis="index")


def aligned(styler: Styler) -> Styler:
    """A :func:`literal` table with numbers at the right, their digits under each other and their intervals lighter."""
    forms: dict[Hashable, Callable[[object], object]] = dict.fromkeys(styler.columns, _literally)
    right = []
    for place, name in enumerate(styler.columns):
        matches = [_NUMBER.fullmatch(str(cell)) for cell in styler.data.iloc[:, place]]
        numbers = [match for match in matches if match is not None]
        if len(numbers) == len(matches) and any(match[1] for match in numbers):
            longest = max((match[2] or "" for match in numbers), key=len)
            forms[name] = partial(_with_light_interval, longest=longest)
            right.append(place)
    styler.format(forms)
    styler.set_properties(subset=styler.columns[right], **{"text-align": "right !important"})
    heads = [{"selector": f"th.col{place}", "props": _RIGHT} for place in right]
    return styler.set_table_styles(heads, overwrite=False)


def fill(colour: str) -> str:
    """CSS of a cell in a colour of the palette, in the page's theme."""
    ground, ink = colour, MEASURED_COLOUR
    if st.context.theme.type == "dark":
        ground, ink = IN_THE_DARK[colour], IN_THE_DARK[MEASURED_COLOUR]
    return f"background-color: {ground}; color: {ink}"


def _with_light_interval(cell: object, longest: str) -> str:
    """A number as Markdown, its interval lighter, and filled up so that the numbers of a column end at one place.

    ``longest`` is the column's longest interval; where there is none, spaces as wide as its characters stand for it.
    """
    number, interval = (str(part) for part in _NUMBER.findall(str(cell))[0])
    escaped = interval.strip().replace(" ", "\N{NO-BREAK SPACE}").replace("[", "\\[").replace("]", "\\]")
    if not escaped:
        return number + longest.translate(_BLANKS)
    missing = Counter(longest.translate(_BLANKS)) - Counter(interval.translate(_BLANKS))
    return f"{number}\N{NO-BREAK SPACE}:gray[{escaped}]" + "".join(missing.elements())


def _literally(cell: object) -> object:
    """Text as it is, on one line if it is a rating with its grade."""
    if not isinstance(cell, str):
        return cell
    return plain(cell).replace(" ", "\N{NO-BREAK SPACE}") if _GRADED.fullmatch(cell) else plain(cell)


def problem_table(problems: Sequence[Problem]) -> pd.DataFrame:
    """One row of text per problem: location, what was expected, what was found, what to do."""
    return pd.DataFrame([_cells(problem, "" if problem.row is None else str(problem.row)) for problem in problems])


def short_table(problems: Sequence[Problem]) -> pd.DataFrame:
    """The same table, with neighbouring problems that differ only in the row merged, as in rows 2–21."""
    return pd.DataFrame(
        [
            _cells(problem, _rows([same.row for same in alike if same.row is not None]))
            for problem, alike in groupby(problems, key=lambda problem: replace(problem, row=None))
        ]
    )


def _cells(problem: Problem, rows: str) -> dict[str, str]:
    return {
        "File": problem.where,
        "Row": rows,
        "Column": problem.column or "",
        "Expected": problem.expected,
        "Found": problem.found,
        "What to do": advice_on_page(problem),
    }


def _rows(numbers: Sequence[int]) -> str:
    if len(numbers) > 1 and list(numbers) == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]}–{numbers[-1]}"
    return ", ".join(map(str, numbers))


def show_problems(
    problems: Sequence[Problem],
    what: str = "This campaign cannot be used",
    result: str = "Nothing of it was opened.",
    *,
    place: str = "",
) -> None:
    """Show all problems in the data, and offer them as a file for whoever has to fix them."""
    count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
    st.error(f"**{what}: {count}.** {result}", icon=":material/error:")
    key = f"problems {place} {hash((what, *problems))}"
    table = short_table(problems)
    with st.container(border=True, height=420 if len(table) > 8 else "content"):
        show_table(table.head(_MOST_ROWS), f"table of {key}")
    if len(table) > _MOST_ROWS:
        st.caption(f"The first {_MOST_ROWS}; problems.csv has all.")
    st.download_button(
        "problems.csv", csv_bytes(problem_table(problems)), file_name="problems.csv", mime="text/csv",
        icon=":material/download:", on_click="ignore", key=key,
    )  # fmt: skip


@contextmanager
def refused_into(
    key: str, where: str, expected: str = "a folder that can be written", advice: str = ""
) -> Iterator[None]:
    """Keep under a session key, for the page to show, why something could not be done."""
    try:
        yield
    except DataError as error:
        st.session_state[key] = error.problems
    except (UsageError, OSError) as error:
        found = (error.strerror if isinstance(error, OSError) else None) or str(error)
        st.session_state[key] = (Problem(where, expected, found, advice or "check the path and your rights"),)


def window_label(window_ms: float) -> str:
    """Label of a rated window."""
    return f"0–{window_ms:g} ms"


def conditions_table(campaign: Campaign, display: Display) -> Styler:
    """Every test with its condition, and the rating of its paired CAE run over each window."""
    return _coloured(_conditions(campaign.fingerprint, display.system, campaign))


@st.cache_data(show_spinner=False, max_entries=4)
def _conditions(fingerprint: str, system: UnitSystem, _campaign: Campaign) -> pd.DataFrame:  # noqa: ARG001 - the key
    campaign, display = _campaign, Display(system=system)
    rows = []
    for test in campaign.tests:
        condition, run = test.condition, campaign.cae.paired_run(test.condition)
        (of_speed, speed), *weights = display.columns(condition).items()
        row: dict[str, str] = {"Test": test.id, of_speed: speed}
        # the most important first: the rest may be cut off on a narrow page
        by_window: dict[float, Rating] = {}
        if run is not None:
            pulse = Pulse(GRID_S, campaign.cae.accel_mps2[run])
            by_window = rate_windows(test.pulse, pulse, WINDOWS_MS)
        row |= {window_label(w): graded(by_window[w].overall) if w in by_window else "–" for w in WINDOWS_MS}
        row["In CAE range"] = "no" if campaign.cae.extrapolation(condition) else "yes"
        row |= {
            **dict(weights),
            **{name.capitalize(): value for name, value in condition.factors},
            "Paired run": "none" if run is None else campaign.cae.ids[run],
        }
        rows.append(row)
    return pd.DataFrame(rows).fillna("–")


def ratings_table(
    by_approach: Mapping[str, Mapping[float, Rating]],
    window_ms: float,
    repeats: Mapping[float, Repeatability],
    draws: Mapping[str, tuple[float, float]],
) -> Styler:
    """Overall rating with its grade by approach, or other prediction, and window, and the four parts over one window.

    The last column is the interval of the ratings of single draws, the last row what a repeat of the test would rate.
    """
    table = pd.DataFrame(
        {
            "Approach": LABELS.get(name, name),
            **{window_label(w): graded(rating.overall) for w, rating in by_window.items()},
            **{part.capitalize(): f"{getattr(by_window[window_ms], part):.3f}" for part in WEIGHTS},
            "Single draws": "–".join(f"{end:.3f}" for end in draws.get(name, ())) or "–",
        }
        for name, by_window in by_approach.items()
    )
    if repeats:
        repeat = {window_label(w): graded(own.value) for w, own in repeats.items()}
        table = pd.concat([table, pd.DataFrame([{"Approach": REPEAT, **repeat}])], ignore_index=True).fillna("–")
    return _coloured(table)


def mean_ratings_table(study: Study) -> Styler:
    """Overall rating averaged over the held-out tests, by approach and window; below, what repeats would rate."""
    return _coloured(rating_tables.mean_ratings(study))


def paper_table(study: Study, rows: Mapping[str, str]) -> Styler:
    """Ratings by test, approach and window in the form of the paper's tables, best in bold."""
    table = rating_table(study, rows)
    bold = best(table).reset_index(drop=True).map(lambda is_best: "font-weight: 700" if is_best else "")
    shown = table.map("{:.3f}".format, na_action="ignore").fillna("–").reset_index()
    marks = bold.reindex(columns=shown.columns, fill_value="").to_numpy()
    shown["Test"] = shown["Test"].where(~shown["Test"].duplicated(), "")  # each named once, as in the paper
    return literal(shown).apply(lambda _: marks, axis=None)


def metrics_tables(
    columns: Sequence[tuple[str, Sequence[Metric]]], campaign: Campaign, display: Display
) -> tuple[Styler, Styler]:
    """Pulse metrics, the main ones and the others; coloured where an interval does not hold what the test measured."""
    headings = campaign.metric_headings
    shown = {heading: {metric.name: display.metric(metric) for metric in own} for heading, own in columns}
    rows = [
        {"Pulse metric": display.heading(label), **{heading: own[name].text for heading, own in shown.items()}}
        for name, label in headings.items()
    ]
    main = [name in MAIN_METRICS for name in headings]
    table, missed = pd.DataFrame(rows), fill(GRADE_COLOURS["Fair"])
    css = pd.DataFrame("", table.index, table.columns)
    for heading, names in missed_by(columns).items():
        css.loc[[name in names for name in headings], heading] = missed
    parts = (main, [not each for each in main])
    first, second = (literal(table[part]).apply(lambda _, part=part: css[part].to_numpy(), axis=None) for part in parts)
    return first, second


def missed_by(columns: Sequence[tuple[str, Sequence[Metric]]]) -> dict[str, set[str]]:
    """Metrics whose interval does not hold what the test measured, by heading."""
    measured = {metric.name: metric.value for metric in dict(columns).get(TEST_COLUMN, ())}
    missed = {heading: {m.name for m in row if m.holds(measured.get(m.name)) is False} for heading, row in columns}
    return {heading: names for heading, names in missed.items() if names}


def next_tests_styled(ranked: Sequence[NextTest], display: Display) -> Styler:
    """Ranked tests, with the ranking criterion first."""
    table = next_tests_table(ranked, display.units)
    speed = display.title("speed", "mph")
    first = ["rank", speed, "gain (%)", "extrapolation"]
    table = table[[*first, *table.columns.drop(first)]].rename(columns=str.capitalize)
    digits = {"Gain": 1, "Speed": 1, "Band": 2}
    texts = table.assign(
        **{
            name: table[name].map(f"{{:.{digits[name.split()[0]]}f}}".format)
            for name in table.columns
            if name.split()[0] in digits
        }
    )
    return literal(texts.astype(str))


def _coloured(table: pd.DataFrame) -> Styler:
    def style(cell: object) -> str:
        colour = GRADE_COLOURS.get(str(cell).rpartition(" ")[2])
        return fill(colour) if colour else ""

    return literal(table).map(style)


def show_recommendation(sentences: Sequence[str], beside: Sequence[str] = (), icon: str = "lightbulb") -> None:
    """Show the recommendation in a line; reasons and more unfold."""
    first, *reasons = sentences
    with st.container(horizontal=True, wrap=False, vertical_alignment="center", key="recommendation"):
        use, *details = re.split(r"(?<=\\[.:]) ", plain(first), maxsplit=1)  # escaped by then
        st.markdown(f":material/{icon}: **{use}** {''.join(details)}", width="content")
        if reasons or beside:
            with st.popover("More", type="tertiary"):
                st.markdown("\n\n".join(plain(reason) for reason in (*reasons, *beside)))


def show_account(sentences: Sequence[str], *, missed: bool) -> None:
    """Show how a prediction came out and what sets its test apart, as a warning if it ``missed``."""
    first, *others = map(plain, sentences)
    st.markdown(f":material/{'warning' if missed else 'info'}: **{first}** {' '.join(others)}")


def grade_chip(grade: str) -> str:
    """HTML of a grade word in the colour it has in every table and figure."""
    return f'<span class="cf-grade" style="{fill(GRADE_COLOURS[grade])}">{grade}</span>'


def show_terms(config: StudyConfig) -> None:
    """Explain LF where it is mentioned."""
    if "lf_tcn" in config.approaches:
        st.caption(glossary.LF)


def show_metrics(columns: Sequence[tuple[str, Sequence[Metric]]], view: View) -> None:
    """Show pulse metrics by column, the test or an approach, and explain missing numbers."""
    st.subheader("Pulse metrics", help=glossary.TTZV)
    main, more = metrics_tables(columns, view.campaign, view.display)
    missing, more_missing = metric_remarks(columns)
    show_table(main, "metrics")
    with st.expander("More of the pulse: equivalent pulses, loading, rebound", icon=":material/ssid_chart:"):
        show_table(more, "more metrics")
        st.caption(glossary.PULSE_SHAPE)
        for sentence in more_missing:
            st.caption(plain(sentence))
    for sentence in missing:
        st.caption(plain(sentence))
    missed = " Coloured: the test lies outside." if missed_by(columns) else ""
    st.caption(f"Brackets: central 95 % of the model's predictive distribution, where it has one.{missed}")


def show_notes(estimates: Iterable[Estimate], said: Collection[str] = ()) -> None:
    """List each note once, with the approaches it applies to; notes already ``said`` on the page are left out."""
    makers = {note: names for note, names in notes_by_makers(estimates).items() if note not in said}
    if makers:
        st.subheader("Notes")
        st.markdown("\n".join(f"- {', '.join(names)}: {plain(note)}" for note, names in makers.items()))


def show_fits(estimates: Iterable[Estimate]) -> None:
    """Show how the fits went, folded: few readers need it, but those need all of it."""
    for estimate in estimates:
        if sentences := fit_sentences(estimate.state):
            with st.expander(f"How the fit went: {LABELS[estimate.approach].lower()}"):
                st.markdown("\n\n".join(plain(sentence) for sentence in sentences))
                if not (table := fit_table(estimate.state, chosen_units())).empty:
                    show_table(table, f"fit of {estimate.approach}")
