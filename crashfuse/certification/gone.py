"""Tests that a certification used and that are not used any more: what they had shown is not forgotten."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Self

from crashfuse.certification.criteria import Criterion
from crashfuse.certification.forecast import quantity
from crashfuse.condition import Condition


@dataclass(frozen=True, eq=False)
class Gone:
    """Such a test.

    Attributes
    ----------
    test, digest : str
        Its id then, and :attr:`crashfuse.crash_test.CrashTest.digest`.
    condition : Condition
        That of the matrix, at which it was run.
    measured : mapping of str to float or None
        By :func:`quantity`, in the units of criteria; None if its record is too short. A rating is that of the
        prediction of then.
    """

    test: str
    digest: str
    condition: Condition
    measured: Mapping[str, float | None]

    def without(self, metrics: Set[str]) -> Self:
        """The same but for what it showed of these metrics."""
        return replace(self, measured={name: value for name, value in self.measured.items() if name not in metrics})

    def missed(self, criteria: Sequence[Criterion]) -> tuple[str, ...]:
        """The criteria that it missed."""
        each = ((own, self.measured.get(quantity(own))) for own in criteria)
        return tuple(own.name for own, value in each if value is not None and not own.is_met_by(value))

    def not_asked(self, criteria: Sequence[Criterion]) -> tuple[str, ...]:
        """The criteria on what no certification had asked of it."""
        return tuple(own.name for own in criteria if quantity(own) not in self.measured)

    def cannot_tell(self, criteria: Sequence[Criterion]) -> tuple[str, ...]:
        """The criteria for which its record is too short."""
        return tuple(own.name for own in criteria if self.measured.get(quantity(own), 0.0) is None)
