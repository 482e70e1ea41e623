"""Fine-tuning in closed form: it is the penalised least squares it says, and a left-out test is left out."""

import numpy as np
import pytest

from crashfuse.approaches.time_domain import fine_tuning as increments
from crashfuse.approaches.time_domain.fine_tuning import Increments, Posterior
from crashfuse.signals.pulse import FloatArray

N, N_TIMES, N_WEIGHTS = 4, 5, 40
RHO, UNRESOLVED = 0.06, increments._UNRESOLVED


def _toy(seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Derivatives of a toy network at N tests and a new condition, unit kernel on average, and misfits of the tests."""
    rng = np.random.default_rng(seed)
    jacobian = rng.standard_normal((N + 1, N_TIMES, N_WEIGHTS))
    jacobian /= np.sqrt(np.mean(np.sum(jacobian[:N] ** 2, axis=-1)))
    return jacobian, rng.standard_normal((N, N_TIMES))


def _kernel(a: FloatArray, b: FloatArray) -> FloatArray:
    kernel: FloatArray = np.einsum("itp,jup->itju", a, b)
    return kernel


@pytest.fixture
def one_penalty(monkeypatch: pytest.MonkeyPatch) -> None:
    """No choice of ρ."""
    monkeypatch.setattr(increments, "PENALTIES", (RHO,))


@pytest.mark.usefixtures("one_penalty")
def test_the_mean_minimises_the_penalised_squares() -> None:
    jacobian, misfit = _toy()
    fitted = Increments().fit(_kernel(jacobian[:N], jacobian[:N]), misfit)
    posterior = fitted.posterior(
        _kernel(jacobian[:N], jacobian[N:])[:, :, 0], _kernel(jacobian[N:], jacobian[N:])[0, :, 0]
    )

    n_all = N_WEIGHTS * (N + 1)  # the shared ones, then each test's own
    data = np.zeros((N, N_TIMES, N + 1, N_WEIGHTS))
    data[:, :, 0] = jacobian[:N]
    for k in range(N):
        data[k, :, k + 1] = jacobian[k]
    penalties = np.repeat([1.0] + [1 / np.sqrt(RHO)] * N, N_WEIGHTS)
    system = np.vstack([data.reshape(-1, n_all) / np.sqrt(UNRESOLVED), np.diag(penalties)])
    right = np.concatenate([misfit.ravel() / np.sqrt(UNRESOLVED), np.zeros(n_all)])
    weights = np.linalg.lstsq(system, right, rcond=None)[0][:N_WEIGHTS]
    np.testing.assert_allclose(posterior.mean, jacobian[N] @ weights, rtol=1e-8)


@pytest.mark.usefixtures("one_penalty")
@pytest.mark.parametrize("out", [(0,), (0, 2)])
def test_left_out_tests_are_predicted_as_if_they_had_not_been(out: tuple[int, ...]) -> None:
    """Alone or together: mean and covariance from the whole matrix are those of a fit on the other tests."""
    jacobian, misfit = _toy()
    rest = [i for i in range(N) if i not in out]
    jacobian = jacobian / np.sqrt(np.mean(np.sum(jacobian[rest] ** 2, axis=-1)))  # each fit has its own unit
    again = Increments().fit(_kernel(jacobian[rest], jacobian[rest]), misfit[rest])
    trial = increments._Trial.of(_kernel(jacobian[:N], jacobian[:N]), misfit, RHO)
    errors, covariances = increments._left_out(trial.inverse, trial.weights, out)
    for i, error, covariance in zip(out, errors, covariances, strict=True):
        new = jacobian[i : i + 1]
        alone = again.posterior(_kernel(jacobian[rest], new)[:, :, 0], _kernel(new, new)[0, :, 0])
        np.testing.assert_allclose(misfit[i] - error, alone.mean, rtol=1e-8)
        resolved = covariance - UNRESOLVED * np.eye(N_TIMES)
        np.testing.assert_allclose(resolved, alone.covariance / again._size, rtol=1e-8, atol=1e-10)


def test_the_weakest_penalty_within_one_standard_error_is_taken() -> None:
    """One that is worse by chance stays; one that is worse in every test goes."""
    rng = np.random.default_rng(0)
    best = 1 + 0.1 * rng.random(9)
    noisy = best + np.array([0.5, -0.5, 0.5, -0.5, 0.5, -0.5, 0.5, -0.4, 0.0])
    assert increments._one_standard_error({0.02: noisy, 0.06: best}) == 0.02
    assert increments._one_standard_error({0.02: best + 0.01 * rng.random(9) + 0.2, 0.06: best}) == 0.06


def test_tests_that_repeat_badly_widen_what_each_has_to_itself() -> None:
    """Two campaigns of pairs and lone tests: where pairs differ as lone tests do, the covariance takes the larger ρ."""
    jacobian = _toy(3)[0][[0, 0, 1, 1, 2, 3]]
    rng = np.random.default_rng(1)
    shared = jacobian @ rng.standard_normal(N_WEIGHTS)
    own = np.einsum("itp,ip->it", jacobian, rng.standard_normal((6, N_WEIGHTS)))
    kernel = _kernel(jacobian, jacobian)
    alike = Increments().fit(kernel, shared + 0.05 * own)
    assert alike.band_penalty_ < Increments().fit(kernel, shared + 0.8 * own).band_penalty_


def test_what_is_known_of_a_functional_holds_afterwards() -> None:
    rng = np.random.default_rng(0)
    root, functional = rng.standard_normal((4, 4)), rng.standard_normal(4)
    posterior = Posterior(rng.standard_normal(4), root @ root.T)
    known = posterior.given(functional, 2.5, 0.0)
    assert functional @ known.mean == pytest.approx(2.5)
    assert functional @ known.covariance @ functional == pytest.approx(0, abs=1e-10)
    np.testing.assert_allclose(posterior.given(functional, 2.5, 1e12).mean, posterior.mean, atol=1e-9)


def test_smoothing_keeps_the_variance_and_joins_neighbours() -> None:
    """White deviations become correlated from step to step as a Gaussian average makes them: exp(-1/4) at one sigma."""
    white = Posterior(np.ones(60), np.diag(np.linspace(1, 2, 60)))
    smooth = white.smoothed(3.0)
    np.testing.assert_allclose(np.diag(smooth.covariance), np.diag(white.covariance))
    spread = np.sqrt(np.diag(smooth.covariance))
    assert smooth.covariance[30, 33] / (spread[30] * spread[33]) == pytest.approx(np.exp(-0.25), rel=0.01)
    np.testing.assert_array_equal(smooth.mean, white.mean)
