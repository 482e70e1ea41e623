"""The page Predict: the predictions at a condition."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.nearness import nearest_sentences
from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.reporting.certification_tables import csv_as_given
from crashfuse.reporting.exports import parquet_bytes
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.reporting.report import prediction_report
from crashfuse.reporting.side_by_side import by_one, cautions, predictions_table, side_by_side
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.facts import condition_facts
from crashfuse.study.history import PastResult, keep
from crashfuse.study.recommendation import Recommendation
from crashfuse.ui.kit import choices, results
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.choices import MOST_PINS, pinned
from crashfuse.ui.kit.computation import FitRequest, Fitted, advised, answers
from crashfuse.ui.kit.curves import (
    choose_curves,
    leading,
    offer_predictions_here,
    predictions_here,
    without_clicks,
)
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.files import choose_form, download_bytes, download_report, download_table, offer_pulses
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain
from crashfuse.units import LB, MPH
from crashfuse.wording import joined

DECIMALS = 9
"""Of speeds and weights in the session and the address: 56 km/h come back as 56."""
_FIGURES = {"Over time": "motion", "Over displacement": "displacement", "Energy over crush": "energy"}


def choose_condition(campaign: Campaign, display: Display) -> Condition:
    """Ask for a condition, and warn if it lies outside the CAE runs; factors not given are left out."""
    with st.container(key="condition"):
        left, middle, right, *columns = st.columns(3 + min(len(campaign.factors), 3))
    if (further := len(campaign.factors) - 3) > 0:
        columns += st.columns(further)
    factors = {}
    for column, (name, values) in zip(columns, campaign.factors.items(), strict=False):
        if st.session_state.get(key := f"factor_{name}") not in values:  # left from another campaign
            choices.put(key, None)
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
    choices.default(name, round(float(np.median(runs)) / in_si, digits))
    asked = round(state[name] * in_si * shown, DECIMALS)
    value = min(max(asked, least), most)
    if asked != value:  # by a link, left from another campaign, or typed: the field itself would refuse without a word
        st.warning(f"{label} is from {least:g} to {most:g} here, not {asked:g}: {value:g} is taken.")
        state[name] = round(value / shown / in_si, DECIMALS)
    # A browser sends what its widgets showed before it hears of a new value, as if that was chosen: each value that a
    # widget did not come by itself makes another widget of it, and what the one before still sends does not count.
    widgets = state.get(f"{name} widgets", {})
    if widgets.get("value") != state[name]:  # a link, Back, or another page
        widgets = dict.fromkeys(("value", "field", "slider"), state[name])
    field = f"field {name} {shown:g} after {widgets['field']!r}"
    slider = f"slider {name} {low:g} to {high:g} after {widgets['slider']!r}"
    state[f"{name} widgets"] = {**widgets, "keys": (field, slider)}
    choices.put(field, value)
    choices.put(slider, min(max(value, low), high))

    def take(key: str, other: str) -> None:
        if key in state[f"{name} widgets"]["keys"]:
            state[name] = round(state[key] / shown / in_si, DECIMALS)
            state[f"{name} widgets"] = {**widgets, "value": state[name], other: state[name], "keys": (key,)}

    form = f"%.{digits}f"
    column.number_input(label, step=step, format=form, key=field, on_change=take, args=(field, "slider"))
    column.slider(
        f"{label}, over the CAE runs", low, high, step=step, format=form, key=slider, on_change=take,
        args=(slider, "field"), label_visibility="collapsed",
    )  # fmt: skip
    return float(state[name] * in_si)


@dataclass(frozen=True, eq=False)
class Answer:
    """The prediction of every approach at a condition, and how the reader wants to see it."""

    view: View
    request: FitRequest  # all tests of the campaign, and the settings that were chosen
    fitted: Fitted  # ready to predict any condition; while networks train, fewer approaches than the settings ask for
    condition: Condition

    @cached_property
    def estimates(self) -> list[Estimate]:
        """One for each approach."""
        return answers(self.request.key, self.condition, self.fitted)

    @property
    def whole(self) -> bool:
        """True once every approach is known."""
        return len(self.fitted.fits) == len(self.config.approaches)

    @cached_property
    def advice(self) -> Recommendation | None:
        """Which of them to use; None while approaches are still missing."""
        if not self.whole:
            return None
        window_ms = self.view.display.window_ms
        return advised(self.request.key, self.condition, window_ms, self.estimates, self.campaign)

    @property
    def campaign(self) -> Campaign:
        """What the predictions learned from."""
        return self.view.campaign

    @property
    def config(self) -> StudyConfig:
        """The settings that were chosen."""
        return self.request.config

    @property
    def recommended(self) -> str | None:
        """The approach to use, once it is known."""
        return None if self.advice is None else self.advice.approach

    @property
    def predictions(self) -> Mapping[str, Prediction]:
        """By approach."""
        return {estimate.approach: estimate.prediction for estimate in self.estimates}

    @property
    def prediction(self) -> PredictedPulse:
        """All of them, as the library has it."""
        return PredictedPulse(self.campaign, tuple(self.estimates), self.config)

    @cached_property
    def beside(self) -> list[PredictedPulse]:
        """Predictions here by other seeds and presets, and those at pinned conditions."""
        others = [condition for text, condition in pinned().items() if text != self.condition.text]
        at_pins = (tuple(answers(self.request.key, condition, self.fitted)) for condition in others)
        same = predictions_here(self.campaign, self.condition) if self.whole else []
        return [*same, *(PredictedPulse(self.campaign, estimates, self.config) for estimates in at_pins)]

    def remember(self) -> None:
        """Keep a record of it among the results of this machine."""
        keep(PastResult.of_prediction(self.campaign, self.estimates, self.config))

    @property
    def key(self) -> Hashable:
        """Equal for equal data, settings, condition and display: part of the key of a cached figure."""
        return self.request.key, self.fitted.approaches, self.condition, self.view.display


def show_pins(view: View, condition: Condition, remember: Callable[[], None]) -> None:
    """Offer to pin the condition shown, and to unpin others; ``remember`` is called when it is pinned."""
    pins = pinned()

    def pin() -> None:
        st.session_state["pins"] = list(dict.fromkeys([*pinned(), condition.text]))
        remember()

    def unpin(text: str) -> None:
        st.session_state["pins"] = [other for other in pinned() if other != text]

    st.button(
        "Pin this prediction", icon=":material/keep:", on_click=pin,
        disabled=condition.text in pins or len(pins) >= MOST_PINS,
        help="Keeps it in the figures, a table of differences, the link, the report, and the list on History; up to "
        f"{MOST_PINS}.",
    )  # fmt: skip
    if not pins:
        return
    with st.popover(f"{len(pins)} pinned", key="pinned"):
        for text, other in pins.items():
            st.button(
                plain(view.display.briefly(other)), icon=":material/close:", key=f"unpin {text}", on_click=unpin,
                args=(text,), help="Unpin", type="tertiary",
            )  # fmt: skip


def show_pulses(answer: Answer) -> None:
    """Show every approach's prediction, and what was put beside, in the figure that the user picks."""
    condition, display = answer.condition, answer.view.display
    offer_predictions_here(answer.campaign)
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        shown = choose("Figure", list(_FIGURES), key="predicted")
        curves = choose_curves(answer.view, answer.predictions, answer.recommended, condition)

    def draw() -> go.Figure:
        drawn = answer.prediction.plot(
            _FIGURES[shown], approaches=curves.approaches, also=curves.also, band=curves.band, display=display
        )
        return without_clicks(drawn)

    said = f"Prediction by {curves.by}" if curves.approaches else "Beside the prediction"
    alt = f"{said} at {display.condition(condition)}: {shown.lower()}"
    name = curves.named(f"{condition.text} {shown.lower()}")
    show_cached_figure(draw, alt, shown, answer.key, curves.key, name=name, beside=curves.also)


def show_metrics(answer: Answer) -> None:
    """Show metrics, notes and fits."""
    campaign, estimates = answer.campaign, answer.estimates
    offer_predictions_here(campaign)
    _show_beside(answer)
    results.show_metrics([(LABELS[estimate.approach], estimate.metrics) for estimate in estimates], answer.view)
    weight = f"{answer.view.display.weight(answer.condition.mass_kg)} in all."
    st.caption("  \n".join(map(plain, [weight, *nearest_sentences(campaign, answer.condition)])))
    said = () if answer.advice is None else answer.advice.sentences
    results.show_notes(estimates, (*said, *campaign.cae.extrapolation(answer.condition)))
    results.show_fits(estimates)


def _show_beside(answer: Answer) -> None:
    if not answer.beside:
        return
    approach = leading(answer.predictions, answer.recommended)
    shown, display = by_one(approach, [answer.prediction, *answer.beside]), answer.view.display
    st.subheader(f"Beside other predictions: {LABELS[approach]}")
    show_table(side_by_side(shown, display), "beside")
    for sentence in cautions(shown, display):
        st.caption(plain(sentence))
    of = display.briefly(answer.condition)
    st.caption(f"Differences are from the first column, {plain(of)}, of values before they are rounded.")


def show_files(answer: Answer) -> None:
    """Offer tables; the report, and pulses for others, once every approach is known."""
    campaign, estimates, config = answer.campaign, answer.estimates, answer.config
    prediction, beside = answer.prediction, answer.beside
    offer_predictions_here(campaign)
    of = f"{campaign.name} {answer.view.display.briefly(answer.condition)}"
    form = choose_form(
        "recommendation, pulses, metrics and limits",
        "the pulse over displacement, how the fits went, the data, the method and its settings",
    )
    with st.container(horizontal=True):
        download_table("pulses.csv", lambda: prediction.pulses, of)
        download_table("metrics.csv", lambda: prediction.metrics, of)
        if beside:
            download_bytes("side_by_side.csv", lambda: csv_as_given(predictions_table([prediction, *beside])), of)
        download_bytes("pulses.parquet", lambda: parquet_bytes(prediction.pulses), of)
        if answer.whole:
            display = answer.view.display
            download_report(
                lambda: prediction_report(campaign, estimates, config, display, beside, form), f"{of} {form}"
            )
    if answer.recommended is not None:
        offer_pulses(campaign, estimates, answer.recommended, config.seed)
