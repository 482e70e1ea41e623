"""What pages show of results: tables, problems in data, recommendation, notes."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import groupby

import pandas as pd
import streamlit as st
from pandas.io.formats.style import Styler

from crashfuse.approaches.registry import label_of
from crashfuse.errors import DataError, Problem, UsageError
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.display import Display
from crashfuse.results.plots.palette import GRADE_COLOURS, IN_THE_DARK, MEASURED_COLOUR
from crashfuse.results.rating_tables import TTZV_COLUMN
from crashfuse.results.render.text import spreadsheet_text
from crashfuse.results.result import Result
from crashfuse.results.table import VAGUE, Cell, Column, Table
from crashfuse.signals.metrics import MAIN_METRICS, in_sentence
from crashfuse.signals.rating import WEIGHTS, Rating
from crashfuse.ui.kit.navigation import component
from crashfuse.ui.kit.text import METRICS, PULSE_SHAPE, advice_on_page, chosen_units, plain

_UNUSABLE = "This campaign cannot be used"
_MOST_ROWS = 50  # shown; the downloaded file has all


def show_table(table: Table, key: str = "", remark: str = "", meanings: Sequence[str] = ()) -> None:
    """Show a table with a button that copies it, a remark, and what its rows mean as tooltips."""
    units, flipped = chosen_units(), st.session_state.get("sign") == "Deceleration"
    display = Display(unit=units.acceleration, deceleration=flipped, system=units)
    st.table(styled(table, display), border="horizontal")
    copy = component("copy_table", css="buttons.css")
    text = spreadsheet_text(table, display)
    with st.container(horizontal=True, vertical_alignment="center", gap="small"):
        copy(data={"text": text, "meanings": list(meanings)}, key=f"copy {key or table.name}", width="content")
        st.caption(remark)


def styled(table: Table, display: Display) -> Styler:
    """A table on a page: numbers at the right, intervals lighter, grades and what stands out in colours."""
    columns, shown = table.cells(display), table.texts(display).rename(columns=plain)
    styler, right = shown.style.hide(axis="index"), "right !important"
    for place, (name, (column, cells)) in enumerate(zip(shown, columns.values(), strict=True)):
        styler.format({cell.text: _markdown(column, cell) for cell in cells}.__getitem__, subset=[name])
        colours = [GRADE_COLOURS["Fair"] if cell.is_marked else "" for cell in cells]
        if column.kind == "grade":
            colours = [GRADE_COLOURS.get(cell.detail, "") for cell in cells]
        styler.apply(lambda _, css: css, css=[colour and _fill(colour) for colour in colours], subset=[name])
        if column.is_numeric:
            styler.set_properties(subset=[name], **{"text-align": right})
            styler.set_table_styles([{"selector": f"th.col{place}", "props": f"text-align: {right}"}], overwrite=False)
    return styler


def _markdown(column: Column, cell: Cell) -> str:
    if not cell.detail:
        return plain(cell.text)
    look = {"interval": ":gray[{}]", "pair": "**{}**"}.get(column.kind, "{}")
    detail = look.format(plain(cell.detail))
    return f"{plain(cell.value)} {detail}".replace(" ", "\N{NO-BREAK SPACE}")


def _fill(colour: str) -> str:
    ground, ink = colour, MEASURED_COLOUR
    if st.context.theme.type == "dark":
        ground, ink = IN_THE_DARK[colour], IN_THE_DARK[MEASURED_COLOUR]
    return f"background-color: {ground}; color: {ink}"


def problem_table(problems: Sequence[Problem], *, merged: bool = False) -> pd.DataFrame:
    """One row per problem, or per run of neighbours that differ only in their row, as in 2–21."""
    runs = groupby(problems, key=lambda problem: replace(problem, row=None) if merged else id(problem))
    table = []
    for first, *others in (tuple(run) for _, run in runs):
        numbers = [problem.row for problem in (first, *others) if problem.row is not None]
        rows = ", ".join(map(str, numbers))
        if len(numbers) > 1 and numbers == list(range(numbers[0], numbers[-1] + 1)):
            rows = f"{numbers[0]}–{numbers[-1]}"
        table.append((first.where, rows, first.column or "", first.expected, first.found, advice_on_page(first)))
    return pd.DataFrame(table, columns=["File", "Row", "Column", "Expected", "Found", "What to do"])


def show_problems(
    problems: Sequence[Problem], what: str = _UNUSABLE, result: str = "Nothing of it was opened.", *, place: str = ""
) -> None:
    """Show all problems in the data, and offer them as a file."""
    n = len(problems)
    st.error(f"**{what}: {n} problem{'s' * (n != 1)}.** {result}", icon=":material/error:")
    key = f"problems {place} {hash((what, *problems))}"
    table = Table.of("problems", problem_table(problems, merged=True))
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


def ratings_table(
    by_approach: Mapping[str, Mapping[float, Rating]],
    window_ms: float,
    draws: Mapping[str, tuple[float, float]],
    to_ttzv: Mapping[str, float],
) -> Table:
    """Ratings by prediction and window, parts and draws over one window."""
    rows: list[dict[str, object]] = [
        {
            "Approach": label_of(name),
            **{window_label(w): rating.overall for w, rating in by_window.items()},
            **({TTZV_COLUMN: to_ttzv[name]} if name in to_ttzv else {}),
            **{part.capitalize(): getattr(by_window[window_ms], part) for part in WEIGHTS},
            "Single draws": None,
            **dict(zip(("Single draws lower", "Single draws upper"), draws.get(name, ()), strict=False)),
        }
        for name, by_window in by_approach.items()
    ]
    windows = {window_label(w) for by_window in by_approach.values() for w in by_window}
    grades = (Column(name, "grade") for name in (*windows, TTZV_COLUMN))
    parts = (Column(part.capitalize(), "number", form=".3f") for part in WEIGHTS)
    return Table.of("ratings", rows, *grades, *parts, Column("Single draws", "range", form=".3f"))


def show_with_reasons(text: str, reasons: Sequence[str]) -> None:
    """Show what is known, in Markdown; reasons unfold."""
    with st.container(horizontal=True, wrap=False, vertical_alignment="center", key="recommendation"):
        st.markdown(text, width="content")
        if reasons:
            with st.popover("More", type="tertiary"):
                st.markdown("\n\n".join(map(plain, reasons)))


def show_metrics(about: Result, *hidden: str, beside: bool = False) -> None:
    """Show the main pulse metrics, but for those hidden; in few words beside a figure."""
    main = about.tables["metrics"].without(*hidden)
    headings = main.frame["label"]
    if beside:
        short = headings.map(in_sentence)
        main = replace(main, frame=main.frame.assign(label=short.str[:1].str.upper() + short.str[1:]))
    has_dash = any(cell.detail == VAGUE for _, cells in main.cells().values() for cell in cells)
    remark = "Middle [95 of 100 tests]." + f" {VAGUE}: wider than its value." * has_dash
    missed = " Coloured: the test lies outside." if main.is_marked else ""
    meanings = [f"{headings[name]}: {METRICS[name]}" for name in MAIN_METRICS]
    show_table(main, remark=f"{remark}{missed}", meanings=meanings)


def show_details(about: Result, remarks: Sequence[str] = ()) -> None:
    """Show, folded, what few readers need."""
    with st.expander("More metrics, notes, fits", icon=":material/notes:"):
        show_table(about.tables["more_metrics"])
        st.caption(PULSE_SHAPE)
        st.caption("  \n".join(map(plain, [*about.sentences["more_missing"], *remarks])))
        st.markdown("\n".join(f"- {plain(text)}" for text in about.sentences["remarks"]))
        for fit in about.parts["fits"]:
            st.markdown("\n\n".join([f"**{fit.title}**", *map(plain, fit.sentences["fit"])]))
            if not (table := fit.tables["hyperparameters"]).empty:
                show_table(table)
