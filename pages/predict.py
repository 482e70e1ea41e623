"""Predict: the pulse at a condition that was never tested."""

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches import LABELS
from crashfuse.plots import pulses as plots
from crashfuse.pulse import Condition
from crashfuse.results import metrics_table, pulses_table
from crashfuse.ui import evidence, frame, tables
from crashfuse.ui.computation import FitRequest, chosen_config
from crashfuse.ui.panel import result_of
from crashfuse.units import LB, MPH

view = frame.enter_with_campaign("Predict")
campaign, config = view.campaign, chosen_config()
st.markdown("The pulse at a speed and weights that were never tested, learned from all tests and CAE runs.")


def field(column: DeltaGenerator, label: str, unit: float, start: float, *, step: float, digits: int) -> float:
    """Number field in the reader's unit; returns SI."""
    value = column.number_input(
        label,
        min_value=1.0,
        max_value=50_000.0,
        value=round(start / unit, digits),
        step=step,
        format=f"%.{digits}f",
        key=f"{label} {campaign.fingerprint[:8]}",
        persist_state="session",
    )
    return value * unit


speed_mps, front_kg, rear_kg = np.median(campaign.cae.vectors, axis=0).tolist()  # to begin with
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
    speed_mps=field(left, "Impact speed (mph)", MPH, speed_mps, step=0.5, digits=1),
    front_weight_kg=field(middle, "Front weight (lb)", LB, front_kg, step=10.0, digits=0),
    rear_weight_kg=field(right, "Rear weight (lb)", LB, rear_kg, step=10.0, digits=0),
    factors=tuple(factors.items()),
)
st.caption(f"{condition}; {condition.mass_kg:.0f} kg in all")
for note in campaign.cae.extrapolation(condition):
    st.warning(note, icon=":material/warning:")

fitted = result_of(
    FitRequest(campaign, config),
    invitation=f"The approaches have yet to learn from all {len(campaign.tests)} tests of this campaign. That takes a "
    "minute or two the first time; after that, every condition is answered in seconds.",
    button="Predict",
)
estimates = fitted.estimates(condition)
predictions = {estimate.approach: estimate.prediction for estimate in estimates}

evidence.show_figure(
    plots.motion(None, predictions, speed_mps=condition.speed_mps, unit=view.unit, deceleration=view.deceleration),
    alt=f"Predicted acceleration, velocity and displacement over time at {condition}",
)
st.subheader("Pulse metrics")
columns = [(LABELS[estimate.approach], estimate.metrics) for estimate in estimates]
st.table(tables.metrics(columns), border="horizontal")
evidence.show_missing(columns)
st.caption("Shaded bands and brackets: the middle 95 % of what the model holds possible, where it says so.")
evidence.show_notes(predictions)
evidence.show_fits(estimates)
with st.container(horizontal=True):
    evidence.download("pulses.csv", pulses_table(("", estimate) for estimate in estimates))
    evidence.download("metrics.csv", metrics_table(("", estimate.approach, estimate.metrics) for estimate in estimates))
