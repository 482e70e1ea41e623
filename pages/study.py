"""Study: every test left out in turn."""

import streamlit as st

from crashfuse.fits import coverage_table
from crashfuse.plots.ratings import rating_heatmap
from crashfuse.results import scores_table, study_metrics
from crashfuse.ui import evidence, frame, tables
from crashfuse.ui.computation import StudyRequest, chosen_config
from crashfuse.ui.panel import result_of

view = frame.enter_with_campaign("Study")
campaign, config = view.campaign, chosen_config()
st.markdown(
    "How well does each approach predict a test that it has not seen? Every test is left out in turn, predicted from "
    "all others, and rated."
)
study = result_of(
    StudyRequest(campaign, campaign.test_ids, config),
    invitation=f"The study of all {len(campaign.tests)} tests has not been run yet. It takes several minutes the first "
    "time; you can go on working on the other pages meanwhile.",
    button=f"Leave out each of {len(campaign.tests)} tests",
)

st.subheader("Mean rating over the tests")
st.table(tables.mean_ratings(study), border="horizontal")
st.subheader(f"Rating of each test, {tables.window_label(view.window_ms)}")
evidence.show_figure(
    rating_heatmap(
        {
            fold.held_out: {name: by_window[view.window_ms].overall for name, by_window in fold.ratings.items()}
            for fold in study.folds
        }
    ),
    alt="Ratings of each held-out test by approach, with their mean; the same numbers are in scores.csv",
)
st.caption("ISO/TS 18571: Excellent above 0.94, Good above 0.80, Fair above 0.58, else Poor.")
for test in campaign.tests:
    for note in campaign.cae.extrapolation(test.condition):
        st.caption(f":material/warning: {test.id}: {note}")
if study.coverage:
    st.subheader("What the 95 % band is worth")
    st.table(coverage_table(study.coverage).style.hide(axis="index"), border="horizontal")
    st.caption(
        f"How much of the left-out tests lies inside. With {len(study.folds)} tests no more can be promised than these "
        "counts."
    )
with st.container(horizontal=True):
    evidence.download("scores.csv", scores_table(study))
    evidence.download("metrics.csv", study_metrics(study))
st.caption(f"{config.preset.capitalize()} settings, seed {config.seed}.")
