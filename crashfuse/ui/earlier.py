"""Predictions with other settings, to be put beside those shown: of a held-out test, as computed before.

What is chosen stands in the address as settings alone, of whatever a figure is: on Compare and Data of the held-out
test, on Predict of the condition (``other_seeds``).
"""

from collections.abc import Hashable, Mapping
from dataclasses import asdict, dataclass

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.reporting.earlier_prediction import EarlierPrediction, earlier_name, otherwise
from crashfuse.study.config import StudyConfig
from crashfuse.study.earlier_settings import earlier_settings
from crashfuse.study.estimate import Estimate
from crashfuse.study.estimate_cache import find_estimate, is_estimate_cached
from crashfuse.study.history import past_results
from crashfuse.ui.computation import chosen_config, jobs
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
        Those that were chosen; what was deleted meanwhile is left out.
    missing : tuple of str
        Sentences on what was chosen, for another test or by a link, and cannot be shown.
    """

    names: Mapping[str, str]
    chosen: tuple[EarlierPrediction, ...] = ()
    missing: tuple[str, ...] = ()


def earlier_of_test(campaign: Campaign, test_id: str, approach: str, *, among_tests: bool = False) -> Earlier:
    """An approach's predictions of a held-out test that were computed before.

    They are put beside that with the chosen settings; in a figure ``among_tests``, which shows none, one with the usual
    settings is offered, too, and each is named after its test.
    """
    chosen = chosen_config()
    shown = StudyConfig(chosen.approaches, device=chosen.device) if among_tests else chosen
    of = test_id if among_tests else ""
    offered = _offered((campaign.fingerprint, jobs().ended), test_id, approach, shown, among_tests, campaign)
    wanted = {name: offered[name] for name in asked() if name in offered}
    found = (
        (config, _estimate(campaign.fingerprint, test_id, approach, config, campaign)) for config in wanted.values()
    )
    known = {*offered, *([] if among_tests else [settings_text(shown)])}
    missing = plain(" or with ".join(_in_words(name, shown) for name in asked() if name not in known))
    why = "is not shown: it has not been predicted here yet, or comes out the same."
    return Earlier(
        {name: earlier_name(approach, config, shown, of) for name, config in offered.items()},
        tuple(EarlierPrediction(own, config, shown, of) for config, own in found if own is not None),
        (f"{plain(test_id)} with {missing} {why}",) if missing else (),
    )


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
    return StudyConfig.parse({**asdict(shown), "preset": preset, "seed": int(seed), "leave_out": leave_out})


def _in_words(text: str, shown: StudyConfig) -> str:
    """In what the settings that a text stands for differ from those shown; the text if it stands for none."""
    try:
        return otherwise(settings_of(text, shown), shown) or "the usual settings"
    except (ValueError, KeyError):
        return text.removeprefix(EARLIER)[:80]


@st.cache_resource(max_entries=20, ttl=LOOK_AGAIN_S, show_spinner=False)
def _offered(
    key: Hashable,  # noqa: ARG001 - of the data, and of what was computed here
    test_id: str,
    approach: str,
    shown: StudyConfig,
    itself: bool,
    _campaign: Campaign,
) -> Mapping[str, StudyConfig]:
    """Settings by what stands for them; those shown, too, if ``itself`` and they were computed."""
    found, cache = earlier_settings(past_results(), _campaign, test_id, approach, shown, Cache()), Cache()
    training, condition = shown.training_campaign(_campaign, test_id), _campaign.test(test_id).condition
    if itself and is_estimate_cached(training, condition, approach, shown, cache):
        found = [shown, *found]
    return {settings_text(config): config for config in found}


@st.cache_resource(max_entries=12, show_spinner=False)
def _estimate(
    fingerprint: str,  # noqa: ARG001 - of the campaign
    test_id: str,
    approach: str,
    config: StudyConfig,
    _campaign: Campaign,
) -> Estimate | None:
    training, condition = config.training_campaign(_campaign, test_id), _campaign.test(test_id).condition
    return find_estimate(training, condition, approach, config, Cache())
