"""Physical constraint on networks over time: a crash pulse has to bring its vehicle to a stop (Eq. 11)."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.fine_tuning import Posterior
from crashfuse.approaches.time_domain.scaling import Scaling
from crashfuse.condition import Condition
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics

SMOOTH_S = 0.0032  # increments vary faster than real pulses, and draws that oscillate too fast have too high peaks
_LEAST_SPREAD = 0.02  # least spread of the share of v0 left at the end of the record
_UNKNOWN_SPREAD = 0.1  # with a single test


@dataclass(frozen=True, eq=False, slots=True)
class Stopping:
    """Relation of network outputs to the velocity of a vehicle at one condition.

    Attributes
    ----------
    time_s : ndarray, shape (n_times,)
        Times of the outputs.
    change : ndarray, shape (n_times,)
        Contribution of each output to the change of velocity over the record, as a share of v0.
    """

    time_s: FloatArray
    change: FloatArray

    @classmethod
    def of(cls, condition: Condition, scaling: Scaling, config: TcnConfig) -> Self:
        """Create it for a condition and for networks with this scaling and configuration."""
        time = GRID_S[:: config.stride]
        weights = np.full(time.size, time[1])
        weights[[0, -1]] /= 2
        return cls(time, weights * scaling.outputs(condition.vector[None], config) / condition.speed_mps)

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
        """Condition the output on a vehicle that stops and rebounds about as those in the tests did.

        Eq. 11 over the whole record is one more measurement: acceleration must integrate to ΔV. ``end_shares`` are the
        shares of v0 left at the end of each test; without any, nothing is imposed.
        """
        if not len(end_shares):
            return posterior
        spread = max(float(end_shares.std(ddof=1)), _LEAST_SPREAD) if len(end_shares) > 1 else _UNKNOWN_SPREAD
        known = self.change, float(end_shares.mean()) - 1, spread**2
        stopped = posterior.given(*known)
        after = self.after_t0(posterior.mean)
        if not after.any():
            return stopped
        # The expected pulse already stops the vehicle, so only the part after the stop is corrected.
        return Posterior(posterior.given(*known, where=after).mean, stopped.covariance)


def stopping_notes(condition: Condition, pulse_mps2: FloatArray, lf_mps2: FloatArray) -> tuple[str, ...]:
    """A sentence if a predicted pulse does not stop the vehicle although the CAE model's does."""
    motion = kinematics(np.array([pulse_mps2, lf_mps2]), condition.speed_mps, DT_S)
    if not (np.isnan(motion.t0_s[0]) and np.isfinite(motion.t0_s[1])):
        return ()
    left = motion.velocity_mps[0].min() / condition.speed_mps
    return (
        f"The predicted pulse does not stop the vehicle within {GRID_S[-1] * 1e3:.0f} ms, as the CAE model's does: "
        f"{left:.1%} of the impact speed is left.",
    )
