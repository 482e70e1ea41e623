"""Parts of the tests: even over speed, at random, and every test left out somewhere."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.study.subsets import Subset, subsets
from crashfuse.units import MPH


def with_tests(campaign: Campaign, n: int) -> Campaign:
    """The campaign with n tests at speeds of their own, in no order."""
    speeds = np.random.default_rng(3).permutation(np.linspace(10.0, 40.0, n))
    pulse = campaign.tests[0].pulse
    tests = tuple(
        CrashTest(f"T{i:02d}", Condition.of_vector([v * MPH, 900.0, 650.0]), pulse) for i, v in enumerate(speeds)
    )
    return replace(campaign, tests=tests)


@pytest.mark.parametrize("n", [2, 3, 4, 5, 7, 11, 13, 31, 34])
def test_every_test_is_left_out_by_an_even_choice_of_every_size(campaign: Campaign, n: int) -> None:
    """So means over the tests compare the same tests at every size; all but one is leaving each out in turn."""
    own = with_tests(campaign, n)
    parts = [part for part in subsets(own, 2, 0) if part.choice == "even"]
    sizes = {len(part.chosen) for part in parts}
    assert sizes >= {1, n - 1}
    for size in sizes:
        held_out = [test for part in parts if len(part.chosen) == size for test in part.held_out(own)]
        assert set(held_out) == set(own.test_ids)
    alone = [part.held_out(own) for part in parts if len(part.chosen) == n - 1]
    assert sorted(alone) == sorted((test_id,) for test_id in own.test_ids)


def test_the_sizes_are_small_steps_first_up_to_all_but_one(campaign: Campaign) -> None:
    """1, 2, 3, 4, then every second, then wider."""
    sizes = [len(part.chosen) for part in subsets(with_tests(campaign, 12), 0, 0)]
    assert sorted(set(sizes)) == [1, 2, 3, 4, 6, 8, 10, 11]


def test_even_choices_are_even_over_speed(campaign: Campaign) -> None:
    """In the order of speed, neighbours of an even choice are as far apart as n / size, to a place."""
    own = with_tests(campaign, 13)
    order = sorted(own.test_ids, key=lambda test_id: own.test(test_id).condition.speed_mps)
    for part in subsets(own, 0, 0):
        places = sorted(order.index(test_id) for test_id in part.chosen)
        assert all(abs(b - a - 13 / len(places)) < 1 for a, b in pairwise(places))


def test_random_choices_are_those_of_the_seed(campaign: Campaign) -> None:
    """Equal seeds choose equally, others otherwise; where even choices are all there are, nothing is drawn."""
    own = with_tests(campaign, 9)

    def drawn(seed: int) -> list[Subset]:
        return [part for part in subsets(own, 3, seed) if part.choice == "random"]

    assert drawn(1) == drawn(1) != drawn(2)
    assert {len(part.chosen) for part in drawn(1)} == {1, 2, 3, 4, 6}
    assert all(len(set(part.chosen)) == len(part.chosen) for part in drawn(1))
    assert not [part for part in subsets(with_tests(campaign, 3), 3, 0) if part.choice == "random"]


def test_a_part_has_its_tests_in_the_order_of_the_campaign(campaign: Campaign) -> None:
    """So the same tests are the same part, however they were chosen, and are learned from once."""
    for part in subsets(campaign, 3, 0):
        assert part.chosen == tuple(test_id for test_id in campaign.test_ids if test_id in part.chosen)
