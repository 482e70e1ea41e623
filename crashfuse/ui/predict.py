"""The page Predict: the predictions at a condition."""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.neighbours import nearest_sentences
from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.reporting.certification_tables import csv_as_given
from crashfuse.reporting.exports import parquet_bytes
from crashfuse.reporting.fit_explanations import whole_sentences
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.reporting.report import prediction_report
from crashfuse.reporting.side_by_side import by_one, cautions, column_names, predictions_table, side_by_side
from crashfuse.study.estimate import Estimate
from crashfuse.study.facts import condition_facts
from crashfuse.study.history import PastResult, keep
from crashfuse.study.recommendation import Recommendation
from crashfuse.ui.kit import address, results
from crashfuse.ui.kit.address import MOST_PINS, pinned
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import FitRequest, Fitted, advised, answers
from crashfuse.ui.kit.curves import REPRESENTATIVE, Subject, choose_curves, predicted, without_clicks
from crashfuse.ui.kit.figures import choose, show_cached_figure
from crashfuse.ui.kit.files import choose_form, download_bytes, download_report, download_table, offer_pulses
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import plain
from crashfuse.wording import IN_SI, joined

DECIMALS = 9
"""Of speeds and weights in the session and the address: 56 km/h come back as 56."""


class Field(NamedTuple):
    """A number of a condition, or a range of it, with the unit that the session and the address have it in."""

    label: str
    key: str
    unit: str
    step: float
    digits: int = 0


_FIELDS = (
    Field("Impact speed", "speed_mph", "mph", 0.1, 1),
    Field("Front weight", "front_weight_lb", "lb", 1.0, 0),
    Field("Rear weight", "rear_weight_lb", "lb", 1.0, 0),
)
_FIGURES = {"Over time": "motion", "Over displacement": "displacement", "Energy over crush": "energy"}


def choose_condition(campaign: Campaign, display: Display) -> Condition:
    """Ask for a condition, and warn if it lies outside the CAE runs; factors not given are left out."""
    with st.container(key="condition"):
        first, further = st.columns(3 + min(len(campaign.factors), 3)), max(len(campaign.factors) - 3, 0)
    columns = [*first, *(st.columns(further) if further else [])]
    factors = {}
    for column, (name, values) in zip(columns[3:], campaign.factors.items(), strict=True):
        if st.session_state.get(key := f"factor_{name}") not in values:  # left from another campaign
            address.put(key, None)
        factors[name] = column.selectbox(
            plain(name.capitalize()), values, index=None, placeholder="not given", key=key, persist_state="session",
            help="If it is not given, the band covers every value.",
        )  # fmt: skip
    fields = zip(columns, _FIELDS, campaign.cae.vectors.T, strict=False)
    condition = Condition.of_vector(
        [_choose_number(column, field, display, runs) for column, field, runs in fields],
        tuple((name, choice) for name, choice in factors.items() if choice),
        units=display.system.endings,
    )
    if facts := condition_facts(campaign, condition):
        st.markdown(f":material/warning: **{plain(display.words(joined([fact.sentence for fact in facts])))}**")
    return condition


def fill_in(campaign: Campaign, condition: Condition) -> None:
    """Choose a condition on the page Predict; call it from a callback."""
    given, numbers = dict(condition.factors), zip(_FIELDS, condition.vector, strict=True)
    st.session_state.update({field.key: round(float(value) / IN_SI[field.unit], DECIMALS) for field, value in numbers})
    st.session_state.update({f"factor_{name}": given.get(name) or None for name in campaign.factors})


def _choose_number(column: DeltaGenerator, field: Field, display: Display, runs: np.ndarray) -> float:
    """Slider over the CAE runs' range, and a field beyond it; returns SI, kept in mph or lb."""
    name, in_si, step, digits = field.key, IN_SI[field.unit], field.step, field.digits
    label, shown = display.title(field.label, field.unit), 1 / display.units.in_si(field.unit)
    state, values = st.session_state, runs * shown
    low, high = max(float(np.floor(values.min())), step), float(np.ceil(values.max()))
    least, most = max(low / 2, step), 2 * high  # a decimal comma typed by mistake gives ten times the intended value
    address.default(name, round(float(np.median(runs)) / in_si, digits))
    asked = round(state[name] * in_si * shown, DECIMALS)
    value = min(max(asked, least), most)
    if asked != value:  # by a link, left from another campaign, or typed: the field itself would refuse without a word
        st.warning(f"{label} is from {least:g} to {most:g} here, not {asked:g}: {value:g} is taken.")
        state[name] = round(value / shown / in_si, DECIMALS)
    # A browser sends what its widgets showed before it hears of a new value. So each value that a widget did not give
    # itself makes another widget of it, and what the one before still sends does not count.
    widgets = state.get(f"{name} widgets", {})
    if widgets.get("value") != state[name]:  # a link, Back, or another page
        widgets = dict.fromkeys(("value", "field", "slider"), state[name])
    number = f"field {name} {shown:g} after {widgets['field']!r}"
    slider = f"slider {name} {low:g} to {high:g} after {widgets['slider']!r}"
    state[f"{name} widgets"] = {**widgets, "keys": (number, slider)}
    address.put(number, value)
    address.put(slider, min(max(value, low), high))

    def take(key: str, other: str) -> None:
        # a field that a slow browser has only just put into the page may send its default, 0
        if state[key] and key in state[f"{name} widgets"]["keys"]:
            state[name] = round(state[key] / shown / in_si, DECIMALS)
            state[f"{name} widgets"] = {**widgets, "value": state[name], other: state[name], "keys": (key,)}

    form = f"%.{digits}f"
    column.number_input(label, step=step, format=form, key=number, on_change=take, args=(number, "slider"))
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
    fitted: Fitted  # while networks train, fewer approaches than the settings ask for
    condition: Condition

    @cached_property
    def estimates(self) -> list[Estimate]:
        """One for each approach."""
        return answers(self.request.key, self.condition, self.fitted)

    @property
    def whole(self) -> bool:
        """True once every approach is known."""
        return len(self.fitted.fits) == len(self.request.config.approaches)

    @cached_property
    def advice(self) -> Recommendation | None:
        """Which of them to use; None while approaches are still missing."""
        if not self.whole:
            return None
        window_ms = self.view.display.window_ms
        return advised(self.request.key, self.condition, window_ms, self.estimates, self.view.campaign)

    @property
    def prediction(self) -> PredictedPulse:
        """All of them, as the library has it."""
        return PredictedPulse(self.view.campaign, tuple(self.estimates), self.request.config)

    @property
    def subject(self) -> Subject:
        """What predictions with other settings are of."""
        return Subject(self.view, self.condition)

    @cached_property
    def others(self) -> list[PredictedPulse]:
        """Predictions here with other settings, and those at pinned conditions, once this one is whole."""
        if not self.whole:
            return []
        pins = [condition for text, condition in pinned().items() if text != self.condition.text]
        asked = [(config, self.condition) for config in self.subject.wanted]
        asked += [(self.request.config, condition) for condition in pins]
        found = (predicted(self.view.campaign, config, condition) for config, condition in asked)
        return [prediction for prediction in found if prediction is not None]

    @property
    def key(self) -> Hashable:
        """Equal for equal data, settings, condition and display: part of the key of a cached figure."""
        return self.request.key, self.fitted.approaches, self.condition, self.view.display


def show_pins(answer: Answer) -> None:
    """Offer to pin the condition, with a record among the results of this machine, and to unpin others."""
    pins, here = pinned(), answer.condition.text

    def pin() -> None:
        st.session_state["pins"] = list(dict.fromkeys([*pinned(), here]))
        keep(PastResult.of_prediction(answer.view.campaign, answer.estimates, answer.request.config))

    def unpin(text: str) -> None:
        st.session_state["pins"] = [other for other in pinned() if other != text]

    st.button(
        "Pin this prediction", icon=":material/keep:", on_click=pin, disabled=here in pins or len(pins) >= MOST_PINS,
        help=f"Keeps it in figures, the link, the report and the past results; up to {MOST_PINS}.",
    )  # fmt: skip
    if pins:
        with st.popover(f"{len(pins)} pinned", key="pinned"):
            for text, other in pins.items():
                st.button(
                    plain(answer.view.display.briefly(other)), icon=":material/close:", key=f"unpin {text}",
                    on_click=unpin, args=(text,), help="Unpin", type="tertiary",
                )  # fmt: skip


def show_pulses(answer: Answer) -> None:
    """Show the prediction, and what was put beside, in the figure that the user picks; below it the metrics."""
    condition, display = answer.condition, answer.view.display
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        shown = choose("Figure", list(_FIGURES), key="predicted")
        curves = choose_curves(answer.subject, answer.fitted.approaches)

    def draw() -> go.Figure:
        drawn = answer.prediction.plot(
            _FIGURES[shown], approaches=curves.approaches, also=curves.also, band=curves.approach,
            representative=REPRESENTATIVE in curves.others, display=display,
        )  # fmt: skip
        return without_clicks(drawn)

    alt = f"Prediction by {curves.by} at {display.condition(condition)}: {shown.lower()}"
    name = curves.named(f"{condition.text} {shown.lower()}")
    show_cached_figure(draw, alt, shown, answer.key, curves.key, name=name, beside=curves.also)
    if answer.others:
        _show_differences(answer)
    estimates = [estimate for estimate in answer.estimates if estimate.approach in curves.approaches]
    columns = [(LABELS[estimate.approach], estimate.metrics) for estimate in estimates]
    if not answer.others:
        results.show_metrics(columns, answer.view)
    weight = f"{display.weight(condition.mass_kg)} in all."
    advice = () if answer.advice is None else answer.advice.sentences
    remarks = [weight, *nearest_sentences(answer.view.campaign, condition), *whole_sentences(estimates)]
    said = (*advice, *answer.view.campaign.cae.extrapolation(condition))
    results.show_details(columns, estimates, answer.view, said, remarks)


def _show_differences(answer: Answer) -> None:
    display, shown = answer.view.display, by_one(answer.subject.approach, [answer.prediction, *answer.others])
    names = column_names(shown, display)
    first, second, *more = names

    def minus(name: str) -> str:
        return f"− {name}" if more else f"{second if name == first else first} − {name}"

    base = names.index(choose("Difference", names, key="subtracted", label_of=minus))
    show_table(side_by_side(shown, display, base), "beside")
    for sentence in cautions(shown, display):
        st.caption(plain(sentence))


def show_files(answer: Answer) -> None:
    """Offer tables; the report, and pulses for others, once every approach is known."""
    campaign, estimates, config = answer.view.campaign, answer.estimates, answer.request.config
    prediction, others, display = answer.prediction, answer.others, answer.view.display
    of = f"{campaign.name} {display.briefly(answer.condition)}"
    form = choose_form(
        "recommendation, pulses, metrics and limits",
        "the pulse over displacement, how the fits went, the data, the method and its settings",
    )
    with st.container(horizontal=True):
        download_table("pulses.csv", lambda: prediction.pulses, of)
        download_table("metrics.csv", lambda: prediction.metrics, of)
        if others:
            download_bytes("side_by_side.csv", lambda: csv_as_given(predictions_table([prediction, *others])), of)
        download_bytes("pulses.parquet", lambda: parquet_bytes(prediction.pulses), of)
        if answer.whole:
            write = partial(prediction_report, campaign, estimates, config, display, others, form)
            download_report(write, f"{of} {form}")
    if answer.advice is not None:
        offer_pulses(campaign, estimates, answer.advice.approach, config.seed)
