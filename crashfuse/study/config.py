"""What a study computes: approaches, preset, seed, windows, and what is left out together."""

from dataclasses import dataclass, replace
from typing import Literal

from crashfuse.approaches.base import Approach
from crashfuse.approaches.registry import APPROACHES, create
from crashfuse.approaches.settings import Device, Preset, Settings
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache

WINDOWS_MS = (20.0, 40.0, 60.0)
LeaveOut = Literal["test", "speed group", "both"]


@dataclass(frozen=True, slots=True)
class StudyConfig:
    """What a study computes.

    Parameters
    ----------
    preset : {"fast", "paper"}
    windows_ms : tuple of float
        The rating is taken over [0, w) for each w, in ms.
    leave_out : {"test", "speed group", "both"}
        Whether each test is left out alone, or with all tests at about its speed: then nothing like it remains to be
        remembered, and what is rated is the step to a new speed. Both gives one study beside the other.
    device : {"auto", "cpu", "cuda"}
        Where networks are trained: numbers of different kinds of device differ in their last digits.
    """

    approaches: tuple[str, ...] = APPROACHES
    preset: Preset = "fast"
    seed: int = 0
    windows_ms: tuple[float, ...] = WINDOWS_MS
    leave_out: LeaveOut = "test"
    device: Device = "auto"

    def training_campaign(self, campaign: Campaign, test_id: str) -> Campaign:
        """What may be learned from when this test is to be predicted."""
        return campaign.without(campaign.speed_group(test_id) if self.leave_out == "speed group" else [test_id])

    @property
    def split_configs(self) -> tuple["StudyConfig", ...]:
        """One config for each way to leave tests out."""
        ways: tuple[LeaveOut, ...] = ("test", "speed group") if self.leave_out == "both" else (self.leave_out,)
        return tuple(replace(self, leave_out=way) for way in ways)

    def check(self) -> None:
        """Raise a UsageError if an approach, the preset or the device is wrong, before anything is computed."""
        for name in self.approaches:
            _ = self.create(name).device

    def create(self, approach: str, cache: Cache | None = None) -> Approach:
        """The approach of this name with these settings, unfitted."""
        return create(approach, settings=Settings(self.preset, self.seed, self.device, cache))
