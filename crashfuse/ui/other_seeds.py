"""On Predict: the same condition by other seeds and presets, to see whether they say the same.

Those that were fitted on all tests before are offered, and the next seed, which a click predicts.
"""

from collections.abc import Hashable, Sequence
from contextlib import suppress
from dataclasses import replace

import streamlit as st

from crashfuse.approaches.settings import PRESETS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError
from crashfuse.reporting.earlier_prediction import EarlierPrediction, earlier_name, otherwise
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.study.config import StudyConfig
from crashfuse.study.history import past_results
from crashfuse.ui import explanations
from crashfuse.ui.computation import FitRequest, answers, chosen_config, jobs
from crashfuse.ui.earlier import LOOK_AGAIN_S, Earlier, asked, settings_of, settings_text
from crashfuse.ui.panel import result_or_none


def other_seeds(campaign: Campaign, condition: Condition, approach: str) -> Earlier:
    """An approach's predictions at a condition that a figure can show beside that with the chosen settings."""
    shown, wanted = _shown(), _wanted()
    known = _known((campaign.fingerprint, jobs().ended), shown, campaign)
    offered = {config: settings_text(config) for config in known} | wanted
    return Earlier(
        {name: earlier_name(approach, config, shown) for config, name in offered.items()},
        tuple(
            EarlierPrediction(estimate, own.config, shown)
            for own in predicted(campaign, condition)
            for estimate in own.estimates
            if estimate.approach == approach
        ),
    )


def predicted(campaign: Campaign, condition: Condition) -> list[PredictedPulse]:
    """What every approach predicts at a condition by the seeds and presets that were chosen, once they are ready."""
    found = []
    for config in _wanted():
        request = FitRequest(campaign, config)
        if (fitted := request.result) is not None:
            found.append(PredictedPulse(campaign, tuple(answers(request.key, condition, fitted)), config))
    return found


def show_missing(campaign: Campaign) -> None:
    """Offer to predict by those that were chosen and are not ready, or show how far they are."""
    for config in _wanted():
        words = otherwise(config, _shown())
        result_or_none(
            FitRequest(campaign, config),
            invitation=f"Nothing was predicted with {words} yet. "
            + explanations.patience(config, "This takes a minute or two; then it stands beside the others."),
            button=f"Predict with {words}",
        )


def _shown() -> StudyConfig:
    """The chosen settings, without how tests are left out: here none is."""
    return replace(chosen_config(), leave_out="test")


def _wanted() -> dict[StudyConfig, str]:
    """Settings that were chosen, by what stands for them in the address: what is left out means nothing here."""
    shown = _shown()
    found: dict[StudyConfig, str] = {}
    for text in asked():
        with suppress(ValueError):  # a link has it from nowhere
            config = replace(settings_of(text, shown), leave_out=shown.leave_out)
            if config != shown:
                found.setdefault(config, text)
    return found


@st.cache_resource(max_entries=20, ttl=LOOK_AGAIN_S, show_spinner=False)
def _known(
    key: Hashable,  # noqa: ARG001 - of the data, and of what was computed here
    shown: StudyConfig,
    _campaign: Campaign,
) -> Sequence[StudyConfig]:
    """Other settings with which all approaches were fitted on all tests, and the next seed."""
    following = replace(shown, seed=shown.seed + 1 if shown.seed < 2**32 - 1 else 0)
    past = [(own.config.preset, own.config.seed) for own in past_results() if own.fingerprint == _campaign.fingerprint]
    usual = [(preset, seed) for preset in PRESETS for seed in (0, shown.seed, following.seed)]
    tried = [replace(shown, preset=preset, seed=seed) for preset, seed in sorted({*past, *usual})]
    return [own for own in tried if own != shown and (own == following or _is_fitted(_campaign, own))]


def _is_fitted(campaign: Campaign, config: StudyConfig) -> bool:
    with suppress(CrashfuseError):  # no such approach with these settings here
        return FitRequest(campaign, config).in_cache()
    return False
