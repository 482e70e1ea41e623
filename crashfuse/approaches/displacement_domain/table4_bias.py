"""The paper's model of the bias: scikit-learn's regressor with the settings of Table 4."""

import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from scipy.optimize import minimize

from crashfuse.approaches.base import FittedState, draw
from crashfuse.approaches.displacement_domain.bias import BiasDraws, BiasPoints, CaeStop
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.pulse import FloatArray

if TYPE_CHECKING:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import Product

Loss = Callable[[FloatArray], tuple[float, FloatArray]]

_BOUNDS = (1e-5, 2e3)
_START = 2.0
_ALPHA = 1e-5
_INPUTS = ("s", "v0", "front weight", "rear weight")
_DEAD = 0.05  # nats per point over noise alone; below this a fit explains nothing


class Table4Bias:
    """A constant times Matérn-3/2 on (s, v0, front weight, rear weight), each standardised (Eqs. 23 to 27).

    The bias is in m/s², unscaled: alpha and the bounds of Table 4 apply to (m/s²)². The paper does not state this unit,
    the Matérn's order or the scaling of the inputs. From most starts the fit explains no more than noise, and a note
    says so (``dead_``). ``restarts`` are Table 4's training repeats: further starts after the one at 2.
    """

    end_share: ClassVar[float] = 0.0  # the paper follows a CAE pulse over displacement to its end

    def __init__(self, restarts: int = 10, *, seed: int = 0) -> None:
        self.restarts, self.seed = restarts, seed

    def fit(self, tests: Sequence[BiasPoints], watch: Watch = SILENT) -> Self:
        """Fit to the bias of each test."""
        # importing scikit-learn takes a second and 70 MB in every process, and the fast preset needs nothing of it
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor

        kernel = _kernel(_START, np.full(len(_INPUTS), _START))
        done = 0

        def climb(loss: Loss, start: FloatArray, bounds: FloatArray) -> tuple[FloatArray, float]:
            """Optimise as scikit-learn does by default, but report progress: one start takes 15 s."""
            nonlocal done

            def watched(theta: FloatArray) -> tuple[float, FloatArray]:
                watch.report("Bias model", done, self.restarts + 1)
                return loss(theta)

            best = minimize(watched, start, jac=True, method="L-BFGS-B", bounds=bounds)
            done += 1
            return best.x, best.fun

        process = GaussianProcessRegressor(
            kernel, alpha=_ALPHA, optimizer=climb, n_restarts_optimizer=self.restarts, random_state=self.seed
        )
        with warnings.catch_warnings():  # the state reports the bounds reached
            warnings.simplefilter("ignore", ConvergenceWarning)
            self._fit(process, tests)
        watch.report("Bias model", self.restarts + 1, self.restarts + 1)
        return self

    def learned(self) -> FittedState:
        """The kernel's variance and length scales."""
        kernel = self.process_.kernel_
        return FittedState({"variance": float(kernel.k1.constant_value)}, {"lengths": np.array(kernel.k2.length_scale)})

    def restore(self, tests: Sequence[BiasPoints], learned: FittedState) -> Self:
        """Restore hyperparameters that were learned from the bias of these tests."""
        from sklearn.gaussian_process import GaussianProcessRegressor

        kernel = _kernel(learned.values["variance"], learned.arrays["lengths"])
        self._fit(GaussianProcessRegressor(kernel, alpha=_ALPHA, optimizer=None), tests)
        return self

    def _fit(self, process: "GaussianProcessRegressor", tests: Sequence[BiasPoints]) -> None:
        x = np.concatenate([_columns(test) for test in tests])
        y = np.concatenate([test.bias_mps2 for test in tests])
        self.centre_ = x.mean(axis=0)
        self.spread_ = np.where((spread := x.std(axis=0)) > 0, spread, 1.0)
        self.process_ = process.fit((x - self.centre_) / self.spread_, y)
        noise_alone = -0.5 * y.size * (np.log(2 * np.pi * max(np.mean(y**2), _ALPHA)) + 1)
        self.dead_ = bool(self.process_.log_marginal_likelihood_value_ < noise_alone + _DEAD * y.size)

    def sample(self, moving: BiasPoints, stop: CaeStop, n_draws: int, rng: np.random.Generator) -> BiasDraws:
        """Mean and draws at displacements (Eqs. 26 and 27); zero over velocity, which is not in Table 4."""
        x = (_columns(moving) - self.centre_) / self.spread_
        mean, covariance = self.process_.predict(x, return_cov=True)
        functions = np.vstack([mean, draw(mean, covariance, n_draws, rng)])
        return BiasDraws(functions, np.zeros((1 + n_draws, stop.speed_share.size)))

    @property
    def state(self) -> dict[str, object]:
        """Hyperparameters (variance in (m/s²)², lengths in standard deviations of the input) and diagnostics."""
        kernel = self.process_.kernel_
        names = ("variance", *(f"length in {name}" for name in _INPUTS))
        touched = np.isclose(kernel.theta[:, None], kernel.bounds, atol=1e-3).any(axis=1)
        return {
            "points": len(self.process_.X_train_),
            "hyperparameters": dict(zip(names, np.exp(kernel.theta).tolist(), strict=True)),
            "touched_bounds": [name for name, hit in zip(names, touched, strict=True) if hit],
            "log_marginal_likelihood": round(float(self.process_.log_marginal_likelihood_value_), 2),
            "dead": self.dead_,
            "retries": 0,
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """A warning if the fit explains no more than noise."""
        return ("The fit of Table 4 failed: it explains no more than noise.",) * self.dead_


def _kernel(variance: float, lengths: FloatArray) -> "Product":
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern

    return ConstantKernel(variance, _BOUNDS) * Matern(lengths, _BOUNDS, nu=1.5)


def _columns(points: BiasPoints) -> FloatArray:
    return np.column_stack([points.displacement_m, np.tile(points.condition.vector, (points.displacement_m.size, 1))])
