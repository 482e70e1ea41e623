"""The hierarchical Gaussian process, against scikit-learn, finite differences and the textbook."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern

from crashfuse.approaches.displacement_domain.covariance import Covariance, LogNormal, Part
from crashfuse.approaches.displacement_domain.gaussian_process import GaussianProcess
from crashfuse.signals.pulse import FloatArray

WIDE = LogNormal(1.0, 1.0)
ONE = Part("one", LogNormal(1.0, 1.0), (((0, LogNormal(0.3, 1.0)), (1, LogNormal(2.0, 1.0))),))
TWO = Part("two", LogNormal(0.5, 1.0), (((0, LogNormal(1.0, 1.0)), (1, LogNormal(1.0, 1.0))),))
ALL_KINDS = (
    Part("shared", WIDE, (((0, LogNormal(0.3, 0.5)),),)),
    Part("varying", WIDE, (((0, LogNormal(0.3, 0.5)),), ((1, WIDE), (2, WIDE)))),
    Part("ratio", WIDE, (((0, WIDE),),), times=2),
    Part("own", LogNormal(0.3, 0.5), (((0, LogNormal(0.2, 0.5)),),), same=-1),
)
NOISE = LogNormal(0.1, 0.7)


def deviations(process: GaussianProcess, x: FloatArray) -> FloatArray:
    return np.sqrt(np.diag(process.posterior(x)[1]))


@pytest.fixture(scope="module")
def process() -> GaussianProcess:
    """Fitted to :func:`rows`, the output in units far from one."""
    x, y = rows()
    return GaussianProcess(ALL_KINDS, NOISE).fit(x, 40 * y)


def new_rows(n: int = 15, seed: int = 5, test: int = -1) -> FloatArray:
    """Inputs of another test."""
    new = rows(n, seed)[0]
    new[:, -1] = test
    return new


def rows(n: int = 60, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Inputs in three columns and the test's number, and an output of unit root mean square."""
    rng = np.random.default_rng(seed)
    x = np.column_stack([rng.uniform(0, 1, n), rng.normal(size=(n, 2)), np.arange(n) // 12])
    y = np.sin(7 * x[:, 0]) + 0.3 * x[:, 1] + 0.1 * rng.normal(size=n)
    return x, y / np.sqrt(np.mean(y**2))


def test_the_likelihood_is_scikit_learns() -> None:
    """For a sum of two Matérn kernels, which both can express, at hyperparameters that are not the optimum."""
    x, y = rows()
    theta = np.log([1.3, 0.4, 1.5, 0.6, 0.9, 2.2, 0.15])
    ours = GaussianProcess((ONE, TWO), NOISE).fit(x, y).log_marginal_likelihood(theta)[0]
    kernel = ConstantKernel(1.3**2) * Matern([0.4, 1.5], nu=2.5) + ConstantKernel(0.6**2) * Matern([0.9, 2.2], nu=2.5)
    peer = GaussianProcessRegressor(kernel, alpha=0.15**2, optimizer=None).fit(x[:, :2], y)
    assert ours == pytest.approx(peer.log_marginal_likelihood_value_, abs=1e-8 * len(y))


def test_the_gradient_is_the_finite_difference(process: GaussianProcess) -> None:
    theta = process.theta_ + np.random.default_rng(1).normal(scale=0.3, size=process.theta_.size)
    gradient = process.log_marginal_likelihood(theta)[1]
    step = 1e-5
    for i, direction in enumerate(step * np.eye(theta.size)):
        up, down = (process.log_marginal_likelihood(theta + sign * direction)[0] for sign in (1, -1))
        assert gradient[i] == pytest.approx((up - down) / (2 * step), rel=1e-5, abs=1e-5)


def test_predictions_and_their_parts_are_the_textbooks(process: GaussianProcess) -> None:
    """Means K*ᵀ K⁻¹ y and covariances K** - K*ᵀ K⁻¹ K*, with a plain solver; output in units far from one."""
    (x, y), new = rows(), new_rows()
    logs, noise = process.theta_[:-1], np.exp(2 * process.theta_[-1])
    inverse = np.linalg.inv(Covariance(ALL_KINDS, x, x)(logs) + noise * np.eye(len(y)))
    mean, covariance = process.posterior(new)
    moments: list[tuple[tuple[Part, ...], FloatArray, FloatArray, FloatArray]]
    moments = [(ALL_KINDS, logs, mean, np.diag(covariance))]
    own = process._by_part(process.theta_)
    for part, (mean_of_part, std) in zip(ALL_KINDS, process.predict_parts(new), strict=True):
        moments.append(((part,), own[part.name], mean_of_part, std**2))
    for parts, theta, found, variances in moments:
        cross, prior = Covariance(parts, new, x)(theta), Covariance(parts, new, new)(theta)
        np.testing.assert_allclose(found, cross @ inverse @ (40 * y), rtol=1e-5, atol=1e-5)
        expected = process.output_scale_**2 * (prior - cross @ inverse @ cross.T)
        np.testing.assert_allclose(variances, np.diag(expected), rtol=1e-4, atol=1e-4)
        if len(parts) > 1:
            np.testing.assert_allclose(covariance, expected, rtol=1e-4, atol=1e-4)


def test_the_fit_is_a_maximum_of_the_posterior(process: GaussianProcess) -> None:
    medians = [prior.median for part in ALL_KINDS for prior in part.priors] + [NOISE.median]
    spreads = np.array([prior.spread for part in ALL_KINDS for prior in part.priors] + [NOISE.spread])

    def posterior(theta: FloatArray) -> float:
        away = (theta - np.log(medians)) / spreads
        return process.log_marginal_likelihood(theta)[0] - 0.5 * float(away @ away)

    best = posterior(process.theta_)
    for direction in 0.1 * np.eye(process.theta_.size):
        assert posterior(process.theta_ + direction) < best
        assert posterior(process.theta_ - direction) < best


def test_noise_alone_is_told_from_a_pattern() -> None:
    """Where there is nothing to learn the fit is tried again, and then called dead; with a pattern it is not.

    A single test has some twenty points: they can give fewer nats than a hierarchy has hyperparameters.
    """
    (x, y), rng = rows(), np.random.default_rng(0)
    nothing = GaussianProcess((ONE,), LogNormal(1.0, 0.5), restarts=2).fit(x, rng.normal(size=len(y)))
    few = np.column_stack([np.linspace(0, 1, 8), np.zeros((8, 3))])
    pattern = GaussianProcess(ALL_KINDS, NOISE).fit(few, np.sin(5 * few[:, 0]) + rng.normal(scale=0.2, size=8))
    fits = (nothing, GaussianProcess((ONE,), NOISE).fit(x, y), pattern)
    assert [(fit.dead_, fit.retries_) for fit in fits] == [(True, 2), (False, 0), (False, 0)]


def test_the_density_of_a_left_out_test_is_the_textbooks(process: GaussianProcess) -> None:
    x, y = rows()
    covariance = Covariance(ALL_KINDS, x, x)(process.theta_[:-1])
    covariance += (np.exp(2 * process.theta_[-1]) + 1e-10) * np.eye(len(y))
    expected = []
    for test in range(5):
        out = x[:, -1] == test
        gain = covariance[np.ix_(out, ~out)] @ np.linalg.inv(covariance[np.ix_(~out, ~out)])
        left = covariance[np.ix_(out, out)] - gain @ covariance[np.ix_(~out, out)]
        scaled = 40 * y / process.output_scale_
        expected.append(multivariate_normal.logpdf(scaled[out], gain @ scaled[~out], left))
    np.testing.assert_allclose(process.left_out_log_density(), expected, rtol=1e-6)


def test_without_a_test_it_predicts_from_the_others() -> None:
    """As scikit-learn does from their rows, with the same kernel."""
    x, y = rows()
    process = GaussianProcess((ONE,), NOISE).fit(x, y)
    scale, *lengths, noise = np.exp(process.theta_)
    rest = x[:, -1] != 2
    peer = GaussianProcessRegressor(
        ConstantKernel(scale**2) * Matern(lengths, nu=2.5), alpha=noise**2 + 1e-10, optimizer=None
    ).fit(x[rest, :2], y[rest])
    np.testing.assert_allclose(process.without(2).predict(x), peer.predict(x[:, :2]), atol=1e-7)
    assert np.abs(process.predict(x) - peer.predict(x[:, :2])).max() > 1e-3


def test_the_spread_of_hyperparameters_is_that_of_the_posteriors_curvature() -> None:
    process = GaussianProcess((ONE,), NOISE).fit(*rows())
    spread, step = process.spread(), 1e-3
    for i, direction in enumerate(step * np.eye(spread.size)):
        losses = [process._loss(process.theta_ + k * direction)[0] for k in (-1, 0, 1)]
        alone = step / np.sqrt(losses[0] - 2 * losses[1] + losses[2])
        assert alone * 0.99 < spread[i] < 4 * alone
    noise_of_60_rows = 1 / np.sqrt(2 * 60)
    assert noise_of_60_rows < spread[-1] < 2 * noise_of_60_rows


def test_further_rows_take_off_what_a_fit_with_them_would(process: GaussianProcess) -> None:
    """The closed form, set by set, is that of all rows at once; what is found there does not matter."""
    new, further = new_rows(test=98), [new_rows(6, 6, 99), new_rows(3, 7, 3)]
    now, then = process.std_given(new, further)
    np.testing.assert_allclose(now, deviations(process, new), rtol=1e-9)
    for std, more in zip(then, further, strict=True):
        other = process.also_at(more)
        np.testing.assert_allclose(std, deviations(other, new), rtol=1e-6)
        np.testing.assert_allclose(other.predict(new), process.predict(new), rtol=1e-6, atol=1e-6)
        assert (std <= now).all()
        assert std.mean() < 0.999 * now.mean()
