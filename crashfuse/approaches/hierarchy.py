"""Our model of the bias: a hierarchy of what all tests share, what like tests share, and what each has alone."""

from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np
from scipy.special import stdtrit

from crashfuse.approaches.bias import BiasDraws, BiasPart, BiasPoints
from crashfuse.approaches.covariance import Covariance, LogNormal, Part
from crashfuse.approaches.gaussian_process import GaussianProcess, draw
from crashfuse.progress import SILENT, Watch
from crashfuse.pulse import Condition, FloatArray
from crashfuse.units import G

_S, _V0, _FRONT, _REAR, _CAE, _SHARE, _STOPPING = range(7)
_LENGTH_UNITS = {
    _S: "s in m",
    _V0: "v0 in m/s",
    _FRONT: "front weight in kg",
    _REAR: "rear weight in kg",
    _SHARE: "v/v0",
}
_FORCE_UNIT = 10 * G  # so that the ratio counts with its standard deviation where the CAE model brakes with 10 g

# The medians are orders of magnitude of a car's front end, fitted to none: 0.1 m is what a CFC 60 pulse resolves at
# 35 mph; 5 m/s tells crashes apart, weights hardly do, for the CAE model knows about mass.
_REACH = (_S, LogNormal(0.1, 0.3))
_WEIGHT = LogNormal(300.0, 0.5)
_PARTS = (
    Part("shared", LogNormal(0.7, 0.7), ((_REACH,),)),
    Part("by speed", LogNormal(0.5, 0.7), ((_REACH,), ((_V0, LogNormal(5.0, 0.5)),))),
    Part("by weight", LogNormal(0.3, 0.7), ((_REACH,), ((_FRONT, _WEIGHT), (_REAR, _WEIGHT)))),
    Part("ratio", LogNormal(0.2, 0.7), (((_S, LogNormal(0.5, 0.3)),),), times=_CAE),
    Part("own", LogNormal(0.2, 0.7), (((_S, LogNormal(0.07, 0.4)),),), of_each_test=True),
    Part("stopping", LogNormal(0.5, 0.5), (((_SHARE, LogNormal(0.15, 0.4)),),), times=_STOPPING, of_each_test=True),
)
_NOISE = LogNormal(0.07, 0.8)
_LEAST_FREEDOM = 3


class HierarchicalBias:
    """δ(s, x, k) = f0(s) + f1(s, v0) + f2(s, weights) + ρ(s) G_a(s, x) + r_k(s) + e_k(v / v0) + noise.

    f0 is what all tests share, f1 and f2 what varies with the condition, ρ what is proportional to the CAE model's own
    force (a stiffer material, say). Test k's own are r_k, its repeatability, and e_k, how it comes to its stop: there
    displacement hardly grows while acceleration changes, so that part is kept apart, over velocity, and does not blur
    the rest. Where like tests contradict each other r_k grows, and a prediction shrinks to the CAE model. A new test
    has an r and an e of its own, so they are in its band.

    Parameters
    ----------
    seed : int
        For further starts of the optimiser, should the first be dead.

    Attributes
    ----------
    end_share : float
        Below this share of its impact speed a vehicle is stopping: 6 % of its energy is left.
    process_ : GaussianProcess
    freedom_ : int
        Degrees of freedom of the draws, one less than there are tests: how much tests differ is known from so few.
    """

    end_share: ClassVar[float] = 0.25

    def __init__(self, *, seed: int = 0) -> None:
        self.seed = seed

    def fit(self, tests: Sequence[BiasPoints], watch: Watch = SILENT) -> Self:
        """Learn from the bias of each test.

        Raises
        ------
        Cancelled
            If the watch was told to stop.
        """
        watch.report("Bias model", 0, 1)
        x = [_rows(t.condition, t.displacement_m, t.cae_mps2, t.speed_share, number) for number, t in enumerate(tests)]
        y = np.concatenate([test.bias_mps2 for test in tests])
        self.process_ = GaussianProcess(_PARTS, _NOISE, seed=self.seed).fit(np.concatenate(x), y)
        self.freedom_ = max(len(tests) - 1, _LEAST_FREEDOM)
        watch.report("Bias model", 1, 1)
        return self

    def sample(
        self,
        condition: Condition,
        displacement_m: FloatArray,
        cae_mps2: FloatArray,
        speed_share: FloatArray,
        n_draws: int,
        rng: np.random.Generator,
    ) -> BiasDraws:
        """Mean and draws of a new test's bias, with its own deviation and stop, without noise.

        The draws have Student's t distribution: hyperparameters are estimates, from a handful of tests.

        Parameters
        ----------
        condition : Condition
        displacement_m, cae_mps2 : ndarray, shape (n,)
            Displacements, and the CAE model's acceleration there.
        speed_share : ndarray, shape (m,)
            Velocities as shares of the impact speed.
        n_draws : int
        rng : numpy.random.Generator
        """
        moving = np.ones_like(displacement_m)
        mean, covariance = self.process_.predict(
            _rows(condition, displacement_m, cae_mps2, moving, number=-1), return_cov=True
        )
        stop = _rows(condition, np.zeros_like(speed_share), np.zeros_like(speed_share), speed_share, number=-1)
        stop_part = _PARTS[-1]
        own = self.process_.theta_[-1 - len(stop_part.priors) : -1]
        stop_covariance = self.process_.output_scale_**2 * Covariance((stop_part,), stop, stop)(own)
        widening = np.sqrt(self.freedom_ / rng.chisquare(self.freedom_, size=(n_draws, 1)))
        deviations = widening * draw(np.zeros_like(mean), covariance, n_draws, rng)
        stops = widening * draw(np.zeros_like(speed_share), stop_covariance, n_draws, rng)
        return BiasDraws(np.vstack([mean, mean + deviations]), np.vstack([np.zeros_like(speed_share), stops]))

    def parts(self, condition: Condition, displacement_m: FloatArray, cae_mps2: FloatArray) -> tuple[BiasPart, ...]:
        """Take the bias of a new test apart, as long as it moves: what comes with its stop is zero until then.

        Parameters
        ----------
        condition : Condition
        displacement_m, cae_mps2 : ndarray, shape (n,)
            As for :meth:`sample`.

        Returns
        -------
        tuple of BiasPart
            Shared, by speed, by weight, ratio, own; then their total, which is the mean that :meth:`sample` gives.
        """
        x = _rows(condition, displacement_m, cae_mps2, np.ones_like(displacement_m), number=-1)
        moments = self.process_.predict_parts(x)[: len(_PARTS) - 1]
        moments.append(self.process_.predict(x, return_std=True))
        names = (*(part.name for part in _PARTS[:-1]), "total")
        reach = float(stdtrit(self.freedom_, 0.975))  # the draws have Student's t distribution
        return tuple(
            BiasPart(name, mean, mean - reach * std, mean + reach * std)
            for name, (mean, std) in zip(names, moments, strict=True)
        )

    @property
    def state(self) -> dict[str, object]:
        """Hyperparameters (standard deviations relative to the bias, lengths in SI), likelihood, how the fit went."""
        names = []
        for part in _PARTS:
            columns = [column for group in part.groups for column, _ in group]
            names.append(f"{part.name}, standard deviation")
            names += [f"{part.name}, length in {_LENGTH_UNITS[column]}" for column in columns]
        names.append("noise, standard deviation")
        process = self.process_
        return {
            "points": len(process.x_),
            "bias_rms_g": round(process.output_scale_ / G, 3),
            "hyperparameters": dict(zip(names, np.exp(process.theta_).round(4).tolist(), strict=True)),
            "touched_bounds": [name for name, touched in zip(names, process.touched_, strict=True) if touched],
            "log_marginal_likelihood": round(process.log_marginal_likelihood_, 2),
            "dead": process.dead_,
            "retries": process.retries_,
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """A warning if the fit explains nothing."""
        return ("The bias model found nothing in the tests that noise would not explain.",) * self.process_.dead_


def _rows(
    condition: Condition, displacement_m: FloatArray, cae_mps2: FloatArray, speed_share: FloatArray, number: int
) -> FloatArray:
    """Columns in the order of their constants above, then the test's number."""
    n = displacement_m.size
    stopping = np.maximum(1 - speed_share / HierarchicalBias.end_share, 0.0)
    x = np.tile(condition.vector, (n, 1))
    return np.column_stack([displacement_m, x, cae_mps2 / _FORCE_UNIT, speed_share, stopping, np.full(n, number)])
