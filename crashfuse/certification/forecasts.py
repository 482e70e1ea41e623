"""Forecasts of many conditions by approaches that learned from parts of the tests: computed side by side, and kept."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import astuple, dataclass, field, fields, replace
from functools import lru_cache, partial
from itertools import starmap
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from crashfuse.approaches.metric_calibration import Distribution, mean_quantiles, metric_distributions
from crashfuse.approaches.registry import BASELINE, CLASSES
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import RATING, WINDOW_MS, Criteria, Criterion, Tolerances
from crashfuse.certification.matrix import Matrix
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.cache import Code, Entry, numbers
from crashfuse.execution.run import Run, one_thread_throughout
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.occupant import OccupantModel
from crashfuse.signals.pulse import N_SAMPLES, FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit, estimates_at
from crashfuse.study.expected_rating import RatingDistribution, overall_rating
from crashfuse.study.running import prepare
from crashfuse.units import KPH

_UNKNOWN = (np.nan,) * len(fields(Distribution))
_SCALE = [own.name for own in fields(Distribution)].index("scale")


def quantity(criterion: Criterion) -> str:
    """What a criterion limits, as a key: the metric, or the rating over its window."""
    return criterion.metric if criterion.window_ms is None else f"{RATING} {criterion.window_ms:g}"


@dataclass(frozen=True, eq=False)
class Forecast:
    """What an approach predicts for a test at a condition, by one seed or several: the first axis of every array."""

    names: tuple[str, ...]  # of quantities (:func:`quantity`): metrics, then ratings
    accel_mps2: FloatArray  # shape (n_seeds, n_samples)
    values: FloatArray  # (n_seeds, n_names): what a single test shows in the middle; NaN if the record is too short
    distributions: FloatArray  # (n_seeds, n_names, n_fields): and at all, by the fields of a :class:`Distribution`
    ranks: FloatArray  # (n_seeds, n_metrics, n_draws): the share of draws that each is above
    whole_mps2: FloatArray  # (n_seeds, 2 or 0, n_samples): band of whole pulses, if any
    folds: FloatArray  # (n_seeds, 2, n_names, n_fields): as distributions, of tests alike and of one that stands apart
    apart_share: FloatArray  # (n_seeds,): of draws that fold as that one

    @classmethod
    def of(cls, fit: Fit, condition: Condition, windows_ms: Sequence[float]) -> Self:
        """What a fit predicts at a condition, and its rating over windows as those of its left-out tests."""
        (estimate,) = estimates_at([fit], condition, with_state=False)
        drawn, apart = estimate.drawn, estimate.apart
        found = metric_distributions(drawn, fit.metric_errors)
        known = {name: None if own is None else own.median for name, own in found.items()}
        unknown = [name for name, own in found.items() if own is None]
        of_pulse = metric_values(estimate.accel_mps2, condition.speed_mps, occupant=estimate.occupant, names=unknown)
        known |= {name: float(value) for name, value in of_pulse.items() if np.isfinite(value)}
        pairs = [(fit.campaign.test(test_id), own.accel_mps2) for test_id, own in fit.left_out.items()]
        away = np.abs(np.array([test.condition.speed_mps for test, _ in pairs]) - condition.speed_mps)
        agreements, here = np.array(list(fit.agreements.values())), estimate.agreement
        for window in windows_ms:
            ratings = np.array([overall_rating(test.pulse, own, window) for test, own in pairs])
            rating = RatingDistribution.learned(ratings, away, agreements, here) if ratings.size else None
            name = f"{RATING} {window:g}"
            found[name], known[name] = rating, None if rating is None else rating.median
        ways = () if apart is None else (~apart, apart)
        by_way = [{name: values[way] for name, values in drawn.items()} for way in ways]
        folds = [metric_distributions(values, fit.metric_errors) for values in by_way] or [{}, {}]
        arrays = {
            "accel_mps2": estimate.accel_mps2,
            "values": np.array([np.nan if known[name] is None else known[name] for name in found], dtype=np.float64),
            "distributions": _rows(found, found),
            "ranks": _ranks(np.array(list(drawn.values()))),
            "whole_mps2": np.array(estimate.whole_band() or np.empty((0, N_SAMPLES))),
            "folds": np.array([_rows(fold, found) for fold in folds]),
            "apart_share": np.array(0.0 if apart is None else apart.mean()),
        }
        return cls(tuple(found), **{name: array[np.newaxis] for name, array in arrays.items()})

    @classmethod
    def mean(cls, by_seed: Sequence[Self]) -> Self:
        """The mean of forecasts by several seeds, of networks, fits and draws alike."""
        arrays = {name: np.concatenate([getattr(own, name) for own in by_seed]) for name in _SHAPES}
        return cls(by_seed[0].names, **arrays)

    @property
    def entry(self) -> dict[str, npt.NDArray[Any]]:
        """As arrays, for the cache."""
        return {"names": np.array(self.names), **{name: getattr(self, name) for name in _SHAPES}}

    @classmethod
    def restored(cls, entry: Entry) -> Self:
        """Restore from :attr:`entry`."""
        return cls(tuple(entry["names"].tolist()), **{name: numbers(entry, name, *_SHAPES[name]) for name in _SHAPES})

    def _distributions(self, criterion: Criterion) -> list[Distribution]:
        kind = Distribution if criterion.window_ms is None else RatingDistribution
        rows = self.distributions[:, self.names.index(quantity(criterion))]
        return [] if np.isnan(rows).any() else [kind(*row) for row in rows.tolist()]

    def _folds(self, criterion: Criterion) -> FloatArray:
        """:meth:`by_fold` by seed; shape (n_seeds, 2)."""
        rows = self.folds[:, :, self.names.index(quantity(criterion))].tolist()
        limits = criterion.at_least, criterion.at_most
        chances = [[np.nan if np.isnan(row[0]) else Distribution(*row).probability(*limits) for row in p] for p in rows]
        return np.array(chances)

    def chances(self, criterion: Criterion) -> tuple[float, ...]:
        """Probability of meeting a criterion, by seed; empty if a record is too short to tell."""
        parts, folds = self._distributions(criterion), self._folds(criterion)
        return tuple(
            part.probability(criterion.at_least, criterion.at_most)
            if np.isnan(ways).any()
            else float(np.average(ways, weights=(1 - share, share)))
            for part, ways, share in zip(parts, folds, self.apart_share.tolist(), strict=bool(parts))
        )

    def probability_interval(self, criterion: Criterion) -> tuple[float, float] | None:
        """Central 95 % of the probability itself, as left-out tests leave it open; None as :meth:`chances` is empty."""
        if not (parts := self._distributions(criterion)):
            return None
        place, by_seed = self.names.index(quantity(criterion)), []
        for part, folds, apart in zip(parts, self.folds[:, :, place].tolist(), self.apart_share.tolist(), strict=True):
            ways = [(1.0, part)]
            if not np.isnan(folds).any():
                ways = [*zip((1 - apart, apart), starmap(Distribution, folds), strict=True)]
            laws = [share * way.probabilities(criterion.at_least, criterion.at_most) for share, way in ways]
            by_seed.append(np.sum(laws, axis=0))
        lower, upper = np.quantile(np.mean(by_seed, axis=0), [0.025, 0.975]).tolist()
        return lower, upper

    def by_fold(self, criterion: Criterion) -> tuple[float, float] | None:
        """Probability of meeting a criterion if a test folds as most do, and as the one that stands apart, if any."""
        alike, apart = self._folds(criterion).mean(axis=0).tolist()
        return None if np.isnan([alike, apart]).any() else (alike, apart)

    def numbers(self, criterion: Criterion) -> tuple[float | None, float | None, float | None]:
        """What a single test shows in the middle, and the central 95 %."""
        values = self.values[:, self.names.index(quantity(criterion))]
        value = None if np.isnan(values).any() else float(values.mean())
        if not (parts := self._distributions(criterion)):
            return value, None, None
        median, lower, upper = mean_quantiles(tuple(parts))
        return value if len(parts) == 1 else median, lower, upper

    def drawn(self, criterion: Criterion) -> npt.NDArray[np.bool_]:
        """Which draws meet a criterion by their ranks, shape (n_seeds, n_draws); none of a rating, or without draws."""
        place, parts = self.names.index(quantity(criterion)), self._distributions(criterion)
        if place >= self.ranks.shape[1] or not self.ranks.size or not parts:
            return np.empty(0, dtype=bool)
        shares = np.array([part.shares(criterion.at_least, criterion.at_most) for part in parts])
        ranks = self.ranks[:, place]
        return np.asarray((shares[:, :1] < ranks) & (ranks <= shares[:, 1:]))

    def widened(self, spreads: Mapping[str, float]) -> Self:
        """The forecast with a further normal scatter of its metrics, by name, of these standard deviations."""
        further = np.array([spreads.get(name, 0.0) for name in self.names])
        distributions, folds = self.distributions.copy(), self.folds.copy()
        for array in (distributions, folds):
            array[..., _SCALE] = np.hypot(array[..., _SCALE], further)
        return replace(self, distributions=distributions, folds=folds)

    def measured(self, criterion: Criterion, test: CrashTest, occupant: OccupantModel) -> float | None:
        """What a test here shows: its metric, or the rating of this prediction against it; None if it is too short."""
        if (window := criterion.window_ms) is not None:
            return float(np.mean([overall_rating(test.pulse, own, window) for own in self.accel_mps2]))
        value = _metrics_of(test, occupant)[criterion.metric]
        return value if np.isfinite(value) else None


_SHAPES: Mapping[str, tuple[int | None, ...]] = {
    "accel_mps2": (None, N_SAMPLES),
    "values": (None, None),
    "distributions": (None, None, len(_UNKNOWN)),
    "ranks": (None, None, None),
    "whole_mps2": (None, None, N_SAMPLES),
    "folds": (None, 2, None, len(_UNKNOWN)),
    "apart_share": (None,),
}


def _rows(distributions: Mapping[str, Distribution | None], names: Iterable[str]) -> FloatArray:
    return np.array([_UNKNOWN if (own := distributions.get(name)) is None else astuple(own) for name in names])


@lru_cache(maxsize=256)  # asked for by every criterion, and again with every other limit
def _metrics_of(test: CrashTest, occupant: OccupantModel) -> dict[str, float]:
    pulse, speed = test.pulse, test.condition.speed_mps
    values = metric_values(pulse.accel_mps2, speed, dt_s=pulse.dt_s, occupant=occupant)
    return {name: float(value) for name, value in values.items()}


def _ranks(drawn: FloatArray) -> FloatArray:
    """The share of draws below each; of equal ones the middle, and those without a value last."""
    n_draws = drawn.shape[1] if drawn.shape[1] > 1 else 0  # a single one is the pulse itself
    ends = [[np.searchsorted(np.sort(row), row[:n_draws], end) for row in drawn] for end in ("left", "right")]
    return np.asarray(np.mean(ends, axis=0) / max(n_draws, 1))


_KIND = "forecasts"  # kind of cache entry
SEEDS = (0, 1)
"""Averaged over, the same for everyone: nobody can choose others."""
_LEAST_RUNS = 2  # that are left to learn from
_CHUNK = 16  # conditions predicted by one task, a usual matrix as a whole: each task has to restore the fit


class Query(NamedTuple):
    """A forecast: by an approach that learned from all tests but some, at a condition."""

    held_out: tuple[str, ...]
    approach: str
    condition: Condition
    runs: Literal["kept", "paired", "dropped"]  # CAE runs at the tests held out
    seed: int = 0


def training(campaign: Campaign, asked: Query) -> Campaign:
    """What a forecast is learned from."""
    others, cae, runs = campaign.without(asked.held_out), campaign.cae, paired_runs(campaign, asked.held_out)
    if asked.runs != "paired":
        return replace(others, cae=cae.without(runs)) if asked.runs == "dropped" else others
    of_others = (cae.ids[row] for test in others.tests if (row := cae.paired_run(test.condition)) is not None)
    return replace(others, cae=replace(cae, paired_only=runs.difference(of_others)))


def paired_runs(campaign: Campaign, tests: Sequence[str]) -> frozenset[str]:
    """Ids of the CAE runs paired with tests; none if no other runs are left."""
    runs = campaign.cae.paired_ids(campaign.test(test).condition for test in tests)
    return runs if len(runs) + _LEAST_RUNS <= len(campaign.cae) else frozenset()


@dataclass(frozen=True, eq=False)
class Forecasts:
    """Computes forecasts, or finds them in the cache."""

    campaign: Campaign
    windows_ms: tuple[float, ...]
    config: StudyConfig
    run: Run
    _known: dict[tuple[object, ...], Campaign] = field(default_factory=dict)

    def averaged(self, asked: Sequence[Query], step: str, learn_for: Sequence[Query] = ()) -> dict[Query, Forecast]:
        """Forecasts by all seeds, of what no seed changes by the first."""
        by_seed = {each: self._by_seed(each) for each in asked}
        ahead = [own for each in learn_for for own in self._by_seed(each)]
        found = self.all([own for seeds in by_seed.values() for own in seeds], step, ahead)
        return {each: Forecast.mean([found[own] for own in seeds]) for each, seeds in by_seed.items()}

    def _by_seed(self, asked: Query) -> list[Query]:
        is_random = hasattr(self.config.create(asked.approach), "seed")
        return [asked._replace(seed=seed) for seed in (SEEDS if is_random else SEEDS[:1])]

    def all(self, asked: Sequence[Query], step: str, learn_for: Sequence[Query] = ()) -> dict[Query, Forecast]:
        """All forecasts asked for, and one of ``learn_for``, so that the fit to all tests is made beside the others."""
        found = {each: own for each in asked if (own := self.find(each)) is not None}
        missing = [each for each in dict.fromkeys(asked) if each not in found]
        tasks: dict[tuple[object, ...], list[Query]] = {}
        for each in missing:
            seed = each.seed if self._is_fitted(each) else None
            tasks.setdefault((each.held_out, each.runs, seed), []).append(each)
        chunks = [own[i : i + _CHUNK] for own in tasks.values() for i in range(0, len(own), _CHUNK)]
        to_learn = {each.seed: each for each in learn_for if not self._is_fitted(each) and not self.is_known(each)}
        chunks[:0] = [list(to_learn.values())] if to_learn else []
        shared = self.run.anew()
        for seed in sorted({each.seed for each in missing}):
            approaches = {each.approach for each in missing if each.seed == seed}
            shared.cache.used |= prepare(self.campaign, approaches, replace(self.config, seed=seed), shared).cache.used
        work = partial(_forecast, config=self.config.on_this_device, windows_ms=self.windows_ms)
        done, total = len(found), len(found) + len(missing)
        self.run.watch.report(step, done, total)
        with closing(shared.completed(work, self.campaign, chunks)) as completed:
            for some in completed:
                found |= dict(some)
                self.run.watch.report(step, min(len(found), total), total)
        return found

    def _is_fitted(self, asked: Query) -> bool:
        config = replace(self.config, seed=asked.seed).on_this_device
        return config.create(asked.approach).is_cached(self._training(asked))

    def is_known(self, asked: Query) -> bool:
        """Whether the cache has a forecast."""
        return self.run.cache.is_cached(_KIND, _key(self._training(asked), asked, self.config, self.windows_ms))

    def are_known(self, asked: Sequence[Query]) -> bool:
        """Whether the cache has all that :meth:`averaged` takes."""
        return all(self.is_known(own) for each in asked for own in self._by_seed(each))

    def find(self, asked: Query) -> Forecast | None:
        """The forecast in the cache, if there is one."""
        key = _key(self._training(asked), asked, self.config, self.windows_ms)
        return self.run.cache.find(_KIND, key, Forecast.restored)

    def _training(self, asked: Query) -> Campaign:
        key = asked.held_out, asked.runs
        if key not in self._known:
            self._known[key] = training(self.campaign, asked)
        return self._known[key]


def _forecast(
    campaign: Campaign, asked: list[Query], run: Run, *, config: StudyConfig, windows_ms: tuple[float, ...]
) -> list[tuple[Query, Forecast]]:
    learned_from, made, run = training(campaign, asked[0]), [], replace(run, memory={})
    with one_thread_throughout():
        for name, seed in dict.fromkeys((each.approach, each.seed) for each in asked):
            fit = Fit.of(learned_from, name, replace(config, seed=seed), run)
            for each in asked:
                if (each.approach, each.seed) == (name, seed):
                    forecast = Forecast.of(fit, each.condition, windows_ms)
                    run.cache.put(_KIND, _key(learned_from, each, config, windows_ms), forecast.entry)
                    made.append((each, forecast))
    return made


def _key(training: Campaign, asked: Query, config: StudyConfig, windows_ms: tuple[float, ...]) -> dict[str, object]:
    fit = replace(config, seed=asked.seed).create(asked.approach).identity
    own = {"campaign": training.fingerprint, "condition": asked.condition, "windows_ms": windows_ms}
    return {**fit, **own, "code": Code(__name__)}


def spreads(
    pulse: Callable[[Condition], FloatArray], at: Condition, tolerances: Tolerances, occupant: OccupantModel
) -> dict[str, float]:
    """Standard deviation of each metric by tolerances, to first order; ``pulse`` gives a pulse at any condition."""

    def of(condition: Condition, factor: float = 1.0) -> dict[str, FloatArray]:
        return metric_values(factor * pulse(condition), condition.speed_mps, occupant=occupant)

    away = {
        "speed_mps": tolerances.speed_kph * KPH,
        "front_weight_kg": tolerances.weight * at.front_weight_kg,
        "rear_weight_kg": tolerances.weight * at.rear_weight_kg,
    }
    ends = [[of(replace(at, **{name: getattr(at, name) + s * by})) for s in (-1, 1)] for name, by in away.items() if by]
    ends += [[of(at, 1 - tolerances.acceleration), of(at, 1 + tolerances.acceleration)]]
    values = {name: np.array([[low[name], high[name]] for low, high in ends]) for name in ends[0][0]}
    known = {name: np.where(np.isfinite(own), own, np.nan) for name, own in values.items()}  # or nothing can be said
    return {name: float(np.hypot.reduce(np.diff(own)[:, 0] / 2)) for name, own in known.items()}


Split = tuple[CrashTest, Literal["test", "speed group"], tuple[str, ...]]
"""A test, what is left out with it, the ids of all left out."""


class Plan(NamedTuple):
    """What is to be predicted: left-out tests as the conditions of the matrix are, so mostly without a paired run."""

    splits: Sequence[Split]
    trials: Sequence[Query]
    with_runs: Sequence[Query]  # those that lack the CAE runs at their tests' conditions, with these
    cells: Sequence[Query]
    forecasts: Forecasts

    def widened(self, found: Mapping[Query, Forecast], tolerances: Tolerances | None) -> Mapping[Query, Forecast]:
        """Forecasts of planned tests with the scatter of how these are run and measured."""
        campaign = self.forecasts.campaign
        if tolerances is None:
            return found
        emulator = CaeModel().fit(campaign.cae, self.forecasts.run).emulator_
        return {
            asked: forecast.widened(spreads(emulator.predict, asked.condition, tolerances, campaign.occupant))
            for asked, forecast in found.items()
        }

    @classmethod
    def of(cls, campaign: Campaign, criteria: Criteria, matrix: Matrix, config: StudyConfig, run: Run) -> Self:
        """The plan of a certification by the first approach of the config."""
        approach, splits = config.approaches[0], list[Split]()
        if len(campaign.tests) > 1:
            groups = [(test, campaign.speed_group(test.id)) for test in campaign.tests]
            splits += [(test, "test", (test.id,)) for test in campaign.tests]
            splits += [(test, "speed group", group) for test, group in groups if len(group) < len(campaign.tests)]
        all_have_runs = all(campaign.cae.paired_run(condition) is not None for condition in matrix.conditions)
        trials = [
            Query(held_out, name, test.condition, "kept" if all_have_runs else "dropped")
            for test, _, held_out in splits
            for name in dict.fromkeys((approach, BASELINE))
        ]
        lacking = {out for out in {out for _, _, out in splits} if not all_have_runs and paired_runs(campaign, out)}
        with_runs = [trial._replace(runs="paired") for trial in trials if trial.held_out in lacking]
        cells = [Query((), approach, condition, "kept") for condition in matrix.conditions]
        # networks, which all trials share, are trained on none of the runs that one of these lacks
        if CLASSES[approach].trains_networks:
            tests = sorted({test for out in lacking for test in out})
            untrained = campaign.cae.untrained | paired_runs(campaign, tests)
            campaign = replace(campaign, cae=replace(campaign.cae, untrained=untrained))
        windows_ms = {*criteria.windows_ms, criteria.spot_check.window_ms or WINDOW_MS}
        forecasts = Forecasts(campaign, tuple(sorted(windows_ms)), config, run)
        return cls(splits, trials, with_runs, cells, forecasts)

    def without(self, test: str) -> Campaign:
        """What the record learns from where this test alone is left out."""
        return training(self.forecasts.campaign, next(trial for trial in self.trials if trial.held_out == (test,)))
