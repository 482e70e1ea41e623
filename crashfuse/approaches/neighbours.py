"""How near tests and CAE runs are to a condition: what was checked at a test need not hold far from all of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import SPEED_STEP_MPS, CrashTest
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import MPH, Sentence, joined, speed, weight

_REACH_MPS = 3 * MPH  # speed difference at which a test is neither near nor far


def nearness(speed_mps: float, tests_mps: FloatArray, without: Sequence[int] = ()) -> float:
    """Nearness in speed to the nearest test: 0 far from all, 1 beside one."""
    away = np.abs(np.delete(tests_mps, without) - speed_mps)
    return float(np.exp(-away.min() / _REACH_MPS)) if away.size else 0.0


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A test or a CAE run near a condition."""

    id: str
    condition: Condition

    def differences(self, condition: Condition) -> str:
        """Differences from a condition, in words."""
        faster, *heavier = (self.condition.vector - condition.vector).tolist()
        front, rear = (weight(kg, form="+.0f") for kg in heavier)
        return Sentence("{} ({}, front {}, rear {})", self.id, speed(faster, form="+.1f"), front, rear)


def nearest_tests(campaign: Campaign, condition: Condition, n: int = 3) -> tuple[Neighbour, ...]:
    """The tests nearest to a condition: speeds differ by shares of its speed, weights of its mass."""
    conditions = [test.condition for test in campaign.tests]
    order = _order(np.array([c.vector for c in conditions]), condition)[:n]
    return tuple(Neighbour(campaign.tests[i].id, conditions[i]) for i in order)


def nearest_run(campaign: Campaign, condition: Condition) -> Neighbour:
    """The CAE run nearest to a condition."""
    nearest = _order(campaign.cae.vectors, condition)[0]
    return Neighbour(campaign.cae.ids[nearest], campaign.cae.conditions[nearest])


def nearest_sentences(campaign: Campaign, condition: Condition) -> tuple[str, str]:
    """Sentences on the nearest tests and the nearest CAE run, and their differences."""
    tests = joined([test.differences(condition) for test in nearest_tests(campaign, condition)], ", ")
    run = nearest_run(campaign, condition).differences(condition)
    return Sentence("Nearest tests by speed and weights: {}.", tests), Sentence("Nearest CAE run: {}.", run)


def doubtful_tests(campaign: Campaign, condition: Condition) -> tuple[CrashTest, ...]:
    """Tests whose sensor failed and that decide a prediction."""
    doubtful = [test for test in campaign.tests if test.faults]
    decisive = {near.id for near in nearest_tests(campaign, condition)} if doubtful else set()
    decisive |= {t.id for t in doubtful if abs(t.condition.speed_mps - condition.speed_mps) < SPEED_STEP_MPS}
    return tuple(test for test in doubtful if test.id in decisive)


def _order(vectors: np.ndarray, condition: Condition) -> Sequence[int]:
    away = (vectors - condition.vector) / [condition.speed_mps, condition.mass_kg, condition.mass_kg]
    return [int(i) for i in np.argsort(np.sum(away**2, axis=1), kind="stable")]
