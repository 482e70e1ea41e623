"""Plausibility of pulses against their conditions: ΔV, stop, bandwidth."""

import shlex
from collections.abc import Mapping, Sequence

import numpy as np

from crashfuse.campaign_folder.condition_tables import ConditionTable
from crashfuse.errors import Problem
from crashfuse.signals.filters import CFC60_NOISE, noise_share
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics
from crashfuse.signals.sensor_faults import SensorFault
from crashfuse.units import KPH, LB, MPH, G
from crashfuse.wording import signed, time_text

Faults = Mapping[str, tuple[SensorFault, ...]]
"""What looks like a fault of a test's sensor, by the test's id."""

STOPS: Mapping[str, tuple[float, float]] = {"tests": (0.8, 1.6), "cae": (0.3, 2.5)}
"""Limits of ΔV/v0. Tests: from "not yet stopped at 100 ms" to more rebound than any car has; one CAE run may be odd."""
MOVING = 0.05
"""Residual share of the impact speed at the end of a record: 0.25 % of the energy is left."""
CREEP_MPS = 1.0
"""Below this speed ΔV/v0 is dominated by noise."""
_LIBRARY_STOPS = (0.8, 1.6)  # for the median run: single runs may be odd, not half of them
_BAND_HZ, _HIGH_SHARE = 250, 0.01
_MOST_SPECTRA, _MOST_NOISY = 500, 50  # pulses examined
NEAR = 5
"""CAE runs at about a test's speed that it is compared with."""
_EXCHANGED = (MPH / KPH) ** 0.5  # halfway between the right unit of speed and the wrong one
_BESIDE = 0.05  # of a weight: so far beyond the CAE runs' it is still like theirs
_MOST_FAULTS = 2  # in a sentence
_AT_ONCE = 2000  # pulses per batch


def check_physics(
    role: str, table: ConditionTable, accel: FloatArray, faults: Faults, problems: list[Problem], advice: str = ""
) -> None:
    """Compare each pulse's change of velocity with its stated impact speed, as far as that is known (not NaN).

    ``advice`` is what to do where one cause explains all of them.
    """
    low, high = STOPS[role]
    speed, biggest = _speeds(table), _changes(accel)
    ratio = -biggest / np.maximum(speed, 1e-9)
    moving = speed > CREEP_MPS
    typical = float(np.median(ratio[moving])) if moving.any() else 1.0
    if role == "cae" and not _LIBRARY_STOPS[0] <= typical <= _LIBRARY_STOPS[1]:
        found = f"{typical:.2f} times it"
        expected = "changes of velocity near the impact speed, for half of the runs at least"
        problems.append(Problem("cae.csv", expected, found, advice or _likely_cause(typical, *_LIBRARY_STOPS)))
        return
    for row in np.flatnonzero(np.isnan(speed) & (biggest > CREEP_MPS)):
        found = f"{signed(biggest[row] / MPH, 1)} mph ({signed(biggest[row] / KPH, 1)} km/h)"
        turn, place = _likely_cause(-1.0, low, high), f"id {table.ids[row]}"
        problems.append(Problem(f"{role}.csv", "a pulse that brakes", found, turn, place, table.rows[row]))
    for row in np.flatnonzero(((ratio < low) | (ratio > high)) & moving):
        v0, delta_v = speed[row], biggest[row]
        found = f"a change of {signed(delta_v / MPH, 1)} mph ({signed(delta_v / KPH, 1)} km/h)"
        expected = f"a change of velocity near the impact speed of {v0 / MPH:.1f} mph ({v0 / KPH:.1f} km/h)"
        place, failed = f"id {table.ids[row]}", faults.get(table.ids[row], ())
        cause = fault_advice(table.ids[row], failed) or advice or _likely_cause(float(ratio[row]), low, high)
        problems.append(Problem(f"{role}.csv", expected, found, cause, place, table.rows[row]))


def check_units(tables: Mapping[str, ConditionTable], pulses: Mapping[str, FloatArray]) -> list[str]:
    """Warnings of tests whose ΔV/v0 matches CAE runs at their speed better with mph and km/h exchanged."""
    warnings: list[str] = []
    cae, tests = tables["cae"], tables["tests"]
    speeds, ratios = _speeds(cae), -_changes(pulses["cae"])
    moving = speeds > CREEP_MPS
    if not moving.any():
        return warnings
    speeds, ratios = speeds[moving], ratios[moving] / speeds[moving]
    for test_id, speed, change in zip(tests.ids, _speeds(tests), _changes(pulses["tests"]), strict=True):
        near = float(np.median(ratios[np.argsort(np.abs(speeds - speed), kind="stable")[:NEAR]]))
        share = -change / max(speed * near, 1e-9)
        if speed > CREEP_MPS and near > 0 and not 1 / _EXCHANGED <= share <= _EXCHANGED:
            unit, ending = ("km/h", "_mph") if share < 1 else ("mph", "_kph")
            warnings.append(
                f"tests.csv, {test_id}: over its impact speed its change of velocity is {share:.2f} times that of CAE "
                f"runs near {speed / MPH:.1f} mph ({speed / KPH:.1f} km/h); check its speed ({unit} under a name that "
                f"ends in {ending}?) and the scale and zero of its acceleration."
            )
    return warnings


def unlike_weights(tables: Mapping[str, ConditionTable], _: Mapping[str, FloatArray]) -> list[str]:
    """Warnings of tests whose weights lie among the CAE runs' only in the other unit, or with the axles exchanged."""
    runs = _weights(tables["cae"])
    low, high = runs.min(axis=0) * (1 - _BESIDE), runs.max(axis=0) * (1 + _BESIDE)
    tests, warnings = tables["tests"], []
    for test_id, own in zip(tests.ids, _weights(tests), strict=True):
        might_be = {
            "": own,
            "check their unit (kilograms under a name that ends in _lb?)": own / LB,
            "check their unit (pounds under a name that ends in _kg?)": own * LB,
            "check which axle is which": own[::-1],
        }
        fitting = [advice for advice, kg in might_be.items() if ((low <= kg) & (kg <= high)).all()]
        if fitting and fitting[0]:
            warnings.append(f"tests.csv, {test_id}: its weights are unlike those of all CAE runs; {fitting[0]}.")
    return warnings


def check_ends(
    role: str,
    table: ConditionTable,
    accel: FloatArray,
    ends_s: Mapping[str, float],
    faults: Faults,
    problems: list[Problem],
) -> None:
    """Reject a record that ends while the vehicle is still moving: the rest of its pulse would be invented."""
    for row, run_id in enumerate(table.ids):
        if run_id not in ends_s:
            continue
        speed, end = table.conditions[row].speed_mps, ends_s[run_id]
        velocity = np.interp(end, GRID_S, kinematics(accel[row], speed, DT_S).velocity_mps)
        if velocity > MOVING * speed:
            found = f"{velocity / MPH:.1f} mph ({velocity / KPH:.1f} km/h) at its end, {time_text(end)}"
            expected = "a record that lasts until the vehicle has stopped, or 100 ms"
            place, number = f"id {run_id}", table.rows[row]
            advice = fault_advice(run_id, faults.get(run_id, ())) or "export a longer record"
            problems.append(Problem(f"{role}.csv", expected, found, advice, place, number))


def check_band(role: str, accel: FloatArray, warnings: list[str]) -> None:
    """Warn of pulses with much content above the band that the fast time-domain network resolves, or with noise."""
    if not len(accel):
        return
    some = accel[:: -(-len(accel) // _MOST_SPECTRA)].astype(np.float64)
    power = np.abs(np.fft.rfft(some - some.mean(axis=1, keepdims=True), axis=1)) ** 2
    high = np.fft.rfftfreq(some.shape[1], DT_S) > _BAND_HZ
    share = power[:, high].sum() / max(power.sum(), 1e-300)
    noise = np.median([noise_share(pulse, dt_s=DT_S) for pulse in some[:_MOST_NOISY]])
    if share > _HIGH_SHARE:
        told = f"{100 * share:.0f} % of the pulses' power lies above {_BAND_HZ} Hz, beyond what is modelled"
    elif noise > CFC60_NOISE:
        told = f"above 400 Hz the pulses hold {100 * noise:.1g} % of their peak, more noise than CFC 60 leaves"
    else:
        return
    warnings.append(f"{role}: {told}; set channel_filter_class = 60 in campaign.toml if they are not filtered.")


def fault_advice(test_id: str, faults: Sequence[SensorFault]) -> str:
    """What to do about a test whose sensor failed, as far as its record alone shows it; empty if it does not."""
    sure = sorted((fault for fault in faults if fault.strength >= 1), key=lambda fault: -fault.strength)[:_MOST_FAULTS]
    leave = f"leave it out of use (crashfuse edit CAMPAIGN --leave-out {shlex.quote(test_id)})"
    return f"{'; '.join(fault.text for fault in sure)}; mend its record, or {leave}" if sure else ""


def _likely_cause(ratio: float, low: float, high: float) -> str:
    """Advice derived from how far ΔV/v0 is off."""
    causes = {
        "flip the sign of the acceleration (deceleration is negative)": -1.0,
        "check the unit of the acceleration (m/s² under a name that ends in _g?)": G,
        "check the unit of the acceleration (g under a name that ends in _mps2?)": 1 / G,
        "check the unit of the speed (km/h under a name that ends in _mph?)": KPH / MPH,
        "check the unit of the speed (mph under a name that ends in _kph?)": MPH / KPH,
    }
    likely = [advice for advice, factor in causes.items() if low <= ratio / factor <= high]
    return likely[0] if likely else "check the speed, the units and time zero of this pulse"


def _speeds(table: ConditionTable) -> FloatArray:
    return np.array([condition.speed_mps for condition in table.conditions])


def _weights(table: ConditionTable) -> FloatArray:
    """Weights on front and rear axle in kg, shape (n, 2)."""
    return np.array([condition.vector[1:] for condition in table.conditions])


def _changes(accel: FloatArray) -> FloatArray:
    """The largest change of velocity of each pulse, signed, computed in batches: shape (n,)."""
    changes = np.empty(len(accel))
    for first in range(0, len(accel), _AT_ONCE):
        velocity = kinematics(accel[first : first + _AT_ONCE], 0.0, DT_S).velocity_mps
        changes[first : first + _AT_ONCE] = velocity[np.arange(len(velocity)), np.abs(velocity).argmax(axis=1)]
    return changes
