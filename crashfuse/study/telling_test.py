"""The test that tells most about a campaign if it is left out first."""

import numpy as np

from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest


def telling_test(campaign: Campaign) -> CrashTest:
    """The test nearest to the middle of the speeds, with slower and faster tests on both sides of it.

    What an approach is for shows between tests: beyond the slowest or the fastest of them it has to extrapolate. Tests
    of its own speed group (:meth:`crashfuse.campaign.Campaign.speed_group`) are no neighbours. Where no test lies
    between others, the one nearest to the middle is taken; of equal ones, the first.
    """
    speeds = np.array([test.condition.speed_mps for test in campaign.tests])
    middle = (speeds.min() + speeds.max()) / 2

    def outside(test: CrashTest) -> bool:
        others = campaign.without(campaign.speed_group(test.id)).tests
        beside = [other.condition.speed_mps - test.condition.speed_mps for other in others]
        return not (beside and min(beside) < 0 < max(beside))

    return min(campaign.tests, key=lambda test: (outside(test), abs(test.condition.speed_mps - middle)))
