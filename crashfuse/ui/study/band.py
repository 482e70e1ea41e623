"""How far the bands of a study can be trusted: spread of single draws, coverage, calibration."""

import streamlit as st

from crashfuse.reporting import glossary
from crashfuse.reporting.fit_explanations import coverage_table
from crashfuse.ui.figures import show_cached_figure
from crashfuse.ui.study.outcome import Outcome
from crashfuse.ui.study.ratings import choose_way, file_of
from crashfuse.ui.tables import show_table


def show(outcome: Outcome) -> None:
    """Show the ratings of single draws, and how much of the tests lay inside the bands."""
    study, leave_out = choose_way(outcome)
    if not study.coverage:
        st.info("None of these approaches has a band.", icon=":material/info:")
        return
    st.subheader(f"How sure the ratings are, {outcome.window}")
    show_cached_figure(
        lambda: study.plot(figure="draws", display=outcome.view.display),
        f"Rating of each test, {file_of(leave_out)}, by approach, with the interval of those of single drawn pulses",
        "draws",
        leave_out,
        outcome.key,
        name=f"ratings of draws {file_of(leave_out)}",
    )
    st.caption(
        "Marks: rating of the expected pulse. Lines: 95 % of the ratings of single pulses drawn from the band. A "
        "single pulse has oscillations of its own, so it rates lower. Grey: where a repeat of the test would rate."
    )
    st.subheader("What the 95 % band is worth", help=glossary.TTZV)
    show_table(coverage_table(study.coverage), "coverage")
    st.caption(
        "Share of the left-out tests inside the band, up to the time of zero velocity (TTZV) and after it. With "
        f"{len(study.folds)} tests no more can be promised than these counts."
    )
    show_cached_figure(
        lambda: study.plot(figure="calibration", display=outcome.view.display),
        f"Share of the time up to TTZV at which a(t) lies inside bands of each level, each test {file_of(leave_out)}",
        "calibration",
        leave_out,
        outcome.key,
        name=f"coverage by level {file_of(leave_out)}",
    )
    st.caption("Above the dotted line a band is wider than it claims to be, below it too narrow.")
