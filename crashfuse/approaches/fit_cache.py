"""Cache of fits: the same approach, settings and data are never fitted twice."""

import json
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from crashfuse.approaches.base import Approach, FittedState
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache, Code, Entry
from crashfuse.execution.run import Run

A = TypeVar("A", bound=Approach)

FITS = "fits"  # kind of their cache entries
_TEXT = "text"  # name of the array that holds everything else as JSON


def fitted(approach: A, campaign: Campaign, run: Run) -> tuple[A, float]:
    """Fit an approach, or restore it from the cache; also the duration of the fit in s."""
    campaign = _taught(approach, campaign)

    def learn() -> tuple[float, Mapping[str, npt.ArrayLike]]:
        start = time.perf_counter()
        approach.fit(campaign, run)
        seconds = time.perf_counter() - start
        learned = approach.learned()
        text = json.dumps({"values": learned.values, "seconds": seconds})
        return seconds, {**learned.arrays, _TEXT: np.array(text)}

    def restore(entry: Entry) -> float:
        text = json.loads(str(entry.pop(_TEXT)))
        approach.restore(campaign, FittedState(text["values"], entry), run)
        return float(text["seconds"])

    return approach, run.get_or_compute(FITS, _key(approach, campaign), learn, restore)


def is_cached(approach: Approach, campaign: Campaign) -> bool:
    """Whether :func:`fitted` would find this fit in the cache."""
    return Cache(campaign.cache_folder).is_cached(FITS, _key(approach, campaign))


def _taught(approach: Approach, campaign: Campaign) -> Campaign:
    """The campaign with what it may learn from: fits that past vehicles do not change are those without an archive."""
    return replace(campaign, prior=approach.taught_by(campaign.prior))


def _key(approach: Approach, campaign: Campaign) -> dict[str, object]:
    return {**settings(approach), "campaign": _taught(approach, campaign).fingerprint}


def settings(approach: Approach) -> dict[str, object]:
    """All that determines an approach's numbers besides the data."""
    return {
        "code": Code(type(approach).__module__),
        "approach": approach.name,
        "config": getattr(approach, "config", None),
        "seed": getattr(approach, "seed", 0),
        "device": approach.device,
    }
