"""All approaches by name. A new one needs its own module and an entry here, or an entry point of another package.

Its class defines the rest. Those with networks are listed by what they say of themselves (an abstract base of their
class), so that whoever only names or draws approaches does not wait for PyTorch.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from inspect import isabstract
from math import inf

from crashfuse.approaches.base import Approach
from crashfuse.approaches.cae import Cae
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.fused.about import AboutFused
from crashfuse.approaches.settings import Settings
from crashfuse.approaches.time_domain.about import AboutLfTcn, AboutTimeDomain
from crashfuse.errors import CrashfuseError, UsageError, one_of
from crashfuse.extensions import NO_FAULTS, Broken, load, said

_ALL: tuple[type[Approach], ...] = (
    Cae,
    AboutLfTcn,
    AboutTimeDomain,
    DisplacementDomain,
    AboutFused,
)


def _with_networks() -> tuple[type[Approach], ...]:
    """The classes behind those that are listed by what they say: imported when one is created."""
    from crashfuse.approaches.fused.approach import Fused
    from crashfuse.approaches.time_domain.approach import TimeDomain
    from crashfuse.approaches.time_domain.lf_tcn import LfTcn

    return LfTcn, TimeDomain, Fused


def _checked(name: str, found: object) -> type[Approach]:
    """An approach of another package, if it says all that is shown of it and takes no name of ours."""
    if not (isinstance(found, type) and issubclass(found, Approach)):
        raise ValueError("expected a subclass of crashfuse.approaches.base.Approach")
    if getattr(found, "name", None) != name:
        raise ValueError(f"its name is {getattr(found, 'name', None)!r}, its entry point's {name!r}")
    if name in (approach.name for approach in _ALL):
        raise ValueError("crashfuse has an approach of this name")
    kinds = dict.fromkeys(("label", "in_words", "description", "colour"), str) | {"preference": (int, float)}
    if missing := [name for name, kind in kinds.items() if not isinstance(getattr(found, name, None), kind)]:
        raise ValueError(f"it does not say its {', '.join(missing)}")
    return found


_FOUND = tuple(load("crashfuse.approaches", "approach", _checked))
_BROKEN = {each.name: each.sentence for each in _FOUND if isinstance(each, Broken)}

_USABLE = [each for each in _FOUND if not isinstance(each, Broken)]

CLASSES: dict[str, type[Approach]] = {approach.name: approach for approach in _ALL} | {
    name: approach for name, approach, _ in _USABLE
}
"""All approaches by name; those that other packages add (entry points ``crashfuse.approaches``) come last."""

PACKAGES: dict[str, str] = {name: package for name, _, package in _USABLE}
"""The package of each approach that is not ours."""

APPROACHES: tuple[str, ...] = tuple(CLASSES)
"""Names of all approaches in the order of tables and figures: uncorrected CAE first, mixtures last."""

LABELS: dict[str, str] = {name: approach.label for name, approach in CLASSES.items()}
"""Labels of the approaches in figures and tables."""

BASELINE: str = Cae.name
"""Name of the baseline that every correction has to beat."""


def by_preference(names: Iterable[str]) -> list[str]:
    """Names, those of approaches first, the preferred one at the head; what is no approach keeps its order."""
    return sorted(names, key=lambda name: CLASSES[name].preference if name in CLASSES else inf)


def require_approach(name: str) -> type[Approach]:
    """The class of an approach; raises as :func:`create`."""
    if name in _BROKEN:
        raise UsageError(_BROKEN[name])
    return one_of("approach", name, CLASSES)


def create(name: str, settings: Settings) -> Approach:
    """Create an unfitted approach.

    Parameters
    ----------
    name : str
        One of :data:`APPROACHES`.

    Raises
    ------
    UsageError
        If there is no approach with that name, or another package's cannot be used.
    """
    known = require_approach(name)
    if isabstract(known):
        known = next((each for each in _with_networks() if issubclass(each, known)), known)
    return known.create(settings)


@contextmanager
def blamed_on(name: str) -> Iterator[None]:
    """Tell an unexpected error of another package's approach as that package's own; ours is passed on."""
    try:
        yield
    except BaseException as error:
        if name not in PACKAGES or isinstance(error, (CrashfuseError, *NO_FAULTS)):
            raise
        text = f"The approach {name!r} of the package {PACKAGES[name]} failed: {said(error)}"
        raise CrashfuseError(text) from error
