"""An earlier certification, as its ``certification.json`` tells it, and whether tests run since prove it right."""

import hashlib
import io
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import id_trouble
from crashfuse.campaign_folder.settings import occupant_settings
from crashfuse.certification import seal
from crashfuse.certification.criteria import Criteria, Criterion, criteria_of, is_number
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import Trial
from crashfuse.certification.verdict import WORDS, Verdict, reaches
from crashfuse.condition import Condition
from crashfuse.errors import CrashfuseError, DataError, Problem, printable, refusal
from crashfuse.execution.run import Run
from crashfuse.signals.metrics import METRIC_UNITS, metric_values
from crashfuse.signals.occupant import OccupantModel
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import is_beyond
from crashfuse.units import read_out

FILE = seal.FILE
COMPARED = (FILE, "certification.csv", "track_record.csv")  # whose values are computed again
VERDICTS = "cells, "  # begins their places
AGREEMENTS, UNDERIVED = ("to the last digit", "within rounding", "not"), "not derived"
_ROUNDING = 1e-5  # of a value; tables have six digits
_NOT_DERIVED = re.compile("date|seconds|platform|python|packages|crashfuse|settings, version|command|seal|since|reason")
_LONGEST = 200  # characters of a setting
_WRONG = ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError, CrashfuseError


@dataclass(frozen=True)
class Earlier:
    """An earlier certification, by its own account; equal to another that says the same, whenever it was given."""

    digest: str = field(compare=False)  # SHA-256 of its file
    date: str = field(compare=False)
    settings: Mapping[str, str]  # what decides verdicts besides tests, criteria and matrix, by names that readers know
    tests: Mapping[str, str]  # those that it learned from: digests by id
    criteria: Criteria
    matrix: Matrix
    occupant: OccupantModel
    rows: Mapping[str, tuple[Verdict, ...]]  # by condition of its matrix, then by criterion
    run: tuple[str, ...]  # conditions that tests had been made for
    waived: tuple[str, ...]  # conditions that needed no test, and had none
    trials: tuple[Trial, ...]  # verdicts of certifications before it on tests that were run since

    def __repr__(self) -> str:
        return f"<Earlier certification of {len(self.matrix.ids)} conditions from {len(self.tests)} tests>"

    @property
    def id(self) -> str:
        """Twelve hexadecimal digits, as of other past results."""
        return self.digest[:12]

    def require_of(self, campaign: Campaign) -> None:
        """Raise a DataError unless it is of the vehicle of this campaign (:meth:`is_of`)."""
        if not self.is_of(campaign):
            found = f"one of {self.settings['campaign']}, none of whose tests is in {campaign.name}"
            raise DataError(Problem(FILE, "a certification of this campaign", found, "give one of this vehicle"))

    def is_of(self, campaign: Campaign) -> bool:
        """Whether it knew a test of a campaign: by its record, or by its id if name or CAE runs are those of then."""
        runs = campaign.cae.fingerprint[:12]
        same = self.settings["campaign"] == campaign.name or runs in self.settings.get("CAE runs", "")
        known = {*self.tests.values(), *(self.tests if same else ())}
        return any({test.id, test.digest} & known for test in campaign.tests)


# metrics of which a CAE model knows how they change within 1 km/h and 2 % (benchmarks/off_condition.py)
_SHIFTED = ("delta_v", "max_crush", "mean", "olc", "vpi", "esw")


@dataclass(frozen=True, eq=False)
class LaterTests:
    """What a campaign's tests have to say of an earlier certification of the same vehicle."""

    earlier: Earlier
    campaign: Campaign

    @cached_property
    def new(self) -> tuple[str, ...]:
        """Tests that it did not know, neither by their record nor by their id."""
        known = {*self.earlier.tests, *self.earlier.tests.values()}
        return tuple(test.id for test in self.campaign.tests if not {test.id, test.digest} & known)

    @cached_property
    def made_for(self) -> dict[str, str]:
        """The condition then that a new test was made for, by test; where it knew a test there, it is a repeat."""
        return self.earlier.matrix.made_for((test, self.campaign.test(test).condition) for test in self.new)

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Verdicts on metrics of tests run later, by the occupant model of then, after those that it knew itself."""
        then, found = replace(self.campaign, occupant=self.earlier.occupant), list(self.earlier.trials)
        for test, planned in self.made_for.items():
            if planned not in self.earlier.run:
                shown = {metric.name: metric.value for metric in then.metrics_of(then.test(test))}
                shifts = self._shifts(then.test(test).condition, dict(self.earlier.matrix.items)[planned])
                for verdict in self.earlier.rows[planned]:
                    if (value := shown.get(verdict.criterion.metric)) is not None:  # none of a rating
                        shift = shifts.get(verdict.criterion.metric, 0.0)
                        found.append(Trial(test, "planned", verdict, value - shift, None, shift))
        return tuple(found)

    @property
    def counted(self) -> tuple[Trial, ...]:
        """Those that count: of tests that the CAE model was tuned to, only what was wrong."""
        tuned = {test.id for test in self.campaign.tests if test.cae_tuned}
        return tuple(trial for trial in self.trials if trial.wrong or trial.held_out not in tuned)

    def held_against(self, criteria: Criteria) -> tuple[Trial, ...]:
        """Those on metrics of these criteria; open if given with less confidence than is asked for today."""
        metrics, found = {criterion.metric for criterion in criteria.items}, []
        for trial in self.counted:
            verdict, p = trial.verdict, trial.verdict.probability
            if verdict.decided and (p is None or not reaches(max(p, 1 - p), criteria.confidence)):
                trial = replace(trial, verdict=replace(verdict, word="open"))
            found += [trial] if verdict.criterion.metric in metrics else []
        return tuple(found)

    def _shifts(self, run: Condition, planned: Condition) -> dict[str, float]:
        """What a test shows more than as planned, by the emulator."""
        if run.is_at(planned) or not len(self.campaign.cae):
            return {}
        emulator, occupant = CaeModel().fit(self.campaign.cae, Run.of(self.campaign)).emulator_, self.earlier.occupant
        there, here = (metric_values(emulator.predict(at), at.speed_mps, occupant=occupant) for at in (run, planned))
        shifts = {metric: float(there[metric] - here[metric]) for metric in _SHIFTED}
        return {metric: shift for metric, shift in shifts.items() if np.isfinite(shift)}


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


def recorded(folder: Path, campaign: Campaign) -> tuple[Earlier, StudyConfig, Campaign]:
    """A certification with its configuration and the campaign of then."""
    earlier, values = read_earlier(folder), json.loads((folder / FILE).read_bytes())
    earlier.require_of(campaign)
    then = replace(campaign.without(LaterTests(earlier, campaign).new), name=earlier.settings["campaign"])
    if then.fingerprint != values.get("fingerprint"):
        digests = {test.id: test.digest for test in then.tests}
        others = [test for test, digest in earlier.tests.items() if digests.get(test) != digest]
        found = f"another record of {read_out(others)}" if others else "other CAE runs or past vehicles"
        raise refusal(FILE, "the campaign that it was computed from", found, "give that one")
    try:
        return earlier, StudyConfig.parse(values["config"]), then
    except _WRONG:
        raise refusal(FILE, "settings", "others", seal.ASK) from None


def compared(file: str, then: bytes, now: bytes) -> Iterator[tuple[str, str, object, object, str]]:
    """File, place, recorded and recomputed value, and how they agree."""
    before, again = (dict(_values(file, content)) for content in (then, now))
    for place in {**before, **again}:
        pair = before.get(place), again.get(place)
        yield file, place, *pair, UNDERIVED if _NOT_DERIVED.match(place) else _agreement(*pair)


def _values(file: str, content: bytes) -> Iterator[tuple[str, object]]:
    if file == FILE:
        return _leaves(json.loads(content))
    table = pd.read_csv(io.BytesIO(content), keep_default_na=False)
    return ((f"{name}, row {at}", cell) for name in table for at, cell in enumerate(table[name].tolist(), start=2))


def _leaves(values: dict[str, Any], above: str = "") -> Iterator[tuple[str, object]]:
    for name, value in values.items():
        is_nested = isinstance(value, list) and any(isinstance(part, dict) for part in value)
        inner = dict(enumerate(value, start=1)) if is_nested else value
        yield from _leaves(inner, f"{above}{name}, ") if isinstance(inner, dict) else ((f"{above}{name}", value),)


def _agreement(then: object, now: object) -> str:
    pairs = [(then, now)]
    if isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        pairs = [*zip(then, now, strict=True)]
    near = all(a == b or (is_number(a) and is_number(b) and math.isclose(a, b, rel_tol=_ROUNDING)) for a, b in pairs)
    return AGREEMENTS[0 if then == now else 1 if near else 2]


def _of(values: dict[str, Any], digest: str) -> Earlier:
    conditions, asked, before = [dict(row) for row in values["matrix"]], values["criteria"], values.get("since", {})
    declared = None if asked.get("confidence_by_costs") else asked["confidence"]
    criteria = _criteria(asked["criterion"], declared, asked.get("costs"), asked.get("tolerances"))
    matrix = Matrix(_ids(row.pop("id") for row in conditions), tuple(Condition.of(**row) for row in conditions))
    _require(not any(map(is_beyond, matrix.conditions)))
    digests, problems = values["tests_sha256"], list[Problem]()
    occupant = occupant_settings({"occupant": values.get("occupant", {})}, problems)
    _require(not problems)
    return Earlier(
        digest=digest,
        date=f"{datetime.fromisoformat(values['date']).astimezone(UTC):%Y-%m-%d %H:%M} UTC",
        settings={"campaign": "another vehicle", **{name: _text(value) for name, value in values["settings"].items()}},
        tests=dict(zip(_ids(digests), map(_text, digests.values()), strict=True)),
        criteria=criteria,
        matrix=matrix,
        occupant=occupant,
        rows={
            i: tuple(_verdict(at, own, values["cells"][i][own.name]) for own in criteria.items)
            for i, at in matrix.items
        },
        run=tuple(i for i in values["run"] if i in matrix.ids),
        waived=tuple(i for i in matrix.ids if i in values["waived"]),
        trials=tuple(map(_trial, before.get("verdicts", ()))),
    )


def _criteria(limits: list[dict[str, Any]], *declared: Any) -> Criteria:  # noqa: ANN401
    return criteria_of([{"unit": METRIC_UNITS.get(limit["metric"], ""), **limit} for limit in limits], *declared)


def _require(fine: bool) -> None:
    if not fine:
        raise ValueError("not as it was written")  # whoever reads the file says that it is damaged


def _text(value: object) -> str:
    _require(isinstance(value, str) and printable(value, _LONGEST) == value)
    return str(value)


def _ids(ids: Iterable[str]) -> tuple[str, ...]:
    checked = tuple(ids)
    _require(not any(map(id_trouble, checked)) and len(set(checked)) == len(checked))
    return checked


def _trial(trial: dict[str, Any]) -> Trial:
    (limit,) = _criteria([trial["criterion"]]).items
    measured, shift = trial["measured"], trial.get("shift", 0.0)
    _require(is_number(measured) and is_number(shift) and not id_trouble(trial["test"]))
    verdict = _verdict(Condition.parse(trial["condition"]), limit, trial["said"])
    return Trial(trial["test"], "planned", verdict, float(measured), None, float(shift))


def _verdict(condition: Condition, criterion: Criterion, said: Sequence[Any]) -> Verdict:
    word, probability, *ends = said
    _require(word in WORDS and all(value is None or is_number(value) for value in (probability, *ends)))
    lower, upper = ends
    _require(0 <= (probability or 0) <= 1 and (lower is None or upper is None or lower <= upper))
    return Verdict(condition, criterion, None, lower, upper, probability, word, reason="")
