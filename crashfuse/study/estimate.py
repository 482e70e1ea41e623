"""Fits of approaches to a campaign and their predictions at a condition, both kept in the cache."""

import json
import time
from collections.abc import Hashable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Self

import numpy as np

from crashfuse.approaches import metric_calibration as calibration
from crashfuse.approaches.base import Approach, Prediction
from crashfuse.approaches.metric_calibration import Errors
from crashfuse.approaches.neighbours import doubtful_tests
from crashfuse.approaches.registry import blamed_on
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError, require_a
from crashfuse.execution.cache import Cache, Code, Entry, finite, numbers
from crashfuse.execution.run import Run, one_thread
from crashfuse.signals.metrics import METRIC_LABELS, Metric
from crashfuse.signals.occupant import USUAL_OCCUPANT, OccupantModel
from crashfuse.signals.pulse import N_SAMPLES, FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.facts import doubt_fact
from crashfuse.study.outliers import departures, departures_near, folds_sentence, with_both_folds
from crashfuse.units import Sentence, packed, speed, unpacked, weight

FASTEST_MPS, HEAVIEST_KG = 100.0, 60_000.0
"""Upper limits of the conditions predicted, far beyond any barrier test; below in words."""

BOUNDS = Sentence("at most {} and {} in all", speed(FASTEST_MPS, form=".0f"), weight(HEAVIEST_KG))

_JUDGED, _KIND = "metric errors", "predictions"  # of cache entries
_LEFT_OUT, _ERRORS = "left out ", "error of "  # prefixes of a test's id, and of a metric, in the names of arrays there


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate(Prediction):
    """An approach's prediction at one condition, with its fit."""

    approach: str
    state: dict[str, object] = field(default_factory=dict)  # fit results as plain JSON values
    seconds: float = 0.0
    left_out_mps2: Mapping[str, FloatArray] = field(default_factory=dict)  # for each test learned from, left out
    agreements: Mapping[str, float] = field(default_factory=dict)  # of the draws of each of these with it
    metric_errors: Errors = field(default_factory=dict)  # of these predictions
    occupant: OccupantModel = USUAL_OCCUPANT

    def __repr__(self) -> str:
        return f"<Estimate by {self.approach}: {super().__repr__()}>"

    @cached_property
    def metrics(self) -> tuple[Metric, ...]:
        """Pulse metrics of the prediction, with intervals, calibrated on left-out tests, if it has draws."""
        return calibration.calibrated_metrics(self, self.drawn, self.metric_errors, self.occupant)

    @cached_property
    def drawn(self) -> dict[str, FloatArray]:
        """Metrics of each draw, or of the pulse itself if there are none."""
        return calibration.drawn_metrics(self, self.occupant)

    @cached_property
    def representative(self) -> dict[str, FloatArray]:
        """A pulse that looks like a test, by what follows the approach in its name; a pulse for each fold; if drawn."""
        if self.draws_mps2 is None:
            return {}
        if self.apart is None:
            return {", representative pulse": self.representative_pulses()[0]}
        return {f" if it folds as {fold}": own.representative_pulses()[0] for fold, own in self.by_fold.items()}

    @property
    def by_fold(self) -> dict[str, Self]:
        """It as in either way to fold, by name; none if there is one way."""
        if self.apart is None or self.draws_mps2 is None:
            return {}
        folds = zip(("most", self.apart_as), (~self.apart, self.apart), self.folds_mps2, strict=True)
        return {
            fold: replace(self, accel_mps2=accel, draws_mps2=self.draws_mps2[draws], apart=None, apart_as="")
            for fold, draws, accel in folds
        }

    def representative_pulses(self, draws: Sequence[int] = ()) -> FloatArray:
        """A pulse that looks like a test, then draws as single tests, shape (1 + n, 1250)."""
        with one_thread():
            return calibration.representative_pulses(self, self.drawn, self.metric_errors, draws, self.occupant)


@dataclass(frozen=True, eq=False)
class Fit:
    """An approach fitted to a campaign, and its predictions of left-out tests."""

    approach: Approach
    config: StudyConfig
    seconds: float
    left_out: Mapping[str, Prediction]
    metric_errors: Errors
    campaign: Campaign

    @classmethod
    def of(cls, campaign: Campaign, approach: str, config: StudyConfig = StudyConfig(), run: Run | None = None) -> Self:
        """Fit an approach to the whole campaign as given, or load that fit from the cache.

        A UsageError if there is no such approach, preset or device, or not enough to learn from.
        """
        require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
        require_a(StudyConfig, config, "crashfuse.StudyConfig()")
        require_a(str, approach, "the name of an approach")
        run = run or Run.of(campaign)
        campaign = run.bind(campaign)
        with blamed_on(approach):
            learned, seconds = config.create(approach).fitted(campaign, run)
            left_out, usual = learned.left_out(campaign), learned.usual_errors

        def judge() -> tuple[Errors, Errors]:
            errors = calibration.metric_errors(left_out, campaign, usual)
            return errors, errors

        def restore(entry: Entry) -> Errors:
            return {name: numbers(entry, name, len(left_out) + len(usual.get(name, ()))) for name in METRIC_LABELS}

        errors = run.get_or_compute(_JUDGED, {**learned.fit_key(campaign), "code": Code(__name__)}, judge, restore)
        return cls(learned, config, seconds, left_out, errors, campaign)

    def __repr__(self) -> str:
        return f"<Fit of {self.approach.name}, which took {self.seconds:.1f} s>"

    @cached_property
    def agreements(self) -> Mapping[str, float]:
        """As in :class:`Estimate`."""
        return {test: prediction.agreement for test, prediction in self.left_out.items()}

    @cached_property
    def state(self) -> dict[str, object]:
        """Fit results as plain JSON values; they take longer than a prediction."""
        with blamed_on(self.approach.name), one_thread():
            return self.approach.state

    @cached_property
    def _fitted_mps2(self) -> dict[str, FloatArray]:
        tests = [self.campaign.test(found.test) for found in departures(self.campaign) if found.test in self.left_out]
        with blamed_on(self.approach.name), one_thread():
            return {test.id: self.approach.predict(test.condition).accel_mps2 for test in tests}

    def with_both_folds(self, prediction: Prediction) -> Prediction:
        """The prediction, near a test that stands apart as :func:`crashfuse.study.outliers.with_both_folds`."""
        for departure in departures_near(self.campaign, prediction.condition)[:1]:
            if (fitted_mps2 := self._fitted_mps2.get(departure.test)) is not None:
                left_out_mps2 = self.left_out[departure.test].accel_mps2
                test = self.campaign.test(departure.test)
                return with_both_folds(prediction, departure, test, left_out_mps2, fitted_mps2)
        return prediction

    def estimate(self, condition: Condition) -> Estimate:
        """Predict at a condition, as :func:`estimates_at` does for several fits."""
        return estimates_at([self], condition)[0]


def fits_of(campaign: Campaign, approaches: Sequence[str | Fit], config: StudyConfig, run: Run) -> list[Fit]:
    """The fits of approaches to a campaign, once each; a UsageError if none is asked for."""
    for one in approaches:
        require_a(str | Fit, one, "the name of an approach, or crashfuse.Fit.of(campaign, approach)")
    asked = dict.fromkeys(approaches)
    if not asked:
        raise UsageError("A prediction takes an approach at least, such as fused.")
    if names := tuple(one for one in asked if isinstance(one, str)):
        replace(config, approaches=names).check()
    for one in asked:
        if isinstance(one, Fit) and one.campaign.fingerprint != campaign.fingerprint:
            raise UsageError(f"The fit of {one.approach.name} learned from other data than {campaign.name} holds.")
    return [one if isinstance(one, Fit) else Fit.of(campaign, one, config, run) for one in asked]


def check_factors(campaign: Campaign, condition: Condition) -> None:
    """Raise a UsageError if these are none, or no test has such a factor or its value."""
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    require_a(Condition, condition, "crashfuse.Condition.of(speed_mph=…, …)")
    for name, value in condition.factors:
        if name not in campaign.factors:
            known = ", ".join(campaign.factors) or "none"
            raise UsageError(f"{campaign.name} has no factor {name!r}; its factors are: {known}.")
        if value and value not in campaign.factors[name]:
            raise UsageError(f"No test has {name} {value!r}; known are {', '.join(campaign.factors[name])}.")


def is_beyond(condition: Condition) -> bool:
    """Whether no barrier test is made at a condition."""
    return condition.speed_mps > FASTEST_MPS or condition.mass_kg > HEAVIEST_KG


def estimates_at(fits: Sequence[Fit], condition: Condition, *, with_state: bool = True) -> list[Estimate]:
    """Predictions of several approaches, fitted to one campaign, at a condition, with numbers rounded as for storage.

    Their states take as long as two predictions. A UsageError if there is no such barrier test.
    """
    require_a(Condition, condition, "crashfuse.Condition.of(speed_mph=…, …)")
    if not (np.isfinite(condition.vector).all() and (condition.vector > 0).all()):
        raise UsageError(Sentence("A prediction takes a speed and weights above 0, not {}.", condition))
    if is_beyond(condition):
        raise UsageError(Sentence("No barrier test is made at {}: {} can be predicted.", condition, BOUNDS))
    made: dict[Hashable, tuple[Prediction, float]] = {}

    def predict(approach: Approach) -> tuple[Prediction, float]:
        key = (*approach.identity.values(), approach.taught_)  # equal for approaches that predict the same
        if key not in made:
            parts = [predict(part) for part in approach.parts]
            start = time.perf_counter()
            with blamed_on(approach.name), one_thread():
                prediction = approach.predict_from(condition, [part for part, _ in parts])
            made[key] = prediction, time.perf_counter() - start + sum(seconds for _, seconds in parts)
        return made[key]

    single = [part for fit in fits for part in _single_parts(fit.approach)]
    with ThreadPoolExecutor(1) as aside:  # networks alone fill but one core for half of their time
        others = aside.map(predict, [part for part in single if not part.trains_networks])
        for part in single:
            if part.trains_networks:
                predict(part)
        list(others)  # raises what went wrong there

    estimates = []
    for fit in fits:
        prediction, seconds = predict(fit.approach)
        if fit.approach.learns_from_tests:
            doubts = [doubt_fact(test).sentence for test in doubtful_tests(fit.campaign, condition)]
            prediction = replace(prediction, notes=(*prediction.notes, *doubts))
            prediction = fit.with_both_folds(prediction)
        if prediction.draws_mps2 is not None:
            prediction = replace(prediction, draws_mps2=prediction.draws_mps2.astype(np.float32))
        estimate = Estimate(
            **vars(prediction),
            approach=fit.approach.name,
            state=fit.state if with_state else {},
            seconds=fit.seconds + seconds,
            left_out_mps2={test: pulse.accel_mps2 for test, pulse in fit.left_out.items()},
            agreements=fit.agreements,
            metric_errors=fit.metric_errors,
            occupant=fit.campaign.occupant,
        )
        if prediction.apart is not None:
            note = folds_sentence(departures_near(fit.campaign, condition)[0], estimate.metrics)
            estimate = replace(estimate, notes=(*estimate.notes, note))
        estimates.append(estimate)
    return estimates


def _single_parts(approach: Approach) -> list[Approach]:
    return [single for part in approach.parts for single in _single_parts(part)] or [approach]


def estimate_at(
    campaign: Campaign, condition: Condition, approach: str, config: StudyConfig = StudyConfig(), run: Run | None = None
) -> Estimate:
    """Fit an approach to the whole campaign as given and predict at a condition; cached."""
    run = run or Run.of(campaign)

    def compute() -> tuple[Estimate, Entry]:
        estimate = Fit.of(campaign, approach, config, run).estimate(condition)
        return estimate, _entry(estimate)

    restore = partial(_restored, condition, approach, campaign.occupant)
    return run.get_or_compute(_KIND, _cache_key(campaign, condition, approach, config), compute, restore)


def find_estimate(
    campaign: Campaign, condition: Condition, approach: str, config: StudyConfig, cache: Cache
) -> Estimate | None:
    """The cached estimate for these settings and this campaign, or None."""
    restore = partial(_restored, condition, approach, campaign.occupant)
    return cache.find(_KIND, _cache_key(campaign, condition, approach, config), restore)


def is_estimate_cached(campaign: Campaign, condition: Condition, approach: str, config: StudyConfig) -> bool:
    """Whether :func:`find_estimate` would find one, without reading it."""
    return Cache(campaign.cache_folder).is_cached(_KIND, _cache_key(campaign, condition, approach, config))


def store_estimate(estimate: Estimate, campaign: Campaign, config: StudyConfig, cache: Cache) -> None:
    """Store an estimate from this campaign, for :func:`find_estimate`."""
    cache.put(_KIND, _cache_key(campaign, estimate.condition, estimate.approach, config), _entry(estimate))


def _entry(estimate: Estimate) -> Entry:
    values = {"notes": [packed(note) for note in estimate.notes], "agreements": dict(estimate.agreements)}
    text = json.dumps({**values, "state": estimate.state, "seconds": estimate.seconds})
    entry = {"accel_mps2": estimate.accel_mps2, "text": np.array(text)}
    entry |= {f"{_LEFT_OUT}{test}": pulse for test, pulse in estimate.left_out_mps2.items()}
    entry |= {f"{_ERRORS}{metric}": errors for metric, errors in estimate.metric_errors.items()}
    if estimate.draws_mps2 is not None:
        entry["draws_mps2"] = estimate.draws_mps2
    if estimate.apart is not None:
        entry |= {"apart": estimate.apart, "apart_as": np.array(estimate.apart_as)}
    return entry


def _restored(condition: Condition, approach: str, occupant: OccupantModel, entry: Entry) -> Estimate:
    text = json.loads(str(entry["text"]))
    draws = finite(entry, "draws_mps2", None, N_SAMPLES) if "draws_mps2" in entry else None
    notes = tuple(map(unpacked, text["notes"]))
    apart, apart_as = (entry["apart"].astype(bool), str(entry["apart_as"])) if "apart" in entry else (None, "")
    left_out, errors = (
        {name.removeprefix(prefix): check(entry, name, length) for name in entry if name.startswith(prefix)}
        for prefix, check, length in ((_LEFT_OUT, finite, N_SAMPLES), (_ERRORS, numbers, None))
    )
    if not isinstance(text["state"], dict) or errors.keys() != METRIC_LABELS.keys():
        raise ValueError("no estimate")
    prediction = condition, finite(entry, "accel_mps2", N_SAMPLES), draws, notes, apart, apart_as
    estimate = Estimate(*prediction, approach=approach, state=text["state"], seconds=float(text["seconds"]))
    agreements = {test: float(value) for test, value in text["agreements"].items()}
    return replace(estimate, left_out_mps2=left_out, agreements=agreements, metric_errors=errors, occupant=occupant)


def _cache_key(campaign: Campaign, condition: Condition, approach: str, config: StudyConfig) -> dict[str, object]:
    fit = config.create(approach).identity
    key = {**fit, "campaign": campaign.fingerprint, "condition": condition, "code": Code(__name__)}
    doubts = doubtful_tests(campaign, condition)  # seen in the records, of which the campaign keeps what it learns from
    return {**key, "doubts": [str(doubt) for doubt in doubts]} if doubts else key
