"""What became of an earlier certification: verdicts that changed, and what tests run since then measured."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.earlier import Earlier, EarlierVerdict
from crashfuse.certification.forecast import quantity
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.verdict import Verdict
from crashfuse.condition import Condition

_DIGITS = 5  # of m/s and kg: conditions go through mph and lb


@dataclass(frozen=True, slots=True)
class Change:
    """One criterion at one condition, by both certifications or by one of them.

    Attributes
    ----------
    before, now : EarlierVerdict or None, Verdict or None
        None if that one did not ask for it.
    since : mapping of str to float or None
        What tests that the earlier one did not know measured there: a metric, or the rating of the prediction made
        without it today; None if the record is too short, or no criterion asks for it any more.
    """

    condition_id: str
    condition: Condition
    criterion: Criterion
    before: EarlierVerdict | None
    now: Verdict | None
    since: dict[str, float | None] = field(default_factory=dict)

    @property
    def came_true(self) -> dict[str, bool]:
        """Whether each test run since showed what the earlier verdict, met or not met, said."""
        if self.before is None or not self.before.decided:
            return {}
        said = self.before.word == "met"
        return {test: self.criterion.is_met_by(v) == said for test, v in self.since.items() if v is not None}


@dataclass(frozen=True, eq=False)
class Changes:
    """An earlier certification beside a later one; conditions and limits are the same if their numbers are."""

    earlier: Earlier
    later: Certification
    cells: tuple[Change, ...]

    @classmethod
    def of(cls, earlier: Earlier, later: Certification) -> Self:
        """Compare them: what the earlier one said, in its order, then what only the later one says."""
        now = {_key(own.condition, own.criterion): (i, own) for i, own in later.cells}
        measured = {
            (trial.held_out, quantity(trial.verdict.criterion)): trial.measured
            for trial in later.record.trials
            if trial.left_out == "test"
        }
        cells = []
        for i, condition, row in zip(earlier.matrix.ids, earlier.matrix.conditions, earlier.verdicts, strict=True):
            tests = [test.id for test in later.campaign.tests_at(condition) if test.id not in earlier.tests]
            for criterion, before in zip(earlier.criteria.items, row, strict=True):
                since = {test: measured.get((test, quantity(criterion))) for test in tests}
                _, verdict = now.pop(_key(condition, criterion), (i, None))
                cells.append(Change(i, condition, criterion, before, verdict, since))
        cells += [Change(i, verdict.condition, verdict.criterion, None, verdict) for i, verdict in now.values()]
        return cls(earlier, later, tuple(cells))

    def __repr__(self) -> str:
        return f"<Changes of {len(self.compared)} verdicts since {self.earlier!r}>"

    @property
    def new_tests(self) -> tuple[str, ...]:
        """Tests that the earlier certification did not know."""
        return tuple(test for test in self.later.campaign.test_ids if test not in self.earlier.tests)

    @property
    def compared(self) -> tuple[tuple[Change, EarlierVerdict, Verdict], ...]:
        """What both have a verdict on, with both."""
        return tuple((cell, cell.before, cell.now) for cell in self.cells if cell.before and cell.now)

    @cached_property
    def run_since(self) -> dict[str, tuple[str, ...]]:
        """Tests that were run since at conditions of the earlier certification, by its ids."""
        return {cell.condition_id: tuple(cell.since) for cell in self.cells if cell.since}

    @property
    def outcomes(self) -> tuple[int, int]:
        """How many earlier verdicts, met or not met, tests run since tell of, and how many were wrong; one a metric."""
        told: dict[tuple[str, str, str], bool] = {}
        for cell in self.cells:
            for test, came_true in cell.came_true.items():
                key = cell.condition_id, quantity(cell.criterion), test
                told[key] = came_true and told.get(key, True)
        return len(told), list(told.values()).count(False)

    @property
    def intervals(self) -> tuple[int, int]:
        """How many earlier 95 % intervals hold what tests run since measured, and of how many; one a metric."""
        held = {
            (cell.condition_id, quantity(cell.criterion), test): cell.before.holds(value)
            for cell in self.cells
            for test, value in cell.since.items()
            if cell.before is not None and cell.before.word != "outside" and value is not None
        }
        known = [own for own in held.values() if own is not None]
        return sum(known), len(known)

    @property
    def waived_outcomes(self) -> dict[str, dict[str, tuple[str, ...]]]:
        """Of conditions that needed no test and had one since, the criteria that each test missed."""
        return {
            i: {
                test: tuple(
                    cell.criterion.name
                    for cell in self.cells
                    if cell.condition_id == i and cell.before and not cell.came_true.get(test, True)
                )
                for test in tests
            }
            for i, tests in self.run_since.items()
            if i in self.earlier.waived
        }

    @property
    def newly_waived(self) -> tuple[str, ...]:
        """Conditions that need no test, and did then; by the ids of today."""
        then, waived = _by_place(self.earlier.matrix), self.earlier.waived
        return tuple(
            i
            for place, i in _by_place(self.later.matrix).items()
            if i in self.later.waived and place in then and then[place] not in waived
        )

    @property
    def withdrawn(self) -> tuple[str, ...]:
        """Conditions that need a test, had none since, and needed none then; by the ids of today."""
        then, settled = _by_place(self.earlier.matrix), {*self.later.waived, *self.later.run}
        return tuple(
            i
            for place, i in _by_place(self.later.matrix).items()
            if i not in settled and then.get(place) in self.earlier.waived
        )


def _place(condition: Condition) -> tuple[object, ...]:
    return (*condition.vector.round(_DIGITS).tolist(), *sorted(pair for pair in condition.factors if pair[1]))


def _by_place(matrix: Matrix) -> dict[tuple[object, ...], str]:
    return {_place(condition): i for i, condition in zip(matrix.ids, matrix.conditions, strict=True)}


def _key(condition: Condition, criterion: Criterion) -> tuple[object, ...]:
    return _place(condition), quantity(criterion), criterion.at_least, criterion.at_most
