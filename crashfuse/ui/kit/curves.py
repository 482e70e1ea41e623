"""Curves of a figure of pulses: those that were chosen, one filled band, and those that were added.

The choices are in the address. Added are tests, CAE runs, predictions at pinned conditions, and predictions with other
settings: of the held-out test, on Predict at the condition.
"""

from collections.abc import Collection, Hashable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.neighbours import nearest_tests
from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
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
from crashfuse.ui.kit import address
from crashfuse.ui.kit.address import chosen_config, kept_choice, pinned
from crashfuse.ui.kit.campaigns import View
from crashfuse.ui.kit.computation import FitRequest, Request, StudyRequest, answers, jobs
from crashfuse.ui.kit.navigation import end_page
from crashfuse.ui.kit.progress import patience, result_or_none
from crashfuse.ui.kit.text import plain
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
    also: tuple[Further, ...]
    band: str  # the approach whose band is filled; added predictions are by it, too
    key: Hashable  # equal for equal choices: part of the key of a cached figure
    unlike: tuple[str, ...]  # in what it is not as usual, in few words for names of files
    every: bool  # whether no approach is hidden

    @property
    def by(self) -> str:
        """By which approaches its predictions are, in words."""
        return "every approach" if self.every else read_out([LABELS[name] for name in self.approaches])

    def named(self, drawn: str, *, of_test: bool = True) -> str:
        """A name of files: what is drawn, and what is unusual; a figure without a curve ``of_test`` lacks none."""
        return " ".join([drawn, *(part for part in self.unlike if of_test or part != f"no {_label(TEST)}")])

    def of(self, test: str) -> str:
        """What it shows of a test, in words."""
        prediction = f"by {self.by}" if self.approaches else ""
        if not self.test:
            return f"prediction of test {test} {prediction}" if prediction else f"beside test {test}"
        return f"test {test} and its prediction {prediction}" if prediction else f"test {test}"


@dataclass(frozen=True, eq=False)
class Subject:
    """What added predictions are of: a held-out test, alone or in a figure ``among_tests``, or a condition."""

    view: View
    condition: Condition
    test: str = ""  # none at a condition
    among_tests: bool = False  # where no prediction is shown, but for those that are added

    @classmethod
    def held_out(cls, view: View, *, among_tests: bool = False) -> "Subject":
        """The held-out test."""
        return cls(view, view.held_out.condition, view.held_out.id, among_tests)

    @property
    def shown(self) -> StudyConfig:
        """The settings that names leave out: the chosen ones; among tests the usual ones."""
        chosen = chosen_config()
        if self.among_tests:
            return StudyConfig(chosen.approaches, device=chosen.device)
        return chosen if self.test else replace(chosen, leave_out="test")

    @property
    def wanted(self) -> dict[StudyConfig, str]:
        """Other settings that were chosen, with what stands for them in the address."""
        wanted: dict[StudyConfig, str] = {}
        for text in _asked() if not self.test or len(self.view.campaign.tests) > 1 else ():
            if (config := _settings_of(text, self.shown)) is not None:
                here = config if self.test else replace(config, leave_out="test")
                if here != self.shown or self.among_tests:
                    wanted.setdefault(here, text)
        return wanted

    def names(self, approach: str) -> dict[str, str]:
        """Names in the legend of an approach's predictions that can be added, by what stands for them."""
        campaign = self.view.campaign
        key = campaign.fingerprint, jobs().ended
        if self.test:
            known = _known_of_test(key, self.test, approach, self.shown, self.among_tests, campaign)
        else:
            known = _known_at_conditions(key, self.shown, campaign)
        offered = {config: settings_text(config) for config in known} | self.wanted
        return {text: earlier_name(approach, config, self.shown, self._of) for config, text in offered.items()}

    def predictions(self, approach: str) -> tuple[EarlierPrediction, ...]:
        """An approach's predictions that were chosen and are there."""
        found = ((config, self._estimate(config, approach)) for config in self.wanted)
        return tuple(EarlierPrediction(own, config, self.shown, self._of) for config, own in found if own is not None)

    def offer(self, approach: str) -> None:
        """Offer to predict with settings that were chosen, by a link perhaps, or show how far that is."""
        for config in self.wanted:
            if self._estimate(config, approach) is None:
                words = otherwise(config, self.shown) or "the usual settings"
                of = plain(self.test) if self.test else "this condition"
                then = patience(config, "This takes a minute or two; then it stands beside the others.")
                lacking = f"The prediction of {of} with {words} is not there yet, or is no longer kept."
                button = " ".join(["Predict", *([of] if self.test else []), "with", words])
                result_or_none(self._request(config), invitation=f"{lacking} {then}", button=button)

    @property
    def _of(self) -> str:
        return self.test if self.among_tests else ""

    def _request(self, config: StudyConfig) -> Request[Any]:
        campaign = self.view.campaign
        return StudyRequest(campaign, (self.test,), config) if self.test else FitRequest(campaign, config)

    def _estimate(self, config: StudyConfig, approach: str) -> Estimate | None:
        campaign, estimates = self.view.campaign, None
        if not self.test:
            prediction = predicted(campaign, config, self.condition)
            estimates = None if prediction is None else prediction.estimates
        elif (study := StudyRequest(campaign, (self.test,), config).result) is not None:
            estimates = study.fold(self.test).estimates
        else:  # a study by fewer approaches may have left this one
            key = campaign.fingerprint, jobs().ended
            return _estimate_of_test(key, self.test, approach, config, campaign)
        return next((estimate for estimate in estimates or () if estimate.approach == approach), None)


def predicted(campaign: Campaign, config: StudyConfig, condition: Condition) -> PredictedPulse | None:
    """What is predicted at a condition from all tests with some settings, if it is ready."""
    request = FitRequest(campaign, config)
    if (fitted := request.result) is None:
        return None
    return PredictedPulse(campaign, tuple(answers(request.key, condition, fitted)), config)


def choose_curves(
    subject: Subject,
    predictions: Mapping[str, Prediction],
    recommended: str | None,
    offered: Sequence[str] | None = None,
) -> Shown:
    """Let the user choose what a figure shows of the predictions; one with fixed curves says which are ``offered``."""
    held_out = subject.test
    own_curves = [*([TEST] if held_out else []), *predictions] if offered is None else offered
    chosen: list[str] = []
    with st.popover("Curves", icon=":material/stacked_line_chart:"):
        if own_curves:
            chosen = kept_choice(
                "curves", own_curves, st.pills, "Curves", selection_mode="multi", width="content", format_func=_label,
                help="The choice stays, whatever else you change, and is in the link.",
            )  # fmt: skip
        band = _choose_band(predictions, recommended) if offered is None else leading(predictions, recommended)
        also, missing = _add(subject, band, [held_out])
    st.button(
        "Nearest tests", icon=":material/near_me:", on_click=_add_nearest, args=(subject,),
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
        also, missing = _add_to_tests(view, names)
    _show_missing([*_unknown("only", names), *missing])
    return tuple(test for test in view.campaign.test_ids if not only or test in only), also


def add_to_runs(view: View) -> tuple[Further, ...]:
    """Let the user add tests, CAE runs and predictions to those of the CAE model."""
    also, missing = _add_to_tests(view, ())
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


def settings_text(config: StudyConfig) -> str:
    """What stands for settings in the address."""
    return f"{_SETTINGS}{config.preset} {config.seed} {config.leave_out}"


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
            help="Of other bands the edges are drawn. Added predictions are by this approach.",
        )  # fmt: skip
    return leading(predictions, recommended)


def _choose_several(key: str, labels: Mapping[str, str], title: str, placeholder: str) -> list[str]:
    if len(st.session_state[key]) > _MOST:  # of a link, or one more: Streamlit would refuse them all
        st.session_state[key] = st.session_state[key][-_MOST:]
    return kept_choice(
        key, list(labels), st.multiselect, title, format_func=labels.__getitem__, max_selections=_MOST,
        placeholder=placeholder, filter_mode="contains", select_all=False,
    )  # fmt: skip


def _add_to_tests(view: View, tests: Collection[str]) -> tuple[tuple[Further, ...], list[str]]:
    with st.popover("Add curves", icon=":material/stacked_line_chart:"):  # closed, a thousand runs cost nothing
        return _add(Subject.held_out(view, among_tests=True), usual_approach(), tests)


def _add(subject: Subject, approach: str, shown: Collection[str]) -> tuple[tuple[Further, ...], list[str]]:
    """Let the user add curves but for tests that are ``shown`` anyway; second are sentences on what is not there."""
    view, pins, settings = subject.view, pinned(), subject.names(approach)
    campaign = view.campaign
    pin_names = {f"{_PIN}{text}": prediction_name(approach, pin, view.display) for text, pin in pins.items()}
    offered = {
        **{t.id: pulse_name(t.id, t.condition, view.display) for t in campaign.tests if t.id not in shown},
        **settings,
        **(pin_names if subject.test else {}),
        **_offered_runs(campaign.fingerprint, view.display, campaign),
    }
    also = _choose_several("also", offered, "Also show", "tests, CAE runs, other settings")
    if not subject.test:
        also += [name for name in pin_names if name != f"{_PIN}{subject.condition.text}"]
    wanted = [pins[name.removeprefix(_PIN)] for name in also if name in pin_names]
    found = (predicted(campaign, chosen_config(), condition) for condition in wanted)
    at_pins = by_one(approach, [prediction for prediction in found if prediction is not None])
    missing = _unknown("also", {*campaign.test_ids, *offered})
    if wanted and not at_pins:
        missing.append("Pinned predictions are shown once the page Predict has an answer with these settings.")
    if wrong := [text for text in _asked() if _settings_of(text, subject.shown) is None]:
        texts = " or ".join(text.removeprefix(_SETTINGS)[:80] for text in wrong)
        missing.append(f"Not shown: {plain(texts)}. There are no such settings.")
    pulses = [name for name in also if name not in pin_names and name not in settings]
    return (*pulses, *subject.predictions(approach), *at_pins), missing


def _unknown(key: str, known: Collection[str]) -> list[str]:
    wanted = [name for name in st.session_state[key] if not name.startswith((_PIN, _SETTINGS))]
    missing = ", ".join(name.removeprefix(RUN)[:80] for name in wanted if name not in known)
    return [f"Not among the tests in use and the CAE runs: {plain(missing)}."] if missing else []


def _show_missing(sentences: Sequence[str]) -> None:
    """Say beside a figure what it cannot show: folded away, nobody would know that it lacks what a link asks for."""
    for sentence in sentences:
        st.caption(sentence, width="content")


def _add_nearest(subject: Subject) -> None:
    others = subject.view.campaign.without([subject.test] if subject.test else [])
    near = [test.id for test in nearest_tests(others, subject.condition, _NEAREST)]
    st.session_state["also"] = list(dict.fromkeys([*st.session_state["also"], *near]))[:_MOST]


def _asked() -> list[str]:
    return [name for name in st.session_state["also"] if name.startswith(_SETTINGS)]


def _settings_of(text: str, shown: StudyConfig) -> StudyConfig | None:
    """The settings that a text stands for, otherwise like those shown; None if a link has it from nowhere."""
    with suppress(ValueError):
        preset, seed, leave_out = text.removeprefix(_SETTINGS).split(" ", 2)
        if int(seed) in address.CHOICES["seed"].options and leave_out in LEFT_OUT:
            return StudyConfig.parse({**asdict(shown), "preset": preset, "seed": int(seed), "leave_out": leave_out})
    return None


@st.cache_resource(max_entries=8, show_spinner=False)
def _offered_runs(key: str, display: Display, _campaign: Campaign) -> Mapping[str, str]:  # noqa: ARG001
    """Labels of a campaign's thousands of CAE runs, made once for all sessions."""
    runs = zip(_campaign.cae.ids, _campaign.cae.conditions, strict=True)
    return {(name := f"{RUN}{run}"): pulse_name(name, at, display) for run, at in runs}


@st.cache_resource(max_entries=20, ttl=_LOOK_AGAIN_S, show_spinner=False)
def _known_of_test(
    key: Hashable, test_id: str, approach: str, shown: StudyConfig, among_tests: bool, _campaign: Campaign  # noqa: ARG001
) -> Sequence[StudyConfig]:  # fmt: skip
    """Settings of past results with a prediction of a test; the key is of the data and of what was computed here."""
    if not among_tests:
        return earlier_settings(past_results(), _campaign, test_id, approach, shown, Cache())
    past = past_settings(past_results(), _campaign, test_id, approach, shown)
    return sorted(past, key=lambda config: (config.preset, config.seed, config.leave_out != "test"))  # usual one first


@st.cache_resource(max_entries=20, ttl=_LOOK_AGAIN_S, show_spinner=False)
def _known_at_conditions(key: Hashable, shown: StudyConfig, _campaign: Campaign) -> Sequence[StudyConfig]:  # noqa: ARG001
    """Other seeds and presets of past results, the usual seed, and the next one."""
    configs = [result.config for result in past_results() if result.fingerprint == _campaign.fingerprint]
    pairs = {(shown.preset, 0), *((config.preset, config.seed) for config in configs)}
    pairs.add((shown.preset, shown.seed + 1 if shown.seed < 2**32 - 1 else 0))
    others = sorted(pairs - {(shown.preset, shown.seed)})
    return [replace(shown, preset=preset, seed=seed) for preset, seed in others]


@st.cache_resource(max_entries=12, show_spinner=False)
def _estimate_of_test(
    key: Hashable, test_id: str, approach: str, config: StudyConfig, _campaign: Campaign  # noqa: ARG001
) -> Estimate | None:  # fmt: skip
    training, condition = config.training_campaign(_campaign, test_id), _campaign.test(test_id).condition
    return find_estimate(training, condition, approach, config, Cache())
