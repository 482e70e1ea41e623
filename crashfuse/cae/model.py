"""The CAE model at any condition, over time and over displacement: the run at that condition, else the emulator."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from crashfuse.cae_library import CaeLibrary
from crashfuse.condition import Condition
from crashfuse.errors import refuse_if
from crashfuse.execution.cache import Code, Entry, finite
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import UNKEPT, Run, one_thread
from crashfuse.signals.loading_phase import LoadingPhase, loading_phase
from crashfuse.signals.pulse import N_SAMPLES, FloatArray

_MOST_MODES, _MOST_RUNS = 40, 1200  # time grows with the cube of runs; larger libraries are thinned evenly
_MOST_LENGTH_RUNS = 300  # to find the length scales from
_NOISE = np.geomspace(1e-6, 2.0, 30)  # candidate ratios of a mode's noise variance to its signal variance
_LOG_NOISE_PRIOR = -0.5 * (np.log(_NOISE / 1e-3) / 3.0) ** 2
_LOG_LENGTH_PRIOR = np.log([0.5, 3.0, 3.0])  # speed matters more than weight
_ENOUGH = {"ftol": 1e-8, "gtol": 1e-2, "maxiter": 40}
_LEAST_SHARE = 1e-6  # of the largest mode: smaller ones are noise of single-precision pulses
_LEAST_MPS = 0.5  # slower runs are divided by this speed, as their pulses are almost zero
_LIKE = 30  # number of nearby runs whose errors represent the error at a condition
_SCALING = ("centre_", "spread_", "inputs_", "length_scales_", "speed_range_")
_LEARNED = (*_SCALING, "mean_", "modes_", "noise_", "residuals_", "weights_")

_FASTER = 1.1  # speed ratio of successive crashes that continue a loading curve
_JOIN_M = 0.03  # displacement over which the step between two of them fades


class Emulator:
    """Emulator of the CAE model for conditions without a run, learned from the runs of a library.

    The pulses, divided by impact speed so that slow crashes count as much as fast ones, are decomposed into principal
    modes in time. The score of each mode is a Gaussian process over (v0, front weight, rear weight): the modes share
    one Matérn-5/2 correlation with ``length_scales_`` in standard deviations of the library; each has a variance and a
    noise relative to it (``noise_``), so that a mode that does not vary smoothly is averaged, not interpolated.
    ``residuals_`` are those of each run left out, at these values, shape (n_runs, n_modes).
    """

    def fit(self, cae: CaeLibrary, watch: Watch = SILENT) -> Self:
        """Train on the runs of the library; raises a DataError without a run, or Cancelled."""
        refuse_if(not len(cae), "CAE runs", "at least one run", "none", "add CAE runs to the campaign")
        watch.report("CAE emulator", 0, 1)
        rows = np.linspace(0, len(cae) - 1, min(len(cae), _MOST_RUNS)).astype(int)
        vectors = cae.vectors[rows]
        self.speed_range_ = np.array([vectors[:, 0].min(), vectors[:, 0].max()])
        self.centre_ = vectors.mean(axis=0)
        self.spread_ = np.where((spread := vectors.std(axis=0)) > 0, spread, 1.0)
        self.inputs_ = (vectors - self.centre_) / self.spread_
        pulses = cae.accel_mps2[rows] / np.maximum(vectors[:, :1], _LEAST_MPS)
        self.mean_ = pulses.mean(axis=0)
        with one_thread():
            self._fit_modes(pulses - self.mean_)
        watch.report("CAE emulator", 1, 1)
        return self

    def _fit_modes(self, pulses: FloatArray) -> None:
        n = len(pulses)
        squares, left = eigh(pulses @ pulses.T, subset_by_index=[max(n - _MOST_MODES, 0), n - 1])
        size, left = np.sqrt(np.maximum(squares[::-1], 0.0)), left[:, ::-1]
        keep = int((size > _LEAST_SHARE * size[0]).sum()) if size[0] > 0 else 0
        size, left = size[:keep], left[:, :keep]
        scale = size / np.sqrt(n)
        scores = left * np.sqrt(n)  # each of unit variance
        rows = np.linspace(0, n - 1, min(n, _MOST_LENGTH_RUNS)).astype(int)
        x, y = self.inputs_[rows], scores[rows]

        def loss(log_length: FloatArray) -> tuple[float, FloatArray]:
            _, evidence, slope = _evidence(x, y, np.exp(log_length))
            away = log_length - _LOG_LENGTH_PRIOR
            return float(0.5 * away @ away) - evidence, away - slope

        best = minimize(loss, _LOG_LENGTH_PRIOR, jac=True, method="L-BFGS-B", options=_ENOUGH)
        self.length_scales_ = np.exp(best.x)
        self.noise_ = _evidence(x, y, self.length_scales_)[0]
        values, vectors = _eigen(_correlation(_distance(self.inputs_, self.inputs_, self.length_scales_)))
        inverse = 1 / (values[:, None] + self.noise_)
        weights = vectors @ ((vectors.T @ scores) * inverse)
        self.weights_ = weights * scale  # weights of the correlations with each run, shape (n_runs, n_modes)
        self.residuals_ = (weights / (vectors**2 @ inverse)) * scale  # of each run, leaving it out
        self.modes_ = (left / size).T @ pulses

    def predict(self, condition: Condition) -> FloatArray:
        """The CAE pulse at a condition, m/s², shape (1250,); outside the library its boundary's, scaled with speed."""
        x = (condition.vector[None] - self.centre_) / self.spread_
        x = np.clip(x, self.inputs_.min(axis=0), self.inputs_.max(axis=0))
        correlation = _correlation(_distance(x, self.inputs_, self.length_scales_))
        pulse = self.mean_ + correlation @ self.weights_ @ self.modes_
        return np.asarray(pulse[0] * max(condition.speed_mps, _LEAST_MPS))

    def errors(self, condition: Condition, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw errors of :meth:`predict`, shape (n, 1250): leave-one-out residuals of similar runs, of either sign."""
        x = (condition.vector - self.centre_) / self.spread_
        away = np.sum(((self.inputs_ - x) / self.length_scales_) ** 2, axis=1)
        chosen = rng.choice(np.argsort(away, kind="stable")[:_LIKE], size=n)
        signs = rng.choice([-1.0, 1.0], size=(n, 1))
        return np.asarray(max(condition.speed_mps, _LEAST_MPS) * signs * (self.residuals_[chosen] @ self.modes_))

    def restore(self, learned: Entry, cae: CaeLibrary) -> Self:
        """Restore a fitted state; raises if it cannot be that of this library."""
        for name in _LEARNED:
            setattr(self, name, finite(learned, name, *(None,) * learned[name].ndim))
        pulse, largest = self.predict(cae.conditions[0]), 10 * np.abs(cae.accel_mps2).max()
        if self.speed_range_.shape != (2,) or pulse.shape != (N_SAMPLES,) or not (np.abs(pulse) <= largest).all():
            raise ValueError("not the emulator of this library")
        return self


def _distance(x: FloatArray, z: FloatArray, length_scales: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(5) * cdist(x / length_scales, z / length_scales))


def _correlation(u: FloatArray) -> FloatArray:
    return np.asarray((1 + u + u**2 / 3) * np.exp(-u))  # Matérn-5/2


def _eigen(correlation: FloatArray) -> tuple[FloatArray, FloatArray]:
    values, vectors = np.linalg.eigh(correlation)
    return np.maximum(values, 0.0), vectors


def _evidence(x: FloatArray, y: FloatArray, length_scales: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Most probable noise of each mode, the log marginal likelihood of all, and its slope by each log length scale.

    The variance of each mode is the optimal one (Rasmussen & Williams, Eqs. 2.30 and 5.9). In the eigenbasis of the
    correlation matrix, noise only adds to the eigenvalues: one decomposition serves all candidates.
    """
    u = _distance(x, x, length_scales)
    values, vectors = _eigen(_correlation(u))
    turned, n = vectors.T @ y, len(x)
    variance = values[:, None] + _NOISE
    misfit = (turned**2).T @ (1 / variance)
    evidence = -0.5 * (n * np.log(misfit / n) + np.log(variance).sum(axis=0)) + _LOG_NOISE_PRIOR
    best, modes = evidence.argmax(axis=1), np.arange(y.shape[1])
    inverse = 1 / variance[:, best]
    alpha = vectors @ (turned * inverse) * np.sqrt(n / misfit[modes, best])
    by_correlation = alpha @ alpha.T - (vectors * inverse.sum(axis=1)) @ vectors.T
    by_share = by_correlation * (5 / 3 * (1 + u) * np.exp(-u))
    slope = [0.5 * np.sum(by_share * np.subtract.outer(column, column) ** 2) for column in (x / length_scales).T]
    return _NOISE[best], float(evidence[modes, best].sum()), np.array(slope)


@dataclass(frozen=True, eq=False, slots=True)
class CaePulse:
    """A pulse of the CAE model and its source: ``run C0001`` or ``emulator``."""

    accel_mps2: FloatArray
    source: str


@dataclass(frozen=True, eq=False)
class LoadingCurve:
    """The CAE model over displacement at one condition, G_a(s, x) of Eq. 10."""

    phase: LoadingPhase  # of the CAE pulse at this condition
    faster: Sequence[LoadingPhase] = ()  # of successively faster crashes, which continue the curve at larger crush

    def accel_at(self, displacement_m: FloatArray, end_share: float = 0.0) -> FloatArray:
        """Acceleration at displacements, in m/s²: of each pulse until its vehicle has slowed to a share of its speed.

        The next faster one then continues it without a jump; after the last one the curve is constant.
        """
        reached = self.phase.displacement_at_speed(end_share)
        level = float(self.phase.accel_at(np.array(reached)))
        curve = np.where(displacement_m < reached, self.phase.accel_at(displacement_m), level)
        for faster in self.faster:
            if (end := faster.displacement_at_speed(end_share)) <= reached:
                continue
            beyond = displacement_m > reached
            step = level - faster.accel_at(np.array(reached))
            at = np.minimum(displacement_m[beyond], end)
            curve[beyond] = faster.accel_at(at) + step * np.exp(-(at - reached) / _JOIN_M)
            level = float(faster.accel_at(np.array(end)) + step * np.exp(-(end - reached) / _JOIN_M))
            reached = end
        return curve

    def stopping_accel(self, speed_share: FloatArray, end_share: float) -> FloatArray:
        """Additional acceleration of the CAE vehicle while it stops, in m/s², over shares v/v0 of its impact speed.

        Added to ``accel_at(s, end_share)`` it gives the CAE pulse; it is zero above that share of the impact speed.
        """
        phase = self.phase
        extra = phase.accel_mps2 - self.accel_at(phase.displacement_m, end_share)
        order = np.argsort(phase.speed_share)
        extra = np.interp(speed_share, phase.speed_share[order], extra[order])
        return np.where(speed_share < end_share, extra, 0.0)


class CaeModel:
    """The CAE model at any condition; the cache keeps the trained emulator by fingerprint of the library."""

    def fit(self, cae: CaeLibrary, run: Run = UNKEPT) -> Self:
        """Train the emulator, or load it from the cache."""
        self.cae_, self.emulator_, runs = cae, (emulator := Emulator()), cae.learned_from
        key = {"cae": runs.fingerprint, "code": Code(Emulator.__module__)}

        def compute() -> tuple[Emulator, Entry]:
            return emulator.fit(runs, run.watch), {name: getattr(emulator, name) for name in _LEARNED}

        run.get_or_compute("emulator", key, compute, lambda entry: emulator.restore(entry, runs))
        return self

    def pulse(self, condition: Condition) -> CaePulse:
        """The pulse of the run at exactly this condition, else that of the emulator."""
        run = self.cae_.paired_run(condition)
        if run is None:
            return CaePulse(self.emulator_.predict(condition), "emulator")
        return CaePulse(self.cae_.accel_mps2[run].astype(np.float64), f"run {self.cae_.ids[run]}")

    def loading_curve(self, condition: Condition) -> LoadingCurve:
        """The CAE model over displacement, continued by the emulator up to the library's fastest run."""
        phase = loading_phase(self.pulse(condition).accel_mps2, condition.speed_mps)
        top = self.emulator_.speed_range_[1]
        speed, faster = condition.speed_mps, []
        while speed < top:
            speed = min(_FASTER * speed, top)
            faster.append(loading_phase(self.emulator_.predict(replace(condition, speed_mps=speed)), speed))
        return LoadingCurve(phase, tuple(faster))

    def errors(self, condition: Condition, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw errors of :meth:`pulse`, shape (n, 1250); zero if there is a run."""
        if self.cae_.paired_run(condition) is not None:
            return np.zeros((n, self.cae_.accel_mps2.shape[1]))
        return self.emulator_.errors(condition, n, rng)

    def notes(self, condition: Condition) -> tuple[str, ...]:
        """The source of the pulse at a condition, and inputs outside the library's range."""
        source = self.pulse(condition).source
        origin = "CAE pulse: from the emulator." if source == "emulator" else f"CAE pulse: paired {source}."
        return (origin, *self.cae_.extrapolation(condition))


def cae_pulses(cae: CaeLibrary, conditions: Sequence[Condition], run: Run = UNKEPT) -> list[FloatArray]:
    """The CAE pulse at each condition; the emulator is trained only if one has no run."""
    runs, model = [cae.paired_run(condition) for condition in conditions], CaeModel()
    if None in runs:
        model.fit(cae, run)
    pairs = zip(runs, conditions, strict=True)
    return [model.pulse(c).accel_mps2 if n is None else cae.accel_mps2[n].astype(np.float64) for n, c in pairs]
