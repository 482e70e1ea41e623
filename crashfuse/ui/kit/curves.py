"""Curves of a figure of pulses: a prediction with its band, and what is chosen beside it."""

from collections.abc import Hashable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from crashfuse.approaches.neighbours import nearest_tests
from crashfuse.approaches.registry import BASELINE, LABELS, by_preference, uses_preset
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache
from crashfuse.reporting import figures
from crashfuse.reporting.plots.curves import TEST
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.predicted import PredictedPulse, by_one
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, find_estimate
from crashfuse.study.history import earlier_settings, past_results
from crashfuse.study.outliers import departures_near
from crashfuse.study.recommendation import Recommendation
from crashfuse.ui.kit import address
from crashfuse.ui.kit.address import chosen_config, kept_choice, pinned
from crashfuse.ui.kit.campaigns import HASHED, View
from crashfuse.ui.kit.computation import Request, answers, fit_request, jobs, study_request
from crashfuse.ui.kit.progress import patience, result_or_none
from crashfuse.ui.kit.text import plain
from crashfuse.units import read_out

REPRESENTATIVE = "representative"  # stands among the curves for a pulse that looks like a test
_NEAREST = 3
_NEAREST_HELP = f"The {_NEAREST} nearest tests by speed and mass, and any that stands apart near the condition."
_MOST = 24  # added curves: with the test and the approaches some thirty
_PIN, _SETTINGS = "at:", "by:"  # begin what stands for them in the address: no id of a test has a colon in it
_LOOK_AGAIN_S = 60.0  # the command line may have computed more


@dataclass(frozen=True, eq=False)
class Shown:
    """What a figure shows."""

    approach: str  # whose prediction and band it shows; added predictions are by it, too
    others: tuple[str, ...]  # further approaches, the held-out test, the representative pulse
    also: tuple[figures.Further, ...]

    @property
    def approaches(self) -> tuple[str, ...]:
        """By which approaches its predictions are."""
        return (*(name for name in self.others if name in LABELS), self.approach)

    @property
    def key(self) -> Hashable:
        """Equal for equal choices: part of the key of a cached figure."""
        return self.approach, self.others, tuple(curve if isinstance(curve, str) else curve.text for curve in self.also)

    @property
    def by(self) -> str:
        """By which approaches its predictions are, in words."""
        return read_out([LABELS[name] for name in self.approaches])

    def named(self, drawn: str) -> str:
        """A name of files: what is drawn, and which curves."""
        return " ".join([drawn, *map(_label, (self.approach, *self.others))])

    def of(self, test: str) -> str:
        """What it shows of a test, in words."""
        return f"{f'test {test} and its' if TEST in self.others else f'test {test},'} prediction by {self.by}"


@dataclass(frozen=True, eq=False)
class Subject:
    """What added predictions are of: a held-out test, or a condition."""

    view: View
    condition: Condition
    test: str = ""  # none at a condition

    @property
    def page(self) -> str:
        """The page that it is shown on, with which the keys of its choices begin."""
        return "compare" if self.test else "predict"

    @property
    def chosen_approach(self) -> str:
        """Key of the approach that was chosen there."""
        return "explained" if self.test else "predict_approach"

    @property
    def approach(self) -> str:
        """The approach that was chosen there."""
        return str(st.session_state[self.chosen_approach])

    @property
    def settings_asked(self) -> list[str]:
        """What stands for other settings among the curves that were added."""
        return [name for name in st.session_state[f"{self.page}_also"] if name.startswith(_SETTINGS)]

    @property
    def shown(self) -> StudyConfig:
        """The settings that names leave out: the chosen ones."""
        return chosen_config() if self.test else replace(chosen_config(), leave_out="test")

    @property
    def wanted(self) -> dict[StudyConfig, str]:
        """Other settings that were chosen, with what stands for them in the address."""
        wanted: dict[StudyConfig, str] = {}
        for text in self.settings_asked if not self.test or len(self.view.campaign.tests) > 1 else ():
            if (config := _settings_of(text, self.shown)) is not None:
                here = config if self.test else replace(config, leave_out="test")
                if self._is_other(here):
                    wanted.setdefault(here, text)
        return wanted

    def _is_other(self, config: StudyConfig) -> bool:
        acting = config if uses_preset(self.approach) else replace(config, preset=self.shown.preset)
        return acting == config != self.shown

    def names(self) -> dict[str, str]:
        """Names in the legend of the predictions that can be added, by what stands for them."""
        campaign = self.view.campaign
        if self.test:
            known = _known_of_test(jobs().ended, self.test, self.approach, self.shown, campaign)
        else:
            known = _known_at_conditions(jobs().ended, self.shown, campaign)
        others = filter(self._is_other, known)
        texts = {config: f"{_SETTINGS}{config.preset} {config.seed} {config.leave_out}" for config in others}
        return {
            text: figures.earlier_name(self.approach, config, self.shown)
            for config, text in (texts | self.wanted).items()
        }

    def predictions(self) -> tuple[figures.EarlierPrediction, ...]:
        """Those that were chosen and are there."""
        found = ((config, self._estimate(config)) for config in self.wanted)
        return tuple(figures.EarlierPrediction(own, config, self.shown) for config, own in found if own is not None)

    def offer(self) -> None:
        """Offer to predict with settings that were chosen, or show how far that is."""
        for config in self.wanted:
            if self._estimate(config) is None:
                words = figures.otherwise(config, self.shown)
                of = plain(self.test) if self.test else "this condition"
                then = patience(config, "This takes a minute or two.")
                lacking = f"The prediction of {of} with {words} is not there (any more)."
                button = " ".join(["Predict", *([self.test] if self.test else []), "with", words])
                result_or_none(self._request(config), invitation=f"{lacking} {then}", button=button)

    def _request(self, config: StudyConfig) -> Request[Any]:
        campaign = self.view.campaign
        return study_request(campaign, (self.test,), config) if self.test else fit_request(campaign, config)

    def _estimate(self, config: StudyConfig) -> Estimate | None:
        campaign, approach, estimates = self.view.campaign, self.approach, None
        if not self.test:
            prediction = predicted(campaign, config, self.condition)
            estimates = None if prediction is None else prediction.estimates
        elif (study := study_request(campaign, (self.test,), config).result) is not None:
            estimates = study.fold(self.test).estimates
        else:  # a study by fewer approaches may have left this one
            return _estimate_of_test(jobs().ended, self.test, approach, config, campaign)
        return next((estimate for estimate in estimates or () if estimate.approach == approach), None)


def predicted(campaign: Campaign, config: StudyConfig, condition: Condition) -> PredictedPulse | None:
    """What is predicted at a condition from all tests with some settings, if it is ready."""
    request = fit_request(campaign, config)
    if (fitted := request.result) is None:
        return None
    return PredictedPulse(campaign, tuple(answers(request.key, condition, fitted)), config)


def choose_approach(subject: Subject, known: Sequence[str], advice: Recommendation | None) -> None:
    """Let the user choose an approach, at first the recommended one."""
    usual = by_preference(known)[0] if advice is None else advice.approach
    address.default(subject.chosen_approach, usual, known)
    st.selectbox(
        "Approach", known, format_func=lambda name: f"By {LABELS[name]}", key=subject.chosen_approach,
        width=230, persist_state="session", label_visibility="collapsed", on_change=address.publish,
    )  # fmt: skip


def choose_curves(subject: Subject, known: Sequence[str]) -> Shown:
    """Let the user choose what a figure shows beside the prediction."""
    approach = subject.approach
    others = [name for name in known if name != approach]
    offered = [TEST, *others] if subject.test else [*others, REPRESENTATIVE]
    key = f"{subject.page}_curves"
    address.default(key, [TEST, BASELINE] if subject.test else [] if pinned() else [BASELINE])
    with st.popover("Curves", icon=":material/stacked_line_chart:"):
        chosen = kept_choice(
            key, offered, st.pills, "Beside the prediction", selection_mode="multi", width="content",
            format_func=_label, help="Stays on this page, and is in the link.",
        )  # fmt: skip
        also, missing = _add(subject)
    if st.toggle("Nearest tests", key=f"{subject.page}_nearest", persist_state="session", help=_NEAREST_HELP):
        also = (*also, *(test for test in _nearest(subject) if test not in also))
    if subject.test and any(isinstance(curve, PredictedPulse) for curve in also):
        missing.append(f"Pinned predictions learned from {plain(subject.test)}, too.")
    for sentence in missing:  # folded away, nobody would know that the figure lacks what a link asks for
        st.caption(sentence, width="content")
    return Shown(approach, tuple(name for name in offered if name in chosen), also)


def without_clicks(figure: go.Figure) -> go.Figure:
    """The same, with a legend that takes no clicks: what they hide would come back."""
    return figure.update_layout(legend={"itemclick": False, "itemdoubleclick": False})


def _label(curve: str) -> str:
    return {TEST: "Test", REPRESENTATIVE: "Representative pulse", **LABELS}[curve]


def _add(subject: Subject) -> tuple[tuple[figures.Further, ...], list[str]]:
    view, approach, pins, key = subject.view, subject.approach, pinned(), f"{subject.page}_also"
    campaign, settings = view.campaign, subject.names()
    pin_names = {f"{_PIN}{text}": figures.prediction_name(approach, pin, view.display) for text, pin in pins.items()}
    offered = {
        **{t.id: figures.pulse_name(t.id, t.condition, view.display) for t in campaign.tests if t.id != subject.test},
        **settings,
        **(pin_names if subject.test else {}),
        **_offered_runs(view.display, campaign),
    }
    if len(st.session_state[key]) > _MOST:  # of a link, or one more: Streamlit would refuse them all
        st.session_state[key] = st.session_state[key][-_MOST:]
    also = kept_choice(
        key, list(offered), st.multiselect, "Also show", format_func=offered.__getitem__, max_selections=_MOST,
        placeholder="tests, CAE runs, other settings", filter_mode="contains", select_all=False,
    )  # fmt: skip
    if not subject.test:
        also += [name for name in pin_names if name != f"{_PIN}{subject.condition.text}"]
    wanted = [pins[name.removeprefix(_PIN)] for name in also if name in pin_names]
    found = (predicted(campaign, chosen_config(), condition) for condition in wanted)
    at_pins = by_one(approach, [prediction for prediction in found if prediction is not None])
    wanted_pulses = [name for name in st.session_state[key] if not name.startswith((_PIN, _SETTINGS))]
    unknown = [
        name.removeprefix(figures.RUN)[:80] for name in wanted_pulses if name not in {*campaign.test_ids, *offered}
    ]
    missing = [f"Not among the tests in use and the CAE runs: {plain(', '.join(unknown))}."] if unknown else []
    if wanted and not at_pins:
        missing.append("Pinned predictions are shown once Predict has an answer with these settings.")
    if wrong := [text for text in subject.settings_asked if _settings_of(text, subject.shown) is None]:
        texts = " or ".join(text.removeprefix(_SETTINGS)[:80] for text in wrong)
        missing.append(f"Not shown: {plain(texts)}. There are no such settings.")
    pulses = [name for name in also if name not in pin_names and name not in settings]
    return (*pulses, *subject.predictions(), *at_pins), missing


def _nearest(subject: Subject) -> Sequence[str]:
    others = subject.view.campaign.without([subject.test] if subject.test else [])
    apart = (departure.test for departure in departures_near(subject.view.campaign, subject.condition))
    near = dict.fromkeys([*(test.id for test in nearest_tests(others, subject.condition, _NEAREST)), *apart])
    return [test for test in near if test != subject.test]


def _settings_of(text: str, shown: StudyConfig) -> StudyConfig | None:
    with suppress(ValueError):
        preset, seed, leave_out = text.removeprefix(_SETTINGS).split(" ", 2)
        if int(seed) in address.CHOICES["seed"].options and leave_out in figures.LEFT_OUT:
            return StudyConfig.parse({**asdict(shown), "preset": preset, "seed": int(seed), "leave_out": leave_out})
    return None


@st.cache_resource(max_entries=8, show_spinner=False, hash_funcs=HASHED)
def _offered_runs(display: Display, campaign: Campaign) -> Mapping[str, str]:
    runs = zip(campaign.cae.ids, campaign.cae.conditions, strict=True)
    return {(name := f"{figures.RUN}{run}"): figures.pulse_name(name, at, display) for run, at in runs}


@st.cache_resource(max_entries=20, ttl=_LOOK_AGAIN_S, show_spinner=False, hash_funcs=HASHED)
def _known_of_test(
    ended: int, test_id: str, approach: str, shown: StudyConfig, campaign: Campaign  # noqa: ARG001 - part of the key
) -> Sequence[StudyConfig]:  # fmt: skip
    return earlier_settings(past_results(), campaign, test_id, approach, shown)


@st.cache_resource(max_entries=20, ttl=_LOOK_AGAIN_S, show_spinner=False, hash_funcs=HASHED)
def _known_at_conditions(ended: int, shown: StudyConfig, campaign: Campaign) -> Sequence[StudyConfig]:  # noqa: ARG001
    configs = [result.config for result in past_results() if result.fingerprint == campaign.fingerprint]
    pairs = {(shown.preset, seed) for seed in (0, (shown.seed + 1) % 2**32)}
    pairs |= {(config.preset, config.seed) for config in configs}
    others = sorted(pairs - {(shown.preset, shown.seed)})
    return [replace(shown, preset=preset, seed=seed) for preset, seed in others]


@st.cache_resource(max_entries=12, show_spinner=False, hash_funcs=HASHED)
def _estimate_of_test(
    ended: int, test_id: str, approach: str, config: StudyConfig, campaign: Campaign  # noqa: ARG001 - part of the key
) -> Estimate | None:  # fmt: skip
    training, condition = config.training_campaign(campaign, test_id), campaign.test(test_id).condition
    return find_estimate(training, condition, approach, config, Cache())
