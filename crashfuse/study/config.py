"""Configuration and plan of a study: approaches, preset, seed, windows, and which tests are left out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Any, Literal, Self, cast, get_args

import numpy as np

from crashfuse.approaches.base import DEVICES, PRESETS, Approach, Device, Preset, Settings
from crashfuse.approaches.registry import APPROACHES, create, require_approach, uses_preset
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem, UsageError, one_of, printable, require_a, several
from crashfuse.signals.metrics import FURTHER_METRICS
from crashfuse.signals.pulse import DT_S

WINDOWS_MS = (20.0, 40.0, 60.0)
TO_TTZV = "ttzv"  # a window that ends with each test's time of zero velocity
LeaveOut = Literal["test", "speed group", "both"]

_SLOWEST_S = 1e-3  # longest sampling step of a record, which its last sample covers


@dataclass(frozen=True, slots=True)
class StudyConfig:
    """Configuration of a study.

    Parameters
    ----------
    preset, device
        As in :class:`crashfuse.approaches.base.Settings`.
    windows_ms : tuple of float
        Ratings are computed over [0, w) for each w, in ms. Of ``ttzv`` among them comes ``to_ttzv``.
    leave_out : {"test", "speed group", "both"}
        Leave each test out alone, or with all tests at about its speed: then no similar test remains, and the rating
        measures extrapolation to a new speed. "both" runs both studies.
    to_ttzv : bool
        Tables also have ratings up to each test's time of zero velocity, from which nothing is learned or recommended.
    also : tuple of {"sprague-geers", "anova"}
        Measures beside the rating in tables, from which nothing is learned or recommended either.
    """

    approaches: tuple[str, ...] = APPROACHES
    preset: Preset = "fast"
    seed: int = 0
    windows_ms: tuple[float, ...] = WINDOWS_MS
    leave_out: LeaveOut = "test"
    device: Device = "auto"
    to_ttzv: bool = False
    also: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.approaches is not APPROACHES:  # which are not listed before they are asked for
            if not (approaches := several(self.approaches)):
                raise UsageError(f"Name at least one approach: {', '.join(APPROACHES)}.")
            for name in approaches:
                require_approach(name)
            object.__setattr__(self, "approaches", tuple(dict.fromkeys(approaches)))
        one_of("preset", self.preset, dict.fromkeys(PRESETS))
        one_of("way to leave tests out", self.leave_out, dict.fromkeys(get_args(LeaveOut)))
        one_of("device", self.device, dict.fromkeys(DEVICES))
        if not (isinstance(self.seed, Integral) and 0 <= self.seed < 2**32):
            raise UsageError(f"Seed must be between 0 and {2**32 - 1}, got {self.seed}.")
        windows = several(self.windows_ms)
        for window in windows:
            require_a(str | Real, window, "a window in ms")
        if TO_TTZV in windows:
            object.__setattr__(self, "to_ttzv", True)
            windows = tuple(window for window in windows if window != TO_TTZV) or WINDOWS_MS
        object.__setattr__(self, "also", several(self.also))
        for name in self.also:
            one_of("measure", name, FURTHER_METRICS)
        if not windows:
            raise UsageError("Name at least one rating window.")
        for window in windows:
            require_window(window)
        object.__setattr__(self, "windows_ms", tuple(dict.fromkeys(map(float, windows))))

    @classmethod
    def parse(cls, values: Mapping[str, Any]) -> Self:
        """The configuration of plain values as in JSON; a ValueError or TypeError if they are none."""
        given: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
        try:
            return cls(**given)
        except UsageError as error:
            raise ValueError(f"no configuration of a study: {error}") from error

    def left_out(self, campaign: Campaign, test_id: str) -> tuple[str, ...]:
        """The tests not learned from to predict this one, itself among them."""
        return campaign.speed_group(test_id) if self.leave_out == "speed group" else (test_id,)

    def training_campaign(self, campaign: Campaign, test_id: str) -> Campaign:
        """The campaign learned from to predict this test."""
        return campaign.without(self.left_out(campaign, test_id))

    @property
    def split_configs(self) -> tuple["StudyConfig", ...]:
        """One config for each way of leaving tests out."""
        ways: tuple[LeaveOut, ...] = ("test", "speed group") if self.leave_out == "both" else (self.leave_out,)
        return tuple(replace(self, leave_out=way) for way in ways)

    def check(self) -> None:
        """Raise a UsageError, before anything is computed, if a setting does not act or lacks its device here."""
        if self.effective != self:
            told, acts_on = ", ".join(self.approaches), ", ".join(filter(uses_preset, APPROACHES))
            told = f"The preset {self.preset} does not act on {told}: every preset gives the same."
            raise UsageError(f"{told} It acts on {acts_on}.")
        for name in self.approaches:
            _ = self.create(name).device

    @property
    def under_preset(self) -> tuple[str, ...]:
        """The approaches that the preset acts on."""
        return tuple(filter(uses_preset, self.approaches))

    @property
    def effective(self) -> "StudyConfig":
        """The settings that act: the usual preset where another acts on none of the approaches."""
        usual = StudyConfig().preset
        return self if self.preset == usual or self.under_preset else replace(self, preset=usual)

    @property
    def on_this_device(self) -> "StudyConfig":
        """The config with the device that its approaches use here in place of "auto"."""
        devices = [device for name in self.approaches if (device := self.create(name).device)] or [self.device]
        return replace(self, device=cast(Device, devices[0]))

    def create(self, approach: str) -> Approach:
        """The unfitted approach with these settings."""
        return create(approach, settings=Settings(self.preset, self.seed, self.device))


def require_window(window_ms: object) -> None:
    """Raise a UsageError if nothing can be rated over [0, window_ms)."""
    if not (isinstance(window_ms, Real) and 10 <= float(window_ms) <= 100):
        asked = f"{window_ms:g}" if isinstance(window_ms, Real) else printable(str(window_ms), 40)
        raise UsageError(f"A rating window of {asked} ms is not possible; choose 10 to 100 ms.")


def require_rated(what: str, window_ms: float, known: Sequence[float]) -> None:
    """Raise a UsageError if a study or curve was not rated over this window."""
    if window_ms not in known:
        windows = ", ".join(f"{window:g}" for window in known)
        raise UsageError(f"The {what} was rated over 0 to {windows} ms, not to {window_ms:g} ms.")


@dataclass(frozen=True, eq=False)
class StudyPlan:
    """Which tests to leave out in turn (empty: all), and how; checked, so any plan can be run."""

    campaign: Campaign
    config: StudyConfig = StudyConfig()
    held_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        campaign, config = self.campaign, self.config
        require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
        require_a(StudyConfig, config, "crashfuse.StudyConfig()")
        held_out = several(self.held_out)
        campaign.without(held_out)
        object.__setattr__(self, "held_out", tuple(dict.fromkeys(held_out or campaign.test_ids)))
        if len(campaign.tests) < 2:
            raise UsageError("Leaving a test out takes at least 2 tests.")
        config.check()
        if config.leave_out == "speed group" and not has_speed_groups(campaign):
            raise UsageError("All tests are of one speed group: nothing would be left to learn from.")
        for window in config.windows_ms:
            for test_id in self.held_out:
                check_window(campaign.test(test_id), window)

    @property
    def configs(self) -> tuple[StudyConfig, ...]:
        """One config for each way of leaving tests out; if both were requested, only the possible ones."""
        ways = self.config.split_configs
        return ways if has_speed_groups(self.campaign) else ways[:1]


def has_speed_groups(campaign: Campaign) -> bool:
    """Whether tests remain when a speed group is left out."""
    return len(campaign.speed_group(campaign.test_ids[0])) < len(campaign.tests)


def check_window(test: CrashTest, window_ms: float) -> None:
    """Raise if a test cannot be rated over a window."""
    if window_ms / 1e3 > test.recorded_s + _SLOWEST_S:
        length, advice = f"{test.recorded_s * 1e3:.4g} ms", "rate a shorter window, or hold out other tests"
        raise DataError(Problem(test.id, f"a record over 0–{window_ms:g} ms", length, advice))
    if np.ptp(test.pulse.accel_mps2[: round(window_ms / 1e3 / DT_S)]) == 0:
        advice = "check its time zero or rate a longer window"
        raise DataError(Problem(test.id, f"a pulse that varies over 0–{window_ms:g} ms", "no change at all", advice))


def telling_test(campaign: Campaign) -> CrashTest:
    """The test to leave out first: the nearest to the middle of the speeds, with slower and faster ones if any has."""
    speeds = np.array([test.condition.speed_mps for test in campaign.tests])
    middle = (speeds.min() + speeds.max()) / 2

    def outside(test: CrashTest) -> bool:
        others = campaign.without(campaign.speed_group(test.id)).tests
        faster = [other.condition.speed_mps - test.condition.speed_mps for other in others]
        return not (faster and min(faster) < 0 < max(faster))

    return min(campaign.tests, key=lambda test: (outside(test), abs(test.condition.speed_mps - middle)))
