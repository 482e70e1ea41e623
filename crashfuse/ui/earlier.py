"""Predictions with other settings, to be put beside those shown: of a held-out test, as computed before.

What is chosen stands in the address as settings alone, of whatever a figure is: on Compare and Data of the held-out
test, on Predict of the condition (``other_seeds``).
"""

from collections.abc import Hashable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.reporting.earlier_prediction import LEFT_OUT, EarlierPrediction, earlier_name, otherwise
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, find_estimate
from crashfuse.study.history import earlier_settings, past_results, past_settings
from crashfuse.ui import address, explanations
from crashfuse.ui.computation import StudyRequest, chosen_config, jobs
from crashfuse.ui.panel import result_or_none
from crashfuse.ui.text import plain

EARLIER = "by:"
"""Begins what stands for settings in the address: no id of a test has a colon in it."""
LOOK_AGAIN_S = 60.0
"""The command line may have computed more."""


@dataclass(frozen=True)
class Earlier:
    """What a figure offers of predictions with other settings.

    Attributes
    ----------
    names : mapping of str to str
        Their names in the legend, by what stands for them in the address.
    chosen : tuple of EarlierPrediction
        Those that were chosen and are there.
    missing : tuple of str
        Sentences on what was chosen, for another test or by a link, and cannot be shown.
    """

    names: Mapping[str, str]
    chosen: tuple[EarlierPrediction, ...] = ()
    missing: tuple[str, ...] = ()


def earlier_of_test(campaign: Campaign, test_id: str, approach: str, *, among_tests: bool = False) -> Earlier:
    """An approach's predictions of a held-out test that were computed before.

    They are put beside that with the chosen settings; in a figure ``among_tests``, which shows none, one with the usual
    settings is offered, too, and each is named after its test. There they are not looked up before they are chosen.
    """
    shown, of = _shown(among_tests=among_tests), test_id if among_tests else ""
    key, requests = (campaign.fingerprint, jobs().ended), _requests(campaign, test_id, shown)
    offered = dict(_offered(key, test_id, approach, shown, among_tests, campaign))
    if among_tests:
        offered |= {name: request.config for name, request in requests.items()}
    found = {
        name: EarlierPrediction(estimate, offered[name], shown, of)
        for name in asked()
        if name in offered and (estimate := _estimate(key, test_id, approach, offered[name], campaign)) is not None
    }
    to_predict = {name for name, request in requests.items() if request.result is None}
    known = {*found, *to_predict, *([] if among_tests else [settings_text(shown)])}
    missing = plain(" or with ".join(_in_words(name, shown) for name in asked() if name not in known))
    alone = "there is no other test to learn from." if len(campaign.tests) == 1 else ""
    why = f"is not shown: {alone or 'it comes out the same, or there are no such settings.'}"
    return Earlier(
        {name: earlier_name(approach, config, shown, of) for name, config in offered.items()},
        tuple(found.values()),
        (f"{plain(test_id)} with {missing} {why}",) if missing else (),
    )


def show_missing(campaign: Campaign, test_id: str, approach: str, *, among_tests: bool = False) -> None:
    """Offer what a figure lacks: to predict a test with settings that were chosen, by a link perhaps."""
    shown = _shown(among_tests=among_tests)
    there = {own.config for own in earlier_of_test(campaign, test_id, approach, among_tests=among_tests).chosen}
    for name, request in _requests(campaign, test_id, shown).items():
        words = f"{plain(test_id)} with {_in_words(name, shown)}"
        if request.config not in there and (among_tests or request.config != shown):
            result_or_none(
                request,
                invitation=f"The prediction of {words} is not there yet, or is no longer kept. "
                + explanations.patience(request.config, "It takes a minute or two; then it stands beside the others."),
                button=f"Predict {words}",
            )


def _shown(*, among_tests: bool) -> StudyConfig:
    """The settings that names leave out: the chosen ones, or the usual ones where no prediction is shown by itself."""
    chosen = chosen_config()
    return StudyConfig(chosen.approaches, device=chosen.device) if among_tests else chosen


def _requests(campaign: Campaign, test_id: str, shown: StudyConfig) -> Mapping[str, StudyRequest]:
    """What computes the predictions that were chosen, by what stands for their settings in the address."""
    found = {}
    for name in asked() if len(campaign.tests) > 1 else ():
        with suppress(ValueError):  # a link has it from nowhere
            found[name] = StudyRequest(campaign, (test_id,), settings_of(name, shown))
    return found


def asked() -> list[str]:
    """What was chosen to be put beside, as far as it stands for settings."""
    return [name for name in st.session_state["also"] if name.startswith(EARLIER)]


def settings_text(config: StudyConfig) -> str:
    """What stands for settings in the address."""
    return f"{EARLIER}{config.preset} {config.seed} {config.leave_out}"


def settings_of(text: str, shown: StudyConfig) -> StudyConfig:
    """The settings that a text stands for, otherwise like those shown.

    Raises
    ------
    ValueError
        If a link has it from nowhere.
    """
    preset, seed, leave_out = text.removeprefix(EARLIER).split(" ", 2)
    if int(seed) not in address.CHOICES["seed"].options or leave_out not in LEFT_OUT:
        raise ValueError("no settings of a prediction of one test")
    return StudyConfig.parse({**asdict(shown), "preset": preset, "seed": int(seed), "leave_out": leave_out})


def _in_words(text: str, shown: StudyConfig) -> str:
    """In what the settings that a text stands for differ from those shown; the text if it stands for none."""
    try:
        return otherwise(settings_of(text, shown), shown) or "the usual settings"
    except ValueError:
        return text.removeprefix(EARLIER)[:80]


@st.cache_resource(max_entries=20, ttl=LOOK_AGAIN_S, show_spinner=False)
def _offered(
    key: Hashable,  # noqa: ARG001 - of the data, and of what was computed here
    test_id: str,
    approach: str,
    shown: StudyConfig,
    among_tests: bool,
    _campaign: Campaign,
) -> Mapping[str, StudyConfig]:
    if among_tests:
        found = past_settings(past_results(), _campaign, test_id, approach, shown)
        found.sort(key=lambda config: (config.preset, config.seed, config.leave_out != "test"))  # the usual one first
    else:
        found = earlier_settings(past_results(), _campaign, test_id, approach, shown, Cache())
    return {settings_text(config): config for config in found}


@st.cache_resource(max_entries=12, show_spinner=False)
def _estimate(
    key: Hashable,  # noqa: ARG001 - as there: what is not there may be computed
    test_id: str,
    approach: str,
    config: StudyConfig,
    _campaign: Campaign,
) -> Estimate | None:
    training, condition = config.training_campaign(_campaign, test_id), _campaign.test(test_id).condition
    return find_estimate(training, condition, approach, config, Cache())
