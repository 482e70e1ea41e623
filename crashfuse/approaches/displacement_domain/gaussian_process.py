"""A hierarchical Gaussian process: a sum of parts with priors, fitted by maximum a posteriori.

All hyperparameters, including the noise, have log-normal priors, and the most probable values are used: with ten
tests the likelihood alone has many optima, some of which explain no more than noise. It is exact, in O(n³) time.
"""

import copy
from collections.abc import Collection, Sequence
from typing import Self

import numpy as np
from scipy.linalg import cho_solve, lapack, solve_triangular
from scipy.optimize import minimize

from crashfuse.approaches.base import FittedState
from crashfuse.approaches.displacement_domain.covariance import Covariance, LogNormal, Part, TrainingCovariance
from crashfuse.errors import NotFittedError
from crashfuse.signals.pulse import FloatArray

_BOUND = 4.0  # search range of a hyperparameter, in prior standard deviations
_JITTER = 1e-10
_ENOUGH = {"ftol": 1e-5, "gtol": 1e-2}  # of some hundred nats; finer, a search costs twice as much for nothing
_GAIN_A_POINT = 0.25  # nats: reducing the error by less than a fifth, exp(-0.25), is no pattern


class GaussianProcess:
    """Regression with a zero-mean sum of parts, following scikit-learn's conventions.

    ``noise`` is the prior of its standard deviation, relative to the root mean square of the training output
    (``output_scale_``). A fit that explains no more than noise (``dead_``) is retried ``restarts`` times. ``theta_``
    are logarithms: scale and length scales part by part, then the noise; ``touched_`` those at a bound.
    """

    def __init__(self, parts: Sequence[Part], noise: LogNormal, *, restarts: int = 3, seed: int = 0) -> None:
        self.parts, self.noise, self.restarts, self.seed = tuple(parts), noise, restarts, seed

    def fit(self, x: FloatArray, y: FloatArray, like: "GaussianProcess | None" = None) -> Self:
        """Find the most probable hyperparameters, and condition on n rows, the last column the test's number.

        The search starts from the priors' medians, or for parts in common from a process fitted before (``like``).
        """
        self._take(x, y)
        rng = np.random.default_rng(self.seed)
        earlier = {} if like is None else like._by_part(like.theta_)
        first = np.concatenate([earlier.get(name, median) for name, median in self._by_part(self._median).items()])
        best, self.retries_ = self._climb(first), 0
        while self._is_dead(best) and self.retries_ < self.restarts:
            self.retries_ += 1
            start = self._median + self._spread * rng.standard_normal(self._spread.size)
            best = min(best, self._climb(start), key=lambda theta: self._loss(theta)[0])
        return self._settle(best)

    def restore(self, x: FloatArray, y: FloatArray, learned: FittedState) -> Self:
        """Condition on the data that the hyperparameters were learned from."""
        self._take(x, y)
        self.retries_ = learned.values["retries"]
        return self._settle(learned.arrays["theta"])

    def learned(self) -> FittedState:
        """Fitted state: the hyperparameters."""
        return FittedState({"retries": self.retries_}, {"theta": self.theta_})

    def _take(self, x: FloatArray, y: FloatArray) -> None:
        self.x_: FloatArray = np.asarray(x, dtype=np.float64)
        self.output_scale_ = float(np.sqrt(np.mean(np.square(y)))) or 1.0
        self._y: FloatArray = np.asarray(y, dtype=np.float64) / self.output_scale_
        self._covariance = TrainingCovariance(self.parts, self.x_)
        priors = (*(prior for part in self.parts for prior in part.priors), self.noise)
        self._median = np.log([prior.median for prior in priors])
        self._spread = np.array([prior.spread for prior in priors])

    def _by_part(self, theta: FloatArray) -> dict[str, FloatArray]:
        ends = np.cumsum([len(part.priors) for part in self.parts])
        return dict(zip([*(part.name for part in self.parts), ""], np.split(theta, ends), strict=True))

    def _settle(self, theta: FloatArray) -> Self:
        self.theta_ = theta
        self.touched_ = np.abs(theta - self._median) > 0.999 * _BOUND * self._spread
        self.dead_ = self._is_dead(theta)
        self.log_marginal_likelihood_ = self.log_marginal_likelihood(theta)[0]
        self._condition()
        return self

    def _condition(self, prior: FloatArray | None = None) -> None:
        self._prior = Covariance(self.parts, self.x_, self.x_)(self.theta_[:-1]) if prior is None else prior
        self._lower = self._cholesky(self._prior.copy(), self.theta_[-1])
        self._alpha = cho_solve((self._lower, True), self._y)

    def without(self, *tests: int) -> Self:
        """The same as if these tests had not been run."""
        others = ~np.isin(self.x_[:, -1], tests)
        return self._given(self.x_[others], self._y[others], self._prior[np.ix_(others, others)])

    def also_at(self, x: FloatArray) -> Self:
        """The same as if these rows had been measured with the expected output."""
        return self._given(np.vstack([self.x_, x]), np.append(self._y, self.predict(x) / self.output_scale_))

    def _given(self, x: FloatArray, y: FloatArray, prior: FloatArray | None = None) -> Self:
        other = copy.copy(self)
        other.x_, other._y = x, y
        other._condition(prior)
        return other

    def std_given(self, x: FloatArray, further: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Standard deviation now and as by :meth:`also_at` for each set of rows, by the Schur complement."""
        theta = self.theta_[:-1]

        def solved(rows: FloatArray) -> FloatArray:
            cross = Covariance(self.parts, self.x_, rows)(theta)
            return np.asarray(solve_triangular(self._lower, cross, lower=True))

        at_x = solved(x)
        chunks = np.array_split(x, len(x) // 50 + 1)  # only the diagonal of the prior is needed
        prior = np.concatenate([np.diag(Covariance(self.parts, rows, rows)(theta)) for rows in chunks])
        now = prior - np.sum(at_x**2, axis=0)
        then = np.empty((len(further), len(x)))
        for variance, rows in zip(then, further, strict=True):
            at_rows = solved(rows)
            among = Covariance(self.parts, rows, rows)(theta) - at_rows.T @ at_rows
            across = Covariance(self.parts, rows, x)(theta) - at_rows.T @ at_x
            gain = solve_triangular(self._cholesky(among, self.theta_[-1]), across, lower=True)
            variance[:] = now - np.sum(gain**2, axis=0)
        return self.output_scale_ * np.sqrt(np.maximum(now, 0)), self.output_scale_ * np.sqrt(np.maximum(then, 0))

    def left_out_log_density(self) -> FloatArray:
        """Log density of each test's scaled output given all others (Rasmussen & Williams, Sect. 5.4.2)."""
        inverse = cho_solve((self._lower, True), np.eye(self._y.size))
        densities = []
        for test in np.unique(self.x_[:, -1]):
            rows = np.flatnonzero(self.x_[:, -1] == test)
            lower = np.linalg.cholesky(inverse[np.ix_(rows, rows)])
            away = solve_triangular(lower, self._alpha[rows], lower=True)
            constant = 0.5 * rows.size * np.log(2 * np.pi)
            densities.append(np.log(np.diag(lower)).sum() - 0.5 * away @ away - constant)
        return np.array(densities)

    def spread(self) -> FloatArray:
        """Standard deviations of the hyperparameters' logarithms: Laplace's approximation."""
        step = 1e-4
        _, here = self._loss(self.theta_)
        curvature = [(self._loss(self.theta_ + step * unit)[1] - here) / step for unit in np.eye(here.size)]
        values, vectors = np.linalg.eigh(0.5 * (np.array(curvature) + np.array(curvature).T))
        values = np.maximum(values, 1e-2 / self._spread.max() ** 2)  # flat at a bound: little beyond the prior
        return np.asarray(np.sqrt(np.sum(vectors**2 / values, axis=1)))

    def _climb(self, start: FloatArray) -> FloatArray:
        reach = _BOUND * self._spread
        bounds = np.column_stack([self._median - reach, self._median + reach])
        return np.asarray(minimize(self._loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options=_ENOUGH).x)

    def _loss(self, theta: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = self.log_marginal_likelihood(theta)
        away = (theta - self._median) / self._spread
        return 0.5 * float(away @ away) - value, away / self._spread - gradient

    def _is_dead(self, theta: FloatArray) -> bool:
        """Within a nat per hyperparameter of noise alone."""
        power = float(np.mean(self._y**2))
        noise_alone = -0.5 * self._y.size * (np.log(2 * np.pi * power) + 1) if power else np.inf
        gain = min(theta.size, _GAIN_A_POINT * self._y.size)
        return bool(power) and bool(self.log_marginal_likelihood(theta)[0] < noise_alone + gain)

    @staticmethod
    def _cholesky(covariance: FloatArray, log_noise: float) -> FloatArray:
        covariance[np.diag_indices_from(covariance)] += np.exp(2 * log_noise) + _JITTER
        return np.linalg.cholesky(covariance)

    def log_marginal_likelihood(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Of the scaled output, and its gradient (Rasmussen & Williams 2006, Eqs. 2.30 and 5.9)."""
        covariance, derivatives = self._covariance.with_derivatives(theta[:-1])
        lower = self._cholesky(covariance, theta[-1])
        alpha = cho_solve((lower, True), self._y)
        value = -0.5 * self._y @ alpha - np.log(np.diag(lower)).sum() - 0.5 * self._y.size * np.log(2 * np.pi)
        rows, columns = self._covariance.entries
        outer = alpha[rows] * alpha[columns] - lapack.dpotri(lower, lower=1)[0][rows, columns]
        diagonal = rows == columns
        noise = np.exp(2 * theta[-1]) * outer[diagonal].sum()
        outer[diagonal] /= 2  # every other entry stands for two
        gradient = [outer[where] @ slope for where, slopes in derivatives for slope in slopes]
        gradient.append(noise)
        return float(value), np.array(gradient)

    def predict(self, x: FloatArray) -> FloatArray:
        """Posterior mean, shape (m,), at m rows; a number of no training test means a new test."""
        if not hasattr(self, "theta_"):
            raise NotFittedError("The Gaussian process has not been fitted; call fit(x, y) first.")
        return self._mean(Covariance(self.parts, x, self.x_)(self.theta_[:-1]))

    def _mean(self, cross: FloatArray) -> FloatArray:
        return np.asarray(self.output_scale_ * (cross @ self._alpha))

    def posterior(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Posterior mean as from :meth:`predict`, and covariance, shape (m, m), without noise."""
        cross = Covariance(self.parts, x, self.x_)(self.theta_[:-1])
        gain = solve_triangular(self._lower, cross.T, lower=True)
        prior = Covariance(self.parts, x, x)(self.theta_[:-1])
        return self._mean(cross), self.output_scale_**2 * (prior - gain.T @ gain)

    def prior_of(self, names: Collection[str], x: FloatArray) -> FloatArray:
        """Prior covariance, shape (m, m), of the sum of the parts with these names."""
        theta, chosen = self._by_part(self.theta_), [part for part in self.parts if part.name in names]
        return np.asarray(self.output_scale_**2 * sum(Covariance([part], x, x)(theta[part.name]) for part in chosen))

    def predict_parts(self, x: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Posterior mean and standard deviation, shapes (m,), of each part; only the means add up."""
        moments, theta = [], self._by_part(self.theta_)
        for part in self.parts:
            cross, prior = (Covariance([part], x, z)(theta[part.name]) for z in (self.x_, x))
            gain = solve_triangular(self._lower, cross.T, lower=True)
            variance = np.maximum(np.diag(prior) - np.sum(gain**2, axis=0), 0.0)
            moments.append((self._mean(cross), self.output_scale_ * np.sqrt(variance)))
        return moments
