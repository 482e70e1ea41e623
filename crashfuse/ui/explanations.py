"""Explanations on a page: recommendation, settings, glossary, notes of the approaches, quality of the fits."""

import re
from collections.abc import Collection, Iterable, Sequence

import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting import glossary
from crashfuse.reporting.fit_explanations import fit_sentences, fit_table, missing_by_table, notes_by_makers
from crashfuse.reporting.plots.palette import GRADE_COLOURS
from crashfuse.signals.metrics import Metric
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.ui import page_tables
from crashfuse.ui.chosen import View
from crashfuse.ui.look import fill
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import chosen_units, plain


def show_recommendation(sentences: Sequence[str], beside: Sequence[str] = (), icon: str = "lightbulb") -> None:
    """Show the recommendation in a line; the reasons, and what else is to be said beside it, unfold from "More"."""
    first, *reasons = sentences
    with st.container(horizontal=True, wrap=False, vertical_alignment="center", key="recommendation"):
        use, *rest = re.split(r"(?<=\\[.:]) ", plain(first), maxsplit=1)  # escaped by then
        st.markdown(f":material/{icon}: **{use}** {''.join(rest)}", width="content")
        if reasons or beside:
            with st.popover("More", type="tertiary"):
                st.markdown("\n\n".join(plain(reason) for reason in (*reasons, *beside)))


def show_account(sentences: Sequence[str], *, missed: bool) -> None:
    """Show how the prediction of a test came out and what sets the test apart; what ``missed`` is a warning."""
    first, *others = map(plain, sentences)
    st.markdown(f":material/{'warning' if missed else 'info'}: **{first}** {' '.join(others)}")


def grade_chip(grade: str) -> str:
    """HTML of a grade word in the colour it has in every table and figure."""
    return f'<span class="cf-grade" style="{fill(GRADE_COLOURS[grade])}">{grade}</span>'


def show_terms(config: StudyConfig) -> None:
    """Explain LF where it is mentioned."""
    if "lf_tcn" in config.approaches:
        st.caption(glossary.LF)


def patience(config: StudyConfig, usually: str) -> str:
    """Typical duration of a computation, adjusted if the settings are the paper's."""
    return usually if config.preset == "fast" else "With the paper's settings this takes many hours without a GPU."


def show_missing(config: StudyConfig, known: Collection[str]) -> None:
    """Say which approaches a comparison does not show yet, if any, as their networks are still training."""
    if missing := [name for name in config.approaches if name not in known]:
        st.info(f"{', '.join(LABELS[name] for name in missing)}: still training.", icon=":material/hourglass_top:")


def show_metrics(columns: Sequence[tuple[str, Sequence[Metric]]], view: View) -> None:
    """Show pulse metrics by column (the test, an approach), the main ones first, and explain missing numbers."""
    st.subheader("Pulse metrics", help=glossary.TTZV)
    main, more = page_tables.metrics(columns, view.campaign, view.display)
    missing, more_missing = missing_by_table(columns)
    show_table(main, "metrics")
    with st.expander("More of the pulse: equivalent pulses, loading, rebound", icon=":material/ssid_chart:"):
        show_table(more, "more metrics")
        st.caption(glossary.PULSE_SHAPE)
        for sentence in more_missing:
            st.caption(plain(sentence))
    for sentence in missing:
        st.caption(plain(sentence))
    missed = " Coloured: the test lies outside." if page_tables.missed_by(columns) else ""
    st.caption(f"Brackets: central 95 % of the model's predictive distribution, where it has one.{missed}")


def show_notes(estimates: Iterable[Estimate], said: Collection[str] = ()) -> None:
    """List each note once, with the approaches it applies to; notes already ``said`` on the page are left out."""
    makers = {note: names for note, names in notes_by_makers(estimates).items() if note not in said}
    if makers:
        st.subheader("Notes")
        st.markdown("\n".join(f"- {', '.join(names)}: {plain(note)}" for note, names in makers.items()))


def show_fits(estimates: Iterable[Estimate]) -> None:
    """Show how the fits went, in a collapsed section: few readers need it, but those need all of it."""
    for estimate in estimates:
        if sentences := fit_sentences(estimate.state):
            with st.expander(f"How the fit went: {LABELS[estimate.approach].lower()}"):
                st.markdown("\n\n".join(plain(sentence) for sentence in sentences))
                if not (table := fit_table(estimate.state, chosen_units())).empty:
                    show_table(table, f"fit of {estimate.approach}")
