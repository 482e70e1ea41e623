"""Verdicts on the Certify page: the matrix, one cell of it, and the table."""

import pandas as pd
import streamlit as st
from pandas.io.formats.style import Styler

from crashfuse.certification import file_store
from crashfuse.certification.certify import Certification
from crashfuse.certification.verdict import WORDS
from crashfuse.files.csv_text import without_formulas
from crashfuse.reporting.certification_changes import saved_and_missed
from crashfuse.reporting.certification_sentences import beside_matrix
from crashfuse.reporting.certification_tables import verdict_counts, verdicts_shown
from crashfuse.reporting.evidence_sentences import at_most
from crashfuse.reporting.plots.certification import FEW_CONDITIONS, MOST_WORDS, cell_name
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.palette import VERDICT_COLOURS
from crashfuse.ui.certify.request import Judgement
from crashfuse.ui.kit import results
from crashfuse.ui.kit.figures import show_clickable
from crashfuse.ui.kit.results import fill
from crashfuse.ui.kit.text import plain
from crashfuse.ui.kit.window import open_page
from crashfuse.ui.predict import fill_in

_CELL = "cell"
_MANY_PX = 640  # for many conditions: what they come to, below, is not far from the first of them
_NUMBERS = "Numbers: probability that a test there would meet the criterion. Click a cell for its reason."
_COLOURS = (
    "So many conditions have colours alone: point at a cell for its verdict. The answers are in certification.csv."
)
_MEANINGS = {
    "met": "A test there would meet the criterion, with the confidence asked for.",
    "not met": "A test there would miss it, with the same confidence.",
    "open": "Neither can be said with confidence: test it if it was not run yet, or redesign.",
    "outside": "Beyond what the campaign's own tests check.",
}


def show(judgement: Judgement) -> None:
    """Show the counts of verdicts, the matrix in which a cell can be chosen, what it comes to, and a table of all."""
    verdicts, certification, display = judgement.verdicts, judgement.certification, judgement.display
    n = len(certification.matrix.ids)
    _show_numbers(certification)
    with st.container(height=_MANY_PX if n > FEW_CONDITIONS else "content", border=False):
        show_clickable(
            lambda: verdicts.plot(display=display),
            "Verdicts by condition and criterion; the same words are in the table below",
            lambda cell: st.session_state.update({_CELL: cell}),
            "verdict matrix",
            judgement.key,
            display,
            name="verdicts",
        )
    st.caption(_NUMBERS if n <= MOST_WORDS else _COLOURS)
    _show_cell(certification)
    st.markdown("\n".join(f"- {plain(sentence)}" for sentence in beside_matrix(certification)))
    if certification.since is None and (alone := file_store.beside_none(certification.campaign)):
        st.caption(f":material/history: {plain(alone)} Choose one under *Earlier verdicts*.")
    with st.expander("All verdicts as a table", icon=":material/table:"):
        _show_table(certification, display)
    results.show_terms(judgement.config)


def _show_numbers(certification: Certification) -> None:
    """Show the answer, how often such answers were wrong, and the counts of verdicts; in rows, so that none is cut."""
    (saved, of), (told, missed) = certification.saved, saved_and_missed(certification)
    shown = {
        "Need not be run": (
            f"{saved} of {of}", f"confidence {certification.criteria.confidence:g}",
            "Conditions at which a test would meet all criteria at once, with the confidence asked for; those that are "
            "one to within 1 km/h and 2 % of each weight are counted once, as one that takes a test if there is one.",
        ),
        "Wrong so far": (
            f"{missed} of {told}" if told else "–", at_most(missed, told) if told else None,
            "Of left-out tests that need not have been run by their verdicts, and tests that an earlier certification "
            "said need not be run and that were run since, those that missed a criterion; with the exact one-sided "
            "95 % bound of their share.",
        ),
        **{
            word.capitalize(): (f"{n:,}", f"{100 * n / len(certification.cells):.0f} %", _MEANINGS[word])
            for word, n in verdict_counts(certification).items()
        },
    }  # fmt: skip
    with st.container(horizontal=True, gap="large"):
        for label, (number, beside, meaning) in shown.items():
            st.metric(label, number, beside, delta_color="off", delta_arrow="off", help=meaning, width="content")


def _show_table(certification: Certification, display: Display) -> None:
    """Show verdicts of chosen kinds, one row a condition and criterion."""
    words = st.pills("Verdicts", WORDS, selection_mode="multi", key="verdicts", persist_state="session")
    table = verdicts_shown(certification, display)
    speeds = [display.speeds(verdict.condition.speed_mps) for _, verdict in certification.cells]
    table.insert(1, display.title("Speed", "mph"), speeds)
    table = without_formulas(table)  # the page offers it as CSV
    table = table[table["Verdict"].isin(words)]
    st.dataframe(
        coloured(table, "Verdict"),
        hide_index=True,
        height=min(36 * len(table) + 40, 560),
        column_config={
            display.title("Speed", "mph"): st.column_config.NumberColumn(format="%.1f"),
            "Probability": st.column_config.TextColumn(alignment="right"),
            "Reason": st.column_config.TextColumn(width="large"),
        },
        alt="Verdicts by condition and criterion, with values, intervals, probabilities and reasons",
    )


def _show_cell(certification: Certification) -> None:
    cells = {cell_name(i, verdict): verdict for i, verdict in certification.cells}
    if st.session_state.get(_CELL) not in (None, *cells):  # of another matrix, or of a criterion that was renamed
        st.session_state[_CELL] = None
    chosen = st.selectbox(
        "Cell", list(cells), index=None, placeholder="Choose a condition and criterion, or click a cell", key=_CELL,
        persist_state="session", label_visibility="collapsed",
    )  # fmt: skip
    if chosen is None:
        return
    verdict = cells[chosen]
    with st.container(border=True):
        st.markdown(f"**{plain(chosen)}: {verdict.word}**")
        st.markdown(plain(verdict.reason))
        st.caption(f"{plain(verdict.condition)}; {plain(verdict.criterion.label)}, {plain(verdict.criterion.limits)}")
        button = "See the predicted pulse there"
        args = (certification.campaign, verdict.condition)
        if st.button(button, icon=":material/arrow_forward:", on_click=fill_in, args=args):
            open_page("predict")


def coloured(table: pd.DataFrame, *columns: str) -> Styler:
    """A table whose verdicts in these columns have their colours."""
    styles = {word: fill(colour) for word, colour in VERDICT_COLOURS.items()}
    return table.style.map(lambda word: styles.get(word, ""), subset=list(columns))
