"""Learning of an archive: what past vehicles teach the next one, and how each, left out whole, is predicted with it."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from typing import TypeVar

import numpy as np
import pandas as pd

from crashfuse.approaches.base import Prediction, Settings
from crashfuse.approaches.calibration import JUDGED, STRIDE, predicted
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.fused import Fused
from crashfuse.approaches.metric_calibration import (
    drawn_metrics,
    metric_distributions,
    metric_errors,
    standardised_error,
)
from crashfuse.approaches.mixture import PRIOR, STRENGTH, Component, Pool, Scores, Tests
from crashfuse.approaches.pretrained import Pretrained
from crashfuse.approaches.pretrained_tuning import Vehicle, tuned
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError, require_a, several
from crashfuse.execution.cache import Cache, Code, Entry, numbers
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import Run, one_thread_throughout
from crashfuse.execution.workers import running
from crashfuse.files.tensors import Arrays
from crashfuse.signals.metrics import METRIC_LABELS, metric_values
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.learning_curve import subsets
from crashfuse.units import read_out
from crashfuse.vehicle_archive import LEAST_VEHICLES, PastVehicle, Prior, VehicleArchive

SIZES = (1, 2, 3, 4, 6)
"""Numbers of tests that a vehicle of the archive is predicted from."""

_OF_ERRORS = (2, 4)  # those that usual errors are learned from
_LEAST_TESTS, _MOST_TESTS = 4, 14  # of a vehicle, and that the network is tuned to
_WINDOW_MS = 60.0
_SPREAD_OF_ONE = 0.3  # of a single CAE model, relative: as far as any two differ, so that likeness says nothing
_DRAWS = 100
_COUNT = 10.0  # left-out tests that all those of a vehicle count as, as they are predicted from the same ones
_PARTS, _NETWORKS = "archive parts", "archive networks"  # kinds of cache entries

R = TypeVar("R")
T = TypeVar("T")
_Chosen = tuple[str, ...]  # ids of the tests that are learned from
_Members = tuple[int, ...]  # numbers of vehicles of the archive


@dataclass(frozen=True)
class _Part:
    campaign: Campaign
    chosen: _Chosen
    run: Run
    seed: int

    @cached_property
    def held_out(self) -> list[CrashTest]:
        return [test for test in self.campaign.tests if test.id not in self.chosen]

    @cached_property
    def few(self) -> Campaign:
        return self.campaign.without([test.id for test in self.held_out])

    def components(self) -> list[list[Component]]:
        few = replace(self.few, prior=None)

        def predict() -> tuple[FloatArray, Entry]:
            settings, approaches = Settings(seed=self.seed), (TimeDomain, DisplacementDomain)
            fits = [kind.create(settings).fitted(few, self.run)[0] for kind in approaches]
            predictions = [fit.predict(test.condition) for test in self.held_out for fit in fits]
            drawn = ((own.accel_mps2, own.draws_mps2[:_DRAWS]) for own in predictions if own.draws_mps2 is not None)
            rows = [np.vstack(pair)[:, ::STRIDE] for pair in drawn]
            pulses = np.array(rows).reshape(len(self.held_out), len(fits), 1 + _DRAWS, -1)
            return pulses, {"pulses": pulses}

        digests = [test.digest for test in self.held_out]
        key = {"campaign": few.fingerprint, "held_out": digests, "seed": self.seed, "code": Code(__name__)}
        pulses = self.run.get_or_compute(_PARTS, key, predict, lambda entry: numbers(entry, "pulses", *[None] * 4))
        return [[Component(rows[0], rows[1:]) for rows in of_test] for of_test in pulses]

    def is_predicted(self) -> list[bool]:
        return [bool(self.components())]

    def scores(self) -> list[tuple[Scores, Scores]]:
        few = self.few, replace(self.few, prior=None)
        networks = [Pretrained(seed=self.seed).fit(campaign, self.run) for campaign in few]
        tests = Tests.of(self.few, networks[0].model_)

        def score(network: Pretrained, test: CrashTest, components: Sequence[Component]) -> Scores:
            raw = tests.raw(network.model_.pulse(test.condition).accel_mps2, test.condition.speed_mps)
            by_network = np.asarray(network.predict(test.condition).draws_mps2)
            drawn = [*(part.draws for part in components), by_network[:, ::STRIDE], raw.draws[:, ::STRIDE]]
            return Scores.of(test.pulse.accel_mps2[::STRIDE][JUDGED], [draws[:, JUDGED] for draws in drawn])

        pairs = zip(self.held_out, self.components(), strict=True)
        return [(score(networks[0], *pair), score(networks[1], *pair)) for pair in pairs]

    @cached_property
    def fused(self) -> Fused:
        return Fused(seed=self.seed).fit(self.few, self.run)

    def predictions(self) -> Iterator[tuple[CrashTest, Prediction, dict[str, FloatArray], dict[str, float]]]:
        occupant = self.campaign.occupant
        for test, components in zip(self.held_out, self.components(), strict=True):
            prediction = self.fused.predict_from(test.condition, [predicted(test, *part) for part in components])
            measured = metric_values(test.pulse.accel_mps2, test.condition.speed_mps, occupant=occupant)
            floats = {name: float(value) for name, value in measured.items()}
            yield test, prediction, drawn_metrics(prediction, occupant), floats

    def errors(self) -> list[dict[str, float]]:
        return [
            {name: standardised_error(drawn[name], measured[name], name) for name in METRIC_LABELS}
            for _, _, drawn, measured in self.predictions()
        ]

    def judged(self) -> list[dict[str, float]]:
        errors = metric_errors(self.fused.left_out(self.few), self.few, self.fused.usual_errors)
        rows = []
        for test, prediction, drawn, measured in self.predictions():
            pulse = Pulse(GRID_S, prediction.accel_mps2)
            row = {"rating": rate_windows(test.pulse, pulse, [_WINDOW_MS])[_WINDOW_MS].overall}
            for name, distribution in metric_distributions(drawn, errors).items():
                lower, upper = (None, None) if distribution is None else distribution.interval
                row |= {f"inside {name}": np.nan, f"width {name}": np.nan}
                if lower is not None and upper is not None and np.isfinite(measured[name]):
                    row |= {f"inside {name}": float(lower <= measured[name] <= upper), f"width {name}": upper - lower}
            rows.append(row)
        return rows


def _done(
    campaign: Campaign, chosen: _Chosen, run: Run, *, work: Callable[[_Part], R], seed: int
) -> list[tuple[_Chosen, R]]:
    with one_thread_throughout():
        return [(chosen, work(_Part(campaign, chosen, run, seed)))]


def _tuned(
    _: Campaign, members: _Members, run: Run, *, vehicles: Sequence[Vehicle], seed: int
) -> list[tuple[_Members, Arrays]]:
    mine = [vehicles[member] for member in members]

    def tune() -> tuple[Arrays, Arrays]:
        weights = tuned(mine, seed, run.watch)
        return weights, weights

    digest = hashlib.sha256(b"".join(rows.tobytes() for vehicle in mine for rows in vehicle)).hexdigest()
    key = {"vehicles": digest, "seed": seed, "code": Code(Vehicle.__module__)}
    return [(members, run.get_or_compute(_NETWORKS, key, tune, dict))]


@dataclass(frozen=True)
class _Computation:
    seed: int
    run: Run

    def each(
        self, work: Callable[..., list[tuple[T, R]]], campaign: Campaign, tasks: Sequence[T], step: str
    ) -> list[R]:
        done = dict[T, R]()
        with closing(self.run.completed(work, campaign, tasks)) as completed:
            for results in completed:
                done.update(results)
                self.run.watch.report(step, len(done), len(tasks))
        return [done[task] for task in tasks]

    def by_part(self, work: Callable[[_Part], list[R]], campaign: Campaign, sizes: Sequence[int], step: str) -> list[R]:
        chosen = [part.chosen for part in subsets(campaign, 0, 0) if len(part.chosen) in sizes]
        results = self.each(partial(_done, work=work, seed=self.seed), campaign, chosen, f"{campaign.name}: {step}")
        return [row for rows in results for row in rows]

    def prepared(self, campaign: Campaign) -> Vehicle:
        settings = Settings(seed=self.seed)
        conditions = [test.condition for test in campaign.tests]
        for approach in (TimeDomain, DisplacementDomain):
            approach.create(settings).prepare(replace(campaign, tests=()), conditions, self.run)
        self.by_part(_Part.is_predicted, campaign, SIZES, "predictions from few tests")
        many, model = campaign.evenly_over_speed(_MOST_TESTS), CaeModel().fit(campaign.cae, self.run)
        tests = Tests.of(many, model)
        vectors = np.array([test.condition.vector for test in many.tests])
        return Vehicle(tests.measured_mps2[:, ::STRIDE], tests.cae_mps2[:, ::STRIDE], vectors)


@dataclass(frozen=True, eq=False)
class _Learning:
    campaigns: Sequence[Campaign]
    biases: FloatArray  # what each teaches of the bias, shape (n_vehicles, 6, 60)
    caes: FloatArray  # what each CAE model says, shape (n_vehicles, 5, 60)
    networks: Mapping[_Members, Arrays]
    computation: _Computation

    def _each(self, work: Callable[[_Part], list[R]], member: int, prior: Prior | None, *sizes: int) -> list[R]:
        campaign = replace(self.campaigns[member], prior=prior)
        return self.computation.by_part(work, campaign, sizes, "predicted with the others")

    def prior(self, members: _Members) -> Prior:
        others = {member: self._unweighted(_less(members, member)) for member in members}
        scores = [self._each(_Part.scores, member, others[member], *SIZES) for member in members]
        taught = [score for pairs in scores for score, _ in pairs]
        logits = Pool(strength=STRENGTH * _COUNT * len(members) / len(taught)).fit(taught).logits_
        weighted, usual = Pool(logits).fit([]), Pool().fit([])
        gains = []
        for pairs in scores:
            before = np.array([_crps(usual, shipped) for _, shipped in pairs])
            gains.append(1 - np.mean([_crps(weighted, score) for score, _ in pairs]) / before.mean())
        weighed = [(member, replace(others[member], logits=logits)) for member in members]
        errors = [pd.DataFrame(self._each(_Part.errors, *pair, *_OF_ERRORS)) for pair in weighed]
        ends = pd.concat([of_one.mean() + side * of_one.std(ddof=0) for of_one in errors for side in (-1, 1)], axis=1)
        usual_errors = {str(name): row.to_numpy() for name, row in ends.dropna().iterrows()}
        helps = bool(np.mean(gains) > 0)
        return replace(self._unweighted(members), logits=logits, errors=usual_errors, helps=helps)

    def _unweighted(self, members: _Members) -> Prior:
        names = tuple(self.campaigns[member].name for member in members)
        biases, caes = self.biases[list(members)], self.caes[list(members)]
        spread = caes.std(axis=0, ddof=1) if len(caes) > 1 else _SPREAD_OF_ONE * caes[0]
        cae = np.array([caes.mean(axis=0), spread])
        return Prior(names, self.networks[members], PRIOR, {}, carried_over(biases), cae)

    def record(self, number: int, prior: Prior) -> Iterator[dict[str, object]]:
        for size in SIZES:
            rows = [self._each(_Part.judged, number, taught, size) for taught in (prior, None)]
            with_archive, without = map(pd.DataFrame, rows)
            if with_archive.empty:
                continue
            widths = with_archive.filter(like="width ").to_numpy() / without.filter(like="width ").to_numpy()
            row = {"vehicle": self.campaigns[number].name, "n_tests": size, "predicted": len(without)}
            row |= {"rating": with_archive["rating"].mean(), "rating_without": without["rating"].mean()}
            for column, table in (("inside", with_archive), ("inside_without", without)):
                row[column] = float(np.nanmean(table.filter(like="inside ").to_numpy(dtype=float)))
            yield row | {"width": float(np.exp(np.nanmean(np.log(widths))))}


def carried_over(biases: FloatArray) -> FloatArray:
    """The mean of what n vehicles teach of the bias, shape (6, 60), as much of it as carries over to another one.

    With ρ, the correlation between two of them, that is nρ / (1 + (n - 1)ρ). Of a single one it is half.
    """
    shares = []
    for of_all in (biases[:, :-1], biases[:, -1:]):  # the bias, and what is taken out of humps
        pairs = list(combinations(of_all, 2))
        size = sum(float(np.sum(one**2 + other**2)) / 2 for one, other in pairs)
        rho = max(sum(float(np.sum(one * other)) for one, other in pairs) / size, 0.0) if size else 0.5
        shares += [len(biases) * rho / (1 + (len(biases) - 1) * rho)] * of_all.shape[1]
    return np.asarray(np.array(shares)[:, None] * biases.mean(axis=0))


def _crps(pool: Pool, scores: Scores) -> float:
    return scores.crps(pool.weights(scores.spreads))


def _less(members: _Members, out: int) -> _Members:
    return tuple(member for member in members if member != out)


def learn_archive(
    campaigns: Sequence[Campaign],
    *,
    seed: int = 0,
    cache: Cache | None = None,
    watch: Watch = SILENT,
    workers: int | None = None,
) -> VehicleArchive:
    """Learn what three or more campaigns teach the next vehicle; what is finished stays in the cache.

    A UsageError if there are fewer, one has fewer than four tests, or two share a name, tests or CAE runs.
    """
    campaigns = [replace(campaign, prior=None) for campaign in _checked(campaigns)]
    everyone = tuple(range(len(campaigns)))
    without = [_less(everyone, number) for number in everyone]
    wanted = sorted({everyone, *without, *(_less(members, member) for members in without for member in members)})
    with running(campaigns[0], cache=cache, watch=watch, workers=workers) as run:
        computation = _Computation(seed, run)
        work = partial(_tuned, vehicles=[computation.prepared(campaign) for campaign in campaigns], seed=seed)
        weights = computation.each(work, campaigns[0], wanted, "Tuning of the pre-trained network")
        domains = [DisplacementDomain(seed=seed).fitted(campaign, run)[0] for campaign in campaigns]
        biases, caes = map(np.array, zip(*(domain.to_teach() for domain in domains), strict=True))
        learning = _Learning(campaigns, biases, caes, dict(zip(wanted, weights, strict=True)), computation)
        whole, *priors = (learning.prior(members) for members in (everyone, *without))
        rows = [row for number, prior in enumerate(priors) for row in learning.record(number, prior)]
    return VehicleArchive(tuple(map(_past, campaigns)), whole, tuple(priors), pd.DataFrame(rows), seed)


def _checked(campaigns: Sequence[Campaign]) -> list[Campaign]:
    for campaign in several(campaigns):
        require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    for campaign in campaigns:
        if len(campaign.tests) < _LEAST_TESTS:
            found = f"{campaign.name} has {len(campaign.tests)}"
            raise UsageError(f"An archive learns from vehicles with {_LEAST_TESTS} tests or more; {found}.")
    if len(campaigns) < LEAST_VEHICLES:
        raise UsageError(f"An archive takes {LEAST_VEHICLES} campaigns or more, not {len(campaigns)}.")
    for one, other in combinations(campaigns, 2):
        if one.name == other.name or _past(one).is_of(other.cae.fingerprint, other.tests):
            names = read_out([repr(one.name), repr(other.name)])
            raise UsageError(f"Two of the campaigns, {names}, share their name, tests or CAE runs: give each once.")
    return sorted(campaigns, key=lambda campaign: campaign.name)


def _past(campaign: Campaign) -> PastVehicle:
    return PastVehicle(campaign.name, campaign.cae.fingerprint, tuple(test.digest for test in campaign.tests))
