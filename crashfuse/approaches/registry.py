"""All approaches by name. A new one needs its own module and an entry here; its class defines the rest."""

from difflib import get_close_matches

from crashfuse.approaches.base import Approach
from crashfuse.approaches.cae import Cae
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.fused.approach import Fused
from crashfuse.approaches.settings import Settings
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.lf_tcn import LfTcn
from crashfuse.errors import UsageError

_ALL: tuple[type[Approach], ...] = (
    Cae,
    LfTcn,
    TimeDomain,
    DisplacementDomain,
    Fused,
)

CLASSES: dict[str, type[Approach]] = {approach.name: approach for approach in _ALL}

APPROACHES: tuple[str, ...] = tuple(CLASSES)
"""Names of all approaches in the order of tables and figures: uncorrected CAE first, mixtures last."""

LABELS: dict[str, str] = {name: approach.label for name, approach in CLASSES.items()}
"""Labels of the approaches in figures and tables."""

BASELINE: str = Cae.name
"""Name of the baseline that every correction has to beat."""


def create(name: str, settings: Settings) -> Approach:
    """Create an unfitted approach.

    Parameters
    ----------
    name : str
        One of :data:`APPROACHES`.

    Raises
    ------
    UsageError
        If there is no approach with that name.
    """
    if name not in CLASSES:
        near = get_close_matches(str(name).lower(), APPROACHES, 1)
        meant = f"did you mean {near[0]}? All are" if near else "choose from"
        raise UsageError(f"There is no approach {name!r}; {meant} {', '.join(APPROACHES)}.")
    return CLASSES[name].create(settings)
