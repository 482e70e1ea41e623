"""The page Study: ratings of tests left out in turn, the bands, how many tests are enough, and past results."""

import math
from collections.abc import Hashable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.certification.verdict import with_decided
from crashfuse.errors import DataError
from crashfuse.results.figures import how_left_out
from crashfuse.results.fit_explanations import coverage_table
from crashfuse.results.planning import CURVE_MEANING, ONE_MORE_MEANING, learning_curve_result
from crashfuse.results.study import means_table, quality_table, study_files, study_result
from crashfuse.study.config import StudyConfig
from crashfuse.study.learning_curve import CURVE_CONFIG
from crashfuse.study.one_more_test import Cost
from crashfuse.study.recommendation import recommend, worst_test
from crashfuse.study.study import Study
from crashfuse.ui import past_results
from crashfuse.ui.kit import results
from crashfuse.ui.kit.address import choose_held_out, chosen_config, kept
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import learn_curve, study_request
from crashfuse.ui.kit.figures import choose, show_cached_figure, show_clickable, show_figure
from crashfuse.ui.kit.files import choose_report, export_button, offer, offer_result
from crashfuse.ui.kit.navigation import open_page
from crashfuse.ui.kit.progress import result_of, result_or_none, show_training, stop_with_a_single_test
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import DRAWS, TTZV, plain

_NUMBER, _PAST, _BANDS = "Number of tests", "Past results", "Bands"
_TABS = ["Ratings", _BANDS, _NUMBER, _PAST]
_ALONE, _GROUP = "Each test left out alone", "With all tests at about its speed"


def show(view: View) -> None:
    """Show the tab that the user chooses."""
    row = st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center")
    with row:
        tab = choose("Tab", _TABS, key="study_tab")
    if tab == _PAST:
        past_results.show(view, row)
        return
    stop_with_a_single_test(view.campaign)
    if tab == _NUMBER:
        _show_learning_curve(view, chosen_config(), row)
        return
    config, n = chosen_config(), len(view.campaign.tests)
    if config.preset == "fast":  # with the paper's settings it takes hours
        config = replace(config, leave_out="both")
    request = study_request(view.campaign, view.campaign.test_ids, config)
    again = "; then again with all at about its speed" if config.leave_out == "both" else ""
    invitation = f"Every test is left out in turn and predicted from the others{again}."
    study = result_of(request, invitation=invitation, button=f"Leave out each of {n} tests")
    known = tuple((fold.held_out, *fold.ratings) for way in (study, study.speed_groups) if way for fold in way.folds)
    is_whole = len(study.folds) == n and study.config.approaches == config.approaches
    outcome = _Outcome(view, study, is_whole, (request.key, known, tuple(study.repeatability), view.display))
    with row:
        export_button(partial(_show_files, outcome))
    show_training(config, study.config.approaches)
    (_show_bands if tab == _BANDS else _show_ratings)(outcome)


class _Outcome(NamedTuple):
    view: View
    study: Study  # while networks train, of fewer approaches than the settings ask for
    is_whole: bool  # before that, nothing can be recommended
    key: Hashable  # of cached figures

    @property
    def shown(self) -> Study:
        groups = self.study.speed_groups
        return groups if groups is not None and st.session_state.get("ways") == _GROUP else self.study


def _choose_way(outcome: _Outcome) -> tuple[Study, str]:
    if outcome.study.speed_groups is not None:
        choose("Left out", [_ALONE, _GROUP], key="ways")
    return outcome.shown, outcome.shown.config.split_configs[0].leave_out


def _show_ratings(outcome: _Outcome) -> None:
    campaign, display = outcome.view.campaign, outcome.view.display
    if outcome.is_whole:
        use, *reasons = (display.words(fact.sentence) for fact in recommend(outcome.shown).facts)
        basis = f"By {campaign.rating_basis}: Excellent above 0.94, Good above 0.80, Fair above 0.58."
        results.show_with_reasons(f":material/lightbulb: **{plain(use)}**", [*reasons, basis])
        over = f"Ratings over {results.window_label(display.window_ms)}."
        show_table(quality_table(outcome.study, display.window_ms), "quality", over)
    study, leave_out = _choose_way(outcome)
    _show_tests(outcome, study, leave_out)
    if outcome.is_whole:
        worst = worst_test(study, display.window_ms)
        with st.expander(f"The worst test, {plain(worst.test.id)}", icon=":material/troubleshoot:"):
            first, *others = map(plain, worst.sentences)
            st.markdown(f":material/{'warning' if worst.disappoints else 'info'}: **{first}** {' '.join(others)}")
    with st.expander("Mean over the tests, by window", icon=":material/table:"):
        show_table(means_table(study), "means")
    for test in campaign.tests:
        for note in campaign.cae.extrapolation(test.condition):
            st.caption(f":material/warning: {plain(test.id)}: {plain(note)}")


def _show_tests(outcome: _Outcome, study: Study, leave_out: str) -> None:
    tests = [fold.held_out for fold in study.folds]

    def open_test(cell: str) -> None:
        test_id, _, approach = cell.partition(":")
        choose_held_out(outcome.view.campaign.test(test_id))
        st.session_state["leave_out"] = leave_out
        if approach:
            st.session_state["explained"] = approach

    left_out, draw = how_left_out(leave_out), partial(study.draw, display=outcome.view.display)
    alt = f"Ratings of each test, {left_out}, by approach, with their mean"
    clicked = show_clickable(draw, alt, open_test, f"heat map {leave_out}", outcome.key, name=f"ratings {left_out}")
    with st.container(horizontal=True, vertical_alignment="center"):
        st.markdown("Click a cell, or choose a test:", width="content")
        chosen = st.selectbox(
            "Open a test on Compare", tests, index=None, placeholder="Compare", key="open_test", width=160,
            label_visibility="collapsed", on_change=lambda: open_test(st.session_state["open_test"]),
        )  # fmt: skip
    if clicked or chosen is not None:
        open_page("compare")


def _show_bands(outcome: _Outcome) -> None:
    study, leave_out = _choose_way(outcome)
    if not study.coverage:
        st.info("None of these approaches has a band.", icon=":material/info:")
        return
    left_out, draw = how_left_out(leave_out), partial(study.draw, display=outcome.view.display)

    def show(figure: str, alt: str, name: str) -> None:
        show_cached_figure(partial(draw, figure=figure), alt, figure, leave_out, outcome.key, name=f"{name} {left_out}")

    left, right = st.columns(2, gap="medium")
    with left:
        meaning = f"Marks: rating of the expected pulse. Lines: {DRAWS}"
        st.subheader(f"How sure the ratings are, {results.window_label(outcome.view.display.window_ms)}", help=meaning)
        alt = f"Rating of each test, {left_out}, by approach, with the interval of single draws"
        show("draws", alt, "ratings of draws")
    with right:
        st.subheader("What bands of each level hold")
        alt = f"Share of the time up to TTZV inside bands of each level, each test {left_out}"
        show("calibration", alt, "coverage by level")
        st.caption("Above the dotted line a band is too wide, below it too narrow.")
    st.subheader("What the 95 % band is worth", help=TTZV)
    show_table(coverage_table(study.coverage), "coverage")
    st.caption(f"Left-out tests inside the band; of {len(study.folds)} no more can be promised.")


def _show_files(outcome: _Outcome) -> None:
    study, view = outcome.study, outcome.view
    options = choose_report(view, view.campaign.test_ids)
    if outcome.is_whole:
        result = study_result(study, options, view.display.window_ms)
        offer_result(result, view.display, view.campaign.name, f"{options.form} {' '.join(options.tests)}")
    else:
        offer(view.campaign.name, study_files(study))


def _show_learning_curve(view: View, config: StudyConfig, row: DeltaGenerator) -> None:
    campaign = view.campaign
    request = learn_curve(campaign, replace(CURVE_CONFIG, seed=config.seed, device=config.device))
    question = "How good are predictions from fewer tests, and what would one more add?"
    whole = result_or_none(request, invitation=question, button=f"Predict from 1 to {len(campaign.tests) - 1} tests")
    if whole is None:
        return
    criteria = view.folder / "criteria.toml"
    if criteria.is_file():
        try:
            whole = with_decided(whole, criteria)
        except DataError as error:
            st.warning(plain(str(error.problems[0])), icon=":material/error:")
    curve = whole.over(view.display.window_ms)
    look = {"placeholder": "optional, any currency", "help": "Gains are then given as the cost of 0.01 of rating, too."}
    amount = st.number_input("Cost of one test", 0.0, None, None, 1000.0, "%.0f", width=260, **kept("cost", **look))
    cost = Cost(amount) if amount and 0 < amount < math.inf else None  # a link may hold any number
    result = learning_curve_result(curve, cost)
    st.info("  \n".join(map(plain, result.answer)), icon=":material/science:")
    alt = "Mean rating, width of the band, decided verdicts over the number of tests"
    show_figure(whole.draw(display=view.display), alt, name="learning curve")
    st.caption(f"{CURVE_MEANING} Points: means ± standard error; shaded: 80 %. {campaign.rating_basis}.")
    if result.shown:
        with st.expander("What further tests gained", icon=":material/table:"):
            show_table(result.tables["gains"], "gains")
            st.caption(ONE_MORE_MEANING)
    with row:
        export_button(partial(offer_result, result, view.display))
