"""The time domain's band: whole pulses drawn from the posterior, their spread checked on left-out tests."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from crashfuse.approaches.calibration import CHECK_STRIDE, Calibration, Coverage, calibrate
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.fine_tuning import Posterior
from crashfuse.approaches.time_domain.scaling import Scaling
from crashfuse.approaches.time_domain.stopping import SMOOTH_S, Stopping
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import DT_S, FloatArray

_LEAST_FREEDOM = 3  # of the draws; with fewer the variance is infinite
_HELD = Coverage(np.nan, np.nan, np.nan, crush=True, peak=True)


@dataclass(frozen=True, eq=False, slots=True)
class Band:
    """Pulses at any condition from the posterior of the networks' output there.

    Attributes
    ----------
    end_shares : ndarray, shape (n_tests,)
        Share of v0 left at the end of each test.
    """

    scaling: Scaling
    config: TcnConfig
    seed: int
    end_shares: FloatArray

    @classmethod
    def of(
        cls, tests: Sequence[CrashTest], outputs: FloatArray, scaling: Scaling, config: TcnConfig, seed: int
    ) -> Self:
        """Create it for networks with this scaling, tests and what they measured, in units of the network's output."""
        both = zip(tests, outputs, strict=True)
        shares = [Stopping.of(test.condition, scaling, config).end_share(own) for test, own in both]
        return cls(scaling, config, seed, np.array(shares))

    def stopping(self, condition: Condition) -> Stopping:
        """How the networks' output at a condition changes the velocity."""
        return Stopping.of(condition, self.scaling, self.config)

    def stopped(
        self, condition: Condition, lf: FloatArray, posterior: Posterior, without: Sequence[int] = ()
    ) -> Posterior:
        """Sum of LF networks and increments, smoothed to real pulses and constrained to a vehicle that stops.

        As if the tests with the numbers in ``without`` had not been run.
        """
        both = Posterior(lf + posterior.mean, posterior.covariance).smoothed(SMOOTH_S / (DT_S * self.config.stride))
        return self.stopping(condition).imposed(both, np.delete(self.end_shares, without))

    def pulses(
        self, condition: Condition, posterior: Posterior, calibration: Calibration, further: float = 1.0
    ) -> FloatArray:
        """Pulses in m/s², shape (1 + n_draws, 1250): the mean, then draws with widened deviations.

        The widening is that of the calibration, times a further factor.
        """
        late = calibration.late_widening or calibration.widening
        return self.drawn(condition, posterior)(further * calibration.widening, further * late)

    def drawn(self, condition: Condition, posterior: Posterior) -> Callable[[float, float], FloatArray]:
        """The pulses as a function of their widenings, before the stop and after it, in which they are linear."""
        n_draws, n_times = self.config.n_draws, posterior.mean.size
        dof = max(len(self.end_shares), _LEAST_FREEDOM)
        rng = np.random.default_rng(self.seed)
        normal = posterior.draw(n_draws, rng)
        # Student's t, as the variance itself is learned from a handful of tests
        factors = np.sqrt(max(dof - 2, 1) / rng.chisquare(dof, n_draws))
        deviations = np.vstack([np.zeros(n_times), factors[:, None] * normal])
        after = self.stopping(condition).after_t0(posterior.mean)
        parts = [posterior.mean[None], deviations * (1 - after), deviations * after]
        mean, early, late = (
            self.scaling.pulses(part, np.tile(condition.vector, (len(part), 1)), self.config) for part in parts
        )
        return lambda widening, late_widening: mean + widening * early + late_widening * late

    def check(
        self, tests: Sequence[CrashTest], left_out: Mapping[int, Posterior], watch: Watch
    ) -> tuple[Calibration, dict[int, FloatArray]]:
        """Widen the band until it holds on tests, each predicted without it; with the resulting pulses by number."""
        drawn = {number: self.drawn(tests[number].condition, posterior) for number, posterior in left_out.items()}
        pulses: dict[int, FloatArray] = {}

        def check(widening: float, late: float) -> list[Coverage]:
            watch.report("Checking the band on left-out tests", 0, 1)
            for number, own in drawn.items():
                pulses[number] = own(widening, late)
            return [Coverage.of(tests[number], drawn[1:, ::CHECK_STRIDE]) for number, drawn in pulses.items()]

        # Wider draws have higher peaks, so a measured peak below its interval is only reported and does not widen the
        # band. The rebound is less certain and has its own factor.
        first = calibrate(lambda w: [replace(c, rebound=np.nan, peak=True) for c in check(w, w)]).widening
        late = calibrate(lambda w: [replace(_HELD, rebound=c.rebound) for c in check(first, w)]).widening
        return Calibration(first, tuple(check(first, late)), late), pulses
