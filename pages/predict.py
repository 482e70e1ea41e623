"""Predict: the pulse at a condition that was never tested, over speed, and which test to run next."""

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.registry import LABELS
from crashfuse.condition import Condition
from crashfuse.reporting.exports import isomme_prediction, parquet_bytes
from crashfuse.reporting.plots.displacement import energy_over_crush, over_displacement
from crashfuse.reporting.plots.pulses import motion
from crashfuse.reporting.report import prediction_report
from crashfuse.reporting.result_tables import metrics_table, pulses_table
from crashfuse.study.nearest import nearest_sentences
from crashfuse.study.recommendation import recommend_for
from crashfuse.ui import evidence, frame, page_tables, planning
from crashfuse.ui.computation import FitRequest, answers, chosen_config
from crashfuse.ui.panel import result_of
from crashfuse.units import LB, MPH

view = frame.enter_with_campaign("Predict")
campaign, config = view.campaign, chosen_config()
st.markdown(
    "The pulse at a speed and weights that were never tested, learned from all tests and runs; none is held out here."
)


def field(column: DeltaGenerator, label: str, name: str, unit: float, axis: int, *, step: float, digits: int) -> float:
    """Slider over the CAE runs' range, and a number field, kept in the address, for values around it; returns SI."""
    values = campaign.cae.vectors[:, axis] / unit
    low, high = max(float(np.floor(values.min())), step), float(np.ceil(values.max()))
    least, most = max(low / 2, step), 2 * high  # who types a decimal comma means a tenth of what arrives
    slider = f"slider {name}"
    if not least <= st.session_state.get(name, least) <= most:  # of another campaign
        del st.session_state[name]

    def take_slider() -> None:
        st.session_state[name] = st.session_state[slider]

    number = column.number_input(
        label, min_value=least, max_value=most, value=round(float(np.median(values)), digits), step=step,
        format=f"%.{digits}f", key=name, bind="query-params", persist_state="session",
    )  # fmt: skip
    st.session_state[slider] = min(max(number, low), high)
    column.slider(
        f"{label}, over the CAE runs", low, high, step=step, format=f"%.{digits}f", key=slider, on_change=take_slider,
        label_visibility="collapsed",
    )  # fmt: skip
    return number * unit


left, middle, right = st.columns(3)
factors = {
    name: choice
    for column, (name, values) in zip(st.columns(max(len(campaign.factors), 3)), campaign.factors.items(), strict=False)
    if (
        choice := column.selectbox(
            name.capitalize(),
            values,
            index=None,
            placeholder="not given",
            key=f"{name} {campaign.fingerprint[:8]}",
            persist_state="session",
            help="Tests may differ by it; without it the band has to allow for any.",
        )
    )
}
condition = Condition(
    speed_mps=field(left, "Impact speed (mph)", "speed_mph", MPH, 0, step=0.1, digits=1),
    front_weight_kg=field(middle, "Front weight (lb)", "front_weight_lb", LB, 1, step=1.0, digits=0),
    rear_weight_kg=field(right, "Rear weight (lb)", "rear_weight_lb", LB, 2, step=1.0, digits=0),
    factors=tuple(factors.items()),
)
st.caption(f"{condition}; {condition.mass_kg:.0f} kg in all")
for note in campaign.cae.extrapolation(condition):
    st.warning(note, icon=":material/warning:")

request = FitRequest(campaign, config)
fitted = result_of(
    request,
    invitation=f"The approaches have yet to learn from all {len(campaign.tests)} tests of this campaign. "
    + evidence.patience(
        config, "That takes a minute or two the first time; after that, every condition is answered at once."
    ),
    button="Predict",
)
estimates = answers(request.key, condition, fitted)
predictions = {estimate.approach: estimate.prediction for estimate in estimates}

warnings = campaign.cae.extrapolation(condition)
said = recommend_for(estimates, campaign, condition, view.window_ms).sentences
evidence.show_recommendation([sentence for sentence in said if sentence not in warnings])
st.caption("  \n".join(nearest_sentences(campaign, condition)))
evidence.show_settings(config)
shown = st.segmented_control(
    "Figure",
    ["Over time", "Over displacement", "Energy over crush"],
    default="Over time",
    required=True,
    key="predicted",
    persist_state="session",
    label_visibility="collapsed",
)


def draw() -> go.Figure:
    """The figure that was chosen."""
    speed, unit, deceleration = condition.speed_mps, view.unit, view.deceleration
    if shown == "Over time":
        return motion(None, predictions, speed_mps=speed, unit=unit, deceleration=deceleration)
    if shown == "Over displacement":
        return over_displacement(None, predictions, speed_mps=speed, unit=unit, deceleration=deceleration)
    return energy_over_crush(None, predictions, speed_mps=speed, mass_kg=condition.mass_kg)


alt = f"Prediction by every approach at {condition}: {shown.lower()}"
evidence.show_kept_figure(draw, alt, shown, request.key, condition, view.unit, view.deceleration)

st.subheader("Pulse metrics")
columns = [(LABELS[estimate.approach], estimate.metrics) for estimate in estimates]
st.table(page_tables.metrics(columns, view.unit), border="horizontal")
evidence.show_missing(columns)
st.caption("Shaded bands and brackets: the middle 95 % of what the model holds possible, where it says so.")


def pulses() -> pd.DataFrame:
    """Every approach's pulse."""
    return pulses_table(("", estimate) for estimate in estimates)


with st.container(horizontal=True):
    evidence.download("pulses.csv", pulses)
    evidence.download("metrics.csv", lambda: metrics_table(("", each.approach, each.metrics) for each in estimates))
    evidence.download_bytes("pulses.parquet", lambda: parquet_bytes(pulses()))
    evidence.download_bytes("isomme.zip", lambda: planning.zipped(isomme_prediction(campaign, estimates)))
    evidence.download_report(lambda: prediction_report(campaign, estimates, config))
evidence.show_notes(predictions, (*said, *warnings))
evidence.show_fits(estimates)

st.header("Planning")
over_speed, next_test = st.tabs(["Over speed", "Next test"])
with over_speed:
    planning.show_sweep(view, request, fitted, condition)
with next_test:
    planning.show_next_test(view, request, fitted, factors)
