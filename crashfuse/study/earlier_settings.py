"""With which other settings a held-out test was predicted before, as far as the predictions are still in the cache."""

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
    same = [own for own in results if own.fingerprint == campaign.fingerprint and test_id in own.tests]
    if not same:  # an approach with networks is not imported for nothing
        return []
    condition, found = campaign.test(test_id).condition, {_identity(campaign, test_id, approach, shown): shown}
    for result in same:
        for way in result.config.split_configs:
            config = replace(shown, preset=way.preset, seed=way.seed, leave_out=way.leave_out)
            training = config.training_campaign(campaign, test_id)
            if is_estimate_cached(training, condition, approach, config, cache):
                found.setdefault(_identity(campaign, test_id, approach, config), config)
    return list(found.values())[1:]


def _identity(campaign: Campaign, test_id: str, approach: str, config: StudyConfig) -> str:
    """Equal for equal predictions."""
    return repr((settings(config.create(approach)), config.left_out(campaign, test_id)))
