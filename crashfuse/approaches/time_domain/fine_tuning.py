"""Fine-tuning in closed form: increments θ_HF of an ensemble of LF networks, learned from tests (Eq. 6).

The networks are linearised in the small increments: f(x, θ_LF + θ_HF) = f(x, θ_LF) + J(x) θ_HF. Then the penalty
λ‖θ_HF‖² is a Gaussian prior, the penalised least squares have one exact minimum, every left-out test's prediction
comes from the same matrix, and the posterior over θ_HF (Immer et al. 2021) gives the band. The only input is the
tangent kernel J(x) J(x')ᵀ (Jacot et al. 2018).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from crashfuse.approaches.base import FittedState
from crashfuse.signals.pulse import FloatArray

PENALTIES = (0.02, 0.06, 0.2, 0.6)
"""Choices of ρ: variance of the increments specific to one test, relative to the increments that all share.

The weakest comes first and is preferred: shrinking to the CAE betters the mean square error, not the rating.
"""

_UNRESOLVED = 0.01  # variance that a network cannot represent, relative to the kernel's mean
_FEW = 3  # tests; with fewer, leaving one out does not determine ρ


@dataclass(frozen=True, eq=False, slots=True)
class Posterior:
    """Normal distribution of the networks' output at one condition: its mean and covariance."""

    mean: FloatArray
    covariance: FloatArray

    def given(self, functional: FloatArray, value: float, variance: float, where: FloatArray | None = None) -> Self:
        """Condition on a measurement of functional · output; where ``where`` (0 to 1) is 0, the output is known."""
        covariance = self.covariance if where is None else self.covariance * where[:, None] * where
        with_all = covariance @ functional
        gain = with_all / (functional @ with_all + variance)
        mean = self.mean + gain * (value - functional @ self.mean)
        return replace(self, mean=mean, covariance=covariance - np.outer(gain, with_all))

    def smoothed(self, n_steps: float) -> "Posterior":
        """Smooth deviations over about this many steps (Gaussian, one sigma), keeping the variances."""
        step = np.arange(self.mean.size)
        average = np.exp(-0.5 * ((step[:, None] - step) / n_steps) ** 2)
        smooth = average @ self.covariance @ average.T
        scale = np.sqrt(np.diag(self.covariance) / np.diag(smooth))
        return Posterior(self.mean, smooth * scale[:, None] * scale)


class Increments:
    """Increments shared by all tests plus those specific to each test: θ_HF + θ_k.

    Minimises ‖θ_HF‖² + Σ‖θ_k‖² / ρ + misfit² / unresolved variance; ρ is chosen from :data:`PENALTIES` by leaving out
    each test in turn. The mean uses the first ρ (``penalty_``) whose RMS error is within one standard error of the
    least; the covariance that with the highest likelihood of the errors on left-out tests (``band_penalty_``).
    ``left_out_`` has the posteriors of tests left out together, by their numbers.
    """

    def fit(self, kernel: FloatArray, misfit: FloatArray, together: Sequence[tuple[int, ...]] = ()) -> Self:
        """Fit to the tangent kernel between the tests, shape (n, n_times, n, n_times), and their misfit, (n, n_times).

        Besides each test alone, the tests in each entry of ``together`` are left out at once.
        """
        n, n_times = misfit.shape
        unit = float(np.trace(kernel.reshape(n * n_times, -1))) / misfit.size
        trials = {rho: _Trial.of(kernel / unit, misfit, rho) for rho in PENALTIES}
        squares = {rho: np.mean(trial.errors**2, axis=1) for rho, trial in trials.items()}
        self.left_out_error_ = {rho: float(np.sqrt(square.mean())) for rho, square in squares.items()}
        self.error_ = {}
        for rho, trial in trials.items():
            left = misfit.ravel() - kernel.reshape(misfit.size, -1) @ (trial.inverse @ misfit.ravel()) / unit
            self.error_[rho] = float(np.sqrt(np.mean(left**2)))
        self.penalty_ = _one_standard_error(squares) if n >= _FEW else PENALTIES[0]
        errors = trials[self.penalty_].errors
        sizes = {rho: np.mean(errors**2 / trial.variances) for rho, trial in trials.items()}
        surprise = {rho: np.log(sizes[rho] * trial.variances).mean() for rho, trial in trials.items()}
        self.band_penalty_ = min(PENALTIES, key=lambda rho: float(surprise[rho])) if n >= _FEW else PENALTIES[-1]
        best, band = trials[self.penalty_], trials[self.band_penalty_]
        self._unit, self._size, self._inverse = unit, float(sizes[self.band_penalty_]), band.inverse
        self._weights = best.inverse @ misfit.ravel()
        self.left_out_: dict[tuple[int, ...], tuple[Posterior, ...]] = {}
        for out in dict.fromkeys([*((i,) for i in range(n)), *together]):
            means = misfit[list(out)] - _left_out(best.inverse, best.weights, out)[0]
            resolved = _left_out(band.inverse, band.weights, out)[1] - _UNRESOLVED * np.eye(n_times)
            self.left_out_[out] = tuple(map(Posterior, means, self._size * resolved))
        return self

    def posterior(self, across: FloatArray, here: FloatArray) -> Posterior:
        """Correction to the LF prediction, by the kernels between tests and new condition, and of the latter."""
        across, here = across.reshape(-1, here.shape[0]) / self._unit, here / self._unit
        mean = across.T @ self._weights
        covariance = (1 + self.band_penalty_) * here - across.T @ self._inverse @ across
        return Posterior(mean, self._size * covariance)

    def learned(self) -> FittedState:
        """Fitted state: what :meth:`posterior` needs, and the errors that decided the penalty."""
        errors = {"left_out_error": list(self.left_out_error_.items()), "error": list(self.error_.items())}
        values = {"penalty": self.penalty_, "band_penalty": self.band_penalty_, "unit": self._unit, "size": self._size}
        return FittedState({**values, **errors}, {"inverse": self._inverse, "weights": self._weights})

    def restore(self, learned: FittedState) -> Self:
        """Restore a fitted state, except the posteriors of left-out tests."""
        values, arrays = learned.values, learned.arrays
        self.penalty_, self.band_penalty_ = values["penalty"], values["band_penalty"]
        self.left_out_error_, self.error_ = dict(values["left_out_error"]), dict(values["error"])
        self._unit, self._size = values["unit"], values["size"]
        self._inverse, self._weights = arrays["inverse"], arrays["weights"]
        return self


@dataclass(frozen=True, eq=False, slots=True)
class _Trial:
    """Trial of one ρ; arrays but the first of shape (n, n_times)."""

    inverse: FloatArray  # of the covariance of the tests
    weights: FloatArray  # its product with their misfit
    errors: FloatArray  # of each test left out, with their variances
    variances: FloatArray

    @classmethod
    def of(cls, kernel: FloatArray, misfit: FloatArray, rho: float) -> Self:
        n, n_times = misfit.shape
        same_test = np.eye(n)[:, None, :, None]
        covariance = (kernel * (1 + rho * same_test)).reshape(misfit.size, -1) + _UNRESOLVED * np.eye(misfit.size)
        inverse = np.linalg.inv(covariance)
        weights = (inverse @ misfit.ravel()).reshape(n, n_times)
        singly = [_left_out(inverse, weights, (i,)) for i in range(n)]
        errors = np.concatenate([errors for errors, _ in singly])
        variances = np.concatenate([np.diagonal(covariance, axis1=1, axis2=2) for _, covariance in singly])
        return cls(inverse, weights, errors, variances)


def _left_out(inverse: FloatArray, weights: FloatArray, out: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Errors and covariance of tests left out together (Rasmussen & Williams 2006, Eqs. 5.10–5.12)."""
    n, n_times = weights.shape
    m, numbers = len(out), list(out)
    block = inverse.reshape(n, n_times, n, n_times)[numbers][:, :, numbers].reshape(m * n_times, -1)
    covariance = np.linalg.inv(block)
    errors = (covariance @ weights[numbers].ravel()).reshape(m, n_times)
    return errors, covariance.reshape(m, n_times, m, n_times)[range(m), :, range(m)]


def _one_standard_error(squares: dict[float, FloatArray]) -> float:
    best = min(squares, key=lambda rho: float(squares[rho].mean()))
    excess = {rho: square - squares[best] for rho, square in squares.items()}
    return next(rho for rho, e in excess.items() if e.mean() <= e.std(ddof=1) / np.sqrt(len(e)))
