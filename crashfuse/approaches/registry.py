"""All approaches by name."""

from typing import Literal, get_args

from crashfuse.approaches.base import Approach
from crashfuse.approaches.cae import Cae
from crashfuse.approaches.displacement_domain.approach import DisplacementConfig, DisplacementDomain
from crashfuse.approaches.fused.approach import Fused
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.lf_tcn import DEVICES, Device, LfTcn
from crashfuse.approaches.time_domain.network import TcnConfig
from crashfuse.errors import UsageError
from crashfuse.execution.cache import Cache

Preset = Literal["fast", "paper"]
PRESETS: tuple[Preset, ...] = get_args(Preset)

_CLASSES: dict[str, type[Approach]] = {
    approach.name: approach for approach in (Cae, LfTcn, TimeDomain, DisplacementDomain, Fused)
}
APPROACHES: tuple[str, ...] = tuple(_CLASSES)
"""Names of all approaches, the uncorrected CAE first."""

LABELS: dict[str, str] = {name: approach.label for name, approach in _CLASSES.items()}
"""What figures and tables call them."""

CAE_ONLY: dict[str, tuple[str, ...]] = {
    "cae": ("cae",),
    "lf_tcn": ("lf_tcn",),
    "time_domain": ("lf_tcn",),
    "displacement_domain": ("cae",),
    "fused": ("cae", "lf_tcn"),
}
"""For each approach those that do, from the CAE runs alone, the work that all its folds share."""


def create(
    name: str, *, preset: Preset = "fast", seed: int = 0, device: Device = "auto", cache: Cache | None = None
) -> Approach:
    """An unfitted approach.

    Parameters
    ----------
    name : str
        One of :data:`APPROACHES`.
    preset : {"fast", "paper"}
        ``paper`` takes the settings of Tables 2 and 4, ``fast`` ours. ``fused`` is made of the fast ones either way.
    seed : int
    device : {"auto", "cpu", "cuda"}
        Where networks are trained; ``auto`` takes CUDA if there is any. All else runs on the CPU.
    cache : Cache, optional
        Where what doesn't depend on the tests (LF training, emulator) is kept.

    Raises
    ------
    UsageError
        If there is no approach, preset or device of that name.
    """
    if name not in _CLASSES:
        raise UsageError(f"There is no approach {name!r}; choose from {', '.join(APPROACHES)}.")
    if preset not in PRESETS:
        raise UsageError(f"There is no preset {preset!r}; choose from {', '.join(PRESETS)}.")
    if device not in DEVICES:
        raise UsageError(f"There is no device {device!r}; choose from {', '.join(DEVICES)}.")
    if name == Cae.name:
        return Cae(cache=cache)
    if name == Fused.name:
        return Fused(seed=seed, device=device, cache=cache)
    if name == DisplacementDomain.name:
        displacement = DisplacementConfig.paper() if preset == "paper" else DisplacementConfig.fast()
        return DisplacementDomain(displacement, seed=seed, cache=cache)
    network = TcnConfig.paper() if preset == "paper" else TcnConfig.fast()
    return (LfTcn if name == LfTcn.name else TimeDomain)(network, seed=seed, device=device, cache=cache)
