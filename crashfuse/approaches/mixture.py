"""The mixture behind the fused prediction: its components, and weights learned from left-out tests.

A mixture takes a share of its draws from each component, and is judged by the continuous ranked probability score over
time, E|X - y| - E|X - X'|/2 (Gneiting & Raftery 2007, Eq. 21), which is quadratic in the weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple, Self

import numpy as np
from scipy.optimize import minimize
from scipy.special import softmax

from crashfuse.approaches.base import Approach
from crashfuse.approaches.calibration import STRIDE, LeftOut
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.neighbours import nearness
from crashfuse.approaches.time_domain.config import AboutTimeDomain
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.signals.pulse import FloatArray

COMPONENTS = ("time domain", "displacement domain", "pre-trained network", "raw CAE")

_PAIRS = 100  # most draws of each component that are compared
_LEAST_MPS2 = 1e-3  # spread that counts as none

# Round numbers with which mixtures learned from one or two tests rate well on others, on random vehicles
# (benchmarks/fused_prior.py) and on campaigns of other kinds. By the random vehicles alone the pre-trained network
# would count for more, but it was trained on similar ones.
_EQUAL: FloatArray = np.array([0.0, 0.6, 1.0, -2.0])  # logits, in the order of the components
_SLOPES: FloatArray = np.array([-0.6, -0.6, -0.6, -1.0])  # of each by the log ratio of its own spread

PRIOR: FloatArray = np.column_stack([_EQUAL, np.diag(_SLOPES)])
"""Prior mean of logits and slopes, shape (4, 5)."""
SPREAD: FloatArray = np.array([1.0, 0.4, 0.4, 0.4, 0.2])
"""Prior standard deviations of the logits and of their slopes: a handful of tests says little about a slope."""
STRENGTH = 10.0
"""Weight of the data against the prior."""


class AboutFused(Approach):
    """All that is shown of the fused approach."""

    name = "fused"
    label = "Fused"
    in_words = "the fused prediction"
    description = (
        "time domain, displacement domain, a network pre-trained on simulated vehicles and raw CAE, averaged with "
        "weights that left-out tests decide (by CRPS) and narrow bands increase."
    )
    colour = "#009E73"
    preference = 10
    trains_networks = True
    made_of = (AboutTimeDomain, DisplacementDomain)


class Component(NamedTuple):
    """An expected pulse, and draws of whole pulses, shape (n_draws, n_times)."""

    mean: FloatArray
    draws: FloatArray

    def widened(self, factor: float) -> FloatArray:
        """The draws, their deviations from the mean times a factor."""
        return self.mean + factor * (self.draws - self.mean)


class HeldOut(NamedTuple):
    """A left-out test: its components, thinned, and how near the tests learned from are."""

    number: int
    components: list[Component]
    nearness: float


@dataclass(frozen=True, eq=False, slots=True)
class Tests:
    """What was measured in each test, and the raw CAE there."""

    speeds_mps: FloatArray  # shape (n,)
    measured_mps2: FloatArray  # shape (n, 1250)
    cae_mps2: FloatArray  # shape (n, 1250)

    @classmethod
    def of(cls, campaign: Campaign, model: CaeModel) -> Self:
        """Compare a campaign's tests with the CAE model."""
        speeds = np.array([test.condition.speed_mps for test in campaign.tests])
        measured = np.array([test.pulse.accel_mps2 for test in campaign.tests])
        return cls(speeds, measured, np.array([model.pulse(test.condition).accel_mps2 for test in campaign.tests]))

    def raw(self, cae_mps2: FloatArray, speed_mps: float, without: Sequence[int] = ()) -> Component:
        """The CAE pulse; its draws have the errors of the other tests, scaled with speed, with either sign."""
        ratios = speed_mps / np.delete(self.speeds_mps, without)[:, None]
        errors = np.delete(self.measured_mps2 - self.cae_mps2, without, axis=0) * ratios
        either = np.concatenate([errors, -errors]) if len(errors) else np.zeros_like(cae_mps2)[None]
        return Component(cae_mps2, cae_mps2 + either)

    def held_out(self, parts: Sequence[LeftOut], without: Sequence[Sequence[int]]) -> list[HeldOut]:
        """Thinned components for tests that all parts predicted; ``without`` are those left out with each."""
        tests = []
        for number, out in enumerate(without):
            rows = [np.flatnonzero(part.numbers == number) for part in parts]
            if not all(row.size for row in rows):
                continue
            pairs = zip(parts, rows, strict=True)
            components = [Component(part.mean_mps2[n], part.draws_mps2[n].astype(np.float64)) for part, (n,) in pairs]
            speed = float(self.speeds_mps[number])
            raw = self.raw(self.cae_mps2[number], speed, out)
            components.append(Component(raw.mean[::STRIDE], raw.draws[:, ::STRIDE]))
            tests.append(HeldOut(number, components, nearness(speed, self.speeds_mps, out)))
        return tests


def mixed(components: Sequence[Component], weights: FloatArray, n_draws: int, seed: int) -> Component:
    """The weighted mean, and draws from each component in proportion to its weight."""
    rng = np.random.default_rng(seed)
    shares = np.diff(np.floor(np.cumsum(weights) * n_draws + 0.5).astype(int), prepend=0)
    drawn = zip([component.draws for component in components], shares, strict=True)
    chosen = [draws[rng.choice(len(draws), size=share, replace=bool(share > len(draws)))] for draws, share in drawn]
    return Component(weights @ np.array([component.mean for component in components]), np.concatenate(chosen))


@dataclass(frozen=True, eq=False, slots=True)
class Scores:
    """Terms of the score of any mixture, for one left-out test: mean distances of draws."""

    away: FloatArray  # from the measured pulse, E|X - y|, shape (n_components,)
    apart: FloatArray  # between draws of two components, E|X - X'|, shape (n_components, n_components)

    @classmethod
    def of(cls, measured: FloatArray, components: list[FloatArray]) -> "Scores":
        """Compare a measured pulse, shape (n_times,), with each component's draws, shape (n_draws, n_times)."""
        drawn = [draws[:_PAIRS].astype(np.float64) for draws in components]
        away = np.array([np.abs(draws - measured).mean() for draws in drawn])
        within = [_between_all(draws) for draws in drawn]
        apart = np.diag([_apart(draws) for draws in drawn])
        for i, j in combinations(range(len(drawn)), 2):  # what is left of all pairs are those of one with the other
            total = _between_all(np.concatenate([drawn[i], drawn[j]]))
            apart[i, j] = apart[j, i] = (total - within[i] - within[j]) / (len(drawn[i]) * len(drawn[j]))
        return cls(away, apart)

    @property
    def spreads(self) -> FloatArray:
        """Mean distance between two draws of each component, shape (n_components,)."""
        return np.diagonal(self.apart)

    def crps(self, weights: FloatArray) -> float:
        """Score of the mixture with these weights."""
        return float(weights @ self.away - 0.5 * weights @ self.apart @ weights)


def _apart(draws: FloatArray) -> float:
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

    ``prior`` is the mean of the logits where all spreads are equal, and of their slopes, shape (n_components,
    n_components + 1), as of the fitted ``logits_``; ``spread`` their standard deviation; ``strength`` the nats per test
    that a score improved by 100 % counts against the prior.
    """

    def __init__(
        self, prior: FloatArray = PRIOR, *, spread: float | FloatArray = SPREAD, strength: float = STRENGTH
    ) -> None:
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
            score = (weights * (away - 0.5 * among) / size).sum()
            by_weight = (away - among) / size
            by_logit = weights * (by_weight - (weights * by_weight).sum(axis=1, keepdims=True))
            off = (logits - self.prior) / self.spread
            gradient = self.strength * by_logit.T @ inputs + off / self.spread
            return float(self.strength * score + 0.5 * (off**2).sum()), gradient.ravel()

        best = minimize(loss, self.prior.ravel(), jac=True, method="L-BFGS-B").x
        self.logits_ = np.asarray(best).reshape(self.prior.shape)
        return self

    def weights(self, spreads: FloatArray) -> FloatArray:
        """Weights of the components at these spreads; they add up to 1."""
        return np.asarray(softmax(self.logits_ @ log_ratios(spreads)))


def log_ratios(spreads: FloatArray) -> FloatArray:
    """What logits are linear in: 1, and the log ratio of each spread to the geometric mean of all but the last."""
    logs = np.log(np.maximum(spreads, _LEAST_MPS2))
    return np.concatenate([[1.0], logs - logs[:-1].mean()])
