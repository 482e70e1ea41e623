"""Plausibility of pulses: against their conditions, a gap before the barrier, and records unlike the others.

A gap lets the vehicle move freely over one distance in all CAE runs. Its length over the speed is when a run begins to
decelerate, but for a constant: a filter brings an onset forward by up to 4 ms, a soft bumper delays it.
"""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crashfuse.campaign_folder.condition_tables import ConditionTable
from crashfuse.crash_test import SPEED_STEP_MPS
from crashfuse.errors import Problem
from crashfuse.signals.filters import CFC60_NOISE, free_travel_s, noise_share, onset
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics
from crashfuse.signals.sensor_faults import SensorFault, confirmed
from crashfuse.units import KPH, LB, MPH, MS, G, number, signed, time_text

STOPS: Mapping[str, tuple[float, float]] = {"tests": (0.8, 1.6), "cae": (0.3, 2.5)}
"""Limits of ΔV/v0. Tests: not yet stopped at 100 ms, to more rebound than any car has; one CAE run may be odd."""
LONG_ENOUGH = "a record that lasts until the vehicle has stopped, or 100 ms"
WHICH_AXLE = "check which axle is which"
MOVING = 0.05  # residual share of the impact speed at the end of a record: 0.25 % of the energy is left
CREEP_MPS = 1.0  # below this speed ΔV/v0 is dominated by noise
_LIBRARY_STOPS = (0.8, 1.6)  # for the median run: single runs may be odd, not half of them
_BAND_HZ, _HIGH_SHARE = 250, 0.01
_MOST_SPECTRA, _MOST_NOISY = 500, 50  # pulses examined
NEAR = 5  # CAE runs at about a test's speed that it is compared with
_EXCHANGED = (MPH / KPH) ** 0.5  # halfway between the right unit of speed and the wrong one
_BESIDE = 0.05  # of a weight: so far beyond the CAE runs' it is still like theirs
_MOST_FAULTS = 2  # in a sentence
_AT_ONCE = 2000  # pulses per batch
# of a gap
LEAST_M = 0.015  # shorter gaps are no finding
_LEAST_S = 1e-3
_SMEARED_S = 5e-3  # by so much an onset may come before contact
_LATE_ONSET_S = 3e-3  # later than the tests, over no one distance
_TIMES = 4.0  # by so much more than the time of the onset a distance scatters that is none
_MOST_RUNS, _FAST = 500, 1 / 3  # looked at, those faster than a share of the fastest: slow ones may begin gently
_FEWEST, _SPEEDS_APART = 3, 1.3  # runs, and the ratio of their speeds, that tell a distance from a time
_OFF = 0.15  # of the time of the onset, in the median: less is one distance
_MOST, _FEW = 0.5, 0.1  # shares of the runs: begin late over no one distance; are too few to be near any test
# of records unlike the others
_ONSET = 0.02  # share of the impact speed that is gone when deceleration has begun; at CFC 60, or with 0.6 g of noise
_LATE_S = 1.5e-3  # good simulated tests differ by up to 1.0 ms
_OFFSET_MPS2 = 0.9 * G  # good simulated tests differ by up to 0.6 g
_SCATTERED = 3.0  # times the median deviation of the others: what is usual in this campaign is no finding
_FEWEST_OTHERS = 2  # fewer do not tell which of the tests is odd: the CAE runs alone have to


def check_physics(table: ConditionTable, problems: list[Problem], advice: str = "") -> None:
    """Compare changes of velocity with impact speeds; ``advice`` is for a cause that explains them all."""
    low, high = STOPS[table.role]
    speed, biggest = table.speeds_mps, _changes(table.accel_mps2)
    ratio = -biggest / np.maximum(speed, 1e-9)
    moving = speed > CREEP_MPS
    typical = float(np.median(ratio[moving])) if moving.any() else 1.0
    if table.role == "cae" and not _LIBRARY_STOPS[0] <= typical <= _LIBRARY_STOPS[1]:
        expected, cause = "changes of velocity near the impact speed", _likely_cause(typical, *_LIBRARY_STOPS)
        problems.append(Problem(table.file, expected, f"{typical:.2f} times it in most runs", advice or cause))
        return
    turned = np.isnan(speed) & (biggest > CREEP_MPS)
    for row in np.flatnonzero(turned | (((ratio < low) | (ratio > high)) & moving)):
        test_id, share = table.ids[row], -1.0 if turned[row] else float(ratio[row])
        found = f"a change of {signed(biggest[row] / MPH, 1)} mph ({signed(biggest[row] / KPH, 1)} km/h)"
        expected = f"a change of velocity near the impact speed of {_speed_text(speed[row])}"
        expected = "a pulse that brakes" if turned[row] else expected
        cause = fault_advice(test_id, table.faults.get(test_id, ())) or advice or _likely_cause(share, low, high)
        problems.append(Problem(table.file, expected, found, cause, f"id {test_id}", table.rows[row]))


def check_units(tests: ConditionTable, runs: ConditionTable) -> list[str]:
    """Warnings of tests whose ΔV/v0 fits CAE runs better with mph and km/h exchanged."""
    warnings: list[str] = []
    moving = runs.speeds_mps > CREEP_MPS
    if not moving.any():
        return warnings
    speeds = runs.speeds_mps[moving]
    ratios = -_changes(runs.accel_mps2)[moving] / speeds
    for test_id, speed, change in zip(tests.ids, tests.speeds_mps, _changes(tests.accel_mps2), strict=True):
        near = float(np.median(ratios[_nearest(speeds, speed)]))
        share = -change / max(speed * near, 1e-9)
        if speed > CREEP_MPS and near > 0 and not 1 / _EXCHANGED <= share <= _EXCHANGED:
            cause = "km/h in a column …_mph?" if share < 1 else "mph in a column …_kph?"
            finding = f"its change of velocity is {share:.2f} times that of CAE runs near {_speed_text(speed)}"
            warnings.append(f"tests.csv, {test_id}: {finding}; check its speed ({cause}), its scale and zero.")
    return warnings


def _speed_text(speed_mps: float) -> str:
    return f"{speed_mps / MPH:.1f} mph ({speed_mps / KPH:.1f} km/h)"


def unlike_weights(tests: ConditionTable, runs: ConditionTable) -> list[str]:
    """Warnings of tests whose weights fit the CAE runs' only in the other unit, or exchanged."""
    of_runs, warnings = _weights(runs), []
    low, high = of_runs.min(axis=0) * (1 - _BESIDE), of_runs.max(axis=0) * (1 + _BESIDE)
    for test_id, stated_kg in zip(tests.ids, _weights(tests), strict=True):
        might_be = {
            "": stated_kg,
            "check their unit (kilograms in a column …_lb?)": stated_kg / LB,
            "check their unit (pounds in a column …_kg?)": stated_kg * LB,
            WHICH_AXLE: stated_kg[::-1],
        }
        fitting = [advice for advice, kg in might_be.items() if ((low <= kg) & (kg <= high)).all()]
        if fitting and fitting[0]:
            warnings.append(f"tests.csv, {test_id}: its weights are unlike those of all CAE runs; {fitting[0]}.")
    return warnings


def check_ends(table: ConditionTable, problems: list[Problem]) -> None:
    """Refuse records that end while the vehicle is still moving."""
    for row, run_id in enumerate(table.ids):
        if (end := table.ends_s.get(run_id)) is None:
            continue
        speed = table.conditions[row].speed_mps
        velocity = np.interp(end, GRID_S, kinematics(table.accel_mps2[row], speed, DT_S).velocity_mps)
        if velocity > MOVING * speed:
            found = f"{_speed_text(velocity)} at its end, {time_text(end)}"
            advice = fault_advice(run_id, table.faults.get(run_id, ())) or "export a longer record"
            problems.append(Problem(table.file, LONG_ENOUGH, found, advice, f"id {run_id}", table.rows[row]))


def check_band(table: ConditionTable, warnings: list[str]) -> None:
    """Warn of pulses with much content above the band that the fast time-domain network resolves, or with noise."""
    accel = table.accel_mps2
    if not len(accel):
        return
    sample = accel[:: -(-len(accel) // _MOST_SPECTRA)].astype(np.float64)
    power = np.abs(np.fft.rfft(sample - sample.mean(axis=1, keepdims=True), axis=1)) ** 2
    high = np.fft.rfftfreq(sample.shape[1], DT_S) > _BAND_HZ
    share = power[:, high].sum() / max(power.sum(), 1e-300)
    noise = np.median([noise_share(pulse, dt_s=DT_S) for pulse in sample[:_MOST_NOISY]])
    if share > _HIGH_SHARE:
        finding = f"{100 * share:.0f} % of the pulses' power lies above {_BAND_HZ} Hz, beyond what is modelled"
    elif noise > CFC60_NOISE:
        finding = f"above 400 Hz the pulses hold {100 * noise:.1g} % of their peak, more than CFC 60 leaves"
    else:
        return
    advice = "set channel_filter_class = 60 in campaign.toml if they are not filtered"
    warnings.append(f"{table.role}: {finding}; {advice}.")


def fault_advice(test_id: str, faults: Sequence[SensorFault]) -> str:
    """What to do about a test whose record alone shows that its sensor failed; else empty."""
    sure = sorted((fault for fault in faults if fault.strength >= 1), key=lambda fault: -fault.strength)[:_MOST_FAULTS]
    leave = f"leave it out of use (crashfuse edit CAMPAIGN --leave-out {shlex.quote(test_id)})"
    return f"{'; '.join(fault.text for fault in sure)}; mend its record, or {leave}" if sure else ""


def _likely_cause(ratio: float, low: float, high: float) -> str:
    causes = {"flip the sign of the acceleration (deceleration is negative)": -1.0}
    units = [("acceleration", "m/s²", "g", G), ("acceleration", "g", "mps2", 1 / G)]
    units += [("speed", "km/h", "mph", KPH / MPH), ("speed", "mph", "kph", MPH / KPH)]
    causes |= {f"check the unit of the {of} ({unit} in a column …_{end}?)": factor for of, unit, end, factor in units}
    likely = [advice for advice, factor in causes.items() if low <= ratio / factor <= high]
    return likely[0] if likely else "check its speed, units and time zero"


def _weights(table: ConditionTable) -> FloatArray:
    return np.array([condition.vector[1:] for condition in table.conditions])


def _changes(accel: FloatArray) -> FloatArray:
    """The largest change of velocity of each pulse, signed: shape (n,)."""
    changes = np.empty(len(accel))
    for first in range(0, len(accel), _AT_ONCE):
        velocity = kinematics(accel[first : first + _AT_ONCE], 0.0, DT_S).velocity_mps
        changes[first : first + _AT_ONCE] = velocity[np.arange(len(velocity)), np.abs(velocity).argmax(axis=1)]
    return changes


@dataclass(frozen=True, slots=True)
class Gap:
    """What CAE runs move freely before they meet the barrier."""

    distance_m: float | None  # None if it is not one: a late trigger, or models with different gaps
    lasts_s: tuple[float, float]
    share: float  # of the runs
    taken_m: float = 0.0  # out already

    @property
    def hides_tests(self) -> bool:
        """Whether tests cannot be compared with CAE runs."""
        return self.share >= _FEW

    @property
    def advice(self) -> str:
        """What takes it out."""
        if self.distance_m is None:
            return "check the time zero of the CAE runs, which is first contact"
        whole_mm = (self.taken_m + self.distance_m) / MS
        return f"take the gap before the barrier out: cae_gap_mm = {whole_mm:.0f} in campaign.toml"

    @property
    def warning(self) -> str:
        """The finding, and what to do."""
        who = f"{100 * self.share:.0f} % of the" if self.share < 1 else "the"
        first, last = (f"{lasts / MS:.1f}" for lasts in self.lasts_s)
        far, why = f"freely for {first} to {last} ms", "over no one distance"
        if self.distance_m is not None:
            far, why = f"{self.distance_m / MS:.0f} mm", "whatever their speed"
        until = " Until then tests are not compared with CAE runs." if self.hides_tests else ""
        return f"cae.csv: {who} CAE runs move {far} before they decelerate, {why}; {self.advice}.{until}"


def find_gap(runs: ConditionTable, tests: ConditionTable, taken_m: float = 0.0) -> Gap | None:
    """The gap of CAE runs that have one, or begin late, where the tests do not."""
    speed, free_s, sudden = _free_travel(runs)
    late = sudden & (free_s >= _LEAST_S) & (speed * free_s >= LEAST_M)
    if not late.any():
        return None
    v, t = speed[late], free_s[late]
    lasts = float(t.min()), float(t.max())
    test_speed, test_free_s, _ = _free_travel(tests)
    distance = float(np.median(v * t))
    if v.size >= _FEWEST and v.max() > _SPEEDS_APART * v.min():
        from scipy.stats import theilslopes  # half a second

        with np.errstate(invalid="ignore"):  # of its confidence interval, where all times are one
            slope, constant = map(float, theilslopes(t, 1 / v)[:2])
        usual = float(np.median(t))
        # where most speeds are alike, times are equal to a sample
        is_distance = abs(constant) < _SMEARED_S and _scatter(v * t) <= _TIMES * max(_scatter(t), DT_S / usual)
        if np.median(np.abs(t - slope / v - constant) / t) > _OFF or not is_distance:
            is_late = usual > _LATE_ONSET_S and late.mean() >= _MOST and not np.median(test_free_s) > usual / 2
            return Gap(None, lasts, float(late.mean()), taken_m) if is_late else None
        distance = (distance + slope) / 2  # after CFC 60 the one is up to 8 % short, the other up to 8 % long
    if distance < LEAST_M or (test_speed.size and np.median(test_speed * test_free_s) > distance / 2):
        return None
    return Gap(distance, lasts, float(_is_through(free_s, distance / speed).mean()), taken_m)


def gap_s(time_s: FloatArray, accel: FloatArray, speed_mps: float, distance_m: float) -> float:
    """How long a run takes through a gap from time 0 on; 0 for one that decelerates before, as it has none."""
    begun = time_s >= 0
    if not speed_mps > CREEP_MPS or begun.sum() < _FEWEST:
        return 0.0
    lasts = distance_m / speed_mps
    return lasts if _is_through(np.array(free_travel_s(time_s[begun], accel[begun])), np.array(lasts)) else 0.0


def _scatter(values: FloatArray) -> float:
    return float(np.median(np.abs(values / np.median(values) - 1)))


def _is_through(free_s: FloatArray, lasts_s: FloatArray) -> npt.NDArray[np.bool_]:
    return np.asarray(free_s > np.maximum(lasts_s / 3, lasts_s - _SMEARED_S))


def _free_travel(table: ConditionTable) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Speed, time, and whether it ends suddenly, of some pulses that are fast enough."""
    speeds_mps = table.speeds_mps
    rows = np.flatnonzero(speeds_mps > max(CREEP_MPS, _FAST * float(np.nanmax(speeds_mps, initial=0.0))))
    rows = rows[:: max(-(-rows.size // _MOST_RUNS), 1)]
    pulses = [table.accel_mps2[row].astype(np.float64) for row in rows]
    begins = [onset(GRID_S, pulse) for pulse in pulses]
    sudden = [begin is not None and begin.is_sudden(0.0) for begin in begins]
    free_s = [free_travel_s(GRID_S, pulse) for pulse in pulses]
    return speeds_mps[rows], np.array(free_s), np.array(sudden, dtype=bool)


def unlike_others(tests: ConditionTable, runs: ConditionTable) -> list[str]:
    """Warnings of tests whose onset, or mean acceleration over 0 to 100 ms, is unlike that of the other tests."""
    moving, fast = (np.flatnonzero(table.speeds_mps > CREEP_MPS) for table in (tests, runs))
    if not fast.size:
        return []
    ids, speeds, measured = [tests.ids[row] for row in moving], tests.speeds_mps[moving], tests.accel_mps2[moving]
    onsets, means = _onsets(measured, speeds), measured.mean(axis=1, dtype=np.float64)
    run_speeds, usual_onsets, usual_means = runs.speeds_mps[fast], np.empty_like(onsets), np.empty_like(means)
    for i, v0 in enumerate(speeds.tolist()):
        near = _nearest(run_speeds, v0)
        accel = runs.accel_mps2[fast[near]]
        usual_onsets[i] = np.median(_onsets(accel, run_speeds[near]))
        usual_means[i] = v0 * np.median(accel.mean(axis=1, dtype=np.float64) / run_speeds[near])
    by = "by the other tests and the CAE runs near its speed"
    late = [
        f"tests.csv, {ids[i]}: its deceleration begins {abs(off) / MS:.1f} ms {'late' if off > 0 else 'early'} {by}; "
        "check its time zero, which is first contact."
        for i, off in _odd(onsets - usual_onsets, _LATE_S)
    ]
    return late + [
        f"tests.csv, {ids[i]}: its mean acceleration over 0 to 100 ms is {number(means[i] / G, '.1f')} g, expected "
        f"{number((means[i] - off) / G, '.1f')} g {by}; check the zero of its sensor, its time zero, scale and speed."
        for i, off in _odd(means - usual_means, _OFFSET_MPS2)
    ]


def confirmed_faults(
    tests: ConditionTable, runs: ConditionTable, *, is_comparable: bool
) -> dict[str, tuple[SensorFault, ...]]:
    """The faults of sensors that a record shows alone, and likely ones, that other, comparable tests do not show."""
    confirmed_of = {}
    for test_id, likely in tests.faults.items():
        row = tests.ids.index(test_id)
        measured, alike = tests.accel_mps2[row], _alike(tests, row)
        expected = _expected(tests, runs, row) if is_comparable else measured
        if sure := confirmed(likely, GRID_S, measured, expected, [*tests.accel_mps2[alike]]):
            confirmed_of[test_id] = sure
    return confirmed_of


def _nearest(speeds_mps: FloatArray, speed_mps: float) -> npt.NDArray[np.intp]:
    return np.argsort(np.abs(speeds_mps - speed_mps), kind="stable")[:NEAR]


def _alike(tests: ConditionTable, row: int) -> npt.NDArray[np.intp]:
    return np.setdiff1d(np.flatnonzero(np.abs(tests.speeds_mps - tests.speeds_mps[row]) < SPEED_STEP_MPS), row)


def _expected(tests: ConditionTable, runs: ConditionTable, row: int) -> FloatArray:
    test_speeds, run_speeds = tests.speeds_mps, runs.speeds_mps

    def model(test: int) -> FloatArray:
        return np.asarray(np.median(runs.accel_mps2[_nearest(run_speeds, test_speeds[test])], axis=0))

    alike = _alike(tests, row)
    others = alike if alike.size else np.delete(np.arange(test_speeds.size), row)
    added = [tests.accel_mps2[other] - model(other) for other in others]
    return model(row) + (np.median(added, axis=0) if added else 0.0)


def _odd(differences: FloatArray, limit: float) -> list[tuple[int, float]]:
    odd = []
    for i, difference in enumerate(differences):
        others = np.delete(differences, i)
        usual, most = 0.0, 2 * limit
        if others.size >= _FEWEST_OTHERS:
            usual = float(np.median(others))
            most = max(limit, _SCATTERED * float(np.median(np.abs(others - usual))))
        if abs(difference - usual) > most:
            odd.append((i, float(difference - usual)))
    return odd


def _onsets(accel: FloatArray, speeds: FloatArray) -> FloatArray:
    early = accel[:, : GRID_S.size // 2]
    gone = np.cumsum(early, axis=1, dtype=np.float64) * -DT_S >= _ONSET * speeds[:, None]
    return np.where(gone.any(axis=1), GRID_S[gone.argmax(axis=1)], GRID_S[early.shape[1]])
