"""The CAE runs of a campaign: their conditions and pulses, what is paired with a test, what lies beyond them."""

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from crashfuse.condition import SAME_CONDITION, STEP_KG, STEP_MPS, Condition
from crashfuse.run_quality import RunQuality
from crashfuse.signals.pulse import FloatArray
from crashfuse.wording import Sentence, speed, weight

_AXES = (("speed", speed, STEP_MPS), ("front weight", weight, STEP_KG), ("rear weight", weight, STEP_KG))


@dataclass(frozen=True, eq=False)
class CaeLibrary:
    """All CAE runs of a campaign.

    Parameters
    ----------
    accel_mps2 : ndarray of float32, shape (n_runs, 1250)
        Signed acceleration in m/s² on :data:`crashfuse.signals.pulse.GRID_S`.
    quality : tuple of RunQuality
        What the solver says of each run; empty if nothing is recorded for any. It is not in the fingerprint, because
        nothing that is learned depends on it.
    left_out : tuple of (str, RunQuality)
        Ids of runs that were left out for exceeding the campaign's limits, with what the solver says of them.
    """

    ids: tuple[str, ...]
    conditions: tuple[Condition, ...]
    accel_mps2: npt.NDArray[np.float32]
    quality: tuple[RunQuality, ...] = ()
    left_out: tuple[tuple[str, RunQuality], ...] = ()

    def __repr__(self) -> str:
        return f"<CaeLibrary of {len(self):,} runs>"

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def vectors(self) -> FloatArray:
        """Conditions as rows [v0, wf, wr] in m/s and kg, shape (n_runs, 3)."""
        return np.array([condition.vector for condition in self.conditions])

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of ids, conditions and every sample."""
        digest = hashlib.sha256()
        for run_id, condition in zip(self.ids, self.conditions, strict=True):
            digest.update(f"{run_id}|{condition!r}\n".encode())
        digest.update(np.ascontiguousarray(self.accel_mps2).tobytes())
        return digest.hexdigest()

    def paired_run(self, condition: Condition) -> int | None:
        """Index of the run at this condition (to a relative 2e-3), the nearest of several; None if there is none."""
        target = np.abs(condition.vector)
        gap = np.abs(self.vectors - condition.vector)
        away = np.divide(gap, target, out=np.where(gap > 0, np.inf, 0.0), where=target > 0).max(axis=1)
        nearest = int(away.argmin())
        return nearest if away[nearest] <= SAME_CONDITION else None

    @cached_property
    def range(self) -> tuple[FloatArray, FloatArray]:
        """The range of the runs: smallest and largest [v0, wf, wr] in m/s and kg, each of shape (3,)."""
        return self.vectors.min(axis=0), self.vectors.max(axis=0)

    def extrapolation(self, condition: Condition) -> tuple[str, ...]:
        """One sentence for every input of a condition outside :attr:`range`; empty if it is in range.

        This alone decides what is in range, for pages, reports, figures and verdicts alike. A condition with a paired
        run always is; how near the other runs are is another question
        (:func:`crashfuse.approaches.nearness.nearest_run`).
        """
        notes = []
        for (name, quantity, step), x, lo, hi in zip(
            _AXES, condition.vector.tolist(), *(end.tolist() for end in self.range), strict=True
        ):
            tolerance = max(SAME_CONDITION * abs(x), step)  # that of a paired run
            if x < lo - tolerance or x > hi + tolerance:
                outside = quantity(x), quantity(lo, hi, between=" to ")
                notes.append(Sentence("Extrapolation: {} {} lies outside the CAE runs' {}.", name, *outside))
        return tuple(notes)
