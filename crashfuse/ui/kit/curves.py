"""Curves of a figure of pulses: those that were chosen, one filled band, and those that were added.

The choices stay until they are changed, over figures, windows, pages and reloads, and are in the address. A curve is
shown or hidden here alone, not by clicks in a legend, which the next redraw would forget. Added are tests, CAE runs,
predictions at pinned conditions, and predictions with other settings: on Compare and Data of the held-out test, on
Predict of the condition.
"""

from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.nearness import nearest_tests
from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.approaches.settings import PRESETS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError
from crashfuse.execution.cache import Cache
from crashfuse.reporting.earlier_prediction import LEFT_OUT, EarlierPrediction, earlier_name, otherwise
from crashfuse.reporting.figures import RUN, Further, prediction_name, pulse_name
from crashfuse.reporting.plots.curves import TEST
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.reporting.side_by_side import by_one
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, find_estimate
from crashfuse.study.history import earlier_settings, past_results, past_settings
from crashfuse.ui.kit import choices
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.choices import chosen_config, kept_choice, pinned
from crashfuse.ui.kit.computation import FitRequest, Request, StudyRequest, answers, jobs
from crashfuse.ui.kit.progress import patience, result_or_none
from crashfuse.ui.kit.text import plain
from crashfuse.ui.kit.window import end_page
from crashfuse.wording import read_out

_RECOMMENDED = "recommended"  # the approach whose band is filled, unless another is chosen
_NEAREST = 3
_MOST = 24  # added curves: with the test and the approaches some thirty
_PIN, _SETTINGS = "at:", "by:"  # begin what stands for them in the address: no id of a test has a colon in it
_LOOK_AGAIN_S = 60.0  # the command line may have computed more


@dataclass(frozen=True, eq=False)
class Shown:
    """What a figure shows."""

    test: bool  # whether the held-out test is among it
    approaches: tuple[str, ...]
    also: tuple[Further, ...]  # added tests and CAE runs by their ids, pinned predictions, those with other settings
    band: str  # the approach whose band is filled; added predictions are by it, too
    key: Hashable  # equal for equal choices: part of the key of a cached figure
    unlike: tuple[str, ...]  # in what it is not as usual, in few words for names of files
    every: bool  # whether no approach is hidden

    @property
    def by(self) -> str:
        """By which approaches its predictions are, in words."""
        return "every approach" if self.every else read_out([LABELS[name] for name in self.approaches])

    def named(self, drawn: str, *, of_test: bool = True) -> str:
        """What is drawn, and what is unlike the usual figure of that, for names of files.

        A figure without a curve ``of_test``, such as what is left of predictions less the test, lacks none.
        """
        return " ".join([drawn, *(part for part in self.unlike if of_test or part != f"no {_label(TEST)}")])

    def of(self, test: str) -> str:
        """What it shows of a test, in words."""
        prediction = f"by {self.by}" if self.approaches else ""
        if not self.test:
            return f"prediction of test {test} {prediction}" if prediction else f"beside test {test}"
        return f"test {test} and its prediction {prediction}" if prediction else f"test {test}"


def choose_curves(
    view: View,
    predictions: Mapping[str, Prediction],
    recommended: str | None,
    condition: Condition,
    held_out: str = "",
    offered: Sequence[str] | None = None,
) -> Shown:
    """Let the user choose what a figure shows of the predictions at a condition, of a ``held_out`` test perhaps.

    A figure with curves that it always shows says which others are ``offered``.
    """
    own_curves = [*([TEST] if held_out else []), *predictions] if offered is None else offered
    chosen: list[str] = []
    with st.popover("Curves", icon=":material/stacked_line_chart:"):
        if own_curves:
            chosen = kept_choice(
                "curves", own_curves, st.pills, "Curves", selection_mode="multi", width="content", format_func=_label,
                help="The choice stays, whatever else you change, and is in the link.",
            )  # fmt: skip
        band = _choose_band(predictions, recommended) if offered is None else leading(predictions, recommended)
        if held_out:
            also, missing = _add(view, band, predictions_of_test(view.campaign, held_out, band), held_out)
        else:
            also, missing = _add(view, band, _settings_here(view.campaign, condition, band), at=condition)
    st.button(
        "Nearest tests", icon=":material/near_me:", on_click=_add_nearest, args=(view.campaign, condition, held_out),
        help=f"Also show {_NEAREST} tests: the nearest by speed and weights, as shares of the speed and the mass.",
    )  # fmt: skip
    if held_out and any(isinstance(curve, PredictedPulse) for curve in also):
        missing.append(f"Pinned predictions learned from {plain(held_out)}, too.")
    _show_missing(missing)
    approaches = tuple(name for name in own_curves if name in chosen and name in predictions)
    if offered is None and not (approaches or also or TEST in chosen):
        st.info("No curve is chosen.", icon=":material/visibility_off:")
        end_page()
    key = approaches, key_of(also), band, TEST in chosen
    usual = _usual_band(predictions, recommended) if offered is None else band
    unlike = unlike_usual([name for name in own_curves if name not in chosen], band, usual)
    return Shown(TEST in chosen, approaches, also, band, key, unlike, len(approaches) == len(predictions))


def choose_tests(view: View, row: DeltaGenerator) -> tuple[tuple[str, ...], tuple[Further, ...]]:
    """Let the user choose tests, all by default, and add CAE runs and predictions."""
    names = {test.id: pulse_name(test.id, test.condition, view.display) for test in view.campaign.tests}
    with row, st.container(horizontal=True, vertical_alignment="bottom", gap="small"):
        only = _choose_several("only", names, "Tests", "all")
        also, missing = _add_to_tests(view, *names)
    _show_missing([*_unknown("only", names), *missing])
    return tuple(test for test in view.campaign.test_ids if not only or test in only), also


def add_to_runs(view: View) -> tuple[Further, ...]:
    """Let the user add tests, CAE runs and predictions to those of the CAE model."""
    also, missing = _add_to_tests(view)
    _show_missing(missing)
    return also


def key_of(also: Sequence[Further]) -> Hashable:
    """Equal for equal curves that were added: part of the key of a cached figure."""
    return tuple(curve if isinstance(curve, str) else curve.text for curve in also)


def unlike_usual(hidden: Sequence[str], band: str, usual: str) -> tuple[str, ...]:
    """What tells a figure from the usual one, in few words for names of files."""
    return (*(f"no {_label(curve)}" for curve in hidden), *([f"{LABELS[band]} band"] if band != usual else []))


def leading(predictions: Mapping[str, Prediction], recommended: str | None) -> str:
    """The approach whose band is filled and by which added predictions are."""
    chosen = st.session_state["band"]
    if chosen in predictions and predictions[chosen].draws_mps2 is not None:
        return str(chosen)
    return _usual_band(predictions, recommended)


def usual_approach() -> str:
    """The approach whose predictions are added to tests, where none is shown by itself."""
    return by_preference(chosen_config().approaches)[0]


def without_clicks(figure: go.Figure) -> go.Figure:
    """The same figure, with a legend that takes no clicks: what they hide would come back with the next redraw."""
    return figure.update_layout(legend={"itemclick": False, "itemdoubleclick": False})


def _label(curve: str) -> str:
    return LABELS.get(curve, "Test")


def _usual_band(predictions: Mapping[str, Prediction], recommended: str | None) -> str:
    return recommended if recommended is not None and recommended in predictions else by_preference(predictions)[0]


def _choose_band(predictions: Mapping[str, Prediction], recommended: str | None) -> str:
    with_band = [name for name, prediction in predictions.items() if prediction.draws_mps2 is not None]
    if with_band:
        labels = {_RECOMMENDED: "Recommended", **{name: LABELS[name] for name in with_band}}
        if st.session_state["band"] not in labels:
            st.session_state["band"] = _RECOMMENDED
        st.selectbox(
            "Filled band", list(labels), format_func=labels.__getitem__, key="band", persist_state="session",
            help="Of other bands the edges are drawn. Predictions put beside are by this approach.",
        )  # fmt: skip
    return leading(predictions, recommended)


def _choose_several(key: str, labels: Mapping[str, str], title: str, placeholder: str) -> list[str]:
    if len(st.session_state[key]) > _MOST:  # of a link, or one more of History: Streamlit would refuse them all
        st.session_state[key] = st.session_state[key][-_MOST:]
    return kept_choice(
        key, list(labels), st.multiselect, title, format_func=labels.__getitem__, max_selections=_MOST,
        placeholder=placeholder, filter_mode="contains", select_all=False,
    )  # fmt: skip


def _add_to_tests(view: View, *tests: str) -> tuple[tuple[Further, ...], list[str]]:
    approach = usual_approach()
    with st.popover("Beside them", icon=":material/stacked_line_chart:"):  # closed, a thousand runs cost nothing
        with_other = predictions_of_test(view.campaign, view.held_out.id, approach, among_tests=True)
        return _add(view, approach, with_other, *tests)


def _add(
    view: View, approach: str, with_other: "OtherSettings", *shown: str, at: Condition | None = None
) -> tuple[tuple[Further, ...], list[str]]:
    """Let the user add curves, of tests those that are not ``shown`` anyway; second are sentences on what is not there.

    On Predict, ``at`` a condition, the pinned predictions are shown without being asked for.
    """
    campaign, pins = view.campaign, pinned()
    pin_names = {f"{_PIN}{text}": prediction_name(approach, pin, view.display) for text, pin in pins.items()}
    tests = [test for test in campaign.tests if test.id not in shown]
    offered = {
        **{test.id: pulse_name(test.id, test.condition, view.display) for test in tests},
        **with_other.names,
        **(pin_names if at is None else {}),
        **_offered_runs(campaign.fingerprint, view.display, campaign),
    }
    kinds = [*(["tests"] if tests else []), *(["other settings"] if with_other.names else []), "CAE runs"]
    also = _choose_several("also", offered, "Also show", ", ".join(kinds))
    if at is not None:
        also += [name for name in pin_names if name != f"{_PIN}{at.text}"]
    wanted = [pins[name.removeprefix(_PIN)] for name in also if name in pin_names]
    at_pins = by_one(approach, _predicted(campaign, ((chosen_config(), condition) for condition in wanted)))
    missing = [*_unknown("also", {*campaign.test_ids, *offered}), *with_other.missing]
    if wanted and not at_pins:
        missing.append("Pinned predictions are shown once the page Predict has an answer with these settings.")
    pulses = [name for name in also if name not in pin_names and name not in with_other.names]
    return (*pulses, *with_other.predictions, *at_pins), missing


def _unknown(key: str, known: Collection[str]) -> list[str]:
    wanted = [name for name in st.session_state[key] if not name.startswith((_PIN, _SETTINGS))]
    missing = ", ".join(name.removeprefix(RUN)[:80] for name in wanted if name not in known)
    return [f"Not among the tests in use and the CAE runs: {plain(missing)}."] if missing else []


def _show_missing(sentences: Sequence[str]) -> None:
    """Say beside a figure what it cannot show: folded away, nobody would know that it lacks what a link asks for."""
    for sentence in sentences:
        st.caption(sentence, width="content")


@st.cache_resource(max_entries=8, show_spinner=False)
def _offered_runs(key: str, display: Display, _campaign: Campaign) -> Mapping[str, str]:  # noqa: ARG001
    """Labels of a campaign's thousands of CAE runs, made once for all sessions."""
    runs = zip(_campaign.cae.ids, _campaign.cae.conditions, strict=True)
    return {(name := f"{RUN}{run}"): pulse_name(name, at, display) for run, at in runs}


def _add_nearest(campaign: Campaign, condition: Condition, held_out: str) -> None:
    near = nearest_tests(campaign.without([held_out] if held_out else []), condition, _NEAREST)
    also = st.session_state["also"]
    st.session_state["also"] = list(dict.fromkeys([*also, *(test.id for test in near)]))[:_MOST]


def _predicted(campaign: Campaign, at: Iterable[tuple[StudyConfig, Condition]]) -> list[PredictedPulse]:
    """Predictions with settings at conditions, of those that are ready: with which all tests were learned from."""
    requests = ((FitRequest(campaign, config), condition) for config, condition in at)
    return [
        PredictedPulse(campaign, tuple(answers(request.key, condition, fitted)), request.config)
        for request, condition in requests
        if (fitted := request.result) is not None
    ]


@dataclass(frozen=True)
class OtherSettings:
    """Predictions with other settings that a figure offers, by what stands for these in the address."""

    names: Mapping[str, str]  # in the legend
    predictions: tuple[EarlierPrediction, ...] = ()  # those that were chosen and are there
    missing: tuple[str, ...] = ()  # sentences on what was chosen, for another test or by a link, and cannot be shown


def settings_text(config: StudyConfig) -> str:
    """What stands for settings in the address."""
    return f"{_SETTINGS}{config.preset} {config.seed} {config.leave_out}"


def _asked() -> list[str]:
    return [name for name in st.session_state["also"] if name.startswith(_SETTINGS)]


def _settings_of(text: str, shown: StudyConfig) -> StudyConfig | None:
    """The settings that a text stands for, otherwise like those shown; None if a link has it from nowhere."""
    with suppress(ValueError):
        preset, seed, leave_out = text.removeprefix(_SETTINGS).split(" ", 2)
        if int(seed) in choices.CHOICES["seed"].options and leave_out in LEFT_OUT:
            return StudyConfig.parse({**asdict(shown), "preset": preset, "seed": int(seed), "leave_out": leave_out})
    return None


def _in_words(text: str, shown: StudyConfig) -> str:
    config = _settings_of(text, shown)
    return text.removeprefix(_SETTINGS)[:80] if config is None else otherwise(config, shown) or "the usual settings"


def predictions_of_test(campaign: Campaign, test_id: str, approach: str, *, among_tests: bool = False) -> OtherSettings:
    """An approach's predictions of a held-out test that were computed before.

    They are put beside that with the chosen settings; in a figure ``among_tests``, which shows none, one with the usual
    settings is offered, too, and each is named after its test. There they are not looked up before they are chosen.
    """
    shown, of = _shown_of_test(among_tests=among_tests), test_id if among_tests else ""
    key, requests = (campaign.fingerprint, jobs().ended), _requests(campaign, test_id, shown)
    offered = dict(_offered(key, test_id, approach, shown, among_tests, campaign))
    if among_tests:
        offered |= {name: request.config for name, request in requests.items()}
    chosen = {
        name: EarlierPrediction(estimate, offered[name], shown, of)
        for name in _asked()
        if name in offered and (estimate := _estimate(key, test_id, approach, offered[name], campaign)) is not None
    }
    to_predict = {name for name, request in requests.items() if request.result is None}
    explained = {*chosen, *to_predict, *([] if among_tests else [settings_text(shown)])}
    missing = plain(" or with ".join(_in_words(name, shown) for name in _asked() if name not in explained))
    alone = "there is no other test to learn from." if len(campaign.tests) == 1 else ""
    why = f"is not shown: {alone or 'it comes out the same, or there are no such settings.'}"
    return OtherSettings(
        {name: earlier_name(approach, config, shown, of) for name, config in offered.items()},
        tuple(chosen.values()),
        (f"{plain(test_id)} with {missing} {why}",) if missing else (),
    )


def offer_predictions_of_test(campaign: Campaign, test_id: str, approach: str, *, among_tests: bool = False) -> None:
    """Offer to predict a test with settings that were chosen, by a link perhaps."""
    shown = _shown_of_test(among_tests=among_tests)
    there = predictions_of_test(campaign, test_id, approach, among_tests=among_tests).predictions
    unneeded = {prediction.config for prediction in there} | (set() if among_tests else {shown})
    for name, request in _requests(campaign, test_id, shown).items():
        words = f"{plain(test_id)} with {_in_words(name, shown)}"
        if request.config not in unneeded:
            lacking = f"The prediction of {words} is not there yet, or is no longer kept."
            _offer(request, request.config, lacking, words)


def _offer(request: Request[Any], config: StudyConfig, lacking: str, words: str) -> None:
    then = patience(config, "This takes a minute or two; then it stands beside the others.")
    result_or_none(request, invitation=f"{lacking} {then}", button=f"Predict {words}")


def _shown_of_test(*, among_tests: bool) -> StudyConfig:
    """The settings that names leave out: the chosen ones; among tests the usual ones."""
    chosen = chosen_config()
    return StudyConfig(chosen.approaches, device=chosen.device) if among_tests else chosen


def _requests(campaign: Campaign, test_id: str, shown: StudyConfig) -> Mapping[str, StudyRequest]:
    asked = {name: _settings_of(name, shown) for name in _asked() if len(campaign.tests) > 1}
    return {name: StudyRequest(campaign, (test_id,), config) for name, config in asked.items() if config is not None}


@st.cache_resource(max_entries=20, ttl=_LOOK_AGAIN_S, show_spinner=False)
def _offered(
    key: Hashable,  # noqa: ARG001
    test_id: str,
    approach: str,
    shown: StudyConfig,
    among_tests: bool,
    _campaign: Campaign,
) -> Mapping[str, StudyConfig]:
    """Settings of past results with a prediction of a test; the key is of the data and of what was computed here."""
    if among_tests:
        past = past_settings(past_results(), _campaign, test_id, approach, shown)
        past.sort(key=lambda config: (config.preset, config.seed, config.leave_out != "test"))  # the usual one first
    else:
        past = earlier_settings(past_results(), _campaign, test_id, approach, shown, Cache())
    return {settings_text(config): config for config in past}


@st.cache_resource(max_entries=12, show_spinner=False)
def _estimate(
    key: Hashable,  # noqa: ARG001
    test_id: str,
    approach: str,
    config: StudyConfig,
    _campaign: Campaign,
) -> Estimate | None:
    training, condition = config.training_campaign(_campaign, test_id), _campaign.test(test_id).condition
    return find_estimate(training, condition, approach, config, Cache())


def predictions_here(campaign: Campaign, condition: Condition) -> list[PredictedPulse]:
    """What every approach predicts at a condition by the chosen seeds and presets that are ready."""
    return _predicted(campaign, ((config, condition) for config in _wanted()))


def offer_predictions_here(campaign: Campaign) -> None:
    """Offer to predict by those that are not ready, or show how far they are."""
    for config in _wanted():
        words = f"with {otherwise(config, _shown_here())}"
        _offer(FitRequest(campaign, config), config, f"Nothing was predicted {words} yet.", words)


def _settings_here(campaign: Campaign, condition: Condition, approach: str) -> OtherSettings:
    """An approach's predictions at a condition by other seeds and presets; the next seed is always offered."""
    shown = _shown_here()
    fitted = _fitted_settings((campaign.fingerprint, jobs().ended), shown, campaign)
    offered = {config: settings_text(config) for config in fitted} | _wanted()
    return OtherSettings(
        {name: earlier_name(approach, config, shown) for config, name in offered.items()},
        tuple(
            EarlierPrediction(estimate, prediction.config, shown)
            for prediction in by_one(approach, predictions_here(campaign, condition))
            for estimate in prediction.estimates
        ),
    )


def _shown_here() -> StudyConfig:
    return replace(chosen_config(), leave_out="test")


def _wanted() -> dict[StudyConfig, str]:
    """Settings that were chosen on Predict, by what stands for them in the address."""
    shown = _shown_here()
    wanted: dict[StudyConfig, str] = {}
    for text in _asked():
        if (config := _settings_of(text, shown)) is not None and (here := replace(config, leave_out="test")) != shown:
            wanted.setdefault(here, text)
    return wanted


@st.cache_resource(max_entries=20, ttl=_LOOK_AGAIN_S, show_spinner=False)
def _fitted_settings(key: Hashable, shown: StudyConfig, _campaign: Campaign) -> Sequence[StudyConfig]:  # noqa: ARG001
    """Other settings with which all approaches were fitted on all tests, and the next seed."""
    following = replace(shown, seed=shown.seed + 1 if shown.seed < 2**32 - 1 else 0)
    configs = [result.config for result in past_results() if result.fingerprint == _campaign.fingerprint]
    past = [(config.preset, config.seed) for config in configs]
    usual = [(preset, seed) for preset in PRESETS for seed in (0, shown.seed, following.seed)]
    tried = [replace(shown, preset=preset, seed=seed) for preset, seed in sorted({*past, *usual})]
    return [config for config in tried if config != shown and (config == following or _is_fitted(_campaign, config))]


def _is_fitted(campaign: Campaign, config: StudyConfig) -> bool:
    with suppress(CrashfuseError):  # no such approach with these settings here
        return FitRequest(campaign, config).in_cache()
    return False
