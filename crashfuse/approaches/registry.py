"""All approaches by name: ours, then those of other packages (entry points ``crashfuse.approaches``).

Those with networks are listed by an abstract base of their class, so that naming and drawing wait for no PyTorch.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from inspect import isabstract
from math import inf
from typing import cast

from crashfuse.approaches.base import PRESETS, Approach, Settings
from crashfuse.approaches.cae import Cae
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.mixture import AboutFused
from crashfuse.approaches.time_domain.config import AboutLfTcn, AboutTimeDomain
from crashfuse.errors import CrashfuseError, UsageError, one_of
from crashfuse.extensions import NO_FAULTS, Extended, Names, said

_ALL: tuple[type[Approach], ...] = (
    Cae,
    AboutLfTcn,
    AboutTimeDomain,
    DisplacementDomain,
    AboutFused,
)


def _checked(name: str, loaded: object, _: str) -> type[Approach]:
    if not (isinstance(loaded, type) and issubclass(loaded, Approach)):
        raise ValueError("expected a subclass of crashfuse.approaches.base.Approach")
    if getattr(loaded, "name", None) != name:
        raise ValueError(f"its name is {getattr(loaded, 'name', None)!r}, its entry point's {name!r}")
    kinds = dict.fromkeys(("label", "in_words", "description", "colour"), str) | {"preference": (int, float)}
    if missing := [name for name, kind in kinds.items() if not isinstance(getattr(loaded, name, None), kind)]:
        raise ValueError(f"it does not say its {', '.join(missing)}")
    return loaded


CLASSES = Extended({approach.name: approach for approach in _ALL}, "crashfuse.approaches", "approach", _checked)
"""All approaches by name, in the order of tables and figures: uncorrected CAE first, mixtures, then other packages'."""

LABELS: Mapping[str, str] = CLASSES.mapped(lambda approach: approach.label)
"""Labels of the approaches in figures and tables."""


def label_of(name: str) -> str:
    """The label of an approach; any other name as it is."""
    return LABELS.get(name, name)


APPROACHES = cast(tuple[str, ...], Names(CLASSES))  # but for its type, which nothing asks for
"""Names of all approaches."""

BASELINE: str = Cae.name
"""Name of the baseline that every correction has to beat."""


def by_preference(names: Iterable[str]) -> list[str]:
    """Names of approaches by preference, others last in their order."""
    return sorted(names, key=lambda name: CLASSES[name].preference if name in CLASSES else inf)


def require_approach(name: str) -> type[Approach]:
    """The class of an approach; raises as :func:`create`."""
    if isinstance(name, str) and (reason := CLASSES.broken(name)):
        raise UsageError(reason)
    return one_of("approach", name, CLASSES)


def create(name: str, settings: Settings) -> Approach:
    """Create an unfitted approach; a UsageError if there is none that can be used."""
    approach = require_approach(name)
    if isabstract(approach):  # the class behind it
        from crashfuse.approaches.fused import Fused
        from crashfuse.approaches.time_domain.approach import TimeDomain
        from crashfuse.approaches.time_domain.lf_tcn import LfTcn

        approach = next((network for network in (LfTcn, TimeDomain, Fused) if issubclass(network, approach)), approach)
    return approach.create(settings)


@cache
def uses_preset(name: str) -> bool:
    """Whether the preset acts on an approach: whether it decides what its fits are kept by."""
    with suppress(CrashfuseError), blamed_on(name):
        usual, *others = (create(name, Settings(preset)).identity for preset in PRESETS)
        return any(other != usual for other in others)
    return True  # it cannot be made here, which is told when it is asked for


@contextmanager
def blamed_on(name: str) -> Iterator[None]:
    """Tell an unexpected error of another package's approach as that package's own."""
    try:
        yield
    except BaseException as error:
        package = CLASSES.package(name)
        if not package or isinstance(error, (CrashfuseError, *NO_FAULTS)):
            raise
        text = f"The approach {name!r} of the package {package} failed: {said(error)}"
        raise CrashfuseError(text) from error
