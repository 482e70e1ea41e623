"""Predictions of the held-out test that were computed before, with other settings, to be put beside those shown."""

from collections.abc import Hashable, Mapping
from dataclasses import asdict

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.reporting.earlier_prediction import EarlierPrediction, otherwise
from crashfuse.study.config import StudyConfig
from crashfuse.study.earlier_settings import earlier_settings
from crashfuse.study.estimate import Estimate
from crashfuse.study.estimate_cache import find_estimate
from crashfuse.study.history import past_results
from crashfuse.ui.computation import chosen_config, jobs
from crashfuse.ui.text import plain

EARLIER = "by:"
"""Begins what stands for settings in the address: no id of a test has a colon in it."""
_LOOK_AGAIN_S = 60.0  # the command line may have computed more


def offered_earlier(campaign: Campaign, test_id: str, approach: str) -> Mapping[str, StudyConfig]:
    """Other settings with which an approach predicted a test before, by what stands for them in the address."""
    shown = chosen_config()
    return _offered((campaign.fingerprint, jobs().ended), test_id, approach, shown, campaign)


def chosen_earlier(campaign: Campaign, test_id: str, approach: str) -> list[EarlierPrediction]:
    """The predictions by those that were chosen; what was deleted meanwhile is left out."""
    offered = offered_earlier(campaign, test_id, approach)
    wanted = [offered[name] for name in st.session_state["also"] if name in offered]
    found = ((config, _estimate(campaign.fingerprint, test_id, approach, config, campaign)) for config in wanted)
    return [EarlierPrediction(estimate, config, chosen_config()) for config, estimate in found if estimate is not None]


def missing_earlier(offered: Mapping[str, StudyConfig], test_id: str) -> list[str]:
    """Sentence on settings that were chosen, for another test or by a link, with which this test was not predicted."""
    known = {*offered, settings_text(chosen_config())}
    asked = [name for name in st.session_state["also"] if name.startswith(EARLIER) and name not in known]
    if not asked:
        return []
    which = plain(" or with ".join(map(_in_words, asked)))
    return [f"{plain(test_id)} with {which} is not shown: it has not been predicted here yet, or comes out the same."]


def settings_text(config: StudyConfig) -> str:
    """What stands for settings in the address."""
    return f"{EARLIER}{config.preset} {config.seed} {config.leave_out}"


def _in_words(text: str) -> str:
    """In what the settings that a text stands for differ from those shown; the text if a link has it from nowhere."""
    shown = chosen_config()
    try:
        preset, seed, leave_out = text.removeprefix(EARLIER).split(" ", 2)
        values = {**asdict(shown), "preset": preset, "seed": int(seed), "leave_out": leave_out}
        return otherwise(StudyConfig.parse(values), shown)
    except (ValueError, KeyError):
        return text.removeprefix(EARLIER)[:80]


@st.cache_resource(max_entries=20, ttl=_LOOK_AGAIN_S, show_spinner=False)
def _offered(
    key: Hashable,  # noqa: ARG001 - of the data, and of what was computed here
    test_id: str,
    approach: str,
    shown: StudyConfig,
    _campaign: Campaign,
) -> Mapping[str, StudyConfig]:
    found = earlier_settings(past_results(), _campaign, test_id, approach, shown, Cache())
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
