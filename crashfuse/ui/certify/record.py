"""What stands behind the verdicts on the Certify page: the record of left-out tests, and the validated domain."""

import streamlit as st

from crashfuse.reporting.certification_exceptions import exceptions
from crashfuse.reporting.certification_tables import record_shown
from crashfuse.reporting.evidence_sentences import (
    brier_sentence,
    domain_sentences,
    interval_sentence,
    record_sentence,
    waived_sentence,
)
from crashfuse.ui.certify.request import Judgement
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain

_MEASURED, _RELIABILITY = "What left-out tests showed", "Are the probabilities right?"


def show(judgement: Judgement) -> None:
    """Show how often verdicts on left-out tests were wrong, by criterion, and how reliable the probabilities are."""
    verdicts, certification, display = judgement.verdicts, judgement.certification, judgement.display
    record = certification.record
    st.markdown(
        "Every test was left out, alone and with all others at about its speed, got its verdicts from the remaining "
        "tests, and is compared with what was measured. The table counts both; what the record supports, a test once."
    )
    waived = waived_sentence(record, certification.criteria)
    evidence = *interval_sentence(record), *brier_sentence(record)
    st.markdown("\n".join(f"- {plain(s)}" for s in (record_sentence(record), *waived, *evidence)))
    if not record.trials:
        return
    show_table(record_shown(certification, display), "counts")
    if choose("Figure", [_MEASURED, _RELIABILITY], key="record") == _MEASURED:
        show_cached_figure(
            lambda: verdicts.plot("record", display=display),
            "Predicted and measured values of each left-out test by criterion, with intervals and limits",
            "record",
            judgement.key,
            display,
            name="track_record",
        )
        st.caption(
            "Lines: 95 % of tests are predicted to lie there. Left: left out alone; right: with its speed group."
        )
    else:
        show_cached_figure(
            lambda: verdicts.plot("reliability"),
            "Share of left-out tests that met a criterion over the probability given, with exact bounds",
            "reliability",
            judgement.key,
            name="reliability",
        )
        st.caption(
            "Verdicts on left-out tests inside what the others check, in bins of probability; n is their number, the "
            "lines exact 95 % bounds (Clopper and Pearson). Where the dotted line passes within them, nothing that was "
            "measured speaks against the probabilities."
        )


def show_domain(judgement: Judgement) -> None:
    """Show where predictions are checked, with the conditions of the matrix in it."""
    verdicts, display = judgement.verdicts, judgement.display
    show_cached_figure(
        lambda: verdicts.plot("domain", display=display),
        "Speed against mass: the checked region, CAE runs, tests and the conditions of the matrix",
        "domain",
        judgement.key,
        display.system,
        name="validated_domain",
    )
    st.caption("  \n".join(plain(sentence) for sentence in domain_sentences(verdicts.certification.domain)))


def show_exceptions(judgement: Judgement) -> None:
    """List what has to be known against the verdicts."""
    for subject, sentences in exceptions(judgement.certification).items():
        st.markdown(f"**{plain(subject)}**\n" + "\n".join(f"- {plain(sentence)}" for sentence in sentences))
