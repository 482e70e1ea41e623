"""Settings that all approaches share: preset, seed, device, cache."""

from dataclasses import dataclass
from typing import Literal, get_args

from crashfuse.errors import one_of
from crashfuse.execution.cache import Cache

Preset = Literal["fast", "paper"]
PRESETS: tuple[Preset, ...] = get_args(Preset)

Device = Literal["auto", "cpu", "cuda"]
DEVICES: tuple[Device, ...] = get_args(Device)


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings that approaches are created from; each uses those that apply to it.

    Parameters
    ----------
    preset : {"fast", "paper"}
        ``paper`` uses the settings of Tables 2 and 4, ``fast`` ours. ``fused`` uses the fast forms either way.
    seed : int
        Of networks, draws and the starts of optimisers.
    device : {"auto", "cpu", "cuda"}
        For training networks; ``auto`` uses CUDA if available. Everything else runs on the CPU. Results of different
        devices differ in their last bits.
    cache : Cache, optional
        Storage for results that do not depend on the tests (LF training, emulator).
    """

    preset: Preset = "fast"
    seed: int = 0
    device: Device = "auto"
    cache: Cache | None = None

    def __post_init__(self) -> None:
        one_of("preset", self.preset, dict.fromkeys(PRESETS))
        one_of("device", self.device, dict.fromkeys(DEVICES))
