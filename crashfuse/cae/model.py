"""The CAE model at any condition, over time and over displacement: the run at that condition, else the emulator."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from crashfuse.cae.emulator import Emulator
from crashfuse.cae_library import CaeLibrary
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache, Entry
from crashfuse.execution.code_digest import code_digest
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.signals.loading import LoadingPhase, loading_phase
from crashfuse.signals.pulse import FloatArray

_FASTER = 1.1  # speed ratio of successive crashes that continue a loading curve
_JOIN_M = 0.03  # displacement over which the step between two of them fades


@dataclass(frozen=True, eq=False, slots=True)
class CaePulse:
    """A pulse of the CAE model and its source: ``run C0001`` or ``emulator``."""

    accel_mps2: FloatArray
    source: str


@dataclass(frozen=True, eq=False)
class LoadingCurve:
    """The CAE model over displacement at one condition, G_a(s, x) of Eq. 10.

    Parameters
    ----------
    own : LoadingPhase
        Loading phase of the CAE pulse at this condition.
    faster : sequence of LoadingPhase
        Loading phases of successively faster crashes at these weights, which continue the curve at larger crush.
    """

    own: LoadingPhase
    faster: Sequence[LoadingPhase] = ()

    def accel_at(self, displacement_m: FloatArray, end_share: float = 0.0) -> FloatArray:
        """Acceleration at displacements, in m/s².

        Each pulse is used until its vehicle has slowed to ``end_share`` of its impact speed (0: until it stops). The
        next faster one then continues it without a jump; after the last one the curve is constant.
        """
        reached = self.own.displacement_at_speed(end_share)
        level = float(self.own.accel_at(np.array(reached)))
        curve = np.where(displacement_m < reached, self.own.accel_at(displacement_m), level)
        for phase in self.faster:
            if (end := phase.displacement_at_speed(end_share)) <= reached:
                continue
            beyond = displacement_m > reached
            step = level - phase.accel_at(np.array(reached))
            at = np.minimum(displacement_m[beyond], end)
            curve[beyond] = phase.accel_at(at) + step * np.exp(-(at - reached) / _JOIN_M)
            level = float(phase.accel_at(np.array(end)) + step * np.exp(-(end - reached) / _JOIN_M))
            reached = end
        return curve

    def stopping_accel(self, speed_share: FloatArray, end_share: float) -> FloatArray:
        """Additional acceleration of the CAE vehicle while it stops, in m/s², over shares v/v0 of its impact speed.

        Force changes there with the crush rate, over hardly any displacement, so it depends on velocity: a vehicle that
        crushes further or less stops at another displacement. Added to ``accel_at(s, end_share)`` this gives the CAE
        pulse. It is zero above the share of the impact speed at which stopping begins.
        """
        own = self.own
        extra = own.accel_mps2 - self.accel_at(own.displacement_m, end_share)
        order = np.argsort(own.speed_share)
        extra = np.interp(speed_share, own.speed_share[order], extra[order])
        return np.where(speed_share < end_share, extra, 0.0)


class CaeModel:
    """The CAE model at any condition.

    Parameters
    ----------
    cache : Cache, optional
        Storage for the trained emulator, by fingerprint of the library.
    """

    def __init__(self, *, cache: Cache | None = None) -> None:
        self.cache = cache

    def fit(self, cae: CaeLibrary, watch: Watch = SILENT) -> Self:
        """Train the emulator, or load it from the cache."""
        self.cae_, self.emulator_ = cae, (emulator := Emulator())
        if self.cache is None:
            emulator.fit(cae, watch)
            return self
        key = {"cae": cae.fingerprint, "config": emulator.config, "code": code_digest(Emulator.__module__)}

        def compute() -> tuple[Emulator, Entry]:
            return emulator.fit(cae, watch), emulator.arrays()

        self.cache.get_or_compute("emulator", key, compute, lambda entry: emulator.restore(entry, cae), watch)
        return self

    def pulse(self, condition: Condition) -> CaePulse:
        """The pulse of the run at exactly this condition, else that of the emulator."""
        run = self.cae_.paired_run(condition)
        if run is None:
            return CaePulse(self.emulator_.predict(condition), "emulator")
        return CaePulse(self.cae_.accel_mps2[run].astype(np.float64), f"run {self.cae_.ids[run]}")

    def loading_curve(self, condition: Condition) -> LoadingCurve:
        """The CAE model over displacement, continued by the emulator up to the speed of the library's fastest run."""
        own = loading_phase(self.pulse(condition).accel_mps2, condition.speed_mps)
        top = self.emulator_.speed_range_[1]
        speed, faster = condition.speed_mps, []
        while speed < top:
            speed = min(_FASTER * speed, top)
            faster.append(loading_phase(self.emulator_.predict(replace(condition, speed_mps=speed)), speed))
        return LoadingCurve(own, tuple(faster))

    def errors(self, condition: Condition, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw errors of :meth:`pulse`, shape (n, 1250); zero if there is a run."""
        if self.cae_.paired_run(condition) is not None:
            return np.zeros((n, self.cae_.accel_mps2.shape[1]))
        return self.emulator_.errors(condition, n, rng)

    def notes(self, condition: Condition) -> tuple[str, ...]:
        """Notes on the source of the pulse at a condition, and on inputs outside the library's range."""
        source = self.pulse(condition).source
        origin = "CAE pulse: from the emulator." if source == "emulator" else f"CAE pulse: paired {source}."
        return (origin, *self.cae_.extrapolation(condition))
