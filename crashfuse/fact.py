"""Facts that whoever reads a result has to know: found once, worded once, shown wherever the result is."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

IMPORTANCE = (
    "test.stands_apart",
    "test.in_doubt",
    "test.beyond_window",
    "tests.cae_tuned",
    "condition.extrapolated",
    "cae.ended_otherwise",
    "cae.runs_fail",
    "tests.left_out_of_use",
    "campaign.warning",
    "campaign.notice",
)
"""Codes of facts, the most important one first: the order in which pages, reports and files have them."""


@dataclass(frozen=True, slots=True)
class Fact:
    """A fact with its sentence, and the values that it rests on."""

    code: str  # one of IMPORTANCE, or of the catalogue of a kind of result
    sentence: str  # with its subject, its size and what to do
    label: str  # in two or three words, for a badge
    values: Mapping[str, object] = field(default_factory=dict)  # as JSON has them; units end the names

    @property
    def record(self) -> dict[str, object]:
        """The fact as JSON values."""
        return {"code": self.code, **self.values, "sentence": str(self.sentence)}


def by_importance(facts: Iterable[Fact], order: Sequence[str] = IMPORTANCE) -> tuple[Fact, ...]:
    """Facts in the order of their codes; of one code, as they come."""
    return tuple(sorted(facts, key=lambda fact: order.index(fact.code)))
