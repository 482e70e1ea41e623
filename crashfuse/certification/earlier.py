"""An earlier certification, as its ``certification.json`` tells it: what was said of which conditions."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.forecast import quantity
from crashfuse.certification.gone import Gone
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import Trial
from crashfuse.certification.verdict import Verdict, Word, needs_no_test
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem
from crashfuse.signals.occupant import OccupantModel

FILE = "certification.json"
"""The file that an earlier certification is read from."""

_SHORT = 12  # characters of the fingerprint of the CAE runs among the settings


Outcomes = Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]
"""By test, the criteria that it missed, and those of which its record is too short to tell."""


class EarlierVerdict(NamedTuple):
    """What was said of one criterion at one condition: as in :class:`crashfuse.certification.verdict.Verdict`."""

    word: Word
    probability: float | None
    lower: float | None
    upper: float | None

    @property
    def decided(self) -> bool:
        """Whether no test was needed to tell."""
        return self.word in ("met", "not met")

    def trial(self, test: str, condition: Condition, criterion: Criterion, measured: float, shift: float = 0) -> Trial:
        """It as one of a test that was only planned then, beside what was measured, without the shift."""
        verdict = Verdict(condition, criterion, None, self.lower, self.upper, self.probability, self.word, "")
        return Trial(test, "planned", verdict, measured, None, shift)


@dataclass(frozen=True, eq=False)
class Earlier:
    """An earlier certification.

    Attributes
    ----------
    digest : str
        SHA-256 of its file.
    before : tuple of str
        Those of certifications before it, the latest first.
    date : str
        When it was made, by its own account.
    settings : mapping of str to str
        What decides verdicts besides tests, criteria and matrix, by the names that a reader knows.
    tests : mapping of str to str
        Those that it learned from: :attr:`crashfuse.crash_test.CrashTest.digest` by id.
    occupant : OccupantModel
        Of its OLC and VPI.
    trials : tuple of Trial
        Verdicts of certifications before it on tests that were run since.
    waived_before : mapping of str to Outcomes
        Of conditions that needed no test by those before it, what tests there showed.
    gone : tuple of Gone
        Tests of certifications before it that it did not use any more.
    run : mapping of str to mapping
        What tests at its conditions showed: by condition, test and criterion; None if a record is too short.
    verdicts : tuple of tuple of EarlierVerdict
        By condition of its matrix, then by criterion.
    """

    digest: str
    before: tuple[str, ...]
    date: str
    settings: Mapping[str, str]
    tests: Mapping[str, str]
    criteria: Criteria
    matrix: Matrix
    occupant: OccupantModel
    trials: tuple[Trial, ...]
    waived_before: Mapping[str, Outcomes]
    gone: tuple[Gone, ...]
    run: Mapping[str, Mapping[str, Mapping[str, float | None]]]
    verdicts: tuple[tuple[EarlierVerdict, ...], ...]

    def __repr__(self) -> str:
        return f"<Earlier certification of {len(self.matrix.ids)} conditions from {len(self.tests)} tests>"

    @property
    def waived(self) -> tuple[str, ...]:
        """Conditions that needed no test, by :func:`needs_no_test`, and had none."""
        confidence = self.criteria.confidence
        return tuple(i for i, row in self.rows.items() if i not in self.run and needs_no_test(row, confidence))

    @property
    def rows(self) -> dict[str, tuple[EarlierVerdict, ...]]:
        """The verdicts of each condition, by its id."""
        return dict(zip(self.matrix.ids, self.verdicts, strict=True))

    @property
    def said(self) -> Hashable:
        """Equal for equal verdicts from equal tests, criteria, conditions and settings, whenever they were given."""
        given = frozenset(self.settings.items()), frozenset(self.tests.items())
        before = frozenset((own.held_out, own.verdict.criterion, own.verdict.word) for own in self.trials)
        gone = frozenset(own.digest for own in self.gone)
        return *given, self.criteria, self.matrix, frozenset(self.run), before, gone, self.verdicts

    @property
    def records(self) -> tuple[Gone, ...]:
        """The tests at its conditions, and those that were gone then, with what they showed of metrics."""
        conditions = dict(self.matrix.items)
        of = {own.name: quantity(own) for own in self.criteria.items}
        own = (
            Gone(test, self.tests[test], conditions[i], {of[name]: shown[name] for name in of if name in shown})
            for i, tests in self.run.items()
            for test, shown in tests.items()
            if test in self.tests
        )
        return *self.gone, *own

    def require_of(self, campaign: Campaign) -> None:
        """Raise unless it is of the vehicle of this campaign.

        Raises
        ------
        DataError
            If :meth:`is_of` says no.
        """
        if not self.is_of(campaign):
            found = f"one of {self.settings['campaign']}, none of whose tests is in {campaign.name}"
            advice = "give one that was made from tests of this vehicle"
            raise DataError(Problem(FILE, "a certification of this campaign", found, advice))

    def is_of(self, campaign: Campaign) -> bool:
        """Whether it knew a test of a campaign: its record by whatever id, or its id if the campaign is that of then.

        It is by its name or its CAE runs: another filter class changes all records, those of the runs included.
        """
        same_runs = campaign.cae.fingerprint[:_SHORT] in self.settings.get("CAE runs", "")
        same = same_runs or self.settings["campaign"] == campaign.name
        known = {*self.tests.values(), *(self.tests if same else ())}
        return any({test.id, test.digest} & known for test in campaign.tests)
