"""The page Predict: the predictions at a condition, over speed, and which test to run next."""

import math
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.approaches.neighbours import nearest_sentences
from crashfuse.approaches.registry import BASELINE, LABELS, by_preference
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.results.display import Display
from crashfuse.results.fit_explanations import estimates_result
from crashfuse.results.planning import MEANING, next_tests_result, sweep_result
from crashfuse.results.prediction import cautions, column_names, prediction_result, side_by_side
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.config import StudyConfig
from crashfuse.study.facts import condition_facts
from crashfuse.study.history import PastResult, keep
from crashfuse.study.planning import BEST, ConditionRange, NextTests, rank_next_tests, weights_sentence
from crashfuse.study.prediction import PredictedPulse, by_one
from crashfuse.study.recommendation import Recommendation
from crashfuse.ui.kit import address, results
from crashfuse.ui.kit.address import DECIMALS, MOST_PINS, chosen_config, kept, pin_all, pinned
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import Fitted, Request, advised, answers, fit_request, sweep_over_speed
from crashfuse.ui.kit.curves import AVERAGE, choose_curves, predicted
from crashfuse.ui.kit.figures import choose, show_cached_figure, show_figure
from crashfuse.ui.kit.files import choose_form, export_button, offer_pulses, offer_result
from crashfuse.ui.kit.frame import by_itself
from crashfuse.ui.kit.progress import result_of, result_or_none, show_training
from crashfuse.ui.kit.results import show_table
from crashfuse.ui.kit.text import TTZV, plain
from crashfuse.units import IN_SI, read_out


class _Field(NamedTuple):  # a number of a condition, or its range, in the unit of the session and the address
    label: str
    key: str
    unit: str
    step: float
    digits: int = 0


_FIELDS = (
    _Field("Impact speed", "speed_mph", "mph", 0.1, 1),
    _Field("Front weight", "front_weight_lb", "lb", 1.0, 0),
    _Field("Rear weight", "rear_weight_lb", "lb", 1.0, 0),
)
_AXES = (
    _Field("Speeds", "speed_range", "mph", 0.5),
    _Field("Front weights", "front_range", "lb", 10.0),
    _Field("Rear weights", "rear_range", "lb", 10.0),
)
_FIGURES = {"Over time": "motion", "Over displacement": "displacement", "Energy over crush": "energy"}


def show(view: View) -> None:
    """Ask for a condition, and show what is predicted there in the tab that the user chooses."""
    config = chosen_config()
    request = fit_request(view.campaign, config)
    show_all = partial(_ask_and_answer, view, config, request)
    if request.result is None:  # the sidebar shows what runs
        show_all()
    else:
        by_itself(show_all)


def _ask_and_answer(view: View, config: StudyConfig, request: Request[Fitted]) -> None:
    campaign, condition = view.campaign, _choose_condition(view.campaign, view.display)
    invitation = f"Fitted once on all {len(campaign.tests)} tests, the approaches answer every condition at once."
    fitted = result_of(request, invitation=invitation, button="Predict")
    prediction, advice = PredictedPulse(campaign, tuple(answers(condition, fitted)), config), None
    if is_whole := fitted.approaches == config.approaches:
        advice = advised(fitted.key, condition, view.display.window_ms, prediction.estimates, campaign)
    pins = [pin for text, pin in pinned().items() if is_whole and text != condition.text]
    at_pins = [found for pin in pins if (found := predicted(campaign, config, pin)) is not None]
    show_training(config, fitted.approaches)
    if advice is not None:
        here = [fact.sentence for fact in condition_facts(campaign, condition)]
        use = f":material/lightbulb: **{plain(advice.brief)}**"
        results.show_with_reasons(use, [*dict.fromkeys([*advice.sentences, *here])])
    with st.container(horizontal=True, vertical_alignment="center", gap="small", key="asked"):
        tab = choose("Tab", ["Pulses", "Over speed", "Next test"], key="predict_tab")
        best = by_preference(fitted.approaches)[0] if advice is None else advice.approach
        address.default("predict_approach", best, fitted.approaches)
        look = kept("predict_approach", on_change=address.publish, label_visibility="collapsed", width=230)
        approach = st.selectbox("Approach", fitted.approaches, format_func=lambda name: f"By {LABELS[name]}", **look)
        if advice is not None:
            _keep_past((fitted.key, condition), prediction)
            _show_pins(prediction)
        st.space("stretch")
        export_button(partial(_show_files, prediction, at_pins, advice, view.display))
    if tab == "Pulses":
        _show_pulses(view, fitted, prediction, at_pins, approach, advice)
    elif tab == "Next test":
        _show_next_test(view, fitted, condition, approach)
    elif advice is None:
        st.info("Speeds are predicted once every approach is fitted.", icon=":material/hourglass_top:")
    else:
        _show_over_speed(view, fitted, condition, approach)


def _choose_condition(campaign: Campaign, display: Display) -> Condition:
    with st.container(key="condition"):
        first, further = st.columns(3 + min(len(campaign.factors), 3)), max(len(campaign.factors) - 3, 0)
    columns = [*first, *(st.columns(further) if further else [])]
    factors = {}
    for column, (name, values) in zip(columns[3:], campaign.factors.items(), strict=True):
        if st.session_state.get(key := f"factor_{name}") not in values:  # left from another campaign
            address.put(key, None)
        tip, label = "If it is not given, the band covers every value.", plain(name.capitalize())
        factors[name] = column.selectbox(label, values, None, placeholder="not given", help=tip, **kept(key))
    fields = zip(columns, _FIELDS, campaign.cae.vectors.T, strict=False)
    vector = [_choose_number(column, field, display, runs) for column, field, runs in fields]
    given = tuple((name, choice) for name, choice in factors.items() if choice)
    condition = Condition.of_vector(vector, given, units=display.system.endings)
    for fact in condition_facts(campaign, condition):
        if fact.code != "test.stands_apart":
            st.markdown(f":material/warning: **{plain(display.words(fact.sentence))}**")
            continue
        tests = [*fact.about, *cast(Sequence[str], fact.values["neighbours"])]
        at = campaign.test(tests[0]).condition.speed_mps
        label = f"{fact.label} at {display.speed(at)}: show {read_out(sorted(tests))}"
        help_, show = plain(display.words(fact.sentence)), partial(_show_tests, tests)
        st.button(plain(label), icon=":material/warning:", type="tertiary", help=help_, on_click=show)
    return condition


def _show_tests(tests: Sequence[str]) -> None:
    state = st.session_state
    state["predict_also"] = [*dict.fromkeys([*state["predict_also"], *tests])]
    state["predict_tab"], state["predicted"] = "Pulses", "Over time"
    address.publish()


def _choose_number(column: DeltaGenerator, field: _Field, display: Display, runs: np.ndarray) -> float:
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
    look: dict[str, Any] = {"key": slider, "on_change": take, "args": (slider, "field"), "format": form}
    column.slider(f"{label}, over the CAE runs", low, high, step=step, label_visibility="collapsed", **look)
    return float(state[name] * in_si)


@st.cache_resource(max_entries=200, show_spinner=False)
def _keep_past(key: Hashable, _prediction: PredictedPulse) -> None:  # noqa: ARG001 - once a condition
    keep(PastResult.of_prediction(_prediction.campaign, _prediction.estimates, _prediction.config))


def _show_pins(prediction: PredictedPulse) -> None:
    pins = pinned()

    def unpin(text: str) -> None:
        st.session_state["pins"] = [other for other in pinned() if other != text]

    tip = f"Keeps up to {MOST_PINS} in figures, link and report."
    pin, is_full = partial(pin_all, [prediction.condition]), prediction.text in pins or len(pins) >= MOST_PINS
    st.button("Pin this prediction", icon=":material/keep:", on_click=pin, disabled=is_full, help=tip)
    if pins:
        with st.popover(f"{len(pins)} pinned", key="pinned"):
            for text, other in pins.items():
                label = f":material/close: {plain(other.brief)}"
                st.button(label, key=f"unpin {text}", on_click=unpin, args=(text,), type="tertiary")


def _show_pulses(
    view: View,
    fitted: Fitted,
    prediction: PredictedPulse,
    at_pins: Sequence[PredictedPulse],
    approach: str,
    advice: Recommendation | None,
) -> None:
    condition = prediction.condition
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        shown = choose("Figure", list(_FIGURES), key="predicted")
        curves = choose_curves(view, condition, approach, fitted.approaches)

    figure = partial(prediction.draw, _FIGURES[shown], average=AVERAGE in curves.others, display=view.display)
    alt = f"Prediction by {curves.by} at {view.display.condition(condition)}: {shown.lower()}"
    name = curves.named(f"{condition.text} {shown.lower()}")
    key = shown, fitted.key, fitted.approaches, condition, view.display, curves.key
    show = partial(show_cached_figure, partial(curves.draw, figure), alt, *key, name=name)
    estimates = [estimate for estimate in prediction.estimates if estimate.approach in curves.approaches]
    known = (*(advice.sentences if advice else ()), *view.campaign.cae.extrapolation(condition))
    about = estimates_result(view.campaign, estimates, known=known)
    if at_pins:
        show()
        _show_differences(by_one(approach, [prediction, *at_pins]), view.display)
    else:
        with st.container(key="pulse"):
            pulse, metrics = st.columns([3, 2])
        with pulse:
            show()
        with metrics:
            mixed = [LABELS[own.approach] for own in estimates[-1:] if own.by_fold]  # both folds stand beside it
            results.show_metrics(about, *mixed, beside=True)
    weight = f"{view.display.weight(condition.mass_kg)} in all."
    results.show_details(about, [weight, *nearest_sentences(view.campaign, condition), *about.sentences["whole"]])


def _show_differences(shown: Sequence[PredictedPulse], display: Display) -> None:
    names = [*map(display.words, column_names(shown))]
    first, second, *more = names

    def minus(name: str) -> str:
        return plain(f"− {name}" if more else f"{second if name == first else first} − {name}")

    base = names.index(choose("Difference", names, key="subtracted", label_of=minus))
    show_table(side_by_side(shown, base), "beside")
    for sentence in cautions(shown):
        st.caption(plain(display.words(sentence)))


def _show_over_speed(view: View, fitted: Fitted, condition: Condition, approach: str) -> None:
    request, invitation = sweep_over_speed(view.campaign, fitted, condition), "The metrics over some thirty speeds."
    sweep = result_or_none(request, invitation=invitation, button="Predict over speed")
    if sweep is None:
        return
    look = kept("sweep_metric", format_func=METRIC_LABELS.__getitem__, help=TTZV)
    metric = st.selectbox("Pulse metric", list(METRIC_LABELS), **look)
    shown = replace(sweep, metrics={name: own for name, own in sweep.metrics.items() if name in (approach, BASELINE)})
    alt = f"{METRIC_LABELS[metric]} over impact speed by {LABELS[approach]}, tests as points"
    name = f"{metric} over speed {condition.text.partition(' ')[2]}"
    show_figure(shown.draw(metric, display=view.display), alt, name=name)
    for sentence in (weights_sentence(condition, view.campaign.tests), *shown.missing(metric)):
        st.caption(plain(sentence))
    offer_result(sweep_result(sweep), view.display)


def _show_next_test(view: View, fitted: Fitted, condition: Condition, approach: str) -> None:
    campaign = view.campaign
    domains = [fit.approach for fit in fitted.fits if isinstance(fit.approach, DisplacementDomain)]
    if not domains or not isinstance(domains[0].bias_, HierarchicalBias):
        st.info("Ranking next tests needs the displacement domain with the fast settings.")
        return
    usual, ends, display = ConditionRange.of(campaign.tests), [], view.display
    for place, (column, axis) in enumerate(zip(st.columns(3), _AXES, strict=True)):
        tests = [float(end.vector[place]) for end in (usual.low, usual.high)]
        ends.append(_range(column, axis, view, campaign.cae.vectors[:, place], tests))
    kind = condition.factors or usual.low.factors
    low, high = (Condition.of_vector([v0, front, rear], kind) for v0, front, rear in zip(*ends, strict=True))
    try:
        over = ConditionRange(low, high)
        rank = partial(rank_next_tests, campaign, domains[0], over, config=chosen_config())
        ranking = _ranked((fitted.key, campaign.name, over, chosen_config()), rank)
    except UsageError as error:
        st.warning(plain(error.args[0]), icon=":material/warning:")
        return
    alt, name = "How much each candidate would narrow the band", f"next test {over.low.text} to {over.high.text}"
    for sentence in ranking.repeats:
        st.markdown(f"**{plain(display.words(sentence))}**")
    show_figure(ranking.draw(display=display), alt, name=name)
    st.caption(MEANING)
    if approach != DisplacementDomain.name:
        st.caption(f"By the displacement domain: {LABELS[approach]} cannot rank tests.")
    named = ", ".join(f"{name} {value}" for name, value in kind if value)
    usual_kind = "" if condition.factors else ", of which there are most tests"
    st.markdown(f"**The best {BEST}**" + (f", for {plain(named)}{usual_kind}" if named else ""))
    result = next_tests_result(ranking)
    show_table(result.tables["best"], "next tests")
    offer_result(result, display)


@st.cache_resource(show_spinner="Ranking candidates …", max_entries=32)
def _ranked(key: Hashable, _rank: Callable[[], NextTests]) -> NextTests:  # noqa: ARG001 - of fits, range, settings
    return _rank()


def _range(
    column: DeltaGenerator, axis: _Field, view: View, runs: np.ndarray, tests: Sequence[float]
) -> tuple[float, float]:
    own_unit, unit = (units.unit(axis.unit) for units in (view.campaign.units, view.display.units))
    state, step = st.session_state, axis.step
    own_in_si, in_si = IN_SI[own_unit], IN_SI[unit]
    least, most = min(float(runs.min()), *tests), max(float(runs.max()), *tests)
    low = step * int(max(least / in_si, step) / step + 1e-6)
    high = -step * int(-most / in_si / step - 1 + 1e-6)
    first, last = _ends(state[axis.key] or "")
    if not least / 2 <= first <= last <= 2 * most:  # nothing yet, a link that was cut, or another campaign's
        state[axis.key] = None
    address.default(axis.key, f"{tests[0] / own_in_si:.9g}:{tests[1] / own_in_si:.9g} {own_unit}")
    ends = _ends(state[axis.key])
    slider = f"{axis.key}, {low:g} to {high:g} {unit}"  # another range is another widget
    address.put(slider, tuple(round(min(max(end / in_si, low), high), DECIMALS) for end in ends))

    def take() -> None:
        first, last = state[slider]
        state[axis.key] = f"{first:.12g}:{last:.12g} {unit}"

    label, form = view.display.title(axis.label, axis.unit), "%.1f" if step < 1 else "%.0f"
    column.slider(label, low, high, step=step, format=form, key=slider, on_change=take)
    return ends


def _ends(text: str) -> tuple[float, float]:
    with suppress(ValueError, KeyError):
        numbers, _, unit = text.partition(" ")
        first, last = numbers.split(":")
        return float(first) * IN_SI[unit], float(last) * IN_SI[unit]
    return math.nan, math.nan


def _show_files(
    prediction: PredictedPulse, others: Sequence[PredictedPulse], advice: Recommendation | None, display: Display
) -> None:
    whole = "the pulse over displacement, the fits, the data, the method and its settings"
    form = choose_form("recommendation, pulses, metrics and limits", whole)
    result, where = prediction_result(prediction, others, form), display.words(prediction.condition.brief)
    offer_result(result, display, f"{prediction.campaign.name} {where} {form}", with_report=advice is not None)
    if advice is not None:
        offer_pulses(prediction.campaign, prediction.estimates, advice.approach, prediction.config.seed)
