"""The time domain's band: whole pulses that stop the vehicle (Eq. 11), their spread checked on left-out tests."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from crashfuse.approaches.base import draw
from crashfuse.approaches.calibration import CHECK_STRIDE, Calibration, Coverage, calibrate
from crashfuse.approaches.time_domain.fine_tuning import Posterior
from crashfuse.approaches.time_domain.network import Scaling
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics

SMOOTH_S = 0.0032  # increments vary faster than real pulses, and draws that oscillate too fast have too high peaks
_LEAST_SPREAD = 0.02  # least spread of the share of v0 left at the end of the record
_UNKNOWN_SPREAD = 0.1  # with a single test

_LEAST_FREEDOM = 3  # of the draws; with fewer the variance is infinite
_HELD = Coverage(np.nan, np.nan, np.nan, crush=True, peak=True)


@dataclass(frozen=True, eq=False, slots=True)
class Stopping:
    """Relation of network outputs to the velocity of a vehicle at one condition; shape (n_times,) each."""

    time_s: FloatArray
    change: FloatArray  # of velocity over the record by each output, as a share of v0

    @classmethod
    def of(cls, condition: Condition, scaling: Scaling) -> Self:
        """Create it for a condition and networks with this scaling."""
        time = GRID_S[:: scaling.config.stride]
        weights = np.full(time.size, time[1])
        weights[[0, -1]] /= 2
        return cls(time, weights * scaling.outputs(condition.vector[None]) / condition.speed_mps)

    def end_share(self, outputs: FloatArray) -> float:
        """Share of v0 left at the end of the record; below 0 after a rebound."""
        return float(1 + self.change @ outputs)

    def after_t0(self, outputs: FloatArray) -> FloatArray:
        """Weights that rise from 0 to 1 where these outputs have stopped the vehicle, shape (n_times,)."""
        share_left = 1 + np.cumsum(self.change * outputs)
        t0 = self.time_s[np.argmax(share_left <= 0)] if (share_left <= 0).any() else self.time_s[-1]
        after: FloatArray = 1 - np.exp(-np.maximum(self.time_s - t0, 0.0) / SMOOTH_S)
        return after

    def imposed(self, posterior: Posterior, end_shares: FloatArray) -> Posterior:
        """Condition the output on a vehicle that stops and rebounds about as in the tests: one more measurement, ΔV."""
        if not len(end_shares):
            return posterior
        spread = max(float(end_shares.std(ddof=1)), _LEAST_SPREAD) if len(end_shares) > 1 else _UNKNOWN_SPREAD
        measurement = self.change, float(end_shares.mean()) - 1, spread**2
        stopped = posterior.given(*measurement)
        after = self.after_t0(posterior.mean)
        if not after.any():
            return stopped
        # The expected pulse already stops the vehicle, so only the part after the stop is corrected.
        return Posterior(posterior.given(*measurement, where=after).mean, stopped.covariance)


def stopping_notes(condition: Condition, pulse_mps2: FloatArray, lf_mps2: FloatArray) -> tuple[str, ...]:
    """A sentence if a predicted pulse does not stop the vehicle although the CAE model's does."""
    motion = kinematics(np.array([pulse_mps2, lf_mps2]), condition.speed_mps, DT_S)
    if not (np.isnan(motion.t0_s[0]) and np.isfinite(motion.t0_s[1])):
        return ()
    left = motion.velocity_mps[0].min() / condition.speed_mps
    stop = f"does not stop the vehicle within {GRID_S[-1] * 1e3:.0f} ms, as the CAE model's does"
    return (f"The predicted pulse {stop}: {left:.1%} of the impact speed is left.",)


@dataclass(frozen=True, eq=False, slots=True)
class Band:
    """Pulses at any condition from the posterior of the networks' output there."""

    scaling: Scaling
    seed: int
    end_shares: FloatArray  # share of v0 left at the end of each test, shape (n_tests,)

    @classmethod
    def of(cls, tests: Sequence[CrashTest], outputs: FloatArray, scaling: Scaling, seed: int) -> Self:
        """Create it from tests with their pulses in units of the networks' output."""
        pairs = zip(tests, outputs, strict=True)
        shares = [Stopping.of(test.condition, scaling).end_share(pulse) for test, pulse in pairs]
        return cls(scaling, seed, np.array(shares))

    def stopped(
        self, condition: Condition, lf: FloatArray, posterior: Posterior, without: Sequence[int] = ()
    ) -> Posterior:
        """LF networks and increments, smoothed and made to stop the vehicle, without some tests."""
        n_steps = SMOOTH_S / (DT_S * self.scaling.config.stride)
        total = Posterior(lf + posterior.mean, posterior.covariance).smoothed(n_steps)
        return Stopping.of(condition, self.scaling).imposed(total, np.delete(self.end_shares, without))

    def pulses(
        self, condition: Condition, posterior: Posterior, calibration: Calibration, further: float = 1.0
    ) -> FloatArray:
        """Pulses in m/s², shape (1 + n_draws, 1250): the mean, then draws widened as calibrated, times a factor."""
        late = calibration.late_widening or calibration.widening
        return self.drawn(condition, posterior)(further * calibration.widening, further * late)

    def drawn(self, at: Condition, posterior: Posterior, stride: int = 1) -> Callable[[float, float], FloatArray]:
        """The pulses, thinned, as a function of their widenings, before the stop and after it."""
        n_draws, n_times = self.scaling.config.n_draws, posterior.mean.size
        dof = max(len(self.end_shares), _LEAST_FREEDOM)
        rng = np.random.default_rng(self.seed)
        normal = draw(np.zeros(n_times), posterior.covariance, n_draws, rng)
        # Student's t, as the variance itself is learned from a handful of tests
        factors = np.sqrt(max(dof - 2, 1) / rng.chisquare(dof, n_draws))
        deviations = np.vstack([np.zeros(n_times), factors[:, None] * normal])
        after = Stopping.of(at, self.scaling).after_t0(posterior.mean)
        parts = [posterior.mean[None], deviations * (1 - after), deviations * after]
        pulses = map(self.scaling.pulses, parts, (np.tile(at.vector, (len(part), 1)) for part in parts))
        mean, early, late = (np.ascontiguousarray(rows[:, ::stride]) for rows in pulses)
        return lambda widening, late_widening: mean + widening * early + late_widening * late

    def check(
        self, tests: Sequence[CrashTest], left_out: Mapping[int, Posterior], watch: Watch
    ) -> tuple[Calibration, dict[int, FloatArray]]:
        """Widen the band until it holds on left-out tests; also every fifth sample of their pulses by number."""
        drawn = {n: self.drawn(tests[n].condition, posterior, CHECK_STRIDE) for n, posterior in left_out.items()}
        pulses: dict[int, FloatArray] = {}

        def check(widening: float, late: float) -> list[Coverage]:
            watch.report("Checking the band on left-out tests", 0, 1)
            for number, widened in drawn.items():
                pulses[number] = widened(widening, late)
            return [Coverage.of(*own, whole=False) for own in draws()]

        def draws() -> list[tuple[CrashTest, FloatArray]]:
            return [(tests[number], rows[1:]) for number, rows in pulses.items()]

        # Wider draws have higher peaks, so a measured peak below its interval is only reported and does not widen the
        # band. The rebound is less certain and has its own factor.
        first = calibrate(lambda w: [replace(c, rebound=np.nan, peak=True) for c in check(w, w)]).widening
        late = calibrate(lambda w: [replace(_HELD, rebound=c.rebound) for c in check(first, w)]).widening
        return Calibration(first, tuple(check(first, late)), late).with_whole(draws()), pulses
