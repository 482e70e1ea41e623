"""Compare: the held-out test against every prediction of it."""

import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.registry import BASELINE, LABELS
from crashfuse.reporting import glossary
from crashfuse.reporting.plots.pulses import add_corridors, motion, residuals
from crashfuse.reporting.report import study_report
from crashfuse.reporting.result_tables import pulses_table, scores_table, study_metrics
from crashfuse.study.recommendation import recommend_for
from crashfuse.ui import explanations, frame, page_tables
from crashfuse.ui.compare import displacement, networks
from crashfuse.ui.computation import StudyRequest, chosen_config
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.occupant_model import offer_pulses
from crashfuse.ui.panel import result_of, stop_with_a_single_test
from crashfuse.ui.tables import show_table
from crashfuse.ui.text import plain

CORRIDORS_HELP = (
    "ISO/TS 18571: a curve scores 1 inside the inner corridor about the test and 0 outside the outer one. Their half "
    "widths are 5 % and 50 % of the largest acceleration in the rated window."
)
DRAWS_HELP = (
    "Single pulses drawn from the band, each rated against the test: 95 % of the ratings lie in this interval. A "
    "single pulse has oscillations of its own, so it rates lower than the expected pulse."
)

CARD_PX = 176  # five fit side by side on a wide page
NO_CHANGE = 0.005  # in rating

view = frame.enter_with_campaign("Compare")
test, campaign, config = view.held_out, view.campaign, chosen_config()
stop_with_a_single_test(campaign)
st.subheader(f"Test {plain(test.id)}: {test.condition}")

rest = config.training_campaign(campaign, test.id)
request = StudyRequest(campaign, (test.id,), config)
study = result_of(
    request,
    invitation=f"Test {plain(test.id)} has not been predicted yet. Every approach will be fitted on the CAE runs and "
    f"{len(rest.tests)} other tests. "
    + explanations.patience(config, "The displacement domain takes some seconds, the networks a little longer."),
    button=f"Predict test {test.id}",
)
explanations.show_missing(config, study.config.approaches)
whole = study.config.approaches == config.approaches  # else nothing can be recommended yet
fold = study.fold(test.id)
predictions = {estimate.approach: estimate.prediction for estimate in fold.estimates}

window_ms = view.display.window_ms
raw = fold.ratings[BASELINE][window_ms].overall if BASELINE in fold.ratings else None
beside = "" if raw is None else ", and its change from the raw CAE model"
explanations.show_settings(config, left_out=True)
st.markdown(f"Rating over {page_tables.window_label(window_ms)} ({campaign.rating_basis}){beside}")
cards = st.container(horizontal=True, gap="small")
for name, by_window in fold.ratings.items():
    rating = by_window[window_ms]
    gain = None if raw is None or name == BASELINE else rating.overall - raw
    with cards.container(border=True, width=CARD_PX):
        st.metric(
            LABELS[name], f"{rating.overall:.3f}", None if gain is None else f"{gain:+.3f}",
            delta_color="off" if gain is None or abs(gain) < NO_CHANGE else "normal",
        )  # fmt: skip
        explanations.show_grade(rating.grade)
        if name in fold.with_band:
            low, high = fold.rating_interval(name, window_ms)
            st.caption(f"Draws: {low:.2f}–{high:.2f}", help=DRAWS_HELP)

said: tuple[str, ...] = ()
repeats = study.repeatability.get(test.id, {})
if whole:
    advice = recommend_for(fold.estimates, rest, test.condition, window_ms)
    said = advice.sentences
    explanations.show_recommendation(said)
    if window_ms in repeats:
        rated = fold.ratings[advice.approach][window_ms].overall
        st.markdown(repeats[window_ms].sentence(rated, LABELS[advice.approach]), help=glossary.REPEAT)
left, right = st.columns([3, 2], vertical_alignment="center")
with left:
    shown = choose("Figure", ["Motion", "Residuals"], key="compared")
if shown == "Motion":
    corridors = right.toggle("Corridors of the rating", key="corridors", persist_state="session", help=CORRIDORS_HELP)
    alt = f"Acceleration, velocity and displacement over time: test {test.id} and every prediction of it"
else:
    corridors = False
    alt = f"Every prediction of test {test.id} minus what was measured, over time"


def draw() -> go.Figure:
    """The chosen figure."""
    if shown == "Residuals":
        return residuals(test.pulse, predictions, view.display)
    figure = motion(test.pulse, predictions, test.condition.speed_mps, view.display)
    return add_corridors(figure, test.pulse, view.display) if corridors else figure


key = (request.key, study.config.approaches, view.display)
show_cached_figure(draw, alt, shown, corridors, *key)
if shown == "Residuals":
    st.caption("Where a band leaves zero, the test left that band. RMS: over the rated window.")

networks.show(view, fold, key)
displacement.show(view, config, predictions, key)

st.subheader("Rating by approach and window", help=f"By {campaign.rating_basis}.")
show_table(page_tables.ratings(fold.ratings, window_ms, repeats), "ratings")

columns = [
    ("Test", campaign.metrics_of(test)),
    *((LABELS[estimate.approach], estimate.metrics) for estimate in fold.estimates),
]
explanations.show_metrics(columns, view)

explanations.show_notes(fold.estimates, said)
explanations.show_fits(fold.estimates)
with st.container(horizontal=True):
    download_table("scores.csv", lambda: scores_table(study))
    download_table("pulses.csv", lambda: pulses_table((test.id, estimate) for estimate in fold.estimates))
    download_table("metrics.csv", lambda: study_metrics(study))
    if whole:
        download_report(lambda: study_report(study))
if whole:
    remark = f"Test {test.id}, at this condition, was left out."
    offer_pulses(rest, fold.estimates, advice.approach, config.seed, [remark])
