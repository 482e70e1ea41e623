"""Predictions at a condition that are kept in the cache, with all that is told of them."""

import json
from functools import partial

import numpy as np

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.fit_cache import settings
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache, Entry, finite, numbers
from crashfuse.execution.code_digest import code_digest
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.signals.occupant import OccupantModel
from crashfuse.signals.pulse import N_SAMPLES
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit
from crashfuse.study.nearest import doubtful_tests
from crashfuse.wording import packed, unpacked

_KIND = "predictions"  # of cache entries
_LEFT_OUT, _ERRORS = "left out ", "error of "  # prefixes of a test's id, and of a metric, in the names of arrays there


def estimate_at(
    campaign: Campaign,
    condition: Condition,
    approach: str,
    config: StudyConfig = StudyConfig(),
    *,
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> Estimate:
    """Fit an approach to the whole campaign as given and predict at a condition; cached.

    Raises
    ------
    UsageError
        If there is no such approach or preset, or speed or a weight is not above 0.
    Cancelled
        If the watch was told to stop.
    """
    cache = cache or Cache()

    def compute() -> tuple[Estimate, Entry]:
        estimate = Fit.of(campaign, approach, config, cache=cache, watch=watch).estimate(condition)
        return estimate, _entry(estimate)

    restore = partial(_restored, condition, approach, campaign.occupant)
    return cache.get_or_compute(_KIND, _key(campaign, condition, approach, config), compute, restore, watch)


def find_estimate(
    campaign: Campaign, condition: Condition, approach: str, config: StudyConfig, cache: Cache
) -> Estimate | None:
    """The cached estimate for these settings and exactly this campaign (without the held-out test), or None."""
    return cache.find(
        _KIND, _key(campaign, condition, approach, config), partial(_restored, condition, approach, campaign.occupant)
    )


def is_estimate_cached(
    campaign: Campaign, condition: Condition, approach: str, config: StudyConfig, cache: Cache
) -> bool:
    """Whether :func:`find_estimate` would find an estimate, without reading it."""
    return cache.is_cached(_KIND, _key(campaign, condition, approach, config))


def store_estimate(estimate: Estimate, campaign: Campaign, config: StudyConfig, cache: Cache) -> None:
    """Store an estimate from this campaign, for :func:`find_estimate`."""
    cache.put(_KIND, _key(campaign, estimate.prediction.condition, estimate.approach, config), _entry(estimate))


def _entry(estimate: Estimate) -> Entry:
    prediction = estimate.prediction
    told = {"notes": [packed(note) for note in prediction.notes], "agreements": dict(estimate.agreements)}
    text = json.dumps({**told, "state": estimate.state, "seconds": estimate.seconds})
    entry = {"accel_mps2": prediction.accel_mps2, "text": np.array(text)}
    entry |= {f"{_LEFT_OUT}{test}": pulse for test, pulse in estimate.left_out_mps2.items()}
    entry |= {f"{_ERRORS}{metric}": errors for metric, errors in estimate.metric_errors.items()}
    if prediction.draws_mps2 is not None:
        entry["draws_mps2"] = prediction.draws_mps2
    return entry


def _restored(condition: Condition, approach: str, occupant: OccupantModel, entry: Entry) -> Estimate:
    text = json.loads(str(entry["text"]))
    draws = finite(entry, "draws_mps2", None, N_SAMPLES) if "draws_mps2" in entry else None
    notes = tuple(map(unpacked, text["notes"]))
    prediction = Prediction(condition, finite(entry, "accel_mps2", N_SAMPLES), draws, notes)
    left_out, errors = (
        {name.removeprefix(prefix): check(entry, name, length) for name in entry if name.startswith(prefix)}
        for prefix, check, length in ((_LEFT_OUT, finite, N_SAMPLES), (_ERRORS, numbers, None))
    )
    if not isinstance(text["state"], dict) or errors.keys() != METRIC_LABELS.keys():
        raise ValueError("no estimate")
    agreements = {test: float(value) for test, value in text["agreements"].items()}
    known = left_out, agreements, errors, occupant
    return Estimate(approach, prediction, text["state"], float(text["seconds"]), *known)


def _key(campaign: Campaign, condition: Condition, approach: str, config: StudyConfig) -> dict[str, object]:
    fit = settings(config.create(approach))
    key = {**fit, "campaign": campaign.fingerprint, "condition": condition, "code": code_digest(__name__)}
    doubts = doubtful_tests(campaign, condition)  # seen in the records, of which the campaign keeps what it learns from
    return {**key, "doubts": [str(doubt) for doubt in doubts]} if doubts else key
