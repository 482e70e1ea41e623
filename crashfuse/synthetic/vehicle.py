"""Three-mass model of a vehicle hitting a rigid barrier, its equations of motion, and two such vehicles.

Barrier ─ rails, shell ─ body ─ rear mass; barrier ─ engine contact ─ powertrain ─ firewall, mounts ─ body. This is the
lumped-mass model of Kamal (SAE 700414, 1970), reduced to what shapes the pulse of the passenger compartment; Huang,
*Vehicle Crash Mechanics* (CRC Press, 2002), ch. 4–5, discusses such models and their elements.

``vehicles.toml`` has the CAE model, and the truth behind the tests: with powertrain Type I and front-wheel drive, which
:func:`equipped` turns into the other variants.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, get_type_hints

import numpy as np
import numpy.typing as npt

from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.files.toml_text import package_data
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray
from crashfuse.units import G

_CRUSH_GRID_M = np.linspace(0.0, 1.2, 1201)
_COWPER_SYMONDS_Q = 5.0
_ZONES = ("rails", "shell", "engine", "firewall")
# Compression of each element (rows) per forward displacement of body, powertrain and rear mass (columns).
_ZONE_INCIDENCE = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0], [1, -1, 0]], dtype=np.float64)
_COUPLING_INCIDENCE = np.array([[1, -1, 0], [-1, 0, 1]], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class CrushZone:
    """Sheet metal that resists crushing, unloads steeply and keeps a permanent set.

    ``rate_mps`` is the crush velocity at which the force doubles, Cowper and Symonds' D times the folds' length scale:
    with the mean strain rate 0.33 v/C of a square tube of width C (Abramowicz and Jones, Int. J. Impact Eng. 2, 1984),
    D·C/0.33.
    """

    crush_m: tuple[float, ...]  # knots of the quasi-static loading curve: linear between them, constant beyond
    force_n: tuple[float, ...]
    unloading_npm: float  # slope; steeper than the loading curve anywhere, so that the zone is passive
    gap_m: float = 0.0  # free travel before first contact
    fold_share: float = 0.0  # by which the curve oscillates, one wave per fold
    fold_length_m: float = 0.1
    rate_mps: float = np.inf

    def loading_n(self, crush_m: FloatArray) -> FloatArray:
        """Quasi-static force in N while the crush (m) grows for the first time."""
        crush = np.maximum(crush_m - self.gap_m, 0.0)
        waves = 1.0 + self.fold_share * np.sin(2 * np.pi * crush / self.fold_length_m)
        return np.asarray(np.interp(crush, self.crush_m, self.force_n) * waves)


@dataclass(frozen=True, slots=True)
class Coupling:
    """A joint between two masses that acts both ways: elastic, plastic beyond its strength, and damped.

    In N/m, N·s/m and N; the strength is infinite if it never yields.
    """

    stiffness_npm: float
    damping_nspm: float
    strength_n: float = np.inf


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The physical constants of one vehicle; its weights come with the condition.

    ``powertrain_kg`` (engine and gearbox) is part of the front weight; ``rear_share`` of the rear weight hangs
    elastically on the body: axle, fuel, cargo. ``rails`` have their crash boxes, ``shell`` is upper rails, wheels and
    cabin; ``engine`` is the powertrain against the barrier, ``firewall`` against the powertrain, which hangs in
    ``mounts``.
    """

    powertrain_kg: float
    rear_share: float
    rails: CrushZone
    shell: CrushZone
    engine: CrushZone
    firewall: CrushZone
    mounts: Coupling
    rear: Coupling


@dataclass(frozen=True, eq=False, slots=True)
class Crash:
    """Results of n simulated crashes, unfiltered.

    Acceleration of the body and force on the barrier have shape (n, n_samples), at 12.5 kHz from first contact on;
    masses and final speeds of body, powertrain and rear mass (n, 3). ``work_j``, shape (n, 6), is taken up by rails,
    shell, engine contact, firewall, mounts and rear coupling.
    """

    accel_mps2: FloatArray
    barrier_n: FloatArray
    mass_kg: FloatArray
    final_speed_mps: FloatArray
    work_j: FloatArray


def simulate(
    vehicles: Vehicle | Sequence[Vehicle],
    conditions: Sequence[Condition],
    n_samples: int = N_SAMPLES,
    steps_per_sample: int = 2,
) -> Crash:
    """Simulate crashes into the barrier, all at once, by the leapfrog scheme.

    One vehicle is for all conditions, several are one for each; a speed of 0 is allowed.
    """
    fleet = (vehicles,) if isinstance(vehicles, Vehicle) else tuple(vehicles)
    n = len(conditions)
    law = _Elements(fleet, n)
    mass = np.array([_masses_kg(v, c) for v, c in zip(fleet * (n if len(fleet) == 1 else 1), conditions, strict=True)])
    speed = np.repeat([[condition.speed_mps for condition in conditions]], 3, axis=0)
    inverse_mass = 1.0 / mass.T
    incidence = np.vstack([_ZONE_INCIDENCE, _COUPLING_INCIDENCE])
    position = np.zeros_like(speed)
    work = np.zeros((len(incidence), n))
    accel, barrier = np.empty((2, n_samples, n))
    dt = DT_S / steps_per_sample
    for step in range(n_samples * steps_per_sample):
        rate = incidence @ speed
        force = law.force_n(incidence @ position, rate)
        braking = (incidence.T @ force) * inverse_mass
        speed = speed - braking * dt
        work += force * (0.5 * dt) * (rate + incidence @ speed)
        position = position + speed * dt
        if step % steps_per_sample == 0:
            accel[step // steps_per_sample] = -braking[0]
            barrier[step // steps_per_sample] = force[:3].sum(axis=0)
    return Crash(accel.T, barrier.T, mass, speed.T, work.T)


def _masses_kg(vehicle: Vehicle, condition: Condition) -> tuple[float, float, float]:
    rear = vehicle.rear_share * condition.rear_weight_kg
    return condition.mass_kg - vehicle.powertrain_kg - rear, vehicle.powertrain_kg, rear


class _Elements:
    """Force laws of all elements, with their history (largest crush, plastic slip)."""

    def __init__(self, fleet: Sequence[Vehicle], n: int) -> None:
        zones = [[getattr(v, name) for v in fleet] for name in _ZONES]
        joints = [[getattr(v, name) for v in fleet] for name in ("mounts", "rear")]
        self._table = np.array([[zone.loading_n(_CRUSH_GRID_M) for zone in row] for row in zones])
        self._first = np.arange(len(zones) * len(fleet)).reshape(len(zones), -1) * _CRUSH_GRID_M.size
        self._unloading, self._rate = _field(zones, "unloading_npm"), _field(zones, "rate_mps")
        self._stiffness, self._damping = _field(joints, "stiffness_npm"), _field(joints, "damping_nspm")
        self._strength = _field(joints, "strength_n")
        self._largest, self._slip = np.zeros((len(zones), n)), np.zeros((len(joints), n))

    def force_n(self, deformation_m: FloatArray, rate_mps: FloatArray) -> FloatArray:
        """Forces that resist these deformations and rates, shape (6, n); call once per step, in time order."""
        crush, stretch = deformation_m[:4], deformation_m[4:]
        np.maximum(self._largest, crush, out=self._largest)
        unloaded = self._loading_n(self._largest) - self._unloading * (self._largest - crush)
        hardening = 1.0 + (np.maximum(rate_mps[:4], 0.0) / self._rate) ** (1 / _COWPER_SYMONDS_Q)
        pushing = np.maximum(unloaded, 0.0) * hardening

        elastic = self._stiffness * (stretch - self._slip)
        held = np.clip(elastic, -self._strength, self._strength)
        self._slip += (elastic - held) / self._stiffness
        return np.vstack([pushing, held + self._damping * rate_mps[4:]])

    def _loading_n(self, crush_m: FloatArray) -> FloatArray:
        place = np.minimum(crush_m / _CRUSH_GRID_M[1], _CRUSH_GRID_M.size - 1.001)
        below = place.astype(np.intp)
        index = self._first + below
        low, high = self._table.take(index), self._table.take(index + 1)
        return np.asarray(low + (place - below) * (high - low))


def _field(rows: Sequence[Sequence[CrushZone | Coupling]], name: str) -> npt.NDArray[np.float64]:
    return np.array([[getattr(element, name) for element in row] for row in rows])


_ELEMENTS = get_type_hints(Vehicle)
CONSTANTS = package_data(__file__, "vehicles.toml")


def _vehicle(name: str) -> Vehicle:
    parts = {part: own for part, own in CONSTANTS[name].items() if isinstance(own, dict)}
    tuples = {part: {k: tuple(v) if isinstance(v, list) else v for k, v in own.items()} for part, own in parts.items()}
    return Vehicle(**CONSTANTS[name] | {part: _ELEMENTS[part](**own) for part, own in tuples.items()})


CAE_MODEL, TRUTH = map(_vehicle, ("cae_model", "truth"))

SENSOR_NOISE_MPS2 = 3.0 * G  # standard deviation of white noise before the filter; CFC 60 leaves about 0.4 g of it

_BEFORE_CONTACT = 250  # samples: sensors run before the crash, so the filter treats the start as on a real record


def equipped(vehicle: Vehicle, condition: Condition) -> Vehicle:
    """The vehicle with the condition's powertrain ("Type I", "Type II") and drive ("FWD", "AWD"), else Type I and FWD.

    Type II is the larger engine: heavier, closer to the barrier, with a stiffer block. All-wheel drive adds a transfer
    case to the powertrain, and its propeller shaft braces the mounts.
    """
    factors = {"powertrain": "Type I", "drive": "FWD"} | dict(condition.factors)
    if factors["powertrain"] not in ("Type I", "Type II") or factors["drive"] not in ("FWD", "AWD"):
        given = " with ".join(factors[name] for name in ("powertrain", "drive"))
        raise UsageError(f"The synthetic vehicle is Type I or Type II with FWD or AWD, not {given}.")
    if factors["powertrain"] == "Type II":
        engine = replace(_scaled(vehicle.engine, 1.1), gap_m=vehicle.engine.gap_m - 0.03)
        vehicle = replace(vehicle, powertrain_kg=1.2 * vehicle.powertrain_kg, engine=engine)
    if factors["drive"] == "AWD":
        mounts = replace(vehicle.mounts, strength_n=1.4 * vehicle.mounts.strength_n)
        firewall = replace(vehicle.firewall, gap_m=vehicle.firewall.gap_m - 0.01)
        vehicle = replace(vehicle, powertrain_kg=vehicle.powertrain_kg + 35.0, mounts=mounts, firewall=firewall)
    return vehicle


def scattered(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """One specimen of the vehicle: forces scatter by 2 % as a whole and along the crush, gaps by 4 mm, folds by 1 %."""
    zones: dict[str, Any] = {name: _specimen(getattr(vehicle, name), rng) for name in _ZONES}
    return replace(vehicle, **zones)


def measured_pulses(conditions: Sequence[Condition], seed: int) -> FloatArray:
    """Simulate tests at these conditions with the truth: a new specimen and new noise for each test of a seed."""
    streams = [np.random.default_rng([seed, i]) for i in range(len(conditions))]
    specimens = [scattered(equipped(TRUTH, c), rng) for c, rng in zip(conditions, streams, strict=True)]
    records = _records(specimens, conditions)
    return _study_pulses(records + np.array([rng.normal(0.0, SENSOR_NOISE_MPS2, records.shape[1]) for rng in streams]))


def cae_pulses(conditions: Sequence[Condition]) -> FloatArray:
    """Pulses of the CAE model at these conditions, shape (n, 1250), in m/s², CFC 60, without scatter or noise."""
    return _study_pulses(_records(CAE_MODEL, conditions))


def _scaled(zone: CrushZone, factors: float | FloatArray) -> CrushZone:
    return replace(zone, force_n=tuple((np.array(zone.force_n) * factors).tolist()))


def _specimen(zone: CrushZone, rng: np.random.Generator) -> CrushZone:
    whole, gap, fold, *along = rng.standard_normal(3 + len(zone.force_n))
    return replace(
        _scaled(zone, 1 + 0.02 * whole + 0.02 * np.array(along)),
        gap_m=zone.gap_m + 0.004 * gap if zone.gap_m else 0.0,
        fold_length_m=zone.fold_length_m * (1 + 0.01 * fold),
    )


def _records(vehicles: Vehicle | Sequence[Vehicle], conditions: Sequence[Condition]) -> FloatArray:
    accel = simulate(vehicles, conditions, N_SAMPLES + _BEFORE_CONTACT).accel_mps2
    return np.pad(accel, ((0, 0), (_BEFORE_CONTACT, 0)))


def _study_pulses(records: FloatArray) -> FloatArray:
    return cfc_filter(records, cfc=60, dt_s=DT_S)[:, _BEFORE_CONTACT : _BEFORE_CONTACT + N_SAMPLES]
