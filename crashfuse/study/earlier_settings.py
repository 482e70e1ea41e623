"""With which other settings a held-out test was predicted before, and of which the cache still has the predictions."""

from collections.abc import Iterable
from dataclasses import replace

from crashfuse.approaches.fit_cache import settings
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate_cache import is_estimate_cached
from crashfuse.study.history import PastResult


def earlier_settings(
    results: Iterable[PastResult], campaign: Campaign, test_id: str, approach: str, shown: StudyConfig, cache: Cache
) -> list[StudyConfig]:
    """Settings of past results with another prediction of a test by an approach than those that are shown.

    They differ in preset, seed or what was left out with the test; where an approach takes no notice of that, as the
    raw CAE model of seeds, it is the same prediction.
    """
    condition, found = campaign.test(test_id).condition, {_identity(campaign, test_id, approach, shown): shown}
    for config in past_settings(results, campaign, test_id, approach, shown):
        training = config.training_campaign(campaign, test_id)
        if is_estimate_cached(training, condition, approach, config, cache):
            found.setdefault(_identity(campaign, test_id, approach, config), config)
    return list(found.values())[1:]


def past_settings(
    results: Iterable[PastResult], campaign: Campaign, test_id: str, approach: str, shown: StudyConfig
) -> list[StudyConfig]:
    """Settings of past results with a prediction of a test by an approach, otherwise like those that are shown.

    Whether the predictions are still in the cache is not looked up: that takes seconds where networks have to be
    imported.
    """
    ways = (
        way
        for result in results
        if result.fingerprint == campaign.fingerprint
        and test_id in result.tests
        and approach in result.config.approaches
        for way in result.config.split_configs
    )
    found = (replace(shown, preset=way.preset, seed=way.seed, leave_out=way.leave_out) for way in ways)
    return list(dict.fromkeys(found))


def _identity(campaign: Campaign, test_id: str, approach: str, config: StudyConfig) -> str:
    """Equal for equal predictions."""
    return repr((settings(config.create(approach)), config.left_out(campaign, test_id)))
