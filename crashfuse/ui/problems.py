"""Tables of data problems: what was rejected and why, row by row."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import pandas as pd
import streamlit as st

from crashfuse.errors import Problem
from crashfuse.files.csv_text import csv_bytes
from crashfuse.ui.tables import show_table

_MOST_ROWS = 50  # shown; the downloaded file has all
_INSIDE = r"(?:[^()]|\([^()]*\))*"  # of parentheses: a channel's name may have its own
_OPTION = re.compile(rf" \({_INSIDE}--{_INSIDE}\)")


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


def advice_on_page(problem: Problem) -> str:
    """Advice without the command line's options, which are fields on the page."""
    advice = without_options(problem.advice)
    return advice[:1].upper() + advice[1:]


def without_options(text: str) -> str:
    """A sentence without the command line's options, which stand in parentheses."""
    return _OPTION.sub("", text)


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
    """Show all problems in the data, and offer them as a file for whoever has to fix them.

    The same problems may be shown in two places on a page.
    """
    count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
    st.error(f"**{what}: {count}.** {result}", icon=":material/error:")
    key = f"problems {place} {hash((what, *problems))}"
    table = short_table(problems)
    with st.container(border=True, height=420 if len(table) > 8 else "content"):
        show_table(table.head(_MOST_ROWS), f"table of {key}")
    if len(table) > _MOST_ROWS:
        st.caption(f"The first {_MOST_ROWS}; problems.csv has all.")
    st.download_button(
        "problems.csv",
        csv_bytes(problem_table(problems)),
        file_name="problems.csv",
        mime="text/csv",
        icon=":material/download:",
        on_click="ignore",
        key=key,
    )
