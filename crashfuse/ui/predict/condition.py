"""The condition to predict: speed, weights and factors."""

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.ui import address
from crashfuse.ui.text import plain
from crashfuse.units import LB, MPH


def choose_condition(campaign: Campaign) -> Condition:
    """Ask for a condition, and warn if it lies outside the CAE runs; factors not given are left out."""
    left, middle, right = st.columns(3)
    columns = st.columns(max(len(campaign.factors), 3))
    factors = {}
    for column, (name, values) in zip(columns, campaign.factors.items(), strict=False):
        if st.session_state.get(key := f"factor_{name}") not in values:  # left from another campaign
            st.session_state[key] = None
        factors[name] = column.selectbox(
            name.capitalize(), values, index=None, placeholder="not given", key=key, persist_state="session",
            help="Tests may differ by it; if it is not given, the band covers every value.",
        )  # fmt: skip
    condition = Condition(
        speed_mps=_field(campaign, left, "Impact speed (mph)", "speed_mph", MPH, 0, step=0.1, digits=1),
        front_weight_kg=_field(campaign, middle, "Front weight (lb)", "front_weight_lb", LB, 1, step=1.0, digits=0),
        rear_weight_kg=_field(campaign, right, "Rear weight (lb)", "rear_weight_lb", LB, 2, step=1.0, digits=0),
        factors=tuple((name, choice) for name, choice in factors.items() if choice),
    )
    st.caption(f"{plain(str(condition))}; {condition.mass_kg:.0f} kg in all")
    for note in campaign.cae.extrapolation(condition):
        st.warning(note, icon=":material/warning:")
    return condition


def _field(
    campaign: Campaign,
    column: DeltaGenerator,
    label: str,
    name: str,
    unit: float,
    axis: int,
    *,
    step: float,
    digits: int,
) -> float:
    """Slider over the CAE runs' range, and a number field, kept in the address, for values beyond it; returns SI."""
    values = campaign.cae.vectors[:, axis] / unit
    low, high = max(float(np.floor(values.min())), step), float(np.ceil(values.max()))
    least, most = max(low / 2, step), 2 * high  # a decimal comma typed by mistake gives ten times the intended value
    slider = f"slider {name}"
    if not least <= (st.session_state[name] or 0.0) <= most:  # nothing yet, or left from another campaign
        st.session_state[name] = None
    address.default(name, round(float(np.median(values)), digits))

    def take_slider() -> None:
        st.session_state[name] = st.session_state[slider]

    number = column.number_input(
        label, min_value=least, max_value=most, step=step, format=f"%.{digits}f", key=name, persist_state="session",
    )  # fmt: skip
    st.session_state[slider] = min(max(number, low), high)
    column.slider(
        f"{label}, over the CAE runs", low, high, step=step, format=f"%.{digits}f", key=slider, on_change=take_slider,
        label_visibility="collapsed",
    )  # fmt: skip
    return number * unit
