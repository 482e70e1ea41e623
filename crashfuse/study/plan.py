"""Which tests of a campaign a study leaves out, and how; checked before anything is computed."""

from dataclasses import dataclass

import numpy as np

from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import DataError, Problem, UsageError, require_a
from crashfuse.signals.pulse import DT_S
from crashfuse.study.config import StudyConfig

_SLOWEST_S = 1e-3  # longest sampling step of a record, which its last sample covers


@dataclass(frozen=True, eq=False)
class StudyPlan:
    """Which tests of a campaign to leave out in turn, and how. Checked on creation, so any plan can be run.

    Parameters
    ----------
    held_out : tuple of str
        Ids of the tests to leave out in turn; empty for all.

    Raises
    ------
    UsageError
        If a name, a window or the number of tests makes the study impossible.
    DataError
        If a held-out test cannot be rated over a window: it is constant there, or its record is too short.
    """

    campaign: Campaign
    config: StudyConfig = StudyConfig()
    held_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        campaign, config = self.campaign, self.config
        require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
        require_a(StudyConfig, config, "crashfuse.StudyConfig()")
        campaign.without(self.held_out)
        object.__setattr__(self, "held_out", tuple(dict.fromkeys(self.held_out or campaign.test_ids)))
        if len(campaign.tests) < 2:
            raise UsageError("Leaving a test out takes at least 2 tests: one to predict and one to learn from.")
        config.check()
        if config.leave_out == "speed group" and not has_speed_groups(campaign):
            raise UsageError("All tests are of one speed group: leaving it out leaves nothing to learn from.")
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
        found, advice = f"{test.recorded_s * 1e3:.4g} ms", "rate a shorter window, or hold out other tests"
        raise DataError(Problem(test.id, f"a record over 0–{window_ms:g} ms", found, advice))
    if np.ptp(test.pulse.accel_mps2[: round(window_ms / 1e3 / DT_S)]) == 0:
        advice = "check its time zero or rate a longer window"
        raise DataError(Problem(test.id, f"a pulse that varies over 0–{window_ms:g} ms", "no change at all", advice))
