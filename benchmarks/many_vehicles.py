"""Vehicles of many kinds, for learning: tests, and what a CAE model of the vehicle says at the same conditions.

Broader than ``World.any``, by which predictions are judged: each kind of error of the CAE model (forces, where folds
begin and how long they are, gaps, joints) has a size of its own, from negligible to another vehicle's, and in half of
the vehicles the structure around the sensor rings, in the CAE model at another frequency.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Self

import numpy as np
from scipy.signal import bilinear, lfilter
from vehicles import CRUSH_M, NEVER_M, NOISE_SAMPLES, folded_elsewhere, recorded, scattered_about, varied, wandering

from crashfuse.approaches.calibration import STRIDE
from crashfuse.condition import Condition
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray
from crashfuse.synthetic.vehicle import SENSOR_NOISE_MPS2, Coupling, CrushZone, Vehicle
from crashfuse.units import MPH

TESTS = 14  # of each vehicle
AT_ONCE = 32  # vehicles simulated together
_HIGHEST_MPS2 = 3000.0
_CAE_SPEED_CHANGE, _TEST_SPEED_CHANGE = (-1.5, -0.6), (-1.4, -0.9)  # in 100 ms, in impact speeds; others are left out


class Pulses(NamedTuple):
    """Tests and CAE pulses, shape (n, 14, 125), m/s², and conditions, shape (n, 14, 3): m/s and kg."""

    measured: FloatArray
    cae: FloatArray
    conditions: FloatArray


@dataclass(frozen=True)
class _Zone:
    """A crush zone by what it is made of: a curve, folds of two lengths, and what wanders along the crush."""

    knots_m: FloatArray
    force_n: FloatArray
    fold_share: float
    fold_length_m: float
    phase: float
    short_share: float
    wander: FloatArray
    gap_m: float
    unloading_npm: float
    rate_mps: float

    def built(self) -> CrushZone:
        folds = self.fold_share * np.sin(2 * np.pi * CRUSH_M / self.fold_length_m + self.phase)
        folds += self.short_share * np.sin(2 * np.pi * CRUSH_M / (0.45 * self.fold_length_m) + 2.3 * self.phase)
        curve = np.maximum(np.interp(CRUSH_M, self.knots_m, self.force_n) * (1 + folds) * np.exp(self.wander), 0)
        steepest = 1.2 * np.abs(np.diff(curve)).max() / CRUSH_M[1]  # or it would give back more than it took
        unloading = max(self.unloading_npm, steepest)
        return CrushZone(tuple(CRUSH_M.tolist()), tuple(curve.tolist()), unloading, self.gap_m, rate_mps=self.rate_mps)


@dataclass(frozen=True)
class _Kind:
    """A vehicle by what it is made of."""

    zones: dict[str, _Zone]
    powertrain_kg: float
    rear_share: float
    mounts: Coupling
    rear: Coupling

    @classmethod
    def drawn(cls, mass_kg: float, rng: np.random.Generator) -> Self:
        """A vehicle of any kind."""
        about = partial(scattered_about, rng)
        force = mass_kg * 15.6**2 / 2 / rng.uniform(0.38, 0.98)  # mean barrier force at 35 mph
        rails, shell = rng.uniform(0.3, 0.8), rng.uniform(0.1, 0.65)
        box, second = rng.uniform(0.08, 0.4), rng.uniform(0.25, 0.7)
        rate = about(1400.0, 0.5)

        def zone(
            knots_m: Sequence[float], shares: Sequence[float], gap_m: float, folds: float = 0.0, short: float = 0.0
        ) -> _Zone:
            forces = force * np.array(shares) * np.exp(0.12 * rng.standard_normal(len(knots_m)))
            return _Zone(
                np.array(knots_m), forces, folds, about(0.115, 0.35), rng.uniform(0, 2 * np.pi), short,
                wandering(0.06, 0.08, rng), gap_m, about(60.0, 0.3) * force, rate if rng.random() < 0.75 else np.inf,
            )  # fmt: skip

        rail_knots = (0, 0.02, 0.05, box, box + 0.05, second + 0.06, 1.05)
        rail_shares = (
            0, 0.05 * rails, 0.5 * rails, 0.5 * rails, rails,
            rails * rng.uniform(0.6, 1.6), rails * rng.uniform(0.5, 3.2),
        )  # fmt: skip
        long_folds, short_folds = rng.uniform(0.03, 0.4), rng.uniform(0, 0.15) * (rng.random() < 0.4)
        zones = {"rails": zone(rail_knots, rail_shares, 0.0, long_folds, short_folds)}
        shell_knots = (0, 0.08, rng.uniform(0.25, 0.6), rng.uniform(0.65, 0.9), 1.0)
        shell_shares = (0, 0.2 * shell, shell, rng.uniform(1.1, 1.9) * shell, rng.uniform(1.3, 5.0) * shell)
        zones["shell"] = zone(shell_knots, shell_shares, rng.uniform(0.03, 0.22), 0.12 * rng.random())
        engine = np.array([0, 0.8, 2.2, 4.4]) * about(1, 0.5)
        zones["engine"] = zone(
            (0, 0.03, 0.15, 0.3), engine.tolist(), NEVER_M if rng.random() < 0.12 else rng.uniform(0.2, 0.72)
        )
        firewall = np.array([0, 0.45, 1.3, 2.2]) * about(1, 0.45)
        zones["firewall"] = zone((0, 0.06, 0.2, 0.3), firewall.tolist(), rng.uniform(0.06, 0.22))
        return cls(
            zones,
            powertrain_kg=mass_kg * rng.uniform(0.09, 0.16),
            rear_share=rng.uniform(0.1, 0.4),
            mounts=Coupling(about(6.0, 0.4) * force, about(0.012, 0.5) * force, about(0.1, 0.4) * force),
            rear=Coupling(about(25.0, 0.4) * force, about(0.07, 0.5) * force),
        )

    def misjudged(self, rng: np.random.Generator) -> "_Kind":
        """A CAE model of it."""

        def size(median: float) -> float:
            return float(median * np.exp(0.6 * np.clip(rng.standard_normal(), -2, 1.8)))

        whole, knot, place, wander, fold, gap, joint = map(size, (0.1, 0.16, 0.07, 0.08, 0.13, 0.03, 0.3))
        folds_elsewhere = rng.random() < 0.35
        knows_rates = rng.random() < 0.2

        def zone(true: _Zone) -> _Zone:
            phase = true.phase + (rng.uniform(0, 2 * np.pi) if folds_elsewhere else 0.0)
            n = len(true.knots_m)
            moved = true.knots_m[1:] * np.exp(place * rng.standard_normal(n - 1)) + 1e-3 * np.arange(1, n)
            return _Zone(
                np.r_[0, np.maximum.accumulate(moved)],
                true.force_n * np.exp(whole * rng.standard_normal() + knot * rng.standard_normal(n)),
                true.fold_share * np.exp(0.3 * rng.standard_normal()),
                true.fold_length_m * np.exp(fold * rng.standard_normal()),
                phase,
                true.short_share * np.exp(0.4 * rng.standard_normal()),
                true.wander + wandering(wander, 0.15, rng),
                true.gap_m
                if true.gap_m in (0.0, NEVER_M)
                else abs(true.gap_m + gap * rng.standard_normal() * (2 if true.gap_m > 0.2 else 1)),
                true.unloading_npm * np.exp(0.25 * rng.standard_normal()),
                true.rate_mps * np.exp(0.3 * rng.standard_normal()) if knows_rates else np.inf,
            )

        errors = np.array([joint] * 5 + [0.3 * joint]) * np.clip(rng.standard_normal(6), -2, 2)
        stiffness, damping, strength, rear_stiffness, rear_damping, powertrain = np.exp(errors).tolist()
        zones = {name: zone(true) for name, true in self.zones.items()}
        mounts, rear = self.mounts, self.rear
        return _Kind(
            zones,
            self.powertrain_kg * powertrain,
            float(np.clip(self.rear_share * np.exp(0.15 * rng.standard_normal()), 0.05, 0.5)),
            Coupling(mounts.stiffness_npm * stiffness, mounts.damping_nspm * damping, mounts.strength_n * strength),
            Coupling(rear.stiffness_npm * rear_stiffness, rear.damping_nspm * rear_damping),
        )

    def built(self) -> Vehicle:
        zones = {name: zone.built() for name, zone in self.zones.items()}
        return Vehicle(self.powertrain_kg, self.rear_share, **zones, mounts=self.mounts, rear=self.rear)


class _Ringing(NamedTuple):
    """A resonance between structure and sensor: frequency in Hz, damping ratio, and the share that goes through it."""

    frequency_hz: float
    damping: float
    share: float

    def heard(self, accel_mps2: FloatArray) -> FloatArray:
        per_sample = 2 * np.pi * self.frequency_hz * DT_S
        filtered = lfilter(
            *bilinear([1.0], [1 / per_sample**2, 2 * self.damping / per_sample, 1.0], fs=1.0), accel_mps2
        )
        return np.asarray(accel_mps2 + self.share * (filtered - accel_mps2))


@dataclass(frozen=True)
class _Campaign:
    conditions: list[Condition]
    specimens: list[Vehicle]
    models: list[Vehicle]
    ringing: tuple[_Ringing, _Ringing] | None  # of the vehicle, and of its CAE model


def _campaign(seed: int) -> _Campaign:
    """Fourteen tests of a vehicle, at speeds all over the range or in groups."""
    rng = np.random.default_rng([seed, 4713])
    mass = float(np.exp(rng.uniform(np.log(900.0), np.log(2600.0))))
    front = mass * rng.uniform(0.48, 0.64)
    kind = _Kind.drawn(mass, rng)
    truth, model = kind.built(), kind.misjudged(rng).built()
    top, low = rng.uniform(31.0, 42.0) * MPH, rng.uniform(5.0, 10.0) * MPH
    folding = float(np.exp(rng.normal(np.log(0.012), 0.6))) if rng.random() < 0.6 else 0.0
    scatter = float(np.exp(0.5 * rng.standard_normal()))
    if rng.random() < 0.5:
        speeds = rng.uniform(low, top, TESTS)
    else:
        centres = rng.uniform(low, top, rng.integers(2, 6))
        centres[0] = rng.uniform(0.8, 1) * top
        shares = rng.dirichlet(np.full(centres.size, 2.0))
        speeds = centres[rng.choice(centres.size, TESTS, p=shares)] + rng.normal(0, 0.15, TESTS)
    weights = np.array([front, mass - front]) * rng.uniform(0.92, 1.08, (TESTS, 2))
    conditions = [Condition.of_vector(vector) for vector in np.column_stack([speeds, weights]).tolist()]
    specimens = [
        folded_elsewhere(varied(truth, 0.02 * scatter, 0.02 * scatter, 0.004 * scatter, rng), folding, rng)
        for _ in conditions
    ]
    if rng.random() < 0.3:  # a heavier front is a heavier powertrain
        share = rng.uniform(0.3, 0.9)
        heavier = [share * (c.front_weight_kg - front) for c in conditions]
        specimens = [
            replace(own, powertrain_kg=max(0.5 * own.powertrain_kg, own.powertrain_kg + more))
            for own, more in zip(specimens, heavier, strict=True)
        ]
    share = 0.3 if rng.random() < 0.5 else 0.0
    models = [folded_elsewhere(model, share * folding, rng) for _ in conditions]
    ringing = None
    if rng.random() < 0.5:
        frequency = np.exp(rng.uniform(np.log(25.0), np.log(110.0)))
        own = _Ringing(frequency, rng.uniform(0.04, 0.25), rng.uniform(0, 0.8))
        off = np.exp([0.12, 0.3, 0.3] * rng.standard_normal(3))
        other = _Ringing(own.frequency_hz * off[0], own.damping * off[1], min(1.0, own.share * off[2]))
        ringing = own, other
    return _Campaign(conditions, specimens, models, ringing)


def pulses(first: int) -> Pulses:
    """Pulses of the vehicles with 32 seeds from here on, without those that do not stop or whose parts fly apart."""
    campaigns = [_campaign(seed) for seed in range(first, first + AT_ONCE)]
    conditions = [condition for own in campaigns for condition in own.conditions]
    noise = np.random.default_rng([first, 4712]).normal(0, SENSOR_NOISE_MPS2, (len(conditions), NOISE_SAMPLES))
    shape = AT_ONCE, TESTS, N_SAMPLES
    try:
        with np.errstate(all="ignore"):
            specimens = [vehicle for own in campaigns for vehicle in own.specimens]
            models = [vehicle for own in campaigns for vehicle in own.models]
            measured = recorded(specimens, conditions, noise).reshape(shape)
            cae = recorded(models, conditions, None).reshape(shape)
    except IndexError:  # a vehicle so stiff and light that the time step is too long for it
        none = np.zeros((0, TESTS, N_SAMPLES // STRIDE), np.float16)
        return Pulses(none, none, np.zeros((0, TESTS, 3), np.float32))
    for number, own in enumerate(campaigns):
        if own.ringing:
            vehicle, model = own.ringing
            measured[number], cae[number] = vehicle.heard(measured[number]), model.heard(cae[number])
    measured, cae = measured[..., ::STRIDE], cae[..., ::STRIDE]
    vectors = np.array([condition.vector for condition in conditions]).reshape(AT_ONCE, TESTS, 3)
    usable = np.ones(AT_ONCE, bool)
    for accel, (least, most) in ((cae, _CAE_SPEED_CHANGE), (measured, _TEST_SPEED_CHANGE)):
        change = accel.sum(-1) * STRIDE * DT_S / vectors[..., 0]
        usable &= (np.abs(accel).max((1, 2)) < _HIGHEST_MPS2) & ((change > least) & (change < most)).all(1)
    return Pulses(
        measured[usable].astype(np.float16), cae[usable].astype(np.float16), vectors[usable].astype(np.float32)
    )


def crashes(seed: int, speeds_mps: Sequence[float]) -> FloatArray:
    """Pulses of a vehicle's first specimen at these speeds, as its sensor records them, shape (n, 1250)."""
    vehicle = _campaign(seed)
    conditions = [replace(vehicle.conditions[0], speed_mps=speed) for speed in speeds_mps]
    accel = recorded([vehicle.specimens[0]], conditions, None)
    return vehicle.ringing[0].heard(accel) if vehicle.ringing else accel
