"""What became of an earlier certification: verdicts that changed, and what tests that it did not know measured."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Self

from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criterion
from crashfuse.certification.earlier import Earlier, Outcomes
from crashfuse.certification.forecasts import quantity
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.tested_since import TestedSince
from crashfuse.certification.track_record import TrackRecord, WrongShare, strictest_per_metric, trial_bounds
from crashfuse.certification.verdict import EarlierVerdict, Verdict, needs_no_test
from crashfuse.condition import Condition
from crashfuse.errors import UsageError

_DIGITS = 5  # of m/s and kg: conditions go through mph and lb


@dataclass(frozen=True, slots=True)
class Change:
    """One criterion at one condition, by both certifications or one of them."""

    earlier_id: str | None
    later_id: str | None
    condition: Condition
    criterion: Criterion
    before: EarlierVerdict | None = None
    now: Verdict | None = None
    measured: Mapping[str, float | None] = field(default_factory=dict)  # by tests since, by id; empty of a rating

    @property
    def name(self) -> str:
        """The condition by the id of today, with the earlier one if that is another."""
        if self.later_id is None:
            return f"{self.earlier_id} (then)"
        then = "" if self.earlier_id in (None, self.later_id) else f" (then {self.earlier_id})"
        return f"{self.later_id}{then}"

    @property
    def came_true(self) -> dict[str, bool]:
        """Whether each test showed what the earlier verdict said, if that was decided."""
        if self.before is None or not self.before.decided:
            return {}
        said = self.before.word == "met"
        return {test: self.criterion.is_met_by(v) == said for test, v in self.measured.items() if v is not None}


@dataclass(frozen=True, eq=False)
class Changes:
    """An earlier certification beside a later one; conditions and limits are the same if their numbers are."""

    since: TestedSince
    later: Certification
    cells: tuple[Change, ...]

    @classmethod
    @lru_cache(maxsize=4)  # asked for by tables, sentences and files
    def of(cls, later: Certification) -> Self:
        """Compare one with that which it is beside: what that said, then what only this one says."""
        if later.since is None:
            raise UsageError("Nothing to compare: give an earlier certification.")
        since, earlier = later.since, later.since.earlier
        ids, then = _by_place(later.matrix), _by_place(earlier.matrix)
        now = {_key(verdict.condition, verdict.criterion): verdict for _, verdict in later.cells}
        cells, asked = [], set()
        for i, condition in earlier.matrix.items:
            shown = {test: since.shown[test] for test, place in since.at.items() if place == i}
            for criterion, before in zip(earlier.criteria.items, earlier.rows[i], strict=True):
                rating, key = criterion.window_ms is not None, _key(condition, criterion)
                measured = {} if rating else {test: values[criterion.metric] for test, values in shown.items()}
                asked.add(key)
                cells.append(Change(i, ids.get(key[0]), condition, criterion, before, now.get(key), measured))
        cells += [
            Change(then.get(_place(new.condition)), i, new.condition, new.criterion, now=new)
            for i, new in later.cells
            if _key(new.condition, new.criterion) not in asked
        ]
        return cls(since, later, tuple(cells))

    def __repr__(self) -> str:
        return f"<Changes of {len(self.compared)} verdicts since {self.earlier!r}>"

    @property
    def earlier(self) -> Earlier:
        """That of :attr:`since`."""
        return self.since.earlier

    @property
    def compared(self) -> tuple[tuple[Change, EarlierVerdict, Verdict], ...]:
        """What both have a verdict on, with both."""
        return tuple((cell, cell.before, cell.now) for cell in self.cells if cell.before and cell.now)

    @cached_property
    def tested(self) -> dict[str, tuple[str, ...]]:
        """The tests that measured something since, by the name of their condition."""
        return {cell.name: tuple(cell.measured) for cell in self.cells if cell.measured}

    @property
    def outcomes(self) -> dict[str, WrongShare]:
        """:func:`trial_bounds` of verdicts on metrics of these tests, each once."""
        return trial_bounds(strictest_per_metric(self.since.without_tuned(self.since.latest)))

    @property
    def outcomes_before(self) -> dict[str, WrongShare]:
        """The same of certifications before the earlier one."""
        return trial_bounds(strictest_per_metric(self.since.without_tuned(self.earlier.trials)))

    @cached_property
    def record(self) -> TrackRecord:
        """All that was said of tests before they were run, by certifications before it, too."""
        tuned = self.since.tuned  # to these only what was missed
        return TrackRecord(tuple(t for t in self.since.all_trials if t.held_out not in tuned or t.wrong or not t.held))

    @property
    def too_narrow(self) -> bool:
        """Whether intervals held too little; one test alone, whose metrics hang together, is no sign of it."""
        missed = {own.held_out for own in self.record.missed_intervals if own.verdict.word != "outside"}
        return self.record.too_narrow and len(missed) > 1

    @property
    def waived_outcomes(self) -> dict[str, Outcomes]:
        """Of conditions that needed no test and have one, what each test missed, and what it cannot tell."""
        found = dict(self.earlier.waived_before)
        for name, tests in self.tested.items():
            cells = [cell for cell in self.cells if cell.name == name and cell.measured]
            if cells[0].earlier_id in self.earlier.waived:
                found[name] = {**found.get(name, {})} | {
                    test: (
                        tuple(cell.criterion.name for cell in cells if cell.came_true.get(test) is False),
                        tuple(cell.criterion.name for cell in cells if test not in cell.came_true),
                    )
                    for test in tests
                }
        return found

    @property
    def newly_waived(self) -> tuple[str, ...]:
        """Conditions, by the ids of today, that need no test, and did then; none by other criteria."""
        then, now = ({_limit(criterion) for criterion in c.criteria.items} for c in (self.earlier, self.later))
        if then != now:
            return ()
        waived = self.later.waived
        return tuple(i for i, before in self._both.items() if i in waived and before not in self.earlier.waived)

    @property
    def withdrawn(self) -> dict[str, tuple[Verdict, ...]]:
        """Conditions, not run since, that needed no test then and do by the criteria of both; what is not met."""
        both = {_limit(criterion) for criterion in self.earlier.criteria.items}
        found, run = {}, self.later.run
        for i, before in self._both.items():
            if before in self.earlier.waived and i not in run:
                row = [verdict for verdict in self.later.rows[i] if _limit(verdict.criterion) in both]
                if row and not needs_no_test(row, self.later.criteria.confidence):
                    found[i] = tuple(verdict for verdict in row if verdict.word != "met")
        return found

    @cached_property
    def _both(self) -> dict[str, str]:
        then = _by_place(self.earlier.matrix)
        return {i: then[place] for place, i in _by_place(self.later.matrix).items() if place in then}


def saved_and_missed(certification: Certification) -> tuple[int, int]:
    """As :meth:`TrackRecord.waived`, with tests that earlier certifications waived and that were run since."""
    saved = {test: any(own.values()) for test, own in certification.record.saved(certification.criteria).items()}
    if certification.since is not None:
        for tests in Changes.of(certification).waived_outcomes.values():
            tuned = certification.since.tuned
            told = {test: missed for test, (missed, no) in tests.items() if missed or not (no or test in tuned)}
            known = {test: bool(missed) for test, missed in told.items()}
            saved |= {test: saved.get(test, False) or missed for test, missed in known.items()}
    return len(saved), sum(saved.values())


def _place(condition: Condition) -> tuple[object, ...]:
    return (*condition.vector.round(_DIGITS).tolist(), *sorted(pair for pair in condition.factors if pair[1]))


def _by_place(matrix: Matrix) -> dict[tuple[object, ...], str]:
    return {_place(condition): i for i, condition in matrix.items}


def _limit(criterion: Criterion) -> tuple[object, ...]:
    return quantity(criterion), criterion.at_least, criterion.at_most


def _key(condition: Condition, criterion: Criterion) -> tuple[tuple[object, ...], tuple[object, ...]]:
    return _place(condition), _limit(criterion)
