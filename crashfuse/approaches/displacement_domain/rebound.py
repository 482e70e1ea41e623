"""The rebound after the time of zero velocity: the CAE model's unloading branch and a correction from tests."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from crashfuse.approaches.base import FittedState
from crashfuse.approaches.displacement_domain.covariance import LogNormal, Part
from crashfuse.approaches.displacement_domain.gaussian_process import GaussianProcess
from crashfuse.approaches.draws import draw, student_draws
from crashfuse.signals.loading import LoadingPhase, loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Kinematics, kinematics
from crashfuse.units import G

_JOIN_S = 0.005  # time constant with which a step at zero velocity fades
_SCALES = (1 / 3, 3.0)  # limits of the scaling that joins the branch to the pulse at zero velocity

_STEP_S = 0.002  # a CFC 60 pulse contains no finer detail
_AFTER_S: FloatArray = np.arange(0.0, GRID_S[-1] + _STEP_S, _STEP_S)
_LEAST_S = 0.006  # minimum duration of rebound on record
_LEAST_UNIT = 5 * G  # a rebound is scaled by the deceleration at zero velocity, or this if larger
_TIME, _SPEED, _EARLY, _LATE = range(4)
_RISE_S, _FADE_S = 0.004, 0.012
_QUICK, _SLOW = (_TIME, LogNormal(0.005, 0.4)), (_TIME, LogNormal(0.01, 0.4))
# Most of the difference between CAE and test ends with the contact; the small remainder has its own part, as the band
# would otherwise keep its largest width.
_PARTS = (
    Part("shared", LogNormal(0.7, 0.7), ((_QUICK,),), times=_EARLY),
    Part("by speed", LogNormal(0.5, 0.7), ((_QUICK,), ((_SPEED, LogNormal(5.0, 0.5)),)), times=_EARLY),
    Part("own", LogNormal(0.4, 0.7), ((_QUICK,),), times=_EARLY, same=-1),
    Part("late", LogNormal(0.2, 0.7), ((_SLOW,),), times=_LATE),
    Part("own late", LogNormal(0.2, 0.7), ((_QUICK,),), times=_LATE, same=-1),
)
_OF_A_TEST = {part.name for part in _PARTS if part.same is not None}
_NOISE = LogNormal(0.1, 0.8)
_LEAST_FREEDOM = 3


def follow_unloading(
    accel_mps2: FloatArray, speed_mps: float, cae: FloatArray, cae_loading: LoadingPhase
) -> FloatArray:
    """Replace the rebound by the CAE pulse's unloading, shifted to the time of zero velocity and scaled to join.

    Parameters
    ----------
    accel_mps2 : ndarray, shape (n_draws, n)
        Pulses on the study grid; one that does not stop the vehicle within it is unchanged.
    cae : ndarray, shape (n,)
        The CAE pulse at this condition; beyond its end it keeps its last value.
    cae_loading : LoadingPhase
        Loading phase of that pulse. If it never stops the vehicle there is no unloading: the acceleration just fades.
    """
    return _unloaded(kinematics(accel_mps2, speed_mps, DT_S), cae, cae_loading)


def _unloaded(pulses: Kinematics, cae: FloatArray, cae_loading: LoadingPhase) -> FloatArray:
    """As :func:`follow_unloading`, for pulses at any time step."""
    whole = pulses.accel_mps2.copy()
    some, after = _since_stop(pulses.t0_s, pulses.dt_s, whole.shape[-1])
    accel_mps2, at_t0 = whole[:, some], _at(pulses.accel_mps2, pulses.t0_s[:, None] / pulses.dt_s)
    if np.isnan(cae_loading.t0_s):
        branch, end = np.zeros_like(accel_mps2), 0.0
    else:
        branch, end = np.interp(cae_loading.t0_s + after, np.arange(cae.size) * DT_S, cae), cae_loading.accel_mps2[-1]
    scale = np.clip(at_t0 / end, *_SCALES) if end < 0 else np.ones_like(at_t0)
    unloading = scale * branch + (at_t0 - scale * end) * np.exp(-after / _JOIN_S)
    np.copyto(accel_mps2, unloading, where=after > 0)
    return whole


@dataclass(frozen=True, eq=False, slots=True)
class Unloading:
    """A test paired with the CAE pulse at its condition, for the rebound.

    Attributes
    ----------
    accel_mps2, cae_mps2 : ndarray, shape (1250,)
    """

    speed_mps: float
    accel_mps2: FloatArray
    cae_mps2: FloatArray
    cae_loading: LoadingPhase


class Rebound:
    """Correction of the CAE unloading branch over time since zero velocity: a hierarchical model, as for the bias.

    Attributes
    ----------
    process_ : GaussianProcess or None
        None if no test stops early enough to show a rebound.
    freedom_ : int
        Degrees of freedom of the draws.
    """

    process_: GaussianProcess | None

    def fit(self, tests: Sequence[Unloading]) -> Self:
        """Fit to tests; those whose record ends at zero velocity are skipped."""
        x, y = self._rows_of(tests)
        self.process_ = GaussianProcess(_PARTS, _NOISE).fit(x, y) if len(x) else None
        return self

    def learned(self) -> FittedState:
        """Fitted state: the hyperparameters."""
        return FittedState({}, {}) if self.process_ is None else self.process_.learned()

    def restore(self, tests: Sequence[Unloading], learned: FittedState) -> Self:
        """Restore hyperparameters that were learned from these tests."""
        x, y = self._rows_of(tests)
        self.process_ = GaussianProcess(_PARTS, _NOISE).restore(x, y, learned) if len(x) else None
        return self

    def _rows_of(self, tests: Sequence[Unloading]) -> tuple[FloatArray, FloatArray]:
        x: list[FloatArray] = [np.empty((0, _LATE + 2))]
        y: list[FloatArray] = [np.empty(0)]
        for number, test in enumerate(tests):
            t0 = float(kinematics(test.accel_mps2, test.speed_mps, DT_S).t0_s)
            if not t0 <= GRID_S[-1] - _LEAST_S:
                continue
            branch = follow_unloading(test.accel_mps2[None], test.speed_mps, test.cae_mps2, test.cae_loading)[0]
            after = np.arange(0.0, GRID_S[-1] - t0, _STEP_S)
            x.append(_rows(after, test.speed_mps, number))
            extra = np.interp(t0 + after, GRID_S, test.accel_mps2 - branch)
            y.append(extra / _unit(np.interp(t0, GRID_S, test.accel_mps2)))
        self.freedom_ = max(len(x) - 2, _LEAST_FREEDOM)
        return np.concatenate(x), np.concatenate(y)

    def without(self, *numbers: int) -> Self:
        """The same model, hyperparameters kept, as if the tests with these numbers had not been run."""
        other = copy.copy(self)
        if self.process_ is not None:
            nothing_left = np.isin(self.process_.x_[:, -1], numbers).all()
            other.process_ = None if nothing_left else self.process_.without(*numbers)
        return other

    def follow(
        self,
        pulses_mps2: FloatArray,
        speed_mps: float,
        cae_mps2: FloatArray,
        cae_loading: LoadingPhase,
        rng: np.random.Generator,
        widening: float = 1.0,
        dt_s: float = DT_S,
    ) -> FloatArray:
        """Apply :func:`follow_unloading` with the correction: expected for the first pulse, drawn for the others.

        ``widening`` is a factor on the draws' deviations, ``dt_s`` the time step of the pulses, of 100 ms each.
        """
        own = kinematics(pulses_mps2, speed_mps, dt_s)
        pulses = _unloaded(own, cae_mps2, cae_loading)
        if self.process_ is None:
            return pulses
        mean, covariance = self.process_.posterior(_rows(_AFTER_S, speed_mps, -1))
        draws = student_draws(mean, widening**2 * covariance, self.freedom_, len(pulses) - 1, rng)
        return _with(np.vstack([mean, draws]), pulses, own.t0_s, dt_s)

    def repeat(
        self, pulses_mps2: FloatArray, speed_mps: float, test_mps2: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Let each pulse rebound as a repeat of this test would: as the test, and differently by what tests do."""
        motion = kinematics(pulses_mps2, speed_mps, DT_S)
        pulses = _unloaded(motion, test_mps2, loading_phase(test_mps2, speed_mps))
        if self.process_ is None:
            return pulses
        own = self.process_.prior_of(_OF_A_TEST, _rows(_AFTER_S, speed_mps, -1))
        differences = draw(np.zeros(_AFTER_S.size), 2 * own, len(pulses), rng)
        return _with(differences, pulses, motion.t0_s, DT_S)


def _with(extra: FloatArray, pulses_mps2: FloatArray, t0_s: FloatArray, dt_s: float) -> FloatArray:
    """Add corrections at the times after zero velocity, one row for each pulse, from zero velocity on."""
    some, after = _since_stop(t0_s, dt_s, pulses_mps2.shape[-1])
    scale = _unit(_at(pulses_mps2, t0_s[:, None] / dt_s))
    pulses_mps2[:, some] += np.where(after > 0, scale * _at(extra, after / _STEP_S), 0.0)
    return pulses_mps2


def _since_stop(t0_s: FloatArray, dt_s: float, n_times: int) -> tuple[slice, FloatArray]:
    """The samples from just before any of these times of zero velocity on, and the times since each, 0 before it.

    Both are empty if there is none; the times are NaN where a vehicle does not stop.
    """
    earliest = float(np.fmin.reduce(t0_s, initial=np.inf)) / dt_s
    some = slice(int(earliest), None) if np.isfinite(earliest) else slice(0)
    return some, np.maximum(np.arange(n_times)[some] * dt_s - t0_s[:, None], 0.0)


def _at(rows: FloatArray, place: FloatArray) -> FloatArray:
    """Each row, linear between its samples, at places of its own, counted in samples; NaN where the place is."""
    low = np.minimum(np.nan_to_num(place).astype(np.intp), rows.shape[1] - 2)
    before, after = (np.take_along_axis(rows, low + step, axis=1) for step in (0, 1))
    share = place - low
    return np.asarray(before * (1 - share) + after * share)


def _unit(accel_at_t0: FloatArray | float) -> FloatArray:
    return np.asarray(np.maximum(np.abs(accel_at_t0), _LEAST_UNIT))


def _rows(after_s: FloatArray, speed_mps: float, test: int) -> FloatArray:
    rise = 1 - np.exp(-after_s / _RISE_S)  # no step at zero velocity itself
    n = after_s.size
    return np.column_stack(
        [after_s, np.full(n, speed_mps), rise * np.exp(-after_s / _FADE_S), rise, np.full(n, float(test))]
    )
