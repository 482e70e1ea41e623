"""Vehicles drawn at random, whose true behaviour is known: what the other benchmarks learn from and judge by.

``World.of`` draws a sister of the sample campaign's vehicle. ``World.any`` draws one of many kinds: small cars to
pickup trucks, soft or stiff, engines that reach the barrier early, late or never, few long folds or many short ones,
CAE models that are nearly right or far off, and on some vehicles folds that begin elsewhere in each crash. Their models
know no rates and are too soft; those of ``World.tuned`` were made to crush as far as the vehicle at its top speed.
``World.relative`` draws members of families, whose CAE models err alike for the most part.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.stats import qmc

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray, Pulse
from crashfuse.study.planning import ConditionRange
from crashfuse.synthetic.vehicle import (
    CAE_MODEL,
    SENSOR_NOISE_MPS2,
    TRUTH,
    Coupling,
    CrushZone,
    Vehicle,
    scattered,
    simulate,
)
from crashfuse.units import LB, MPH

SAMPLE_RANGE = ConditionRange(
    Condition.of_vector([8.0 * MPH, 1922.0 * LB, 1349.0 * LB]),
    Condition.of_vector([35.2 * MPH, 2185.0 * LB, 1770.0 * LB]),
)  # of the sample campaign, without the slowest
_BEFORE_CONTACT = 250  # samples, for the filter
NOISE_SAMPLES = N_SAMPLES + 2 * _BEFORE_CONTACT  # of a record, with those before contact
CRUSH_M = np.arange(0.0, 1.1, 0.005)  # knots of a drawn zone: its folds are part of the curve
NEVER_M = 2.0  # a gap that is never closed


@dataclass(frozen=True)
class World:
    """A vehicle that can be tested at any condition.

    Attributes
    ----------
    range : ConditionRange
        Conditions that its CAE runs cover.
    scatter : float
        How much specimens differ, as a multiple of what those of the sample campaign do.
    folding_m : float
        Standard deviation by which the folds of a specimen have moved after half a metre of crush.
    """

    model: Vehicle
    truth: Vehicle
    cae: CaeLibrary
    seed: int
    range: ConditionRange = SAMPLE_RANGE
    scatter: float = 1.0
    folding_m: float = 0.0

    @classmethod
    def of(cls, seed: int, n_runs: int = 240) -> Self:
        """Draw a sister of the sample's vehicle, and run its CAE model over the whole range and slightly beyond."""
        rng = np.random.default_rng([seed, 0])
        model, truth = _another(CAE_MODEL, rng), _another(TRUTH, rng)
        low, high = SAMPLE_RANGE.low.vector * [0.6, 1, 1], SAMPLE_RANGE.high.vector
        conditions = _spread_out(low, high, n_runs, seed)
        return cls(model, truth, _library(recorded([model], conditions, None), conditions), seed)

    @classmethod
    def any(cls, seed: int, n_runs: int = 0) -> Self:
        """Draw a vehicle of any kind; ``n_runs`` CAE runs, or 70 to 400 if 0."""
        rng = np.random.default_rng([seed, 7])
        mass = float(np.exp(rng.uniform(np.log(900.0), np.log(2600.0))))
        front = mass * rng.uniform(0.48, 0.64)
        weights = np.array([front, mass - front])
        truth = _drawn_vehicle(mass, rng)
        model = _misjudged(truth, float(np.exp(0.4 * rng.standard_normal())), rng)
        top = rng.uniform(33.0, 41.0) * MPH
        low, high = (np.array([v, *share * weights]) for v, share in ((8 * MPH, 0.92), (top, 1.08)))
        folds = rng.random() < 0.5
        folding = float(np.exp(rng.normal(np.log(0.012), 0.5))) if folds else 0.0
        scatter = float(np.exp(0.4 * rng.standard_normal()))
        conditions = _spread_out(low * [0.7, 1, 1], high, n_runs or int(np.exp(rng.uniform(4.25, 6.0))), seed)
        reach = ConditionRange(Condition.of_vector(low), Condition.of_vector(high.tolist()))
        return cls(model, truth, runs_of(model, conditions, folding, seed), seed, reach, scatter, folding)

    @classmethod
    def tuned(cls, seed: int) -> Self:
        """The vehicle of :meth:`any`, its CAE model's forces scaled to the vehicle's crush at the top speed."""
        world = cls.any(seed)
        low, high = world.range.low, world.range.high
        fast = Condition.of_vector([high.speed_mps, *(0.5 * (low.vector + high.vector)[1:]).tolist()])
        share = brentq(
            lambda own: _crush(_stronger(world.model, own), fast) - _crush(world.truth, fast), 0.3, 3, xtol=1e-3
        )
        model = _stronger(world.model, share)
        return replace(world, model=model, cae=runs_of(model, world.cae.conditions, world.folding_m, seed))

    @classmethod
    def relative(cls, seed: int) -> Self:
        """A member of the family of ``any(seed // 100)``: it and its CAE model differ from those by the same factors.

        8 % in forces, 2 cm in gaps, 5 % in the length of folds; the CAE model by 5 %, 1 cm and 2 % besides.
        """
        family = cls.any(seed // 100)
        truth, model = (
            varied(vehicle, 0.08, 0.08, 0.02, np.random.default_rng([seed, 1]), stretch=0.05)
            for vehicle in (family.truth, family.model)
        )
        model = varied(model, 0.05, 0.05, 0.01, np.random.default_rng([seed, 2]), stretch=0.02)
        heavier = float(np.exp(0.06 * np.random.default_rng([seed, 3]).standard_normal()))
        low, high = (end.vector * [1, heavier, heavier] for end in (family.range.low, family.range.high))
        conditions = _spread_out(low * [0.7, 1, 1], high, 120 if seed % 2 else 240, seed)
        reach = ConditionRange(Condition.of_vector(low.tolist()), Condition.of_vector(high.tolist()))
        cae = runs_of(model, conditions, family.folding_m, seed)
        return cls(model, truth, cae, seed, reach, family.scatter, family.folding_m)

    def conditions(self, rng: np.random.Generator, n: int) -> list[Condition]:
        """Draw conditions at random in the range."""
        vectors = rng.uniform(self.range.low.vector, self.range.high.vector, (n, 3))
        return [Condition.of_vector(vector) for vector in vectors]

    def over_speed(self, rng: np.random.Generator, n: int) -> list[Condition]:
        """Conditions evenly over the speeds of the range, at random weights."""
        speeds = np.linspace(self.range.low.speed_mps, self.range.high.speed_mps, n).tolist()
        return [replace(c, speed_mps=v) for v, c in zip(speeds, self.conditions(rng, n), strict=True)]

    def library(self, tests: Sequence[CrashTest]) -> CaeLibrary:
        """The CAE runs, and one at the condition of each test."""
        conditions = tuple(test.condition for test in tests)
        paired = recorded([self.model], conditions, None).astype(np.float32)
        ids = (*self.cae.ids, *(f"CAE-{test.id}" for test in tests))
        return CaeLibrary(ids, (*self.cae.conditions, *conditions), np.vstack([self.cae.accel_mps2, paired]))

    def test(self, conditions: Sequence[Condition], first: int) -> tuple[CrashTest, ...]:
        """Run one test per condition, numbered from ``first``: equal numbers have equal scatter and noise."""
        streams = [np.random.default_rng([self.seed, 1, first + i]) for i in range(len(conditions))]
        specimens = [folded_elsewhere(self._specimen(rng), self.folding_m, rng) for rng in streams]
        noise = np.array([rng.normal(0.0, SENSOR_NOISE_MPS2, NOISE_SAMPLES) for rng in streams])
        pulses = recorded(specimens, conditions, noise)
        return tuple(
            CrashTest(f"T{first + i}", condition, Pulse(GRID_S, pulse))
            for i, (condition, pulse) in enumerate(zip(conditions, pulses, strict=True))
        )

    def campaign(self, n_tests: int, *, paired: bool = True) -> Campaign:
        """A campaign of tests evenly over speed, with a CAE run for each or none."""
        tests = self.test(self.over_speed(np.random.default_rng([self.seed, 3]), n_tests), first=0)
        return Campaign(f"vehicle {self.seed}", self.library(tests) if paired else self.cae, tests)

    def _specimen(self, rng: np.random.Generator) -> Vehicle:
        if len(self.truth.rails.force_n) < len(CRUSH_M):
            return scattered(self.truth, rng)
        return varied(self.truth, 0.02 * self.scatter, 0.02 * self.scatter, 0.004 * self.scatter, rng)


KINDS: Mapping[str, Callable[[int], World]] = {
    "sister": World.of,
    "relative": World.relative,
    "any": World.any,
    "tuned": World.tuned,
}
"""Ways to draw a vehicle by its seed."""
NAMES = {"sister": "sisters", "relative": "relatives", "any": "of any kind", "tuned": "tuned"}


def metrics_of(accel_mps2: FloatArray, condition: Condition) -> dict[str, float]:
    """All metrics of a pulse."""
    return {name: float(value) for name, value in metric_values(accel_mps2, condition.speed_mps).items()}


def _another(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """A similar vehicle: each zone's forces differ by 10 % as a whole and 8 % at each knot, and so on."""

    def zone(old: CrushZone) -> CrushZone:
        factors = np.exp(0.1 * rng.standard_normal() + 0.08 * rng.standard_normal(len(old.force_n)))
        gap, fold, length = rng.standard_normal(3)
        return replace(
            old,
            force_n=tuple((np.array(old.force_n) * factors).tolist()),
            gap_m=old.gap_m * np.exp(0.1 * gap),
            fold_share=old.fold_share * np.exp(0.2 * fold),
            fold_length_m=old.fold_length_m * np.exp(0.1 * length),
        )

    return by_zone(vehicle, zone)


def by_zone(vehicle: Vehicle, changed: Callable[[CrushZone], CrushZone]) -> Vehicle:
    """The vehicle with each of its crush zones changed."""
    rails, shell, engine, firewall = map(changed, (vehicle.rails, vehicle.shell, vehicle.engine, vehicle.firewall))
    return replace(vehicle, rails=rails, shell=shell, engine=engine, firewall=firewall)


def _stronger(vehicle: Vehicle, share: float) -> Vehicle:
    def zone(old: CrushZone) -> CrushZone:
        forces = tuple((share * np.array(old.force_n)).tolist())
        return replace(old, force_n=forces, unloading_npm=old.unloading_npm * max(share, 1))

    return by_zone(vehicle, zone)


def _crush(vehicle: Vehicle, condition: Condition) -> float:
    pulses = recorded([vehicle], [condition], None)
    return metrics_of(pulses[0], condition)["max_crush"]


def runs_of(model: Vehicle, conditions: tuple[Condition, ...], folding_m: float, seed: int) -> CaeLibrary:
    """CAE runs: folds do not vary with the specimen, but with the condition they begin elsewhere, too."""
    streams = [np.random.default_rng([seed, 8, i]) for i in range(len(conditions))]
    models = [folded_elsewhere(model, 0.3 * folding_m, own) for own in streams] if folding_m else [model]
    return _library(recorded(models, conditions, None), conditions)


def scattered_about(rng: np.random.Generator, value: float, spread: float) -> float:
    """A number whose logarithm has this standard deviation."""
    return float(value * np.exp(spread * rng.standard_normal()))


def _drawn_vehicle(mass_kg: float, rng: np.random.Generator) -> Vehicle:
    """A vehicle of any kind that stops 15.6 m/s within about 0.5 to 0.85 m, and the stiffer the deeper it is crushed.

    Peaks and crushes are spread, and grow with speed, as in measured tests (``benchmarks/population.py``).
    """
    about = partial(scattered_about, rng)
    force = mass_kg * 15.6**2 / 2 / rng.uniform(0.47, 0.88)  # mean barrier force at 35 mph
    rails, shell = rng.uniform(0.35, 0.75), rng.uniform(0.15, 0.6)
    box, second = rng.uniform(0.14, 0.35), rng.uniform(0.35, 0.63)
    rate = about(1400.0, 0.4)

    def zone(knots_m: Sequence[float], shares: npt.ArrayLike, gap_m: float, folds: float = 0.0) -> CrushZone:
        base = force * np.interp(CRUSH_M, knots_m, np.asarray(shares) * np.exp(0.1 * rng.standard_normal(len(knots_m))))
        waves = folds * np.sin(2 * np.pi * CRUSH_M / about(0.11, 0.35) + rng.uniform(0, 2 * np.pi))
        curve = base * (1 + waves) * np.exp(wandering(0.06, 0.08, rng))
        return CrushZone(
            tuple(CRUSH_M.tolist()), tuple(curve.tolist()), about(60.0, 0.2) * force, gap_m=gap_m, rate_mps=rate
        )

    engine_gap = NEVER_M if rng.random() < 0.15 else rng.uniform(0.3, 0.7)
    return Vehicle(
        powertrain_kg=mass_kg * rng.uniform(0.09, 0.16),
        rear_share=rng.uniform(0.1, 0.4),
        rails=zone(
            (0, 0.02, 0.05, box, box + 0.05, second, 1.0),
            (0, 0.05 * rails, *[0.5 * rails] * 2, rails, rails, rails * rng.uniform(0.8, 3.0)),
            0.0,
            rng.uniform(0.05, 0.4),
        ),
        shell=zone(
            (0, 0.08, 0.42, 0.84, 1.0),
            shell * np.array([0, 0.2, 1.0, 1.5, 4.0]),
            rng.uniform(0.03, 0.2),
            0.1 * rng.random(),
        ),
        engine=zone((0, 0.03, 0.15, 0.3), np.array([0, 1.0, 2.7, 5.4]) * about(1, 0.3), engine_gap),
        firewall=zone((0, 0.06, 0.2, 0.3), np.array([0, 0.55, 1.6, 2.7]) * about(1, 0.3), rng.uniform(0.07, 0.2)),
        mounts=Coupling(about(6.0, 0.4) * force, about(0.012, 0.5) * force, about(0.1, 0.4) * force),
        rear=Coupling(about(25.0, 0.4) * force, about(0.07, 0.5) * force),
    )


def _misjudged(truth: Vehicle, bias: float, rng: np.random.Generator) -> Vehicle:
    """A CAE model of this vehicle: no rate effect, forces, gaps, folds and joints off by multiples of ``bias``."""
    model = varied(truth, 0.08 * bias, 0.1 * bias, 0.02 * bias, rng, stretch=0.08 * bias)
    stiffness, damping, strength, rear_stiffness, rear_damping, powertrain = np.exp(
        0.3 * bias * rng.standard_normal(6)
    ).tolist()
    mounts, rear = truth.mounts, truth.rear
    return replace(
        by_zone(model, lambda zone: replace(zone, rate_mps=np.inf)),
        powertrain_kg=truth.powertrain_kg * powertrain**0.2,
        mounts=Coupling(mounts.stiffness_npm * stiffness, mounts.damping_nspm * damping, mounts.strength_n * strength),
        rear=Coupling(rear.stiffness_npm * rear_stiffness, rear.damping_nspm * rear_damping),
    )


def varied(
    vehicle: Vehicle, whole: float, along: float, gap_m: float, rng: np.random.Generator, *, stretch: float = 0.01
) -> Vehicle:
    """Forces off as a whole and along the crush, gaps moved, folds stretched."""

    def zone(old: CrushZone) -> CrushZone:
        factors = np.exp(whole * rng.standard_normal() + wandering(along, 0.15, rng))
        length = np.exp(stretch * rng.standard_normal())
        curve = np.interp(CRUSH_M * length, CRUSH_M, old.force_n)
        gap = abs(old.gap_m + gap_m * rng.standard_normal()) if old.gap_m else 0.0
        return replace(old, force_n=tuple((curve * factors).tolist()), gap_m=gap)

    return by_zone(vehicle, zone)


def folded_elsewhere(vehicle: Vehicle, folding_m: float, rng: np.random.Generator) -> Vehicle:
    """Folds of rails and shell that drift from where they were, and in one of four crashes jump once."""
    if not folding_m:
        return vehicle

    def zone(old: CrushZone) -> CrushZone:
        walk = np.cumsum(rng.standard_normal(CRUSH_M.size)) * np.sqrt(CRUSH_M[1] / 0.5) * folding_m
        jump = (rng.random() < 0.25) * 3 * folding_m * np.sign(rng.standard_normal())
        start = rng.uniform(0.1, 0.4)
        moved = CRUSH_M + walk + jump / (1 + np.exp(-np.clip((CRUSH_M - start) / 0.015, -50, 50)))
        fade = 1 - np.exp(-CRUSH_M / 0.03)  # contact begins where it did
        return replace(old, force_n=tuple(np.interp(CRUSH_M + (moved - CRUSH_M) * fade, CRUSH_M, old.force_n).tolist()))

    return replace(vehicle, rails=zone(vehicle.rails), shell=zone(vehicle.shell))


def wandering(size: float, length_m: float, rng: np.random.Generator) -> FloatArray:
    """A smooth random function of crush with this standard deviation and length scale."""
    phases, waves = rng.uniform(0, 2 * np.pi, 12), rng.standard_normal(12) / length_m
    curve: FloatArray = size * np.sqrt(2 / 12) * np.cos(np.multiply.outer(CRUSH_M, waves) + phases).sum(axis=1)
    return curve


def _spread_out(low: FloatArray, high: FloatArray, n: int, seed: int) -> tuple[Condition, ...]:
    vectors = qmc.scale(qmc.LatinHypercube(d=3, rng=seed).random(n), low, high)
    return tuple(Condition.of_vector(vector) for vector in vectors)


def _library(pulses: FloatArray, conditions: tuple[Condition, ...]) -> CaeLibrary:
    return CaeLibrary(tuple(map(str, range(len(conditions)))), conditions, pulses.astype(np.float32))


def recorded(vehicles: Sequence[Vehicle], conditions: Sequence[Condition], noise: FloatArray | None) -> FloatArray:
    """Pulses on the study grid, CFC 60, of one vehicle at all conditions or of one for each."""
    n_samples = N_SAMPLES + _BEFORE_CONTACT
    fleet = vehicles[0] if len(vehicles) == 1 else vehicles
    records = np.pad(simulate(fleet, conditions, n_samples).accel_mps2, ((0, 0), (_BEFORE_CONTACT, 0)))
    filtered = cfc_filter(records + (0.0 if noise is None else noise), cfc=60, dt_s=DT_S)
    return filtered[:, _BEFORE_CONTACT : _BEFORE_CONTACT + N_SAMPLES]
