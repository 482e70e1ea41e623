"""Predictions of left-out tests: each test as if it, or its whole speed group, had not been run."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from crashfuse.approaches.base import FittedState, Prediction
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import N_SAMPLES, FloatArray
from crashfuse.signals.thinning import in_full

STRIDE = 10  # samples of the study grid: a CFC 60 pulse contains no finer detail
_DRAWS = 100


@dataclass(frozen=True, eq=False, slots=True)
class LeftOut:
    """Pulses predicted for each test from all others, thinned out but enough to judge a mixture by.

    Attributes
    ----------
    numbers : ndarray of int, shape (n,)
        Indices of these tests in the campaign.
    mean_mps2 : ndarray, shape (n, n_times)
        Expected pulses on every tenth sample of the study grid.
    draws_mps2 : ndarray of float32, shape (n, n_draws, n_times)
    """

    numbers: np.ndarray
    mean_mps2: FloatArray
    draws_mps2: np.ndarray

    @classmethod
    def of(cls, pulses_mps2: Mapping[int, FloatArray]) -> "LeftOut":
        """Thin out pulses, given by test number: row 0 is the expected pulse, then draws.

        They are given on every k-th sample of the study grid, shape (1 + m, 1250 / k), where k divides 10.
        """
        some = [pulses[: 1 + _DRAWS, :: STRIDE * pulses.shape[1] // N_SAMPLES] for pulses in pulses_mps2.values()]
        return cls(
            np.array(list(pulses_mps2), dtype=np.int64),
            np.array([pulses[0] for pulses in some], dtype=np.float64),
            np.array([pulses[1:] for pulses in some], dtype=np.float32),
        )

    def widened(self, factors: Mapping[int, float]) -> "LeftOut":
        """The same with each test's draws moved away from its expected pulse by the factor under its number."""
        by = np.array([factors[int(number)] for number in self.numbers])[:, None, None]
        mean = self.mean_mps2[:, None]
        return LeftOut(self.numbers, self.mean_mps2, (mean + by * (self.draws_mps2 - mean)).astype(np.float32))

    def predictions(self, campaign: Campaign) -> dict[str, Prediction]:
        """The predictions on the study grid, by test id; the campaign is the one that was learned from."""
        rows = zip(self.numbers, self.mean_mps2, self.draws_mps2, strict=True)
        return {test.id: predicted(test, mean, draws) for n, mean, draws in rows for test in [campaign.tests[n]]}

    def learned(self) -> FittedState:
        """These predictions as a state to store."""
        return FittedState({}, {"numbers": self.numbers, "mean": self.mean_mps2, "draws": self.draws_mps2})

    @classmethod
    def restored(cls, learned: FittedState) -> "LeftOut":
        """Restore from the state that :meth:`learned` returned."""
        return cls(learned.arrays["numbers"], learned.arrays["mean"], learned.arrays["draws"])


def speed_groups(campaign: Campaign) -> list[tuple[int, ...]]:
    """For each test, the numbers of the tests of its speed group, itself included."""
    number = {test_id: i for i, test_id in enumerate(campaign.test_ids)}
    return [tuple(number[member] for member in campaign.speed_group(test_id)) for test_id in campaign.test_ids]


def predicted(test: CrashTest, mean_mps2: FloatArray, draws_mps2: FloatArray) -> Prediction:
    """A test's prediction from every tenth sample of its expected pulse and of draws."""
    return Prediction(test.condition, in_full(mean_mps2, STRIDE), in_full(draws_mps2.astype(np.float64), STRIDE))
