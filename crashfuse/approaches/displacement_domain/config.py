"""Hyperparameters of the displacement domain."""

from dataclasses import dataclass
from typing import Literal, Self

_LEAST_POINTS = 8  # bias points of a test, however many tests there are


@dataclass(frozen=True, slots=True)
class DisplacementConfig:
    """Hyperparameters of the displacement-domain approach.

    Parameters
    ----------
    bias : {"hierarchical", "table 4"}
        The bias model.
    n_draws : int
        Whole pulses drawn for the band.
    step_s : float
        Spacing of a test's bias points: the distance covered at impact speed in this time, and while the vehicle stops
        this time itself. A CFC 60 pulse contains little finer detail; closer points would repeat each other, and the
        fit would count them as evidence.
    max_points : int
        Approximate limit on the bias points of all tests together; with more tests, each has fewer. The fit's time
        grows with the cube of their number.
    projected_points : int
        For Table 4: points in each of a test's two projections.
    restarts : int
        For Table 4: further starts of the optimiser after the first.
    """

    bias: Literal["hierarchical", "table 4"] = "hierarchical"
    n_draws: int = 500
    step_s: float = 0.002
    max_points: int = 400
    projected_points: int = 75
    restarts: int = 10

    @classmethod
    def fast(cls) -> Self:
        """The default: a hierarchical Gaussian process, about one second per fit."""
        return cls()

    @classmethod
    def paper(cls) -> Self:
        """Table 4 as published: minutes per fit."""
        return cls(bias="table 4")

    def points_each(self, n_tests: int) -> int:
        """About how many bias points each of so many tests may have."""
        return max(self.max_points // n_tests, _LEAST_POINTS)
