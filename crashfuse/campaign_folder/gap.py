"""A gap before the barrier in CAE runs: the vehicle moves freely before it decelerates, over one distance in all runs.

Its length over the speed is the time at which a run begins to decelerate, but for a constant: a filter brings an onset
forward by up to 4 ms, a soft bumper delays it.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from crashfuse.campaign_folder.plausibility import CREEP_MPS
from crashfuse.signals.onset import free_travel_s, onset
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.units import MS

LEAST_M = 0.015
"""Shorter gaps are no finding."""
_LEAST_S = 1e-3
_SMEARED_S = 5e-3  # by so much an onset may come before contact
_LATE_S, _TIMES = 3e-3, 4.0  # later than the tests, over no one distance; that scatters by so much more than the time
_MOST_RUNS, _FAST = 500, 1 / 3  # looked at, those faster than a share of the fastest: slow ones may begin gently
_FEWEST, _SPEEDS_APART = 3, 1.3  # runs, and the ratio of their speeds, that tell a distance from a time
_OFF = 0.15  # of the time of the onset, in the median: less is one distance
_MOST, _FEW = 0.5, 0.1  # shares of the runs: begin late over no one distance; are too few to be near any test


@dataclass(frozen=True, slots=True)
class Gap:
    """How far and how long CAE runs move freely, what share of them, and how much of a gap is taken out already.

    The distance, in m, is None if it is not one: records of a late trigger, or of models with different gaps.
    """

    distance_m: float | None
    lasts_s: tuple[float, float]
    share: float
    taken_m: float = 0.0

    @property
    def hides_tests(self) -> bool:
        """Whether tests cannot be compared with the CAE runs near their speed."""
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
        """That it is there, and what to do."""
        who = "the CAE runs move" if self.share == 1 else f"{100 * self.share:.0f} % of the CAE runs move"
        first, last = (f"{lasts / MS:.1f}" for lasts in self.lasts_s)
        far = f"freely for {first} to {last} ms before they decelerate, over no one distance"
        if self.distance_m is not None:
            far = f"{self.distance_m / MS:.0f} mm before they decelerate, whatever their speed"
        until = " Until then tests are not compared with CAE runs." if self.hides_tests else ""
        return f"cae.csv: {who} {far}; {self.advice}.{until}"


def find_gap(
    speeds_mps: FloatArray,
    accel: npt.NDArray[np.float32],
    test_speeds_mps: FloatArray,
    tests: npt.NDArray[np.float32],
    taken_m: float = 0.0,
) -> Gap | None:
    """The gap of CAE runs that have one, or begin late, where the tests do not; pulses have shape (n, 1250)."""
    speed, free_s, sudden = _free_travel(speeds_mps, accel)
    late = sudden & (free_s >= _LEAST_S) & (speed * free_s >= LEAST_M)
    if not late.any():
        return None
    v, t = speed[late], free_s[late]
    lasts = float(t.min()), float(t.max())
    test_speed, test_free_s, _ = _free_travel(test_speeds_mps, tests)
    distance = float(np.median(v * t))
    if v.size >= _FEWEST and v.max() > _SPEEDS_APART * v.min():
        from scipy.stats import theilslopes  # half a second

        with np.errstate(invalid="ignore"):  # of its confidence interval, where all times are one
            slope, constant = map(float, theilslopes(t, 1 / v)[:2])
        usual = np.median(t)
        is_distance = abs(constant) < _SMEARED_S and _scatter(v * t) <= _TIMES * _scatter(t)
        if np.median(np.abs(t - slope / v - constant) / t) > _OFF or not is_distance:
            is_late = usual > _LATE_S and late.mean() >= _MOST and not np.median(test_free_s) > usual / 2
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
    """The median deviation, as a share of the median."""
    return float(np.median(np.abs(values / np.median(values) - 1)))


def _is_through(free_s: FloatArray, lasts_s: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether runs move freely for as long as a gap lasts."""
    return np.asarray(free_s > np.maximum(lasts_s / 3, lasts_s - _SMEARED_S))


def _free_travel(
    speeds_mps: FloatArray, accel: npt.NDArray[np.float32]
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Speed, time of free travel, and whether that ends suddenly, of at most 500 pulses that are fast enough."""
    fastest = float(np.nanmax(speeds_mps, initial=0.0))
    rows = np.flatnonzero((speeds_mps > max(CREEP_MPS, _FAST * fastest)) & ~np.isnan(accel[:, 0]))  # NaN: unread
    rows = rows[:: max(-(-rows.size // _MOST_RUNS), 1)]
    pulses = [accel[row].astype(np.float64) for row in rows]
    begins = [onset(GRID_S, pulse) for pulse in pulses]
    sudden = [begin is not None and begin.is_sudden(0.0) for begin in begins]
    free_s = [free_travel_s(GRID_S, pulse) for pulse in pulses]
    return speeds_mps[rows], np.array(free_s), np.array(sudden, dtype=bool)
