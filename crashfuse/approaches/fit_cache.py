"""What was learned from some data with some settings is kept in the cache, and never learned again."""

import json
import time
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from crashfuse.approaches.base import Approach
from crashfuse.approaches.fitted_state import FittedState
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch

A = TypeVar("A", bound=Approach)

_KIND = "fits"  # of entries in the cache


def fitted(approach: A, campaign: Campaign, cache: Cache | None, watch: Watch = SILENT) -> tuple[A, float]:
    """Fit an approach, or take from the cache what one like it learned from this campaign.

    Parameters
    ----------
    approach : Approach
        Unfitted.
    campaign : Campaign
    cache : Cache, optional
    watch : Watch

    Returns
    -------
    Approach
        The same one.
    seconds : float
        What the learning took, then or now.

    Raises
    ------
    UsageError
        If there is not enough to learn from.
    Cancelled
        If the watch was told to stop.
    """
    if cache is None:
        return approach, _learn(approach, campaign, watch)
    key = _key(approach, campaign)
    seconds = _restore(approach, campaign, cache, key)
    if seconds is None:
        with cache.alone(_KIND, key, watch):
            seconds = _restore(approach, campaign, cache, key)  # another process may have come first
            if seconds is None:
                seconds = _learn(approach, campaign, watch)
                learned = approach.learned()
                text = json.dumps({"values": learned.values, "seconds": seconds})
                cache.put(_KIND, key, {**learned.arrays, "text": np.array(text)})
    return approach, seconds


def is_kept(approach: Approach, campaign: Campaign, cache: Cache) -> bool:
    """Whether :func:`fitted` would find in the cache what was learned from this campaign."""
    return cache.path(_KIND, _key(approach, campaign)).is_file()


def _key(approach: Approach, campaign: Campaign) -> dict[str, object]:
    return {**settings(approach), "campaign": campaign.fingerprint}


def _learn(approach: Approach, campaign: Campaign, watch: Watch) -> float:
    """Fit it; returns the seconds that took."""
    start = time.perf_counter()
    approach.fit(campaign, watch)
    return time.perf_counter() - start


def _restore(approach: Approach, campaign: Campaign, cache: Cache, key: Mapping[str, object]) -> float | None:
    """Take up what is kept; returns the seconds that took when it was learned, or None if nothing is kept."""
    entry = cache.get(_KIND, key)
    if entry is None:
        return None
    text = json.loads(str(entry.pop("text")))
    approach.restore(campaign, FittedState(text["values"], entry))
    return float(text["seconds"])


def settings(approach: Approach) -> dict[str, object]:
    """All that decides an approach's numbers, beside the data."""
    return {
        "approach": approach.name,
        "config": getattr(approach, "config", None),
        "seed": getattr(approach, "seed", 0),
        "device": approach.device,
    }
