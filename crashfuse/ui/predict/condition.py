"""The condition to predict: speed, weights and factors."""

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.reporting.plots.display import Display
from crashfuse.study.facts import condition_facts
from crashfuse.ui import address
from crashfuse.ui.text import plain
from crashfuse.units import LB, MPH
from crashfuse.wording import joined

DECIMALS = 9
"""Of speeds and weights in the session and the address: 56 km/h come back as 56."""


def choose_condition(campaign: Campaign, display: Display) -> Condition:
    """Ask for a condition, and warn if it lies outside the CAE runs; factors not given are left out."""
    with st.container(key="condition"):
        left, middle, right, *columns = st.columns(3 + min(len(campaign.factors), 3))
    if (further := len(campaign.factors) - 3) > 0:
        columns += st.columns(further)
    factors = {}
    for column, (name, values) in zip(columns, campaign.factors.items(), strict=False):
        if st.session_state.get(key := f"factor_{name}") not in values:  # left from another campaign
            address.put(key, None)
        factors[name] = column.selectbox(
            plain(name.capitalize()), values, index=None, placeholder="not given", key=key, persist_state="session",
            help="Tests may differ by it; if it is not given, the band covers every value.",
        )  # fmt: skip
    runs = campaign.cae.vectors.T
    speed = display.title("Impact speed", "mph"), "speed_mph", MPH, display.speeds(1.0)
    front, rear = (
        (display.title(label, "lb"), name, LB, display.weights(1.0))
        for label, name in (("Front weight", "front_weight_lb"), ("Rear weight", "rear_weight_lb"))
    )
    condition = Condition(
        speed_mps=_field(left, *speed, runs[0], step=0.1, digits=1),
        front_weight_kg=_field(middle, *front, runs[1], step=1.0, digits=0),
        rear_weight_kg=_field(right, *rear, runs[2], step=1.0, digits=0),
        factors=tuple((name, choice) for name, choice in factors.items() if choice),
        units=display.system.endings,
    )
    if facts := condition_facts(campaign, condition):
        st.markdown(f":material/warning: **{plain(display.words(joined([fact.sentence for fact in facts])))}**")
    return condition


def fill_in(campaign: Campaign, condition: Condition) -> None:
    """Choose a condition on the page Predict; call it from a callback."""
    given = dict(condition.factors)
    st.session_state.update(
        {
            "speed_mph": round(condition.speed_mps / MPH, DECIMALS),
            "front_weight_lb": round(condition.front_weight_kg / LB, DECIMALS),
            "rear_weight_lb": round(condition.rear_weight_kg / LB, DECIMALS),
            **{f"factor_{name}": given.get(name) or None for name in campaign.factors},
        }
    )


def _field(
    column: DeltaGenerator,
    label: str,
    name: str,
    in_si: float,
    shown: float,
    runs: np.ndarray,
    *,
    step: float,
    digits: int,
) -> float:
    """Slider over the CAE runs' range, and a number field for values beyond it; returns SI.

    The session and the address have the value in mph or lb, under ``name``, whatever the reader's unit is: so it stays
    the same when the unit is changed. ``in_si`` is the factor from it to SI, ``shown`` that from SI to the reader's.
    """
    state, values = st.session_state, runs * shown
    low, high = max(float(np.floor(values.min())), step), float(np.ceil(values.max()))
    least, most = max(low / 2, step), 2 * high  # a decimal comma typed by mistake gives ten times the intended value
    address.default(name, round(float(np.median(runs)) / in_si, digits))
    asked = round(state[name] * in_si * shown, DECIMALS)
    value = min(max(asked, least), most)
    if asked != value:  # by a link, left from another campaign, or typed: the field itself would refuse without a word
        st.warning(f"{label} is from {least:g} to {most:g} here, not {asked:g}: {value:g} is taken.")
        state[name] = round(value / shown / in_si, DECIMALS)
    # A browser sends what its widgets showed before it hears of a new value, as if that was chosen: each value that a
    # widget did not come by itself makes another widget of it, and what the one before still sends does not count.
    own = state.get(f"{name} widgets", {})
    if own.get("value") != state[name]:  # a link, Back, or another page
        own = dict.fromkeys(("value", "field", "slider"), state[name])
    field = f"field {name} {shown:g} after {own['field']!r}"
    slider = f"slider {name} {low:g} to {high:g} after {own['slider']!r}"
    state[f"{name} widgets"] = {**own, "keys": (field, slider)}
    address.put(field, value)
    address.put(slider, min(max(value, low), high))

    def take(key: str, other: str) -> None:
        if key in state[f"{name} widgets"]["keys"]:
            state[name] = round(state[key] / shown / in_si, DECIMALS)
            state[f"{name} widgets"] = {**own, "value": state[name], other: state[name], "keys": (key,)}

    form = f"%.{digits}f"
    column.number_input(label, step=step, format=form, key=field, on_change=take, args=(field, "slider"))
    column.slider(
        f"{label}, over the CAE runs", low, high, step=step, format=form, key=slider, on_change=take,
        args=(slider, "field"), label_visibility="collapsed",
    )  # fmt: skip
    return float(state[name] * in_si)
