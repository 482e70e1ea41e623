"""Weights for mixing predictions, learned from left-out tests and how near their neighbours are.

Each component supplies draws. A mixture takes a share of its draws from each, and is judged by the continuous ranked
probability score over time, E|X - y| - E|X - X'|/2 (Gneiting & Raftery 2007, Eq. 21): zero for a perfect prediction,
in the unit of the acceleration. The score is quadratic in the weights, so nothing has to be drawn twice.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import softmax

from crashfuse.signals.pulse import FloatArray

_PAIRS = 100  # most draws of each component that are compared


@dataclass(frozen=True, eq=False, slots=True)
class Scores:
    """Terms from which the score of any mixture follows, for one left-out test.

    Attributes
    ----------
    away : ndarray, shape (n_components,)
        Mean distance of each component's draws from the measured pulse, E|X - y|.
    apart : ndarray, shape (n_components, n_components)
        Mean distance between draws of two components, E|X - X'|.
    """

    away: FloatArray
    apart: FloatArray

    @classmethod
    def of(cls, measured: FloatArray, components: list[FloatArray]) -> "Scores":
        """Compare a measured pulse, shape (n_times,), with each component's draws, shape (n_draws, n_times)."""
        some = [draws[:_PAIRS].astype(np.float64) for draws in components]
        away = np.array([np.abs(draws - measured).mean() for draws in some])
        apart = np.array([[_apart(a, b) for b in some] for a in some])
        return cls(away, apart)

    def crps(self, weights: FloatArray) -> float:
        """Score of the mixture with these weights."""
        return float(weights @ self.away - 0.5 * weights @ self.apart @ weights)


def _apart(a: FloatArray, b: FloatArray) -> float:
    """E|X - X'|, averaged over time; within one component, no draw is paired with itself."""
    if a is b:
        ordered = np.sort(a, axis=0)
        n = len(a)
        ranks = 2 * np.arange(n) - n + 1
        return float(2 * (ranks[:, None] * ordered).sum(axis=0).mean() / max(n * (n - 1), 1))
    joined = np.sort(np.concatenate([a, b]), axis=0)
    n = len(joined)
    total = ((2 * np.arange(n) - n + 1)[:, None] * joined).sum(axis=0).mean()  # over unordered pairs
    own = sum(_apart(x, x) * len(x) * (len(x) - 1) / 2 for x in (a, b))
    return float((total - own) / (len(a) * len(b)))


class Pool:
    """Component weights: a softmax of logits learned for a test far from all others and for one beside another.

    Parameters
    ----------
    prior : ndarray, shape (n_components, 2)
        Prior mean of the logits: far from, and beside, another test.
    spread : float
        Prior standard deviation of the logits.
    strength : float
        Weight of the data against the prior: nats per test that a score improved by 100 % counts.

    Attributes
    ----------
    logits_ : ndarray, shape (n_components, 2)
    """

    def __init__(self, prior: FloatArray, *, spread: float, strength: float) -> None:
        self.prior, self.spread, self.strength = prior, spread, strength

    def fit(self, scores: list[Scores], nearness: FloatArray) -> "Pool":
        """Fit to left-out tests; nearness, shape (n_tests,), is 0 far from all others and 1 beside one."""
        size = np.array([score.crps(np.full(len(self.prior), 1 / len(self.prior))) for score in scores])

        def loss(flat: FloatArray) -> float:
            self.logits_ = flat.reshape(self.prior.shape)
            found = np.array([s.crps(self.weights(near)) for s, near in zip(scores, nearness, strict=True)])
            away = (self.logits_ - self.prior) / self.spread
            return float(self.strength * (found / size).sum() + 0.5 * (away**2).sum())

        best = minimize(loss, self.prior.ravel(), method="L-BFGS-B").x if scores else self.prior.ravel()
        self.logits_ = np.asarray(best).reshape(self.prior.shape)
        return self

    def weights(self, nearness: float) -> FloatArray:
        """Weights of the components for a crash of this nearness to a test; they add up to 1."""
        return np.asarray(softmax(self.logits_ @ np.array([1 - nearness, nearness])))
