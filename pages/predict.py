"""Predict: the pulse at a condition that was never tested, over speed, and which test to run next."""

import pandas as pd
import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.exports import parquet_bytes
from crashfuse.reporting.plots.displacement import energy_over_crush, over_displacement
from crashfuse.reporting.plots.pulses import motion
from crashfuse.reporting.report import prediction_report
from crashfuse.reporting.result_tables import metrics_table, pulses_table
from crashfuse.study.nearest import nearest_sentences
from crashfuse.study.recommendation import recommend_for
from crashfuse.ui import explanations, frame
from crashfuse.ui.computation import FitRequest, answers, chosen_config
from crashfuse.ui.downloads import download_bytes, download_report, download_table
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.occupant_model import offer_pulses
from crashfuse.ui.panel import result_of
from crashfuse.ui.predict.condition import choose_condition
from crashfuse.ui.predict.planning import show_next_test, show_over_speed

view = frame.enter_with_campaign("Predict")
campaign, config = view.campaign, chosen_config()
st.markdown(
    "The pulse at a speed and weights that were not tested, predicted from all tests and CAE runs; none is held out."
)
condition = choose_condition(campaign)
request = FitRequest(campaign, config)
fitted = result_of(
    request,
    invitation=f"The approaches have not been fitted on all {len(campaign.tests)} tests of this campaign yet. "
    + explanations.patience(
        config, "This takes a minute or two the first time; after that, every condition is answered at once."
    ),
    button="Predict",
)
estimates = answers(request.key, condition, fitted)
predictions = {estimate.approach: estimate.prediction for estimate in estimates}

warnings = campaign.cae.extrapolation(condition)
advice = recommend_for(estimates, campaign, condition, view.display.window_ms)
said = advice.sentences
explanations.show_recommendation([sentence for sentence in said if sentence not in warnings])
st.caption("  \n".join(nearest_sentences(campaign, condition)))
explanations.show_settings(config)
shown = choose("Figure", ["Over time", "Over displacement", "Energy over crush"], key="predicted")


def draw() -> go.Figure:
    """The chosen figure."""
    if shown == "Over time":
        return motion(None, predictions, condition.speed_mps, view.display)
    if shown == "Over displacement":
        return over_displacement(None, predictions, condition.speed_mps, view.display)
    return energy_over_crush(None, predictions, condition.speed_mps, condition.mass_kg)


alt = f"Prediction by every approach at {condition}: {shown.lower()}"
show_cached_figure(draw, alt, shown, request.key, condition, view.display)
explanations.show_metrics([(LABELS[each.approach], each.metrics) for each in estimates], view)


def pulses() -> pd.DataFrame:
    """Every approach's pulse."""
    return pulses_table(("", estimate) for estimate in estimates)


with st.container(horizontal=True):
    download_table("pulses.csv", pulses)
    download_table(
        "metrics.csv", lambda: metrics_table((("", each.approach, each.metrics) for each in estimates), campaign)
    )
    download_bytes("pulses.parquet", lambda: parquet_bytes(pulses()))
    download_report(lambda: prediction_report(campaign, estimates, config))
offer_pulses(campaign, estimates, advice.approach, config.seed)
explanations.show_notes(estimates, (*said, *warnings))
explanations.show_fits(estimates)

st.header("Planning")
speed_tab, test_tab = st.tabs(["Over speed", "Next test"])
with speed_tab:
    show_over_speed(view, request, fitted, condition)
with test_tab:
    show_next_test(view, request, fitted, condition.factors)
