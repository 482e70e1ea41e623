"""Learning of an archive: what past vehicles teach the next one, and how each of them, left out, is predicted with it.

Left out is a vehicle with all its tests and CAE runs: from the tuned network, the weights and the errors.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
import pandas as pd

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.calibration import STRIDE
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.fit_cache import fitted
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
from crashfuse.approaches.settings import Settings
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError, require_a
from crashfuse.execution.cache import Cache, Entry, numbers
from crashfuse.execution.code_digest import code_digest
from crashfuse.execution.process import one_thread_throughout
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.files.tensors import Arrays
from crashfuse.signals.metrics import METRIC_LABELS, metric_values
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse, in_full
from crashfuse.signals.rating import rate_windows
from crashfuse.study.learning_curve import subsets
from crashfuse.study.running import workers_at
from crashfuse.vehicle_archive import LEAST_VEHICLES, PastVehicle, Prior, VehicleArchive, differences
from crashfuse.wording import read_out

SIZES = (1, 2, 3, 4, 6)
"""Numbers of tests that a vehicle of the archive is predicted from."""

_OF_ERRORS = (2, 4)  # those that usual errors are learned from
_LEAST_TESTS, _MOST_TESTS = 4, 14  # of a vehicle, and that the network is tuned to
_WINDOW_MS = 60.0
_JUDGED = slice(round(_WINDOW_MS / 1e3 / (STRIDE * DT_S)))
_DRAWS = 100
_COUNT = 10.0  # left-out tests that all those of a vehicle count as, as they are predicted from the same ones
_PARTS, _NETWORKS = "archive parts", "archive networks"  # kinds of cache entries

R = TypeVar("R")
T = TypeVar("T")
_Chosen = tuple[str, ...]  # ids of the tests that are learned from
_Members = tuple[int, ...]  # numbers of vehicles of the archive


@dataclass(frozen=True, eq=False)
class _LikeAny(Prior):
    """What vehicles teach one of a like kind: whether it is one is not asked while they are learned from."""

    def likeness(self, found: FloatArray) -> float:  # noqa: ARG002 - see above
        return np.inf


@dataclass(frozen=True)
class _Run:
    """Computes tasks on all cores, in order."""

    cache: Cache
    watch: Watch
    workers: int | None

    def each(
        self, work: Callable[..., list[tuple[T, R]]], campaign: Campaign, tasks: Sequence[T], step: str
    ) -> list[R]:
        done = dict[T, R]()
        with (
            workers_at(None, self.workers) as place,
            closing(place.completed(work, campaign, tasks, self.cache, self.watch)) as completed,
        ):
            for results in completed:
                done.update(results)
                self.watch.report(step, len(done), len(tasks))
        return [done[task] for task in tasks]


def learn_archive(
    campaigns: Sequence[Campaign],
    *,
    seed: int = 0,
    cache: Cache | None = None,
    watch: Watch = SILENT,
    workers: int | None = None,
) -> VehicleArchive:
    """Learn what three or more campaigns teach the next vehicle; what is finished stays in the cache.

    Raises
    ------
    UsageError
        If there are too few campaigns, one has fewer than four tests, or two share a name, tests or CAE runs.
    Cancelled
        If the watch was told to stop.
    """
    campaigns = [replace(campaign, prior=None) for campaign in _checked(campaigns)]
    run = _Run(cache or Cache(), watch, workers)
    vehicles = [_prepared(campaign, seed, run) for campaign in campaigns]
    everyone = tuple(range(len(campaigns)))
    without = [_less(everyone, number) for number in everyone]
    wanted = sorted({everyone, *without, *(_less(members, member) for members in without for member in members)})
    work = partial(_tuned, vehicles=vehicles, seed=seed)
    weights = run.each(work, campaigns[0], wanted, "Tuning of the pre-trained network")
    networks = dict(zip(wanted, weights, strict=True))
    learning = _Learning(campaigns, vehicles, networks, seed, run)
    priors = [learning.prior(members) for members in (everyone, *without)]
    rows = [row for number in everyone for row in learning.record(number, priors[1 + number])]
    past = [PastVehicle(c.name, c.cae.fingerprint, tuple(test.digest for test in c.tests)) for c in campaigns]
    return VehicleArchive(tuple(past), priors[0], tuple(priors[1:]), pd.DataFrame(rows), seed)


def _checked(campaigns: Sequence[Campaign]) -> list[Campaign]:
    for campaign in campaigns:
        require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
        if len(campaign.tests) < _LEAST_TESTS:
            found = f"{campaign.name} has {len(campaign.tests)}"
            raise UsageError(f"An archive learns from vehicles with {_LEAST_TESTS} tests or more; {found}.")
    if len(campaigns) < LEAST_VEHICLES:
        raise UsageError(f"An archive takes {LEAST_VEHICLES} campaigns or more, not {len(campaigns)}.")
    for number, campaign in enumerate(campaigns):
        for other in campaigns[:number]:
            past = PastVehicle(other.name, other.cae.fingerprint, tuple(test.digest for test in other.tests))
            if other.name == campaign.name or past.is_of(campaign.cae.fingerprint, campaign.tests):
                names = read_out([repr(other.name), repr(campaign.name)])
                raise UsageError(f"Two of the campaigns, {names}, share their name, tests or CAE runs: give each once.")
    return sorted(campaigns, key=lambda campaign: campaign.name)


def _less(members: tuple[int, ...], out: int) -> tuple[int, ...]:
    return tuple(member for member in members if member != out)


def _parts_chosen(campaign: Campaign, sizes: Sequence[int] = SIZES) -> list[_Chosen]:
    return [part.chosen for part in subsets(campaign, 0, 0) if len(part.chosen) in sizes]


def _split(campaign: Campaign, chosen: _Chosen) -> tuple[Campaign, list[CrashTest]]:
    held_out = [test for test in campaign.tests if test.id not in chosen]
    return campaign.without([test.id for test in held_out]), held_out


def _prepared(campaign: Campaign, seed: int, run: _Run) -> Vehicle:
    """Predict a vehicle's tests by both approaches from a few others; its tests as the network reads them."""
    settings = Settings(seed=seed, cache=run.cache)
    conditions = [test.condition for test in campaign.tests]
    for approach in (TimeDomain, DisplacementDomain):
        approach.create(settings).prepare(replace(campaign, tests=()), conditions, run.watch)
    work = partial(_predicted, seed=seed)
    run.each(work, campaign, _parts_chosen(campaign), f"{campaign.name}: predictions from few tests")
    few, model = campaign.evenly_over_speed(_MOST_TESTS), CaeModel(cache=run.cache).fit(campaign.cae, run.watch)
    tests = Tests.of(few, model)
    vectors = np.array([test.condition.vector for test in few.tests])
    return Vehicle(tests.measured_mps2[:, ::STRIDE], tests.cae_mps2[:, ::STRIDE], vectors)


def _predicted(
    campaign: Campaign, chosen: _Chosen, cache: Cache, watch: Watch, *, seed: int
) -> list[tuple[_Chosen, bool]]:
    _parts(campaign, chosen, cache, watch, seed)
    return [(chosen, True)]


def _parts(campaign: Campaign, chosen: _Chosen, cache: Cache, watch: Watch, seed: int) -> dict[str, list[Component]]:
    """Time and displacement domain at each test that was not chosen, on every tenth sample; kept in the cache."""
    rest, held_out = _split(replace(campaign, prior=None), chosen)

    def predict() -> tuple[FloatArray, Entry]:
        settings = Settings(seed=seed, cache=cache)
        with one_thread_throughout():
            fits = [fitted(kind.create(settings), rest, cache, watch)[0] for kind in (TimeDomain, DisplacementDomain)]
            predictions = [fit.predict(test.condition) for test in held_out for fit in fits]
        rows = [
            np.vstack([own.accel_mps2, own.draws_mps2[:_DRAWS]])[:, ::STRIDE]
            for own in predictions
            if own.draws_mps2 is not None
        ]
        pulses = np.array(rows).reshape(len(held_out), len(fits), 1 + _DRAWS, -1)
        return pulses, {"pulses": pulses}

    key = {"campaign": rest.fingerprint, "held_out": [test.digest for test in held_out], "seed": seed}
    key |= {"code": code_digest(__name__)}
    pulses = cache.get_or_compute(_PARTS, key, predict, lambda entry: numbers(entry, "pulses", *[None] * 4), watch)
    return {
        test.id: [Component(own[0], own[1:]) for own in of_test] for test, of_test in zip(held_out, pulses, strict=True)
    }


def _tuned(
    campaign: Campaign,  # noqa: ARG001 - a task is of a campaign; this one is of several
    members: _Members,
    cache: Cache,
    watch: Watch,
    *,
    vehicles: Sequence[Vehicle],
    seed: int,
) -> list[tuple[_Members, Arrays]]:
    """Weights of the network that were tuned to these vehicles; kept in the cache."""
    mine = [vehicles[member] for member in members]

    def tune() -> tuple[Arrays, Arrays]:
        weights = tuned(mine, seed, watch)
        return weights, weights

    digest = hashlib.sha256(b"".join(rows.tobytes() for vehicle in mine for rows in vehicle)).hexdigest()
    key = {"vehicles": digest, "seed": seed, "code": code_digest(Vehicle.__module__)}
    return [(members, cache.get_or_compute(_NETWORKS, key, tune, dict, watch))]


@dataclass(frozen=True, eq=False)
class _Learning:
    """What is learned from vehicles once their parts and networks are known."""

    campaigns: Sequence[Campaign]
    vehicles: Sequence[Vehicle]
    networks: Mapping[_Members, Arrays]
    seed: int
    run: _Run

    def _each(
        self, work: Callable[..., list[tuple[_Chosen, R]]], number: int, prior: Prior | None, sizes: Sequence[int]
    ) -> list[R]:
        campaign = replace(self.campaigns[number], prior=prior)
        step = f"{campaign.name}: predicted with the others"
        return self.run.each(partial(work, seed=self.seed), campaign, _parts_chosen(campaign, sizes), step)

    def prior(self, members: _Members) -> Prior:
        """What these vehicles teach."""
        names = tuple(self.campaigns[member].name for member in members)
        off = np.array(
            [
                differences(own.measured, own.cae, own.conditions[:, 0]).mean(axis=0)
                for own in (self.vehicles[member] for member in members)
            ]
        )
        others = {member: _LikeAny(names, self.networks[_less(members, member)], PRIOR, {}, off) for member in members}
        scores = {
            member: [pair for of_part in self._each(_scored, member, others[member], SIZES) for pair in of_part]
            for member in members
        }
        taught = [score for pairs in scores.values() for score, _ in pairs]
        logits = Pool(strength=STRENGTH * _COUNT * len(members) / len(taught)).fit([*taught]).logits_
        weighted, usual = Pool(logits).fit([]), Pool().fit([])
        gains = [
            np.mean([_crps(usual, without) - _crps(weighted, score) for score, without in pairs])
            / np.mean([_crps(usual, without) for _, without in pairs])
            for pairs in scores.values()
        ]
        errors: dict[str, list[float]] = {name: [] for name in METRIC_LABELS}
        for member in members:
            off_by = [
                row
                for rows in self._each(_errors, member, replace(others[member], logits=logits), _OF_ERRORS)
                for row in rows
            ]
            for name in errors:
                values = np.array([row[name] for row in off_by])
                known = values[np.isfinite(values)]
                if known.size:
                    errors[name] += [known.mean() - known.std(), known.mean() + known.std()]
        usual_errors = {name: np.array(values) for name, values in errors.items() if values}
        return Prior(names, self.networks[members], logits, usual_errors, off, helps=bool(np.mean(gains) > 0))

    def record(self, number: int, prior: Prior) -> Iterator[dict[str, object]]:
        """How a vehicle is predicted with what the others teach, and without, by number of tests."""
        name = self.campaigns[number].name
        for size in SIZES:
            ways = [self._each(_judged, number, own, (size,)) for own in (prior, None)]
            if not all(ways):
                continue
            with_archive, without = (pd.DataFrame([row for rows in way for row in rows]) for way in ways)
            widths = with_archive.filter(like="width ").to_numpy() / without.filter(like="width ").to_numpy()
            row = {"vehicle": name, "n_tests": size, "predicted": len(without)}
            row |= {"rating": with_archive["rating"].mean(), "rating_without": without["rating"].mean()}
            for column, table in (("inside", with_archive), ("inside_without", without)):
                row[column] = float(np.nanmean(table.filter(like="inside ").to_numpy(dtype=float)))
            yield row | {"width": float(np.exp(np.nanmean(np.log(widths))))}


def _crps(pool: Pool, scores: Scores) -> float:
    return scores.crps(pool.weights(scores.spreads))


def _scored(
    campaign: Campaign, chosen: _Chosen, cache: Cache, watch: Watch, *, seed: int
) -> list[tuple[_Chosen, list[tuple[Scores, Scores]]]]:
    """Scores of the components at each test that was not chosen: with the tuned network, and with the shipped one."""
    parts, (rest, held_out) = _parts(campaign, chosen, cache, watch, seed), _split(campaign, chosen)
    with one_thread_throughout():
        networks = [Pretrained(seed=seed, cache=cache).fit(own) for own in (rest, replace(rest, prior=None))]
        tests = Tests.of(rest, networks[0].model_)

        def score(test: CrashTest, network: Pretrained) -> Scores:
            cae = network.model_.pulse(test.condition).accel_mps2
            prediction, raw = network.predict(test.condition), tests.raw(cae, test.condition.speed_mps)
            drawn = [
                *(part.draws for part in parts[test.id]),
                *(own[:, ::STRIDE] for own in (prediction.draws_mps2, raw.draws) if own is not None),
            ]
            return Scores.of(test.pulse.accel_mps2[::STRIDE][_JUDGED], [draws[:, _JUDGED] for draws in drawn])

        return [(chosen, [(score(test, networks[0]), score(test, networks[1])) for test in held_out])]


def _fused(
    campaign: Campaign, chosen: _Chosen, cache: Cache, watch: Watch, seed: int
) -> Iterator[tuple[CrashTest, Fused, Prediction]]:
    """The fused prediction of each test that was not chosen."""
    parts, (rest, held_out) = _parts(campaign, chosen, cache, watch, seed), _split(campaign, chosen)
    with one_thread_throughout():
        fused = Fused(seed=seed, cache=cache).fit(rest)
        for test in held_out:
            said = [
                Prediction(test.condition, in_full(part.mean, STRIDE), in_full(part.draws, STRIDE))
                for part in parts[test.id]
            ]
            yield test, fused, fused.predict_from(test.condition, said)


def _errors(
    campaign: Campaign, chosen: _Chosen, cache: Cache, watch: Watch, *, seed: int
) -> list[tuple[_Chosen, list[dict[str, float]]]]:
    """Standardised errors of the metrics of each test that was not chosen."""
    found = []
    for test, _, prediction in _fused(campaign, chosen, cache, watch, seed):
        drawn, measured = drawn_metrics(prediction, campaign.occupant), _metrics(test, campaign)
        found.append({name: standardised_error(drawn[name], measured[name], name) for name in METRIC_LABELS})
    return [(chosen, found)]


def _judged(
    campaign: Campaign, chosen: _Chosen, cache: Cache, watch: Watch, *, seed: int
) -> list[tuple[_Chosen, list[dict[str, float]]]]:
    """Rating, and for each metric whether the test lies in its interval and how wide that is."""
    rows, errors = [], None
    for test, fused, prediction in _fused(campaign, chosen, cache, watch, seed):
        if errors is None:
            rest = _split(campaign, chosen)[0]
            errors = metric_errors(fused.left_out(rest), rest, fused.usual_errors)
        pulse = Pulse(GRID_S, prediction.accel_mps2)
        row = {"rating": rate_windows(test.pulse, pulse, [_WINDOW_MS])[_WINDOW_MS].overall}
        measured = _metrics(test, campaign)
        for name, distribution in metric_distributions(drawn_metrics(prediction, campaign.occupant), errors).items():
            lower, upper = (None, None) if distribution is None else distribution.interval
            row |= {f"inside {name}": np.nan, f"width {name}": np.nan}
            if lower is not None and upper is not None and np.isfinite(measured[name]):
                row |= {f"inside {name}": float(lower <= measured[name] <= upper), f"width {name}": upper - lower}
        rows.append(row)
    return [(chosen, rows)]


def _metrics(test: CrashTest, campaign: Campaign) -> dict[str, float]:
    values = metric_values(test.pulse.accel_mps2, test.condition.speed_mps, occupant=campaign.occupant)
    return {name: float(value) for name, value in values.items()}
