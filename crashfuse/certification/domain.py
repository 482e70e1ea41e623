"""The validated domain of a campaign: the conditions at which its tests, left out one speed at a time, check it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import RATING
from crashfuse.condition import STEP_KG, STEP_MPS, Condition
from crashfuse.crash_test import SPEED_STEP_MPS, CrashTest
from crashfuse.units import KPH, MPH, Sentence, counted, joined, speed, weight

_FEWEST_TESTS = 4  # with fewer, a left-out test is predicted from one or two others
_FARTHEST_BEYOND_MPS = 5 * MPH  # the slowest or fastest test
_SAME_MASS = 0.02  # a mass this near to a tested one counts as tested
_SAME_SPEED_MPS = 1.0 * KPH  # and a speed
REST_ON_PEAK = ("peak", "peak_time", RATING)
"""Metrics that nobody knows beyond the fastest test: what is crushed there for the first time may bottom out."""
_Gap = tuple[CrashTest, tuple[str, ...], float]  # a test, its speed group, and how far the nearest other one is


@dataclass(frozen=True, eq=False)
class Domain:
    """Where the campaign's own tests, left out with all others at about their speed, checked predictions.

    A condition is no farther beyond the slowest and fastest test than the group there was from the others, 5 mph at
    most. Masses are checked beyond the tests' by as much as these differ, 2 % at least.
    """

    n_tests: int
    speeds_mps: tuple[float, ...]  # of the tests, ascending
    reach_mps: float  # largest distance from a left-out test inside the domain of others to the nearest of them
    below_mps: float
    above_mps: float
    masses_kg: tuple[float, float]
    factors: dict[str, tuple[str, ...]]
    cae: CaeLibrary
    tested_kg: tuple[float, float]  # masses of the tests
    inside: tuple[str, ...]  # tests that lay inside the domain of the others when their speed group was left out
    tuned: tuple[str, ...] = ()  # tests that check nothing, as the CAE model was tuned to them

    @classmethod
    def of(cls, campaign: Campaign, *, for_record: bool = False) -> Self:
        """The domain of one test or more; ``for_record`` it reaches as far as any group is from the others."""
        tuned = tuple(test.id for test in campaign.tests if test.cae_tuned)
        n_tests = len(campaign.tests) - len(tuned)
        if n_tests:  # else there are too few to check anything, wherever they lie
            campaign = campaign.without(tuned)
        tests = sorted(campaign.tests, key=lambda test: test.condition.speed_mps)
        speeds = np.array([test.condition.speed_mps for test in tests])
        gaps = list[_Gap]()
        for test in tests:
            group = campaign.speed_group(test.id)
            rest = [t.condition.speed_mps for t in tests if t.id not in group]
            gap = float(np.abs(np.array(rest) - test.condition.speed_mps).min()) if rest else 0.0
            gaps.append((test, group, gap))
        inside = gaps if for_record else _those_inside(campaign, gaps)
        masses = np.array([test.condition.mass_kg for test in tests])
        slack = max(float(np.ptp(masses)), _SAME_MASS * float(masses.mean()))
        below, above = (min(max(gap, SPEED_STEP_MPS), _FARTHEST_BEYOND_MPS) for *_, gap in (gaps[0], gaps[-1]))
        lightest, heaviest = float(masses.min()), float(masses.max())
        return cls(
            n_tests=n_tests,
            speeds_mps=tuple(speeds.tolist()),
            reach_mps=max((*(gap for *_, gap in inside), SPEED_STEP_MPS)),
            below_mps=below,
            above_mps=above,
            masses_kg=(lightest - slack, heaviest + slack),
            factors=campaign.factors,
            cae=campaign.cae,
            tested_kg=(lightest, heaviest),
            inside=tuple(test.id for test, *_ in inside),
            tuned=tuned,
        )

    @property
    def speed_ranges_mps(self) -> tuple[tuple[float, float], ...]:
        """Checked stretches of speed, ascending, within the CAE runs'; empty if the tests are too few to check any."""
        if self.too_few_tests or not len(self.cae):
            return ()
        slowest, fastest = (float(end[0]) for end in self.cae.range)
        low = max(self.speeds_mps[0] - self.below_mps, slowest)
        high = min(self.speeds_mps[-1] + self.above_mps, fastest)
        ranges = ((max(start, low), min(end, high)) for start, end in self._reached_mps)
        return tuple((start, end) for start, end in ranges if start < end)

    @cached_property
    def _reached_mps(self) -> tuple[tuple[float, float], ...]:
        """As far as the reach from any test; two are one if all between them is at about a speed."""
        ranges: list[tuple[float, float]] = []
        for tested in self.speeds_mps:
            start, end = tested - self.reach_mps, tested + self.reach_mps
            if ranges and start - ranges[-1][1] < SPEED_STEP_MPS:
                start, _ = ranges.pop()
            ranges.append((start, end))
        return tuple(ranges)

    @property
    def checked_masses_kg(self) -> tuple[float, float]:
        """Smallest and largest mass that counts as checked, within the CAE runs'."""
        lightest, heaviest = (float(end[1:].sum()) for end in self.cae.range)
        return max(self.masses_kg[0], lightest), min(self.masses_kg[1], heaviest)

    @property
    def too_few_tests(self) -> tuple[str, ...]:
        """A sentence if tests are too few."""
        if self.n_tests >= _FEWEST_TESTS:
            return ()
        tests = counted(self.n_tests, "test")
        told = f"{tests}: too few to check verdicts by leaving tests out, which takes {_FEWEST_TESTS}."
        return (joined([told, *self.not_counted]),)

    @property
    def not_counted(self) -> tuple[str, ...]:
        """A sentence on tests that check nothing, if any."""
        return (f"Not counted, as the CAE model was tuned to them: {', '.join(self.tuned)}.",) if self.tuned else ()

    def outside(self, condition: Condition) -> tuple[str, ...]:
        """Sentences on why no verdict is given at a condition; empty if one is."""
        return self.too_few_tests or self.exceeded_by(condition)

    def unshown(self, condition: Condition) -> tuple[str, ...]:
        """A sentence on why no verdict on :data:`REST_ON_PEAK` is given at a condition; empty if it is."""
        beyond = condition.speed_mps - self.speeds_mps[-1]
        if beyond <= _SAME_SPEED_MPS:
            return ()
        told = "{} is {} above the fastest test: no test shows whether the structure bottoms out there."
        return (Sentence(told, speed(condition.speed_mps), speed(beyond)),)

    def exceeded_by(self, condition: Condition) -> tuple[str, ...]:
        """Sentences on why a condition lies outside; empty if it lies inside."""
        found: list[str] = []
        v0, slowest, fastest = condition.speed_mps, self.speeds_mps[0], self.speeds_mps[-1]
        away = float(np.abs(np.array(self.speeds_mps) - v0).min())
        for end, beyond, most, word in (
            ("slowest", slowest - v0, self.below_mps, "below"),
            ("fastest", v0 - fastest, self.above_mps, "above"),
        ):
            if beyond > most + STEP_MPS:
                told = f"{{}} is {{}} {word} the {end} test; the tests check up to {{}} {word} it."
                found.append(Sentence(told, speed(v0), speed(beyond), speed(most)))
        if slowest <= v0 <= fastest and not any(a - STEP_MPS <= v0 <= b + STEP_MPS for a, b in self._reached_mps):
            told = "{} is {} from the nearest test; the tests check up to {} away."
            found.append(Sentence(told, speed(v0), speed(away), speed(self.reach_mps)))
        lightest, heaviest = self.masses_kg
        if not lightest - STEP_KG <= condition.mass_kg <= heaviest + STEP_KG:
            checked = weight(lightest, heaviest, between=" to ")
            found.append(Sentence("{} in all; the tests check {}.", weight(condition.mass_kg), checked))
        for name, value in condition.factors:
            if value and name in self.factors and value not in self.factors[name]:
                found.append(f"No test has {name} {value}; tested: {', '.join(self.factors[name])}.")
        return (*found, *(self.not_counted if found else ()), *self.cae.extrapolation(condition))


def _those_inside(campaign: Campaign, gaps: Sequence[_Gap]) -> list[_Gap]:
    groups = {group for _, group, _ in gaps if len(group) < len(gaps)}
    others = {group: Domain.of(campaign.without(group), for_record=True) for group in groups}
    return [gap for gap in gaps if gap[1] in others and not others[gap[1]].exceeded_by(gap[0].condition)]
