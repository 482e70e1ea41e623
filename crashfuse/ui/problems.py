"""What was refused and why, row by row."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import pandas as pd
import streamlit as st

from crashfuse.errors import Problem
from crashfuse.ui.text import plain

_MOST_ROWS = 50  # shown; the file to download has all
_OPTION = re.compile(r" \([^()]*--[^()]*\)")
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def problem_table(problems: Sequence[Problem]) -> pd.DataFrame:
    """One row of text a problem: where it is, what was expected there, what was found, what to do."""
    return pd.DataFrame([_cells(problem, "" if problem.row is None else str(problem.row)) for problem in problems])


def short_table(problems: Sequence[Problem]) -> pd.DataFrame:
    """The same with neighbours that differ by the row alone in one, as rows 2–21."""
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
    """What to do, without the command line's options: here are fields for them."""
    advice = _OPTION.sub("", problem.advice)
    return advice[:1].upper() + advice[1:]


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
    """Show everything that is wrong with the data, and offer it as a file for whoever has to mend them.

    The same problems may be shown at two places of a page.
    """
    count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
    st.error(f"**{what}: {count}.** {result}", icon=":material/error:")
    table = short_table(problems)
    with st.container(border=True, height=420 if len(table) > 8 else "content"):
        st.table(table.head(_MOST_ROWS).map(plain).style.hide(axis="index"), border="horizontal")
    if len(table) > _MOST_ROWS:
        st.caption(f"The first {_MOST_ROWS}; problems.csv has all.")
    st.download_button(
        "problems.csv",
        problem_table(problems).map(_no_formula).to_csv(index=False).encode(),
        file_name="problems.csv",
        mime="text/csv",
        icon=":material/download:",
        on_click="ignore",
        key=f"problems {place} {hash((what, *problems))}",
    )


def _no_formula(cell: str) -> str:
    """A cell that no spreadsheet takes for a formula: it may hold a stranger's file name."""
    return f"'{cell}" if cell.startswith(_FORMULA) else cell
