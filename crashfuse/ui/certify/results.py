"""Verdicts on the Certify page: what is computed for them, and the tabs that show them."""

from collections.abc import Hashable
from dataclasses import dataclass

import pandas as pd
import streamlit as st
from pandas.io.formats.style import Styler

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification import file_store
from crashfuse.certification.certify import Certification, is_computed
from crashfuse.certification.changes import saved_and_missed
from crashfuse.certification.criteria import Criteria, criteria_text
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import at_most
from crashfuse.certification.verdict import WORDS
from crashfuse.execution.cache import Cache
from crashfuse.files.csv_text import without_formulas
from crashfuse.reporting.certification_facts import Place, exceptions, sentences
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_tables import SHOWN, changes_table, csv_as_given, matrix_table
from crashfuse.reporting.plots.certification import FEW_CONDITIONS, MOST_WORDS, cell_name
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.palette import VERDICT_COLOURS
from crashfuse.reporting.report import certification_report
from crashfuse.reporting.verdicts import Verdicts, certify
from crashfuse.study.config import StudyConfig
from crashfuse.ui.kit import results
from crashfuse.ui.kit.computation import Request, Task, said_of
from crashfuse.ui.kit.figures import choose, show_cached_figure, show_clickable
from crashfuse.ui.kit.files import download_bytes, download_report, download_table
from crashfuse.ui.kit.navigation import open_page
from crashfuse.ui.kit.results import fill, show_table
from crashfuse.ui.kit.text import plain
from crashfuse.ui.predict import fill_in

_CELL = "cell"
_MANY_PX = 640  # for many conditions: what they come to, below, is not far from the first of them
_NUMBERS = "Numbers: probability that a test there would meet the criterion. Click a cell for its reason."
_COLOURS = "Many conditions have colours alone: point at a cell for its verdict. All are in certification.csv."
_MEANINGS = {
    "met": "A test there would meet it, with the confidence asked for.",
    "not met": "A test there would miss it, as surely.",
    "open": "Neither is sure: test it if it was not run yet, or redesign.",
    "outside": "Beyond what the campaign's own tests check.",
}
_RECORD = {
    "What left-out tests showed": (
        "record",
        "Predicted and measured values of each left-out test by criterion, with intervals and limits",
        "Lines: 95 % of tests are predicted to lie there. Left: left out alone; right: with its speed group.",
    ),
    "Are the probabilities right?": (
        "reliability",
        "Share of left-out tests that met a criterion over the probability given, with exact bounds",
        "Verdicts in bins of probability; n is their number, lines are exact 95 % bounds (Clopper and Pearson).",
    ),
}


def judge(campaign: Campaign, criteria: Criteria, matrix: Matrix, config: StudyConfig) -> Request[Verdicts]:
    """Judge criteria at the conditions of a matrix, by the first approach of the settings."""
    approach = config.approaches[0]
    return Task(
        ("certification", said_of(campaign), criteria, matrix, approach, config.preset, config.seed, config.device),
        f"{campaign.name}: verdicts at {len(matrix.ids)} conditions",
        lambda watch: certify(campaign, criteria, matrix, approach=approach, config=config, watch=watch),
        lambda: is_computed(campaign, criteria, matrix, config, Cache()),
    )


@dataclass(frozen=True, eq=False)
class Judgement:
    """Verdicts, the settings behind them, notes on the tests, and how the reader wants to see them."""

    verdicts: Verdicts
    config: StudyConfig
    display: Display
    notes: tuple[Note, ...]
    key: Hashable  # equal for equal verdicts: the beginning of the key of a cached figure

    @property
    def certification(self) -> Certification:
        """Verdicts, record and domain in SI."""
        return self.verdicts.certification

    def show_sentences(self, place: Place) -> None:
        """Show what is said in a place, a line each."""
        st.markdown("\n".join(f"- {plain(sentence)}" for sentence in sentences(self.certification, place)))

    def show_figure(self, name: str, alt: str, file: str) -> None:
        """Show a figure of the verdicts."""
        show_cached_figure(
            lambda: self.verdicts.plot(name, display=self.display), alt, name, self.key, self.display, name=file
        )


def show(judgement: Judgement) -> None:
    """Show the counts of verdicts, the matrix in which a cell can be chosen, what it comes to, and a table of all."""
    verdicts, certification, display = judgement.verdicts, judgement.certification, judgement.display
    n = len(certification.matrix.ids)
    _show_numbers(certification)
    with st.container(height=_MANY_PX if n > FEW_CONDITIONS else "content", border=False):
        show_clickable(
            lambda: verdicts.plot(display=display), "Verdicts by condition and criterion, as in the table below",
            lambda cell: st.session_state.update({_CELL: cell}), "verdict matrix", judgement.key, display,
            name="verdicts",
        )  # fmt: skip
    st.caption(_NUMBERS if n <= MOST_WORDS else _COLOURS)
    _show_cell(certification)
    judgement.show_sentences("matrix")
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
            "A test there would meet all criteria at once, with the confidence asked for. Conditions within 1 km/h and "
            "2 % of each weight count once.",
        ),
        "Wrong so far": (
            f"{missed} of {told}" if told else "–", at_most(missed, told) if told else None,
            "Tests that need not have been run and missed a criterion, with the exact 95 % bound of their share.",
        ),
        **{
            word.capitalize(): (f"{n:,}", f"{100 * n / len(certification.cells):.0f} %", _MEANINGS[word])
            for word, n in certification.counts.items()
        },
    }  # fmt: skip
    with st.container(horizontal=True, gap="large"):
        for label, (number, below, meaning) in shown.items():
            st.metric(label, number, below, delta_color="off", delta_arrow="off", help=meaning, width="content")


def _show_table(certification: Certification, display: Display) -> None:
    words = st.pills("Verdicts", WORDS, selection_mode="multi", key="verdicts", persist_state="session")
    table, heading = SHOWN["verdicts"](certification, display), display.title("Speed", "mph")
    table.insert(1, heading, [display.speeds(verdict.condition.speed_mps) for _, verdict in certification.cells])
    table = without_formulas(table)  # the page offers it as CSV
    table = table[table["Verdict"].isin(words)]
    st.dataframe(
        coloured(table, "Verdict"),
        hide_index=True,
        height=min(36 * len(table) + 40, 560),
        column_config={
            heading: st.column_config.NumberColumn(format="%.1f"),
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


def show_record(judgement: Judgement) -> None:
    """Show how often verdicts on left-out tests were wrong, by criterion, and how reliable the probabilities are."""
    st.markdown(
        "Every test was left out, alone and with all others at about its speed, got its verdicts from the remaining "
        "tests, and is compared with what was measured."
    )
    judgement.show_sentences("record")
    if judgement.certification.record.trials:
        show_table(SHOWN["record"](judgement.certification, judgement.display), "counts")
        name, alt, meaning = _RECORD[choose("Figure", list(_RECORD), key="record")]
        judgement.show_figure(name, alt, "track_record" if name == "record" else name)
        st.caption(meaning)


def show_domain(judgement: Judgement) -> None:
    """Show where predictions are checked, with the conditions of the matrix in it."""
    alt = "Speed against mass: the checked region, CAE runs, tests and the conditions of the matrix"
    judgement.show_figure("domain", alt, "validated_domain")
    st.caption("  \n".join(plain(sentence) for sentence in sentences(judgement.certification, "domain")))


def show_exceptions(judgement: Judgement) -> None:
    """List what has to be known against the verdicts."""
    for subject, told in exceptions(judgement.certification).items():
        st.markdown(f"**{plain(subject)}**\n" + "\n".join(f"- {plain(sentence)}" for sentence in told))


def show_files(judgement: Judgement) -> None:
    """Offer them; criteria and matrix ask for the same again."""
    verdicts, certification = judgement.verdicts, judgement.certification
    of = certification.campaign.name
    with st.container(horizontal=True):
        download_bytes("certification.csv", lambda: csv_as_given(verdicts.table), of)
        download_table("track_record.csv", lambda: verdicts.track_record, of)
        if certification.since is not None:
            download_bytes("changes.csv", lambda: csv_as_given(changes_table(certification)), of)
        download_bytes("criteria.toml", lambda: criteria_text(certification.criteria).encode(), of)
        download_bytes("matrix.csv", lambda: csv_as_given(matrix_table(certification.matrix)), of)
        download_bytes("certification.json", lambda: certification_json(certification), of)
        download_report(lambda: certification_report(certification, judgement.display, judgement.notes), of)
