"""Two models of one vehicle: the CAE model, and the truth behind its tests, which has different physics.

The truth differs from the CAE model as reality does from a simulation: sheet metal that hardens with strain rate,
rails that are stiffer at first and softer later, a different fold length, an engine that hits the barrier earlier and
harder, more damping, a different powertrain package for each variant, test-to-test scatter, and sensor noise.

The constants have the order of magnitude of a mid-size car; within that they were set so that the CAE model rates
against the truth as in Table 5 of Zeng et al. 2023, and peak, t0, crush and rebound are realistic.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, N_SAMPLES, FloatArray
from crashfuse.synthetic.vehicle import Coupling, CrushZone, Vehicle, simulate
from crashfuse.units import G

_STEEL_MPS = 1400.0  # Cowper-Symonds rate of high-tensile steel (D = 3200/s, q = 5), 145 mm wide rail: D·C/0.33

CAE_MODEL = Vehicle(
    powertrain_kg=215.0,
    rear_share=0.3,
    rails=CrushZone(
        (0.0, 0.02, 0.05, 0.158, 0.223, 0.475, 0.86),
        (0.0, 11e3, 93e3, 93e3, 187e3, 199e3, 241e3),
        unloading_npm=19e6,
        fold_share=0.23,
        fold_length_m=0.103,
    ),
    shell=CrushZone((0.0, 0.08, 0.285, 0.415), (0.0, 37e3, 164e3, 228e3), unloading_npm=18.5e6, gap_m=0.156),
    engine=CrushZone((0.0, 0.03, 0.15, 0.3), (0.0, 122e3, 472e3, 944e3), unloading_npm=19.5e6, gap_m=0.44),
    firewall=CrushZone((0.0, 0.06, 0.2, 0.3), (0.0, 84e3, 254e3, 427e3), unloading_npm=17.5e6, gap_m=0.097),
    mounts=Coupling(stiffness_npm=2.1e6, damping_nspm=2e3, strength_n=36e3),
    rear=Coupling(stiffness_npm=5.9e6, damping_nspm=14e3),
)  # the biased model behind the CAE runs, without strain rate or powertrain variants

TRUTH = Vehicle(
    powertrain_kg=200.0,
    rear_share=0.3,
    rails=CrushZone(
        (0.0, 0.021, 0.053, 0.133, 0.188, 0.58, 1.08),
        (0.0, 9e3, 80e3, 80e3, 184e3, 107e3, 128e3),
        unloading_npm=13.5e6,
        fold_share=0.24,
        fold_length_m=0.141,
        rate_mps=_STEEL_MPS,
    ),
    shell=CrushZone(
        (0.0, 0.08, 0.43, 0.59), (0.0, 22e3, 164e3, 234e3), unloading_npm=12e6, gap_m=0.122, rate_mps=_STEEL_MPS
    ),
    engine=CrushZone((0.0, 0.03, 0.15, 0.3), (0.0, 184e3, 496e3, 992e3), unloading_npm=16e6, gap_m=0.296),
    firewall=CrushZone(
        (0.0, 0.06, 0.2, 0.3), (0.0, 105e3, 299e3, 501e3), unloading_npm=11e6, gap_m=0.15, rate_mps=_STEEL_MPS
    ),
    mounts=Coupling(stiffness_npm=1.4e6, damping_nspm=4.1e3, strength_n=22e3),
    rear=Coupling(stiffness_npm=7.7e6, damping_nspm=27e3),
)  # the truth with powertrain Type I and front-wheel drive; `equipped` turns it into the other variants

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
    zones = (vehicle.rails, vehicle.shell, vehicle.engine, vehicle.firewall)
    rails, shell, engine, firewall = (_specimen(zone, rng) for zone in zones)
    return replace(vehicle, rails=rails, shell=shell, engine=engine, firewall=firewall)


def measured_pulses(conditions: Sequence[Condition], seed: int) -> FloatArray:
    """Simulate tests at these conditions with the truth: a new specimen and new noise for each test of a seed."""
    streams = [np.random.default_rng([seed, i]) for i in range(len(conditions))]
    specimens = [scattered(equipped(TRUTH, c), rng) for c, rng in zip(conditions, streams, strict=True)]
    records = _records(specimens, conditions)
    noise = np.array([rng.normal(0.0, SENSOR_NOISE_MPS2, records.shape[1]) for rng in streams])
    return _study_pulses(records + noise)


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
    crash = simulate(vehicles, conditions, N_SAMPLES + _BEFORE_CONTACT)
    return np.pad(crash.accel_mps2, ((0, 0), (_BEFORE_CONTACT, 0)))


def _study_pulses(records: FloatArray) -> FloatArray:
    return cfc_filter(records, cfc=60, dt_s=DT_S)[:, _BEFORE_CONTACT : _BEFORE_CONTACT + N_SAMPLES]
