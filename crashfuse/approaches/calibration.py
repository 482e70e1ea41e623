"""Calibration of bands on left-out tests (cross-validation): their predictions, coverage, and the widening needed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Self

import numpy as np

from crashfuse.approaches import base
from crashfuse.approaches.base import MOST_TESTS, Approach, FittedState, Prediction, whole_interval
from crashfuse.approaches.neighbours import nearness
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import DT_S, GRID_S, N_SAMPLES, FloatArray, in_full, kinematics, motion

LEVEL = 0.95
LEVELS: FloatArray = np.linspace(0.05, 0.95, 19)
"""Nominal levels at which the coverage of bands is checked."""

STRIDE = 10  # samples of the study grid: a CFC 60 pulse contains no finer detail
JUDGED = slice(round(0.06 / (STRIDE * DT_S)))  # the rated time in thinned samples: later errors decide nothing
CHECK_STRIDE = 5  # samples between those that are checked: at 0.4 ms the motion differs by less than draws do
WIDENINGS = (1.0, 1.15, 1.3, 1.5, 1.75, 2.0, 2.5)
LEAST_CHECKED = 3  # tests; with fewer, too little is left to learn from

HeldOutPredictor = Callable[[float], FloatArray]
"""Pulses predicted for a test without some tests, as a function of their widening: the expected one, then draws."""

DECAYS: FloatArray = np.array([0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0])
"""Powers of the nearness to tests that a correction may be multiplied by, see :func:`decay_over_speed`."""

_PRICE = 0.02  # least gain in log error by a unit of decay: on random vehicles a bias carries over
_DRAWS = 100
_TINY = 1e-9  # m/s²
_MOST_CHECKED = 20  # tests; more would not change the widening
_STEP = "Check of the band"
_FAR_UNCHECKED = 1.5  # widening far from tests at a single speed, which cannot tell: from random vehicles


@dataclass(frozen=True, eq=False, slots=True)
class LeftOut:
    """Pulses predicted for left-out tests, on every tenth sample of the study grid."""

    numbers: np.ndarray  # shape (n,): indices of these tests in the campaign
    mean_mps2: FloatArray  # shape (n, n_times)
    draws_mps2: np.ndarray  # float32, shape (n, n_draws, n_times)

    @classmethod
    def of(cls, pulses_mps2: Mapping[int, FloatArray]) -> "LeftOut":
        """Thin out pulses by test number, shape (1 + m, 1250 / k), k divides 10: the expected pulse, then draws."""
        thin = [pulses[: 1 + _DRAWS, :: STRIDE * pulses.shape[1] // N_SAMPLES] for pulses in pulses_mps2.values()]
        mean = np.array([pulses[0] for pulses in thin], dtype=np.float64)
        draws = np.array([pulses[1:] for pulses in thin], dtype=np.float32)
        return cls(np.array(list(pulses_mps2), dtype=np.int64), mean, draws)

    def widened(self, factors: Mapping[int, float]) -> "LeftOut":
        """With each test's deviations of draws times the factor under its number."""
        by = np.array([factors[int(number)] for number in self.numbers])[:, None, None]
        mean = self.mean_mps2[:, None]
        return LeftOut(self.numbers, self.mean_mps2, (mean + by * (self.draws_mps2 - mean)).astype(np.float32))

    def predictions(self, campaign: Campaign) -> dict[str, Prediction]:
        """The predictions on the study grid, by id, for the campaign that was learned from."""
        rows = zip(self.numbers, self.mean_mps2, self.draws_mps2, strict=True)
        return {test.id: predicted(test, mean, draws) for n, mean, draws in rows for test in [campaign.tests[n]]}

    def learned(self) -> FittedState:
        """The state to store."""
        return FittedState({}, {"numbers": self.numbers, "mean": self.mean_mps2, "draws": self.draws_mps2})

    @classmethod
    def restored(cls, learned: FittedState) -> "LeftOut":
        """Restore that state."""
        return cls(learned.arrays["numbers"], learned.arrays["mean"], learned.arrays["draws"])


def speed_groups(campaign: Campaign) -> list[tuple[int, ...]]:
    """For each test, the numbers of the tests of its speed group."""
    number = {test_id: i for i, test_id in enumerate(campaign.test_ids)}
    return [tuple(number[member] for member in campaign.speed_group(test_id)) for test_id in campaign.test_ids]


def predicted(test: CrashTest, mean_mps2: FloatArray, draws_mps2: FloatArray) -> Prediction:
    """A test's prediction from every tenth sample of its expected pulse and of draws."""
    return Prediction(test.condition, in_full(mean_mps2, STRIDE), in_full(draws_mps2.astype(np.float64), STRIDE))


@dataclass(frozen=True, slots=True)
class Coverage:
    """Coverage of one left-out test by the 95 % band of its prediction."""

    accel: float  # share of the time up to zero velocity at which a(t) lies inside
    velocity: float  # the same of v(t)
    rebound: float  # the same of a(t) after zero velocity; NaN if the vehicle does not stop in the record
    crush: bool  # maximum dynamic crush lies inside its interval
    peak: bool  # so does the peak deceleration
    whole: bool = True  # a(t) lies inside the band of whole pulses up to 60 ms throughout

    @classmethod
    def of(cls, test: CrashTest, draws_mps2: FloatArray, *, whole: bool = True) -> Self:
        """Compare a test with draws of pulses without it, at every k-th sample, (n_draws, 1250 / k)."""
        stride = N_SAMPLES // draws_mps2.shape[1]
        dt_s, time = stride * DT_S, GRID_S[::stride]
        speed, accel = test.condition.speed_mps, test.pulse.accel_mps2[::stride]
        velocity, displacement = motion(np.asarray(draws_mps2, dtype=np.float64), speed, dt_s)
        measured = kinematics(accel, speed, dt_s)
        loading = ~(measured.t0_s < time)
        accel_inside = _inside(draws_mps2, accel)
        return cls(
            accel=float(accel_inside[loading].mean()),
            velocity=float(_inside(velocity[:, loading], measured.velocity_mps[loading]).mean()),
            rebound=float(accel_inside[~loading].mean()) if not loading.all() else float("nan"),
            crush=bool(_inside(displacement.max(axis=1), measured.displacement_m.max())),
            peak=bool(_inside(np.min(draws_mps2, axis=1), accel.min())),
            whole=whole and base.holds_whole(whole_interval(draws_mps2), test.pulse.accel_mps2),
        )


def shares_inside(test: CrashTest, draws_mps2: FloatArray, levels: FloatArray = LEVELS) -> FloatArray:
    """Share of the time up to zero velocity at which a test's a(t) lies inside the band of each level."""
    accel = test.pulse.accel_mps2
    loading = ~(test.pulse.kinematics(test.condition.speed_mps).t0_s < GRID_S)
    below = (draws_mps2[:, loading] < accel[loading]).mean(axis=0)
    return np.asarray((np.abs(2 * below - 1) <= levels[:, None]).mean(axis=1))


def _inside(draws: FloatArray, true: FloatArray) -> np.ndarray:
    lower, upper = base.central_interval(draws, LEVEL)
    return np.asarray((lower <= true) & (true <= upper))


@dataclass(frozen=True, slots=True)
class Calibration:
    """Check of a band on tests left out one by one, and the widening that resulted."""

    widening: float  # factor on every draw's deviation
    tests: tuple[Coverage, ...]  # of each left-out test by the widened band
    late_widening: float | None = None  # factor after the time of zero velocity, if different
    far: float = 1.0  # further factor far from all tests, where tests left out one by one say little

    def further(self, nearness: float) -> float:
        """Further factor at a condition of this nearness to a test."""
        return nearness + (1 - nearness) * self.far

    def with_whole(self, drawn: Iterable[tuple[CrashTest, FloatArray]]) -> Self:
        """With the whole pulses inside, by each test's widened draws: they decide no widening, so are counted once."""
        whole = [base.holds_whole(whole_interval(draws_mps2), test.pulse.accel_mps2) for test, draws_mps2 in drawn]
        return replace(self, tests=tuple(replace(c, whole=w) for c, w in zip(self.tests, whole, strict=True)))

    @property
    def holds(self) -> bool:
        """Whether curves lie inside 95 % of the time on average, and crush and peak in all tests but one in 20.

        Exceptions are rounded up: ten tests cannot distinguish nine in ten from nineteen in twenty.
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
        shares = np.array([getattr(test, name) for test in self.tests])
        known = shares[~np.isnan(shares)]
        return float(known.mean()) if known.size else float("nan")

    def learned(self) -> FittedState:
        """The state to store."""
        inside = np.array([astuple(test) for test in self.tests], dtype=np.float64).reshape(-1, 6)
        values = {"widening": self.widening, "late_widening": self.late_widening, "far": self.far}
        return FittedState(values, {"inside": inside})

    @classmethod
    def restored(cls, learned: FittedState) -> Self:
        """Restore that state."""
        rows = learned.arrays["inside"].tolist()
        return cls(tests=tuple(Coverage(*row[:3], *map(bool, row[3:])) for row in rows), **learned.values)

    @property
    def state(self) -> dict[str, object]:
        """The counts and the widening, as plain JSON values."""
        late = {} if self.late_widening is None else {"late_widening": self.late_widening}
        return {"widening": self.widening, **late, "far": round(self.far, 3), **self.counts}

    @property
    def counts(self) -> dict[str, object]:
        """Shares of time and numbers of tests inside the band, as plain JSON values."""
        shares = {name: self.share(name) for name in ("accel", "velocity", "rebound")}
        return {
            "left_out_tests": len(self.tests),
            "holds": self.holds,
            **{f"{name}_inside": None if np.isnan(share) else round(share, 3) for name, share in shares.items()},
            **{f"{name}_inside": self.count(name) for name in ("crush", "peak", "whole")},
        }


def calibrate(check: Callable[[float], Sequence[Coverage]], widenings: Sequence[float] = WIDENINGS) -> Calibration:
    """The first widening with which left-out tests are covered by ``check``; the last one if none suffices."""
    for widening in widenings:
        calibration = Calibration(widening, tuple(check(widening)))
        if calibration.holds:
            break
    return calibration


def widening_far(measured_mps2: FloatArray, speeds_mps: FloatArray, left_out: LeftOut) -> float:
    """Smallest widening with which a(t) of tests predicted from other speeds lies inside as often as it should.

    That is on average up to the time of zero velocity; 1 without such tests.
    """
    reach = []  # by how much each band would have to be widened at each time
    for number, mean, draws in zip(left_out.numbers, left_out.mean_mps2, left_out.draws_mps2, strict=True):
        measured = measured_mps2[number]
        loading = (~(kinematics(measured, speeds_mps[number], DT_S).t0_s < GRID_S))[::STRIDE]
        lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0) - mean
        off = measured[::STRIDE] - mean
        reach.append(np.maximum(off / np.maximum(upper, _TINY), off / np.minimum(lower, -_TINY))[loading])
    for widening in WIDENINGS if reach else ():
        if np.mean([(factors <= widening).mean() for factors in reach]) >= LEVEL:
            return widening
    return WIDENINGS[-1] if reach else 1.0


def decay_over_speed(log_errors: Mapping[tuple[int, ...], Sequence[FloatArray]]) -> float:
    """How fast a correction ceases with the distance in speed to tests: 0 if it carries over to any speed.

    Of :data:`DECAYS` it is that with the least error of speed groups, predicted from other speeds, among those with
    which no group is predicted worse. ``log_errors`` are those of the tests of each group, shape (n_decays,).
    """
    changes = np.array([np.mean(rows, axis=0) for rows in log_errors.values()]).reshape(-1, DECAYS.size)
    changes -= changes[:, :1]
    total = np.where((changes <= 0).all(axis=0), changes.sum(axis=0), np.inf)
    return float(DECAYS[(total + _PRICE * DECAYS).argmin()])


class BandedApproach(Approach):
    """An approach whose band is calibrated on left-out tests."""

    calibration_: Calibration
    left_out_: LeftOut
    left_out_groups_: LeftOut  # each test with its whole speed group; empty if all tests are at one speed

    def left_out(self, campaign: Campaign) -> dict[str, Prediction]:
        """Predictions of the tests from the check of the band."""
        self._require("left_out_")
        return self.left_out_.predictions(campaign.evenly_over_speed(MOST_TESTS))

    def _learned_band(self) -> dict[str, FittedState]:
        left_out = {"left_out": self.left_out_.learned(), "left_out_groups": self.left_out_groups_.learned()}
        return {"band": self.calibration_.learned(), **left_out}

    def _restore_band(self, learned: FittedState) -> None:
        self.calibration_ = Calibration.restored(learned.part("band"))
        self.left_out_ = LeftOut.restored(learned.part("left_out"))
        self.left_out_groups_ = LeftOut.restored(learned.part("left_out_groups"))


def checked(campaign: Campaign) -> list[int]:
    """Numbers of the tests that a band is checked on."""
    n = len(campaign.tests)
    return sorted(set(np.linspace(0, n - 1, min(n, _MOST_CHECKED)).astype(int).tolist()))


def check_band(
    campaign: Campaign, without: Callable[[int, tuple[int, ...]], HeldOutPredictor], watch: Watch
) -> tuple[Calibration, LeftOut, LeftOut]:
    """Widen a band until it holds on left-out tests; also their predictions without them, and without their speeds.

    ``without`` takes a test's number and those left out with it.
    """
    tests, numbers, predictors = campaign.tests, checked(campaign), {}
    for done, number in enumerate(numbers):
        watch.report(_STEP, done, len(numbers))
        predictors[number] = without(number, (number,))
    alone: dict[int, FloatArray] = {}

    def check(widening: float) -> list[Coverage]:
        for number, predictor in predictors.items():
            watch.report(_STEP, len(numbers), len(numbers))  # makes it cancellable
            alone[number] = predictor(widening)
        return [Coverage.of(tests[number], pulses[1:], whole=False) for number, pulses in alone.items()]

    calibration = calibrate(check).with_whole((tests[number], pulses[1:]) for number, pulses in alone.items())
    groups = speed_groups(campaign)
    apart = {}
    for number in alone:
        watch.report(_STEP, len(alone), len(alone))
        if len(groups[number]) == 1:
            apart[number] = alone[number]
        elif len(groups[number]) < len(tests):
            apart[number] = without(number, groups[number])(calibration.widening)
    return calibration, LeftOut.of(alone), LeftOut.of(apart)


def check_band_far(
    campaign: Campaign, near: Calibration, alone: LeftOut, apart: LeftOut
) -> tuple[Calibration, LeftOut, LeftOut]:
    """Widen a band far from tests, too; also the predictions of left-out tests, as wide as that far from others."""
    measured = np.array([test.pulse.accel_mps2 for test in campaign.tests])
    speeds = np.array([test.condition.speed_mps for test in campaign.tests])
    far = widening_far(measured, speeds, apart) if apart.numbers.size else _FAR_UNCHECKED
    calibration = replace(near, far=far)

    def further(left_out: Sequence[Sequence[int]]) -> dict[int, float]:
        nearest = (nearness(speeds[number], speeds, out) for number, out in enumerate(left_out))
        return {number: calibration.further(near_by) for number, near_by in enumerate(nearest)}

    singly = [(number,) for number in range(len(speeds))]
    return calibration, alone.widened(further(singly)), apart.widened(further(speed_groups(campaign)))
