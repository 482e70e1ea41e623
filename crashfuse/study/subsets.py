"""Parts of a campaign's tests, evenly spaced over speed or at random: learned from, they predict all other tests.

Sorted by speed, an even choice of k of n tests takes one test of each kth part of the list (systematic sampling). The
place within the parts moves from choice to choice, in as many steps as it takes for each test to be left out at least
once. Of all tests but one there are n even choices: each test is left out in turn.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from crashfuse.approaches.base import MOST_TESTS
from crashfuse.campaign import Campaign

Choice = Literal["even", "random"]

_SIZES = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 24, MOST_TESTS)
_LEAST = 3  # even choices of a size, where there are as many


@dataclass(frozen=True, slots=True)
class Subset:
    """Tests to learn from, and how they were chosen.

    Parameters
    ----------
    chosen : tuple of str
        Ids in the order of the campaign.
    """

    choice: Choice
    chosen: tuple[str, ...]

    def held_out(self, campaign: Campaign) -> tuple[str, ...]:
        """Ids of all other tests."""
        return tuple(test_id for test_id in campaign.test_ids if test_id not in self.chosen)


def subsets(campaign: Campaign, repeats: int, seed: int) -> tuple[Subset, ...]:
    """Choices of 1, 2, 3, 4, 6, 8, 10 … and of all but one of a campaign's tests.

    Parameters
    ----------
    repeats : int
        Random choices of each size; none of all tests but one, as the even choices are all that there are.
    """
    n = len(campaign.tests)
    by_speed = sorted(range(n), key=lambda i: (campaign.tests[i].condition.speed_mps, i))
    found: list[tuple[Choice, list[int]]] = []
    for size in sorted({size for size in _SIZES if size < n - 1} | {n - 1} - {0}):
        even = list(dict.fromkeys(_evenly(n, size)))
        found += [("even", [by_speed[place] for place in places]) for places in even]
        if len(even) < math.comb(n, size):
            rng = np.random.default_rng([seed, size])
            drawn = {tuple(sorted(rng.choice(n, size, replace=False).tolist())): None for _ in range(repeats)}
            found += [("random", list(numbers)) for numbers in drawn]
    return tuple(Subset(way, tuple(campaign.test_ids[i] for i in sorted(numbers))) for way, numbers in found)


def _evenly(n: int, size: int) -> Iterator[tuple[int, ...]]:
    """Places of the tests of each even choice in the order of speed."""
    # A test is left out by a share 1 - size / n of all places within the parts, so this many leave out each of them.
    choices = max(_LEAST, math.ceil(n / (n - size)))
    for number in range(choices):
        yield tuple((2 * (part * choices + number) + 1) * n // (2 * choices * size) for part in range(size))
