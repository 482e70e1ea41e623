"""How near a condition is to what was tested and simulated: the first thing to ask of a prediction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.units import LB, MPH


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A test or a CAE run near a condition."""

    id: str
    condition: Condition

    def differences(self, condition: Condition) -> str:
        """How it differs from a condition, in words."""
        speed, front, rear = (self.condition.vector - condition.vector) / [MPH, LB, LB]
        return f"{self.id} ({speed:+.1f} mph, front {front:+.0f} lb, rear {rear:+.0f} lb)"


def nearest_tests(campaign: Campaign, condition: Condition, n: int = 3) -> tuple[Neighbour, ...]:
    """The tests nearest to a condition, each axis in units of the CAE runs' range; the nearest first."""
    conditions = [test.condition for test in campaign.tests]
    order = _order(campaign, np.array([c.vector for c in conditions]), condition)[:n]
    return tuple(Neighbour(campaign.tests[i].id, conditions[i]) for i in order)


def nearest_runs(campaign: Campaign, condition: Condition, n: int = 1) -> tuple[Neighbour, ...]:
    """The CAE runs nearest to a condition, likewise."""
    order = _order(campaign, campaign.cae.vectors, condition)[:n]
    return tuple(Neighbour(campaign.cae.ids[i], campaign.cae.conditions[i]) for i in order)


def nearest_sentences(campaign: Campaign, condition: Condition) -> tuple[str, str]:
    """Which tests and which CAE run are nearest, and by how much they differ."""
    tests = ", ".join(test.differences(condition) for test in nearest_tests(campaign, condition))
    runs = ", ".join(run.differences(condition) for run in nearest_runs(campaign, condition))
    return f"Nearest tests by speed and weights: {tests}.", f"Nearest CAE run: {runs}."


def _order(campaign: Campaign, vectors: np.ndarray, condition: Condition) -> Sequence[int]:
    extent = np.ptp(campaign.cae.vectors, axis=0)
    away = (vectors - condition.vector) / np.where(extent > 0, extent, np.abs(condition.vector))
    return [int(i) for i in np.argsort(np.sum(away**2, axis=1), kind="stable")]
