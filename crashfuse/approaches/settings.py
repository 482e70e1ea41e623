"""What a user chooses about every approach: preset, seed, device, cache."""

from dataclasses import dataclass
from typing import Literal, get_args

from crashfuse.errors import UsageError
from crashfuse.execution.cache import Cache

Preset = Literal["fast", "paper"]
PRESETS: tuple[Preset, ...] = get_args(Preset)

Device = Literal["auto", "cpu", "cuda"]
DEVICES: tuple[Device, ...] = get_args(Device)


@dataclass(frozen=True, slots=True)
class Settings:
    """What any approach is made from; each takes what concerns it.

    Parameters
    ----------
    preset : {"fast", "paper"}
        ``paper`` takes the settings of Tables 2 and 4, ``fast`` ours. ``fused`` is made of the fast forms either way.
    device : {"auto", "cpu", "cuda"}
        Where networks are trained; ``auto`` takes CUDA if there is any. All else runs on the CPU.
    cache : Cache, optional
        Where what does not depend on the tests (LF training, emulator) is kept.

    Raises
    ------
    UsageError
        If there is no preset or device of that name.
    """

    preset: Preset = "fast"
    seed: int = 0
    device: Device = "auto"
    cache: Cache | None = None

    def __post_init__(self) -> None:
        if self.preset not in PRESETS:
            raise UsageError(f"There is no preset {self.preset!r}; choose from {', '.join(PRESETS)}.")
        if self.device not in DEVICES:
            raise UsageError(f"There is no device {self.device!r}; choose from {', '.join(DEVICES)}.")
