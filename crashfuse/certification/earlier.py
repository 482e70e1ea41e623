"""An earlier certification, as its ``certification.json`` tells it: what was said of which conditions."""

import hashlib
import json
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import id_trouble
from crashfuse.campaign_folder.settings import occupant_settings
from crashfuse.certification import seal
from crashfuse.certification.criteria import Criteria, Criterion, criteria_of, is_number
from crashfuse.certification.forecasts import quantity
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import Trial
from crashfuse.certification.verdict import WORDS, EarlierVerdict, Verdict, Word
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError, DataError, Problem, printable
from crashfuse.signals.metrics import METRIC_UNITS
from crashfuse.signals.occupant import OccupantModel
from crashfuse.study.estimate import is_beyond

FILE = seal.FILE
_SHORT = 12  # characters of the fingerprint of the CAE runs among the settings
Shown = Mapping[str, float | None]
"""What a test showed, by quantity or criterion; None if its record is too short."""


@dataclass(frozen=True, eq=False)
class RemovedTest:
    """A test whose record is not used any more, by its id then, at the condition of the matrix that it was run for."""

    test: str
    digest: str
    condition: Condition
    measured: Shown  # by :func:`quantity`; a rating is that of the prediction of then


@dataclass(frozen=True, eq=False)
class Earlier:
    """An earlier certification, by its own account."""

    digest: str  # SHA-256 of its file
    date: str
    settings: Mapping[str, str]  # what decides verdicts besides tests, criteria and matrix, by names that readers know
    tests: Mapping[str, str]  # those that it learned from: digests by id
    criteria: Criteria
    matrix: Matrix
    occupant: OccupantModel
    trials: tuple[Trial, ...]  # verdicts of certifications before it on tests that were run since
    waived_before: Mapping[str, bool]  # tests run where those before it needed none: whether each missed a criterion
    gone: tuple[RemovedTest, ...]  # of certifications before it, not used any more
    run: Mapping[str, Mapping[str, Shown]]  # what tests at its conditions showed: by condition, test and criterion
    verdicts: tuple[tuple[EarlierVerdict, ...], ...]  # by condition of its matrix, then by criterion
    waived: tuple[str, ...]  # conditions that needed no test, and had none

    def __repr__(self) -> str:
        return f"<Earlier certification of {len(self.matrix.ids)} conditions from {len(self.tests)} tests>"

    @property
    def id(self) -> str:
        """Twelve hexadecimal digits, as of other past results."""
        return self.digest[:12]

    @property
    def rows(self) -> dict[str, tuple[EarlierVerdict, ...]]:
        """The verdicts of each condition, by its id."""
        return dict(zip(self.matrix.ids, self.verdicts, strict=True))

    @property
    def content_key(self) -> Hashable:
        """Equal for equal verdicts from equal tests, criteria, conditions and settings, whenever they were given."""
        given = frozenset(self.settings.items()), frozenset(self.tests.items())
        before = frozenset((trial.held_out, trial.verdict.criterion, trial.verdict.word) for trial in self.trials)
        gone = frozenset(test.digest for test in self.gone)
        return *given, self.criteria, self.matrix, frozenset(self.run), before, gone, self.verdicts

    @property
    def records(self) -> tuple[RemovedTest, ...]:
        """The tests at its conditions, and those that were gone then, with what they showed of metrics."""
        conditions = dict(self.matrix.items)
        of = {criterion.name: quantity(criterion) for criterion in self.criteria.items}
        at_conditions = (
            RemovedTest(test, self.tests[test], conditions[i], {of[name]: shown[name] for name in of if name in shown})
            for i, tests in self.run.items()
            for test, shown in tests.items()
            if test in self.tests
        )
        return *self.gone, *at_conditions

    def require_of(self, campaign: Campaign) -> None:
        """Raise a DataError unless it is of the vehicle of this campaign (:meth:`is_of`)."""
        if not self.is_of(campaign):
            found = f"one of {self.settings['campaign']}, none of whose tests is in {campaign.name}"
            raise DataError(Problem(FILE, "a certification of this campaign", found, "give one of this vehicle"))

    def is_of(self, campaign: Campaign) -> bool:
        """Whether it knew a test of a campaign: by its record, or by its id if name or CAE runs are those of then."""
        same_runs = campaign.cae.fingerprint[:_SHORT] in self.settings.get("CAE runs", "")
        same = same_runs or self.settings["campaign"] == campaign.name
        known = {*self.tests.values(), *(self.tests if same else ())}
        return any({test.id, test.digest} & known for test in campaign.tests)


def trial_of(
    test: str, condition: Condition, criterion: Criterion, said: EarlierVerdict, measured: float, shift: float = 0.0
) -> Trial:
    """An earlier verdict as one on a test that was only planned then."""
    verdict = Verdict(condition, criterion, None, said.lower, said.upper, said.probability, said.word, "")
    return Trial(test, "planned", verdict, measured, None, shift)


_LONGEST = 200  # characters of a setting
_WRONG = ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError, CrashfuseError


def read_earlier(path: Path) -> Earlier:
    """Read ``certification.json``, or the one in this folder; raises a DataError if it is not such a file."""
    path = path / FILE if path.is_dir() else path
    return parse_earlier(seal.read(path, "the record of a certification"), path)


def parse_earlier(content: bytes, path: Path = Path(FILE)) -> Earlier:
    """The same of a file's content; ``path`` is named where it is wrong."""
    try:
        return _of(json.loads(content), hashlib.sha256(content).hexdigest())
    except _WRONG:
        found = "another file, or a damaged one" if content.strip() else "an empty file"
        advice = f"give the {FILE} that crashfuse certify writes"
        raise DataError(Problem(path.name, "the record of a certification", found, advice)) from None


def _of(values: dict[str, Any], digest: str) -> Earlier:
    rows, cells, before = [dict(row) for row in values["matrix"]], values["cells"], values.get("since", {})
    asked = values["criteria"]
    declared = None if asked.get("confidence_by_costs") else asked["confidence"]
    criteria = criteria_of(_in_their_units(asked["criterion"]), declared, asked.get("costs"))
    matrix = Matrix(_ids(row.pop("id") for row in rows), tuple(Condition.of(**row) for row in rows))
    _require(not any(map(is_beyond, matrix.conditions)))
    return Earlier(
        digest,
        f"{datetime.fromisoformat(values['date']).astimezone(UTC):%Y-%m-%d %H:%M} UTC",
        {"campaign": "another vehicle", **{name: _text(value) for name, value in values["settings"].items()}},
        dict(zip(_ids(values["tests_sha256"]), map(_text, values["tests_sha256"].values()), strict=True)),
        criteria,
        matrix,
        _occupant(values),
        tuple(map(_trial, before.get("verdicts", ()))),
        dict(zip(_ids(before.get("waived", {})), map(_truth, before.get("waived", {}).values()), strict=True)),
        tuple(_removed(**test) for test in before.get("gone", ())),
        {i: _shown(tests) for i, tests in values["run"].items() if i in matrix.ids},
        tuple(tuple(_verdict(*cells[i][criterion.name]) for criterion in criteria.items) for i in matrix.ids),
        tuple(i for i in matrix.ids if i in values["waived"]),
    )


def _in_their_units(limits: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{"unit": METRIC_UNITS.get(limit["metric"], ""), **limit} for limit in limits]


def _require(fine: bool) -> None:
    if not fine:
        raise ValueError("not as it was written")  # whoever reads the file says that it is damaged


def _truth(value: object) -> bool:
    _require(isinstance(value, bool))
    return bool(value)


def _text(value: object) -> str:
    _require(isinstance(value, str) and printable(value, _LONGEST) == value)
    return str(value)


def _ids(ids: Iterable[str]) -> tuple[str, ...]:
    checked = tuple(ids)
    _require(not any(map(id_trouble, checked)) and len(set(checked)) == len(checked))
    return checked


def _trial(trial: dict[str, Any]) -> Trial:
    (limit,) = criteria_of(_in_their_units([trial["criterion"]])).items
    numbers, test = (trial["measured"], trial.get("shift", 0.0)), trial["test"]
    _require(all(map(is_number, numbers)) and not id_trouble(test))
    return trial_of(test, Condition.parse(trial["condition"]), limit, _verdict(*trial["said"]), *map(float, numbers))


def _removed(test: str, sha256: str, condition: str, measured: dict[str, float | None]) -> RemovedTest:
    (shown,) = _shown({test: measured}).values()
    return RemovedTest(test, _text(sha256), Condition.parse(condition), shown)


def _occupant(values: dict[str, Any]) -> OccupantModel:
    problems: list[Problem] = []
    found = occupant_settings({"occupant": values.get("occupant", {})}, problems)
    _require(not problems)
    return found


def _shown(tests: dict[str, dict[str, float | None]]) -> Mapping[str, Shown]:
    found = {test: {_text(name): v for name, v in shown.items()} for test, shown in tests.items()}
    _require(all(value is None or is_number(value) for shown in found.values() for value in shown.values()))
    return dict(zip(_ids(tests), found.values(), strict=True))


def _verdict(word: Word, probability: float | None, lower: float | None, upper: float | None) -> EarlierVerdict:
    _require(word in WORDS and all(value is None or is_number(value) for value in (probability, lower, upper)))
    _require(0 <= (probability or 0) <= 1 and (lower is None or upper is None or lower <= upper))
    return EarlierVerdict(word, probability, lower, upper)
