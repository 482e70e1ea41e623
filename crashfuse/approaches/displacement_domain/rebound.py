"""The rebound after the time of zero velocity: the CAE model's unloading branch and a correction from tests."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.random import Generator

from crashfuse.approaches.base import FittedState, StudentT, draw, root
from crashfuse.approaches.displacement_domain.covariance import LogNormal, Part
from crashfuse.approaches.displacement_domain.gaussian_process import GaussianProcess
from crashfuse.signals.loading_phase import LoadingPhase, loading_phase
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
_MOST_KEPT = 16  # corrections: of a left-out test some are asked for again, with each widening and by each seed


def follow_unloading(
    accel_mps2: FloatArray, speed_mps: float, cae: FloatArray, cae_loading: LoadingPhase
) -> FloatArray:
    """Replace the rebound by the CAE pulse's unloading, shifted to the time of zero velocity and scaled to join.

    A pulse that does not stop the vehicle is unchanged; if the CAE pulse never does, the acceleration just fades.
    """
    pulses = kinematics(accel_mps2, speed_mps, DT_S)
    return _unloaded(pulses, _SinceStop.of(pulses), cae, cae_loading)


class _SinceStop(NamedTuple):
    """The samples from just before any zero velocity on, and when they are."""

    samples: slice
    after_s: FloatArray  # time since zero velocity, shape (n_draws, n_samples); 0 before it, or if there is none
    place: FloatArray  # zero velocity, counted in samples from contact, shape (n_draws, 1); 0 if there is none

    @classmethod
    def of(cls, pulses: Kinematics) -> Self:
        earliest = float(np.fmin.reduce(pulses.t0_s, initial=np.inf)) / pulses.dt_s
        samples = slice(int(earliest), None) if np.isfinite(earliest) else slice(0)
        since = np.arange(pulses.accel_mps2.shape[-1])[samples] * pulses.dt_s - pulses.t0_s[:, None]
        return cls(samples, np.fmax(since, 0.0), np.nan_to_num(pulses.t0_s / pulses.dt_s)[:, None])


def _unloaded(pulses: Kinematics, since: _SinceStop, cae: FloatArray, cae_loading: LoadingPhase) -> FloatArray:
    whole, at_t0 = pulses.accel_mps2.copy(), _at(pulses.accel_mps2, since.place)
    if np.isnan(cae_loading.t0_s):
        branch, end = np.zeros_like(since.after_s), 0.0
    else:
        branch = _at(cae[None], np.minimum((cae_loading.t0_s + since.after_s) / DT_S, cae.size - 1.0))
        end = cae_loading.accel_mps2[-1]
    scale = np.clip(at_t0 / end, *_SCALES) if end < 0 else np.ones_like(at_t0)
    unloading = scale * branch + (at_t0 - scale * end) * np.exp(-since.after_s / _JOIN_S)
    np.copyto(whole[:, since.samples], unloading, where=since.after_s > 0)
    return whole


@dataclass(frozen=True, eq=False, slots=True)
class Unloading:
    """A test paired with the CAE pulse at its condition, for the rebound."""

    speed_mps: float
    accel_mps2: FloatArray  # shape (1250,)
    cae_mps2: FloatArray  # shape (1250,)
    cae_loading: LoadingPhase


class Rebound:
    """Correction of the CAE unloading branch over time since zero velocity, modelled as the bias is."""

    process_: GaussianProcess | None  # None if no test stops early enough to show a rebound
    freedom_: int  # degrees of freedom of the draws

    def fit(self, tests: Sequence[Unloading], learned: FittedState | None = None) -> Self:
        """Fit to tests, or restore what was learned from them; those whose record ends at zero velocity are skipped."""
        (x, y), process = self._rows_of(tests), GaussianProcess(_PARTS, _NOISE)
        self._corrections: dict[tuple[float, float], StudentT] = {}  # by speed and widening
        self.process_ = None
        if len(x):
            self.process_ = process.fit(x, y) if learned is None else process.restore(x, y, learned)
        return self

    def learned(self) -> FittedState:
        """The hyperparameters."""
        return FittedState({}, {}) if self.process_ is None else self.process_.learned()

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
        """The same as if the tests with these numbers had not been run."""
        other = copy.copy(self)
        other._corrections = {}
        if self.process_ is not None:
            nothing_left = np.isin(self.process_.x_[:, -1], numbers).all()
            other.process_ = None if nothing_left else self.process_.without(*numbers)
        return other

    def follow(
        self,
        pulses: Kinematics,
        cae_mps2: FloatArray,
        cae_loading: LoadingPhase,
        speed_mps: float,
        rng: Generator,
        widening: float = 1.0,
    ) -> FloatArray:
        """:func:`follow_unloading` with the correction: expected for the first pulse, drawn for the others."""
        since = _SinceStop.of(pulses)
        whole = _unloaded(pulses, since, cae_mps2, cae_loading)
        if self.process_ is None:
            return whole
        if (correction := self._corrections.get((speed_mps, widening))) is None:
            mean, covariance = self.process_.posterior(_rows(_AFTER_S, speed_mps, -1))
            correction = StudentT(mean, root(widening**2 * covariance), self.freedom_)
            if len(self._corrections) < _MOST_KEPT:
                self._corrections[speed_mps, widening] = correction
        return _with(np.vstack([correction.mean, correction.draw(len(whole) - 1, rng)]), whole, since)

    def repeat(self, pulses: Kinematics, test_mps2: FloatArray, speed_mps: float, rng: Generator) -> FloatArray:
        """Let each pulse rebound as a repeat of this test would."""
        since = _SinceStop.of(pulses)
        whole = _unloaded(pulses, since, test_mps2, loading_phase(test_mps2, speed_mps))
        if self.process_ is None:
            return whole
        prior = self.process_.prior_of(_OF_A_TEST, _rows(_AFTER_S, speed_mps, -1))
        return _with(draw(np.zeros(_AFTER_S.size), 2 * prior, len(whole), rng), whole, since)


def _with(extra: FloatArray, pulses_mps2: FloatArray, since: _SinceStop) -> FloatArray:
    added = _at(extra, since.after_s / _STEP_S)
    added *= _unit(_at(pulses_mps2, since.place))
    samples = pulses_mps2[:, since.samples]
    np.add(samples, added, out=samples, where=since.after_s > 0)
    return pulses_mps2


def _at(rows: FloatArray, place: FloatArray) -> FloatArray:
    """Each row at its places, or one row at all, counted in samples."""
    low = np.minimum(place.astype(np.intp), rows.shape[1] - 2)
    share = place - low
    if len(rows) > 1:
        low += np.arange(len(rows))[:, None] * rows.shape[1]
    values = rows.take(low)
    low += 1
    share *= rows.take(low) - values
    values += share
    return np.asarray(values)


def _unit(accel_at_t0: FloatArray | float) -> FloatArray:
    return np.asarray(np.maximum(np.abs(accel_at_t0), _LEAST_UNIT))


def _rows(after_s: FloatArray, speed_mps: float, test: int) -> FloatArray:
    rise = 1 - np.exp(-after_s / _RISE_S)  # no step at zero velocity itself
    speed, number = np.full(after_s.size, speed_mps), np.full(after_s.size, float(test))
    return np.column_stack([after_s, speed, rise * np.exp(-after_s / _FADE_S), rise, number])
