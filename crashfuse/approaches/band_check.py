"""The check of a band on tests that were not learned from."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from crashfuse.approaches.calibration import Calibration, Coverage, calibrate
from crashfuse.approaches.left_out import LeftOut, speed_groups
from crashfuse.campaign import Campaign
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import FloatArray

Unseen = Callable[[float], FloatArray]
"""Pulses predicted for a test without some tests, as a function of their widening: the expected one, then draws."""

LEAST_CHECKED = 3  # tests; with fewer, too little is left to learn from
_MOST_CHECKED = 20  # tests; more would not change the widening
_STEP = "Check of the band"


def checked(
    campaign: Campaign, without: Callable[[int, Sequence[int]], Unseen], watch: Watch
) -> tuple[Calibration, LeftOut, LeftOut]:
    """Widen a band until it holds on tests that are each predicted from the others.

    ``without`` takes a test's number and those left out. Also returned are these tests' predictions from all others,
    and from those at other speeds: empty if there are none.
    """
    tests = campaign.tests
    numbers = np.unique(np.linspace(0, len(tests) - 1, min(len(tests), _MOST_CHECKED)).astype(int)).tolist()
    left_out = {}
    for done, number in enumerate(numbers):
        watch.report(_STEP, done, len(numbers))
        left_out[number] = without(number, [number])
    pulses: dict[int, FloatArray] = {}

    def check(widening: float) -> list[Coverage]:
        for number, unseen in left_out.items():
            watch.report(_STEP, len(numbers), len(numbers))  # makes it cancellable
            pulses[number] = unseen(widening)
        return [Coverage.of(tests[number], drawn[1:]) for number, drawn in pulses.items()]

    calibration = calibrate(check)
    apart = _from_other_speeds(campaign, pulses, lambda *which: without(*which)(calibration.widening), watch)
    return calibration, LeftOut.of(pulses), LeftOut.of(apart)


def _from_other_speeds(
    campaign: Campaign,
    alone: Mapping[int, FloatArray],
    without: Callable[[int, Sequence[int]], FloatArray],
    watch: Watch,
) -> dict[int, FloatArray]:
    pulses, groups = {}, speed_groups(campaign)
    for number, own in alone.items():
        watch.report(_STEP, len(alone), len(alone))
        if len(groups[number]) == 1:
            pulses[number] = own
        elif len(groups[number]) < len(campaign.tests):
            pulses[number] = without(number, groups[number])
    return pulses
