"""Weights for mixing predictions, learned from left-out tests and how wide the components' bands are.

Each component supplies draws. A mixture takes a share of its draws from each, and is judged by the continuous ranked
probability score over time, E|X - y| - E|X - X'|/2 (Gneiting & Raftery 2007, Eq. 21): zero for a perfect prediction,
in the unit of the acceleration. The score is quadratic in the weights, so nothing has to be drawn twice.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Self

import numpy as np
from scipy.optimize import minimize
from scipy.special import softmax

from crashfuse.signals.pulse import FloatArray

_PAIRS = 100  # most draws of each component that are compared
_LEAST_MPS2 = 1e-3  # spread that counts as none


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
        own = [_between_all(draws) for draws in some]
        apart = np.diag([_apart(draws) for draws in some])
        for i, j in combinations(range(len(some)), 2):  # what is left of all pairs are those of one with the other
            total = _between_all(np.concatenate([some[i], some[j]]))
            apart[i, j] = apart[j, i] = (total - own[i] - own[j]) / (len(some[i]) * len(some[j]))
        return cls(away, apart)

    @property
    def spreads(self) -> FloatArray:
        """Mean distance between two draws of each component, shape (n_components,)."""
        return np.diagonal(self.apart)

    def crps(self, weights: FloatArray) -> float:
        """Score of the mixture with these weights."""
        return float(weights @ self.away - 0.5 * weights @ self.apart @ weights)


def _apart(draws: FloatArray) -> float:
    """E|X - X'| of one component, averaged over time; no draw is paired with itself."""
    n = len(draws)
    return _between_all(draws) / max(n * (n - 1) / 2, 1)


def _between_all(draws: FloatArray) -> float:
    """Sum of |x - x'| over all unordered pairs of draws, averaged over time."""
    n = len(draws)
    ranks: FloatArray = 2 * np.arange(n) - n + 1.0
    return float((ranks @ np.sort(draws, axis=0)).mean())


def spread(draws: FloatArray) -> float:
    """Mean distance between two draws: how sure of itself a component is."""
    return _apart(draws[:_PAIRS].astype(np.float64))


class Pool:
    """Component weights: a softmax of logits, linear in log ratios of the components' spreads.

    Far from the tests and beyond them bands grow, not all alike: so of the approaches those with narrow bands count for
    more, and the last component, the raw CAE, the less the narrower they are beside it. How much is learned.

    Parameters
    ----------
    prior : ndarray, shape (n_components, n_components + 1)
        Prior mean of the logits where all spreads are equal, and of their slopes: by the log ratio of each spread, in
        the order of the components, to the geometric mean of the approaches'.
    spread : float or ndarray, shape (n_components + 1,)
        Prior standard deviation of the logits, and of the slopes.
    strength : float
        Weight of the data against the prior: nats per test that a score improved by 100 % counts.

    Attributes
    ----------
    logits_ : ndarray, shape (n_components, n_components + 1)
    """

    def __init__(self, prior: FloatArray, *, spread: float | FloatArray, strength: float) -> None:
        self.prior, self.spread, self.strength = prior, spread, strength

    def fit(self, scores: Sequence[Scores]) -> Self:
        """Fit to left-out tests."""
        self.logits_ = self.prior
        if not scores:
            return self
        away = np.array([score.away for score in scores])
        apart = np.array([score.apart for score in scores])
        inputs = np.array([log_ratios(score.spreads) for score in scores])
        size = np.array([score.crps(np.full(len(self.prior), 1 / len(self.prior))) for score in scores])[:, None]

        def loss(flat: FloatArray) -> tuple[float, FloatArray]:
            logits = flat.reshape(self.prior.shape)
            weights = softmax(inputs @ logits.T, axis=1)
            among = np.einsum("nij,nj->ni", apart, weights)
            found = (weights * (away - 0.5 * among) / size).sum()
            by_weight = (away - among) / size
            by_logit = weights * (by_weight - (weights * by_weight).sum(axis=1, keepdims=True))
            off = (logits - self.prior) / self.spread
            gradient = self.strength * by_logit.T @ inputs + off / self.spread
            return float(self.strength * found + 0.5 * (off**2).sum()), gradient.ravel()

        best = minimize(loss, self.prior.ravel(), jac=True, method="L-BFGS-B").x
        self.logits_ = np.asarray(best).reshape(self.prior.shape)
        return self

    def weights(self, spreads: FloatArray) -> FloatArray:
        """Weights of the components where they have these spreads, shape (n_components,); they add up to 1."""
        return np.asarray(softmax(self.logits_ @ log_ratios(spreads)))


def log_ratios(spreads: FloatArray) -> FloatArray:
    """What logits are linear in: 1, and the log ratio of each spread to the geometric mean of all but the last."""
    logs = np.log(np.maximum(spreads, _LEAST_MPS2))
    return np.concatenate([[1.0], logs - logs[:-1].mean()])
