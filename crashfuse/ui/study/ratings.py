"""Mean ratings of a study by window, and every test's by approach: alone, and with its speed group left out."""

import streamlit as st

from crashfuse.reporting import glossary
from crashfuse.study.account import worst_test
from crashfuse.study.config import has_speed_groups
from crashfuse.study.recommendation import recommend
from crashfuse.study.study import Study
from crashfuse.ui import explanations, page_tables
from crashfuse.ui.chosen import choose_held_out
from crashfuse.ui.computation import StudyRequest, jobs
from crashfuse.ui.figures import choose, show_clickable
from crashfuse.ui.navigation import open_page
from crashfuse.ui.study.outcome import Outcome
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain

_ALONE, _GROUP = page_tables.WAYS.values()


def by_group(request: StudyRequest) -> bool:
    """Whether tests are left out with all at about their speed: where a study has both ways, as the reader has chosen.

    Of a study that is being computed, the way that is shown: at first each test left out alone.
    """
    if request.config.leave_out != "both":
        return request.config.leave_out == "speed group"
    job = jobs().get(request.key)
    study = None if job is None else job.part if job.result is None else job.result
    both = has_speed_groups(request.campaign) if study is None else study.speed_groups is not None
    return both and st.session_state.get("ways") == _GROUP


def choose_way(outcome: Outcome) -> tuple[Study, str]:
    """The study by one way of leaving tests out, and which: what is left out with a test."""
    study = outcome.study
    if study.speed_groups is not None and choose("Left out", [_ALONE, _GROUP], key="ways") == _GROUP:
        return study.speed_groups, "speed group"
    return study, "speed group" if study.config.leave_out == "speed group" else "test"


def file_of(leave_out: str) -> str:
    """What was left out with a test, in the name of a file."""
    return "left out with its speed group" if leave_out == "speed group" else "left out alone"


def show(outcome: Outcome) -> None:
    """Show the ratings of one way of leaving tests out."""
    campaign, (study, leave_out) = outcome.view.campaign, choose_way(outcome)
    _show_tests(outcome, study, leave_out)
    if outcome.whole:
        worst = worst_test(study, outcome.window_ms, approach=recommend(outcome.study).approach)
        explanations.show_account(worst.sentences, missed=worst.disappoints)
    st.markdown("**Mean over the tests, by window**")
    show_table(page_tables.mean_ratings(study), "means")
    st.caption(f"{campaign.rating_basis}: Excellent above 0.94, Good above 0.80, Fair above 0.58, else Poor.")
    for test in campaign.tests:
        for note in campaign.cae.extrapolation(test.condition):
            st.caption(f":material/warning: {plain(test.id)}: {plain(note)}")


def _show_tests(outcome: Outcome, study: Study, leave_out: str) -> None:
    tests = [fold.held_out for fold in study.folds]
    st.markdown(f"**Each test, {outcome.window}**")

    def open_test(cell: str) -> None:
        """Open a test as this study left it out; *Why* explains the approach whose cell it was."""
        test_id, _, approach = cell.partition(":")
        choose_held_out(outcome.view.campaign.test(test_id))
        st.session_state["leave_out"] = leave_out
        if approach:
            st.session_state["explained"] = approach

    clicked = show_clickable(
        lambda: study.plot(display=outcome.view.display),
        f"Ratings of each test, {file_of(leave_out)}, by approach, with their mean; the same numbers are in the tables",
        open_test,
        f"heat map {leave_out}",
        outcome.key,
        name=f"ratings {file_of(leave_out)}",
    )
    with st.container(horizontal=True, vertical_alignment="center"):
        st.markdown("Click a cell, or choose a test, to see it on the page Compare.", width="content")
        chosen = st.selectbox(
            "Open a test on Compare", tests, index=None, placeholder="Test", key="open_test", width=160,
            label_visibility="collapsed", on_change=lambda: open_test(st.session_state["open_test"]),
        )  # fmt: skip
    if clicked or chosen is not None:
        open_page("compare")
    if study.repeats(outcome.window_ms):
        st.caption(glossary.REPEAT)
