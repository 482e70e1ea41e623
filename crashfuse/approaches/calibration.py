"""Calibration of bands: how much of left-out tests lies inside, and how far a band has to be widened for it."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import Self

import numpy as np

from crashfuse.campaign import CrashTest
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics

LEVEL = 0.95
LEVELS: FloatArray = np.linspace(0.05, 0.95, 19)
"""Levels at which the coverage of bands is compared with what they promise."""

WIDENINGS = (1.0, 1.15, 1.3, 1.5, 1.75, 2.0, 2.5)


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much of one left-out test lies inside the 95 % band of its prediction.

    Attributes
    ----------
    accel, velocity : float
        Shares of the time up to zero velocity at which the measured a(t) and v(t) lie inside.
    rebound : float
        Share of the time after zero velocity at which a(t) does; NaN for a test that does not stop within the record.
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
        """Compare a test with equally likely pulses, shape (n_draws, 1250), that were drawn without it."""
        speed, accel = test.condition.speed_mps, test.pulse.accel_mps2
        drawn = kinematics(np.asarray(draws_mps2, dtype=np.float64), speed, DT_S)
        measured = kinematics(accel, speed, DT_S)
        loading = ~(measured.t0_s < GRID_S)
        accel_inside = _inside(draws_mps2, accel)
        crush = _inside(drawn.displacement_m.max(axis=1), measured.displacement_m.max())
        return cls(
            accel=float(accel_inside[loading].mean()),
            velocity=float(_inside(drawn.velocity_mps, measured.velocity_mps)[loading].mean()),
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
    lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    return np.asarray((true >= lower) & (true <= upper))


@dataclass(frozen=True, slots=True)
class Calibration:
    """A band checked on tests that were left out one by one, and how much it was widened for it.

    Attributes
    ----------
    widening : float
        Factor on every draw's deviation; 1 where the band held as it was.
    tests : tuple of Coverage
        One for each left-out test, with the widened band.
    late_widening : float, optional
        The factor after the time of zero velocity, if it differs.
    """

    widening: float
    tests: tuple[Coverage, ...]
    late_widening: float | None = None

    @property
    def holds(self) -> bool:
        """Whether curves lie inside for 95 % of the time on average, and crush and peak for all tests but one in 20.

        That one is rounded up: ten tests cannot tell nine in ten from nineteen in twenty.
        """
        n = len(self.tests)
        enough = n - int(np.ceil(round((1 - LEVEL) * n, 9)))  # of 20 one, though 20 × 0.05 is a little more than 1
        curves = [self.share(name) for name in ("accel", "velocity", "rebound")]
        return self.count("crush") >= enough and self.count("peak") >= enough and all(not c < LEVEL for c in curves)

    def count(self, name: str) -> int:
        """Number of tests whose ``crush`` or ``peak`` lies inside."""
        return sum(getattr(test, name) for test in self.tests)

    def share(self, name: str) -> float:
        """Mean share of ``accel``, ``velocity`` or ``rebound`` over the tests that have one."""
        values = np.array([getattr(test, name) for test in self.tests])
        known = values[~np.isnan(values)]
        return float(known.mean()) if known.size else float("nan")

    @property
    def counts(self) -> dict[str, object]:
        """Shares of time and numbers of tests inside, as plain JSON values."""
        shares = {name: self.share(name) for name in ("accel", "velocity", "rebound")}
        return {
            "left_out_tests": len(self.tests),
            "holds": self.holds,
            **{f"{name}_inside": None if np.isnan(share) else round(share, 3) for name, share in shares.items()},
            **{f"{name}_inside": self.count(name) for name in ("crush", "peak")},
        }

    @property
    def inside(self) -> FloatArray:
        """The coverages as rows of numbers, shape (n_tests, 5)."""
        return np.array([astuple(test) for test in self.tests], dtype=np.float64).reshape(-1, 5)

    @classmethod
    def of(cls, widening: float, inside: FloatArray, late_widening: float | None = None) -> Self:
        """The calibration with these rows of :attr:`inside`."""
        tests = tuple(Coverage(a, v, after, bool(crush), bool(peak)) for a, v, after, crush, peak in inside.tolist())
        return cls(widening, tests, late_widening)

    @property
    def state(self) -> dict[str, object]:
        """The counts, and the widening that led to them."""
        late = {} if self.late_widening is None else {"late_widening": self.late_widening}
        return {"widening": self.widening, **late, **self.counts}


def calibrate(check: Callable[[float], Sequence[Coverage]], widenings: Sequence[float] = WIDENINGS) -> Calibration:
    """Widen a band as little as is needed for it to hold on left-out tests; as far as is tried if it never does.

    ``check`` takes a factor on every draw's deviation, and gives the coverage of each left-out test with it; the
    widenings are those to try, ascending.
    """
    for widening in widenings:
        calibration = Calibration(widening, tuple(check(widening)))
        if calibration.holds:
            break
    return calibration
