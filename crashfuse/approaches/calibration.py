"""Calibration of bands: coverage of left-out tests, and the widening that a band needs to reach it."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import Self

import numpy as np

from crashfuse.approaches.left_out import STRIDE, LeftOut
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray, kinematics, motion

LEVEL = 0.95
LEVELS: FloatArray = np.linspace(0.05, 0.95, 19)
"""Nominal levels at which the coverage of bands is checked."""

CHECK_STRIDE = 5
"""Samples between those at which pulses are checked: at 0.4 ms the motion differs by less than draws do."""

WIDENINGS = (1.0, 1.15, 1.3, 1.5, 1.75, 2.0, 2.5)
_TINY = 1e-9  # m/s²


@dataclass(frozen=True, slots=True)
class Coverage:
    """Coverage of one left-out test by the 95 % band of its prediction.

    Attributes
    ----------
    accel, velocity : float
        Shares of the time up to zero velocity at which the measured a(t) and v(t) lie inside.
    rebound : float
        Share of the time after zero velocity at which a(t) lies inside; NaN if the vehicle does not stop in the record.
    crush, peak : bool
        Whether the measured maximum dynamic crush and peak deceleration lie inside their intervals.
    """

    accel: float
    velocity: float
    rebound: float
    crush: bool
    peak: bool

    @classmethod
    def of(cls, test: CrashTest, draws_mps2: FloatArray) -> Self:
        """Compare a test with equally likely pulses that were drawn without it.

        They are given on every k-th sample of the study grid, shape (n_draws, 1250 / k).
        """
        stride = N_SAMPLES // draws_mps2.shape[1]
        dt_s, time = stride * DT_S, GRID_S[::stride]
        speed, accel = test.condition.speed_mps, test.pulse.accel_mps2[::stride]
        velocity, displacement = motion(np.asarray(draws_mps2, dtype=np.float64), speed, dt_s)
        measured = kinematics(accel, speed, dt_s)
        loading = ~(measured.t0_s < time)
        accel_inside = _inside(draws_mps2, accel)
        crush = _inside(displacement.max(axis=1), measured.displacement_m.max())
        return cls(
            accel=float(accel_inside[loading].mean()),
            velocity=float(_inside(velocity[:, loading], measured.velocity_mps[loading]).mean()),
            rebound=float(accel_inside[~loading].mean()) if not loading.all() else float("nan"),
            crush=bool(crush),
            peak=bool(_inside(np.min(draws_mps2, axis=1), accel.min())),
        )


def shares_inside(test: CrashTest, draws_mps2: FloatArray, levels: FloatArray = LEVELS) -> FloatArray:
    """Share of the time up to zero velocity at which a left-out test's a(t) lies inside the band of each level."""
    accel = test.pulse.accel_mps2
    loading = ~(test.pulse.kinematics(test.condition.speed_mps).t0_s < GRID_S)
    below = (draws_mps2[:, loading] < accel[loading]).mean(axis=0)
    return np.asarray((np.abs(2 * below - 1) <= levels[:, None]).mean(axis=1))


def _inside(draws: FloatArray, true: FloatArray) -> np.ndarray:
    """Whether values lie inside the central interval of draws, shape (n_draws, ...).

    Where clearly more, or clearly fewer, draws lie beyond a value than beyond the interval's end, their number decides;
    quantiles, for which draws are sorted, are computed for the few other values alone.
    """
    tail = (1 - LEVEL) / 2
    end = int(tail * (len(draws) - 1))  # draws that lie beyond the interval's end for sure
    true = np.asarray(true)
    below, above = np.count_nonzero(draws < true, axis=0), np.count_nonzero(draws > true, axis=0)
    beyond = np.minimum(below, above)
    inside = np.asarray(beyond > end + 1)
    unclear = ~inside & (len(draws) - np.maximum(below, above) > end)
    if unclear.any():
        lower, upper = np.quantile(draws[:, unclear], [tail, 1 - tail], axis=0)
        inside[unclear] = (true[unclear] >= lower) & (true[unclear] <= upper)
    return inside


@dataclass(frozen=True, slots=True)
class Calibration:
    """Check of a band on tests left out one by one, and the widening that resulted.

    Attributes
    ----------
    widening : float
        Factor on every draw's deviation; 1 if the band held without widening.
    tests : tuple of Coverage
        One for each left-out test, with the widened band.
    late_widening : float, optional
        Factor after the time of zero velocity, if different.
    far : float
        Further factor far from all tests, where tests left out one by one say little.
    """

    widening: float
    tests: tuple[Coverage, ...]
    late_widening: float | None = None
    far: float = 1.0

    def further(self, nearness: float) -> float:
        """Factor on top of ``widening`` and ``late_widening`` at a condition of this nearness to a test."""
        return nearness + (1 - nearness) * self.far

    @property
    def holds(self) -> bool:
        """Whether curves lie inside 95 % of the time on average, and crush and peak in all tests but one in 20.

        The number of exceptions is rounded up: ten tests cannot distinguish nine in ten from nineteen in twenty.
        """
        n = len(self.tests)
        enough = n - int(np.ceil(round((1 - LEVEL) * n, 9)))  # one of 20, although 20 × 0.05 is slightly above 1
        curves = [self.share(name) for name in ("accel", "velocity", "rebound")]
        return self.count("crush") >= enough and self.count("peak") >= enough and all(not c < LEVEL for c in curves)

    def count(self, name: str) -> int:
        """Number of tests whose ``crush`` or ``peak`` lies inside."""
        return sum(getattr(test, name) for test in self.tests)

    def share(self, name: str) -> float:
        """Mean share of ``accel``, ``velocity`` or ``rebound`` over the tests that have a value."""
        values = np.array([getattr(test, name) for test in self.tests])
        known = values[~np.isnan(values)]
        return float(known.mean()) if known.size else float("nan")

    @property
    def counts(self) -> dict[str, object]:
        """Shares of time and numbers of tests inside the band, as plain JSON values."""
        shares = {name: self.share(name) for name in ("accel", "velocity", "rebound")}
        return {
            "left_out_tests": len(self.tests),
            "holds": self.holds,
            **{f"{name}_inside": None if np.isnan(share) else round(share, 3) for name, share in shares.items()},
            **{f"{name}_inside": self.count(name) for name in ("crush", "peak")},
        }

    @property
    def inside(self) -> FloatArray:
        """The coverages as an array, one row for each test, shape (n_tests, 5)."""
        return np.array([astuple(test) for test in self.tests], dtype=np.float64).reshape(-1, 5)

    @classmethod
    def of(cls, widening: float, inside: FloatArray, late_widening: float | None = None, far: float = 1.0) -> Self:
        """Create the calibration from rows as :attr:`inside` returns them."""
        tests = tuple(Coverage(a, v, after, bool(crush), bool(peak)) for a, v, after, crush, peak in inside.tolist())
        return cls(widening, tests, late_widening, far)

    @property
    def state(self) -> dict[str, object]:
        """The counts and the widening, as plain JSON values."""
        late = {} if self.late_widening is None else {"late_widening": self.late_widening}
        return {"widening": self.widening, **late, "far": round(self.far, 3), **self.counts}


def calibrate(check: Callable[[float], Sequence[Coverage]], widenings: Sequence[float] = WIDENINGS) -> Calibration:
    """Find the smallest widening with which a band holds on left-out tests; the largest one if none suffices.

    ``check`` takes a factor on every draw's deviation and returns the resulting coverage of each left-out test;
    ``widenings`` are the factors to try, in ascending order.
    """
    for widening in widenings:
        calibration = Calibration(widening, tuple(check(widening)))
        if calibration.holds:
            break
    return calibration


def widening_far(measured_mps2: FloatArray, speeds_mps: FloatArray, left_out: LeftOut) -> float:
    """Smallest widening with which a(t) of tests predicted from other speeds lies inside as often as it should.

    That is on average up to the time of zero velocity; 1 without such tests. ``measured_mps2`` and ``speeds_mps`` are
    those of all tests.
    """
    reach = []  # by how much each band would have to be widened at each time
    for number, mean, draws in zip(left_out.numbers, left_out.mean_mps2, left_out.draws_mps2, strict=True):
        measured = measured_mps2[number]
        loading = (~(kinematics(measured, speeds_mps[number], DT_S).t0_s < GRID_S))[::STRIDE]
        lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0) - mean
        off = measured[::STRIDE] - mean
        reach.append(np.maximum(off / np.maximum(upper, _TINY), off / np.minimum(lower, -_TINY))[loading])
    for widening in WIDENINGS if reach else ():
        if np.mean([(own <= widening).mean() for own in reach]) >= LEVEL:
            return widening
    return WIDENINGS[-1] if reach else 1.0
