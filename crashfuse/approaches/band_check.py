"""The check of a band on tests that were not learned from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from crashfuse.approaches.calibration import Calibration, Coverage, calibrate, widening_far
from crashfuse.approaches.left_out import LeftOut, speed_groups
from crashfuse.approaches.nearness import nearness
from crashfuse.campaign import Campaign
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import FloatArray

Unseen = Callable[[float], FloatArray]
"""Pulses predicted for a test without some tests, as a function of their widening: the expected one, then draws."""

LEAST_CHECKED = 3  # tests; with fewer, too little is left to learn from
_MOST_CHECKED = 20  # tests; more would not change the widening
_STEP = "Check of the band"
_FAR_UNCHECKED = 1.5  # widening far from tests at a single speed, which cannot tell: from random vehicles


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


def checked_far(
    campaign: Campaign, near: Calibration, alone: LeftOut, apart: LeftOut
) -> tuple[Calibration, LeftOut, LeftOut]:
    """Widen a band far from all tests, too, until it holds on tests predicted from other speeds.

    Also returned are the predictions of left-out tests, each with its band as wide as that far from the others.
    """
    measured = np.array([test.pulse.accel_mps2 for test in campaign.tests])
    speeds = np.array([test.condition.speed_mps for test in campaign.tests])
    far = widening_far(measured, speeds, apart) if apart.numbers.size else _FAR_UNCHECKED
    calibration = replace(near, far=far)

    def further(out: Sequence[Sequence[int]]) -> dict[int, float]:
        nearest = (nearness(speeds[number], np.delete(speeds, own)) for number, own in enumerate(out))
        return {number: calibration.further(near_by) for number, near_by in enumerate(nearest)}

    singly = [(number,) for number in range(len(speeds))]
    return calibration, alone.widened(further(singly)), apart.widened(further(speed_groups(campaign)))
