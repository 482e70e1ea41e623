"""What an approach expects at a condition, once it has learned from a campaign; both are kept in the cache."""

import json
import time
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from crashfuse.approaches import Approach, Prediction
from crashfuse.approaches.kept import fitted, settings
from crashfuse.cache import Cache
from crashfuse.campaign import Campaign
from crashfuse.config import StudyConfig
from crashfuse.errors import UsageError
from crashfuse.metrics import Metric, pulse_metrics
from crashfuse.progress import SILENT, Watch
from crashfuse.pulse import DT_S, Condition

_KIND = "predictions"  # of entries in the cache


@dataclass(frozen=True, eq=False)
class Estimate:
    """An approach's prediction at one condition, with what its fit found and how long both took."""

    approach: str
    prediction: Prediction
    state: dict[str, object]
    seconds: float

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """Pulse metrics of the prediction, with intervals where it has draws."""
        p = self.prediction
        return pulse_metrics(p.accel_mps2, p.condition.speed_mps, dt_s=DT_S, draws_mps2=p.draws_mps2)


@dataclass(frozen=True, eq=False)
class Fit:
    """An approach that has learned from a campaign and answers any condition, and how long the learning took."""

    approach: Approach
    config: StudyConfig
    seconds: float

    @classmethod
    def of(
        cls,
        campaign: Campaign,
        approach: str,
        config: StudyConfig = StudyConfig(),
        *,
        cache: Cache | None = None,
        watch: Watch = SILENT,
    ) -> Self:
        """Fit an approach on the whole campaign that is handed over, or take from the cache what was learned from it.

        Raises
        ------
        UsageError
            If there is no such approach, preset or device, or not enough to learn from.
        Cancelled
            If the watch was told to stop.
        """
        cache = cache or Cache()
        learned, seconds = fitted(config.create(approach, cache), campaign, cache, watch)
        return cls(learned, config, seconds)

    def estimate(self, condition: Condition) -> Estimate:
        """What the approach expects at a condition, with numbers as they are kept.

        Raises
        ------
        UsageError
            If the speed or a weight is not above 0.
        """
        if not (np.isfinite(condition.vector).all() and (condition.vector > 0).all()):
            raise UsageError(f"A prediction takes a speed and weights above 0, not {condition}.")
        start = time.perf_counter()
        prediction = self.approach.predict(condition)
        if prediction.draws_mps2 is not None:
            prediction = replace(prediction, draws_mps2=prediction.draws_mps2.astype(np.float32))
        seconds = self.seconds + time.perf_counter() - start
        return Estimate(self.approach.name, prediction, self.approach.state, seconds)


def estimate_at(
    campaign: Campaign,
    condition: Condition,
    approach: str,
    config: StudyConfig = StudyConfig(),
    *,
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> Estimate:
    """Fit an approach on the whole campaign that is handed over and predict at a condition; kept in the cache.

    Raises
    ------
    UsageError
        If there is no such approach or preset, or speed or a weight is not above 0.
    Cancelled
        If the watch was told to stop.
    """
    cache = cache or Cache()
    kept = find_estimate(campaign, condition, approach, config, cache=cache)
    if kept is not None:
        return kept
    estimate = Fit.of(campaign, approach, config, cache=cache, watch=watch).estimate(condition)
    prediction = estimate.prediction
    text = json.dumps({"notes": prediction.notes, "state": estimate.state, "seconds": estimate.seconds})
    arrays = {"accel_mps2": prediction.accel_mps2, "text": np.array(text)}
    if prediction.draws_mps2 is not None:
        arrays["draws_mps2"] = prediction.draws_mps2
    cache.put(_KIND, _key(campaign, condition, approach, config), arrays)
    return estimate


def find_estimate(
    campaign: Campaign,
    condition: Condition,
    approach: str,
    config: StudyConfig = StudyConfig(),
    *,
    cache: Cache | None = None,
) -> Estimate | None:
    """What :func:`estimate_at` computed from this very data with these settings before, or None.

    The campaign is the one that was handed over there: without the held-out test.
    """
    entry = (cache or Cache()).get(_KIND, _key(campaign, condition, approach, config))
    if entry is None:
        return None
    text = json.loads(str(entry["text"]))
    prediction = Prediction(condition, entry["accel_mps2"], entry.get("draws_mps2"), tuple(text["notes"]))
    return Estimate(approach, prediction, text["state"], text["seconds"])


def _key(campaign: Campaign, condition: Condition, approach: str, config: StudyConfig) -> dict[str, object]:
    return {**settings(config.create(approach)), "campaign": campaign.fingerprint, "condition": condition}
