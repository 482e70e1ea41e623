"""Next test: where one more test would shrink the displacement domain's band most, over a range of conditions.

The bias is a Gaussian process, whose variance depends on where tests were run and not on their results. This is the
sequential design of Sacks et al., Statistical Science 4 (1989), or Cohn, Neural Networks 9 (1996), but with the mean
standard deviation instead of the mean variance, which a few wide spots dominate.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.displacement_domain.hierarchical_bias import HierarchicalBias
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError
from crashfuse.execution.process import one_thread
from crashfuse.signals.pulse import FloatArray
from crashfuse.wording import Sentence

_N_TARGETS = 48


@dataclass(frozen=True, slots=True)
class ConditionRange:
    """The range of speeds and weights of interest, for one combination of factors; equal limits keep a value fixed."""

    low: Condition
    high: Condition

    def __post_init__(self) -> None:
        low, high = self.low.vector, self.high.vector
        if not (np.isfinite(high).all() and (low > 0).all() and (low <= high).all()):
            raise UsageError(
                Sentence("A range goes from values above 0 to higher ones, not from {} to {}.", self.low, self.high)
            )
        if self.low.factors != self.high.factors:
            raise UsageError(f"A range is of one kind of vehicle, not from {self.low.factors} to {self.high.factors}.")

    @classmethod
    def of(cls, tests: Sequence[CrashTest]) -> Self:
        """The range of tests, with the combination of factors tested most often; a UsageError without tests."""
        if not tests:
            raise UsageError("A range needs a test, or limits of your own.")
        vectors = np.array([test.condition.vector for test in tests])
        [(kind, _)] = Counter(test.condition.factors for test in tests).most_common(1)
        return cls(*_conditions(np.array([vectors.min(axis=0), vectors.max(axis=0)]), kind))

    def grid(self, n_speeds: int, n_weights: int = 1) -> tuple[Condition, ...]:
        """Conditions at evenly spaced speeds and weights, limits included; if just one, the middle value."""
        numbers = (n_speeds, n_weights, n_weights)
        axes = [
            np.unique(np.linspace(low, high, n) if n > 1 else (low + high) / 2)
            for low, high, n in zip(self.low.vector, self.high.vector, numbers, strict=True)
        ]
        return _conditions(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), self.low.factors)

    def spread(self, n: int) -> tuple[Condition, ...]:
        """Conditions that fill the range evenly: the first points of the Halton sequence, so always the same."""
        from scipy.stats import qmc  # half a second

        shares = qmc.Halton(d=3, scramble=False).random(n + 1)[1:]  # the first is a corner
        return _conditions(self.low.vector + shares * (self.high.vector - self.low.vector), self.low.factors)


def _conditions(vectors: FloatArray, factors: tuple[tuple[str, str], ...]) -> tuple[Condition, ...]:
    return tuple(Condition.of_vector([v, front, rear], factors) for v, front, rear in vectors.tolist())


@dataclass(frozen=True, slots=True)
class NextTest:
    """A possible next test, and its effect on half the width of the 95 % band of the bias, mean over the range."""

    condition: Condition
    before_mps2: float
    after_mps2: float
    extrapolation: tuple[str, ...] = ()  # notes on its inputs outside the CAE runs' range

    def __repr__(self) -> str:
        return f"<NextTest at {self.condition}: {100 * self.gain:.1f} % narrower>"

    @property
    def gain(self) -> float:
        """Share by which the band would shrink."""
        return 1 - self.after_mps2 / self.before_mps2


def rank_next_tests(
    domain: DisplacementDomain,
    over: ConditionRange,
    candidates: Sequence[Condition] | None = None,
    planned: Sequence[Condition] = (),
) -> tuple[NextTest, ...]:
    """Rank conditions by how much a test there would shrink the band over a range, the largest gain first.

    The band is that of a new test's bias, averaged over the range and over displacement up to the crush of the CAE
    pulse. A candidate is assumed to crush like its CAE pulse, and to scatter as tests do. Hyperparameters stay. Rebound
    and emulator are left out.

    The domain has to have the hierarchical bias, not that of Table 4. Candidates, by default 14 speeds at the middle
    weights, may lie outside the range. Planned tests count as run: to choose several, add the best one each time.
    """
    candidates = over.grid(14) if candidates is None else candidates
    targets = [domain.expected_points(condition) for condition in over.spread(_N_TARGETS)]
    bias = domain.bias_
    if not isinstance(bias, HierarchicalBias):
        raise UsageError("The next test is chosen by the hierarchical bias (preset fast), not that of Table 4.")
    if open_factors := bias.unknown_factors(over.low):
        raise UsageError(f"Tests differ by {' and '.join(open_factors)}: say for which of these the range is.")
    with one_thread():
        bias = bias.also([domain.expected_points(condition) for condition in planned])
        now, then = bias.half_widths(targets, [domain.expected_points(condition) for condition in candidates])
    weights = np.concatenate([np.full(n := t.displacement_m.size, 1 / (n * len(targets))) for t in targets])
    widening, cae = domain.calibration_.widening, domain.model_.cae_
    before, after = (widening * half_width @ weights for half_width in (now, then))
    ranked = np.argsort(after, kind="stable")
    return tuple(
        NextTest(c := candidates[i], float(before), float(after[i]), cae.extrapolation(c)) for i in ranked.tolist()
    )
