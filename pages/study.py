"""Study: every test left out in turn, alone and with all others at about the same speed."""

from dataclasses import replace
from functools import partial

import streamlit as st

from crashfuse.approaches.calibration import LEVELS
from crashfuse.reporting import glossary
from crashfuse.reporting.fit_explanations import coverage_table
from crashfuse.reporting.paper_tables import TABLE_3, TABLE_5
from crashfuse.reporting.plots.ratings import calibration_curves, rating_heatmap, rating_spread
from crashfuse.reporting.report import study_report
from crashfuse.reporting.result_tables import scores_table, study_metrics
from crashfuse.study.recommendation import recommend
from crashfuse.study.study import Study
from crashfuse.ui import explanations, frame, page_tables
from crashfuse.ui.computation import StudyRequest, chosen_config
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.figures import choose, show_clickable, show_figure
from crashfuse.ui.learning_curve import show_learning_curve
from crashfuse.ui.navigation import open_page
from crashfuse.ui.panel import result_of, stop_with_a_single_test
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain

view = frame.enter_with_campaign("Study")
campaign, config = view.campaign, chosen_config()
stop_with_a_single_test(campaign)
window = page_tables.window_label(view.display.window_ms)
if choose("Question", ["Each test left out", "How many tests are enough"], key="question") != "Each test left out":
    show_learning_curve(view, config)
    st.stop()
st.markdown(
    "How well does each approach predict a test that it has not seen? Every test is left out in turn, predicted from "
    "all others, and rated; then again without any other test at about its speed."
)
if config.preset == "fast":  # a fit with the paper's settings takes minutes, or a GPU
    config = replace(config, leave_out="both")
study = result_of(
    StudyRequest(campaign, campaign.test_ids, config),
    invitation=f"The study of all {len(campaign.tests)} tests has not been run yet. "
    + explanations.patience(
        config, "It takes several minutes the first time; meanwhile you can work on the other pages."
    ),
    button=f"Leave out each of {len(campaign.tests)} tests",
)
explanations.show_missing(config, study.config.approaches)
whole = study.config.approaches == config.approaches  # else nothing can be recommended yet


def open_test(test_id: str, study: Study) -> None:
    """Open a test as this study left it out."""
    frame.choose_held_out(campaign.test(test_id))
    st.session_state["leave_out"] = study.config.leave_out if study.config.leave_out == "speed group" else "test"


def show_ratings(study: Study, way: str) -> None:
    """Show mean ratings by window, and every test by approach."""
    show_table(page_tables.mean_ratings(study), f"means {way}")
    overall = {
        fold.held_out: {name: by_window[view.display.window_ms].overall for name, by_window in fold.ratings.items()}
        for fold in study.folds
    }
    st.markdown(f"**Each test, {window}**")
    chosen = show_clickable(
        rating_heatmap(overall, study.repeats(view.display.window_ms)),
        alt="Ratings of each held-out test by approach, with their mean; the same numbers are in the tables below",
        key=way,
        on_click=lambda test_id: open_test(test_id, study),
    )
    if chosen:
        open_page("compare")
    st.caption(f"Click a cell to open its test on the page Compare. {glossary.REPEAT}")


if whole:
    explanations.show_recommendation(recommend(study).sentences)
explanations.show_settings(config)
st.subheader("Mean rating over the tests")
names = ["Each test left out alone", "With all tests at about its speed"][: 1 if study.speed_groups is None else 2]
for tab, tab_name, own in zip(st.tabs(names), names, (study, study.speed_groups), strict=False):
    if own is not None:
        with tab:
            show_ratings(own, tab_name)
st.caption(f"{campaign.rating_basis}: Excellent above 0.94, Good above 0.80, Fair above 0.58, else Poor.")
for test in campaign.tests:
    for note in campaign.cae.extrapolation(test.condition):
        st.caption(f":material/warning: {plain(test.id)}: {note}")

if study.coverage:
    st.subheader(f"How sure the ratings are, {window}")
    show_figure(
        rating_spread(study.rating_spread(view.display.window_ms), study.repeats(view.display.window_ms)),
        alt="Rating of each held-out test by approach, with the interval of the ratings of single drawn pulses",
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
    show_figure(
        calibration_curves(LEVELS, study.reliability),
        alt="Share of the time up to TTZV at which a(t) lies inside bands of each level, by approach",
    )
    st.caption("Above the dotted line a band is wider than it claims to be, below it too narrow.")
with st.expander("Every rating, in the form of the paper's tables", icon=":material/table:"):
    fifth, third = st.tabs(["Table 5: approaches against the CAE", "Table 3: the network before and after the tests"])
    fifth.table(page_tables.paper_table(study, TABLE_5), border="horizontal")
    third.table(page_tables.paper_table(study, TABLE_3), border="horizontal")
    third.caption(f"{glossary.LF} MF TCN: multi-fidelity (MF) network, the LF network fine-tuned on tests.")
with st.container(horizontal=True):
    download_table("scores.csv", lambda: scores_table(study))
    download_table("metrics.csv", lambda: study_metrics(study))
    if study.speed_groups is not None:
        download_table("speed_groups.csv", partial(scores_table, study.speed_groups))
    if whole:
        download_report(lambda: study_report(study))
