"""The first test to leave out."""

from dataclasses import replace

import pytest

from crashfuse.campaign import Campaign
from crashfuse.study.telling_test import telling_test
from crashfuse.units import MPH


def at(campaign: Campaign, *speeds_mph: float) -> Campaign:
    """A campaign with tests A, B … at these speeds."""
    one = campaign.tests[0]
    return replace(
        campaign,
        tests=tuple(
            replace(one, id=chr(ord("A") + i), condition=replace(one.condition, speed_mps=speed * MPH))
            for i, speed in enumerate(speeds_mph)
        ),
    )


@pytest.mark.parametrize(
    ("speeds_mph", "chosen"),
    [
        ((8, 12, 17, 22, 25, 25, 35, 35), "D"),  # the nearest to the middle, 21.5 mph
        ((35, 8, 30), "C"),  # 8 and 35 have no neighbour on one side, however the table is sorted
        ((8, 34, 35), "B"),  # 34 and 35 are one speed group, so that none lies between: the nearest to the middle
        ((25, 25.5, 24.8), "A"),  # one speed group: equal, so the nearest to the middle
        ((30,), "A"),
    ],
)
def test_it_lies_between_others_near_the_middle_of_the_speeds(
    campaign: Campaign, speeds_mph: tuple[float, ...], chosen: str
) -> None:
    """Not an extreme, where an approach has to extrapolate."""
    assert telling_test(at(campaign, *speeds_mph)).id == chosen
