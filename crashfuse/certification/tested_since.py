"""Tests beside an earlier certification: those that were run since, and those that it knew and that are gone."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import date, datetime
from functools import cached_property

import numpy as np

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.earlier import Earlier, RemovedTest, trial_of
from crashfuse.certification.track_record import Trial
from crashfuse.certification.verdict import Verdict, reaches
from crashfuse.execution.cache import Cache
from crashfuse.signals.metrics import OCCUPANT_METRICS, metric_values

SHIFTED = ("delta_v", "max_crush", "mean", "olc", "vpi", "esw")
"""Metrics of which a CAE model knows how they change within 1 km/h and 2 % (``benchmarks/off_condition.py``)."""


@dataclass(frozen=True, eq=False)
class TestedSince:
    """What a campaign's tests have to say of an earlier certification of the same vehicle."""

    __test__ = False  # no test of ours, whatever its name begins with

    earlier: Earlier
    campaign: Campaign

    @cached_property
    def _digests(self) -> dict[str, str]:
        return {test.id: test.digest for test in self.campaign.tests}

    @cached_property
    def new(self) -> tuple[str, ...]:
        """Tests that it did not know, neither by their record nor by their id."""
        known = {*self.earlier.tests, *self.earlier.tests.values()}
        return tuple(test for test, digest in self._digests.items() if not {test, digest} & known)

    @cached_property
    def changed(self) -> tuple[str, ...]:
        """Tests that it had learned from with another record."""
        known = set(self.earlier.tests.values())
        return tuple(test for test, own in self._digests.items() if test in self.earlier.tests and own not in known)

    @cached_property
    def gone(self) -> tuple[str, ...]:
        """Tests that it learned from and that are not used any more."""
        known = {*self._digests.values(), *(self.earlier.tests[test] for test in self.changed)}
        return tuple(test for test, digest in self.earlier.tests.items() if digest not in known)

    @cached_property
    def made_for(self) -> dict[str, str]:
        """The condition then that a new test was made for, by test."""
        return self.earlier.matrix.made_for((test, self.campaign.test(test).condition) for test in self.new)

    @property
    def at(self) -> dict[str, str]:
        """The same of tests that tell whether verdicts came true."""
        return {test: i for test, i in self.made_for.items() if i not in self.earlier.run}

    @property
    def repeats(self) -> dict[str, str]:
        """The same of tests that repeat one that it knew."""
        return {test: i for test, i in self.made_for.items() if i in self.earlier.run}

    @property
    def elsewhere(self) -> tuple[str, ...]:
        """New tests at none of its conditions."""
        return tuple(test for test in self.new if test not in self.made_for)

    def is_off(self, test_id: str) -> bool:
        """Whether a test was made for a condition, but not quite there."""
        planned = dict(self.earlier.matrix.items)[self.made_for[test_id]]
        return not self.campaign.test(test_id).condition.is_at(planned)

    @cached_property
    def shown(self) -> dict[str, dict[str, float | None]]:
        """Metrics of each test that tells, by the occupant model of then, without shifts."""
        then = replace(self.campaign, occupant=self.earlier.occupant)
        return {
            test: {
                metric.name: None if metric.value is None else metric.value - self.shift(test, metric.name)
                for metric in then.metrics_of(then.test(test))
            }
            for test in self.at
        }

    def shift(self, test_id: str, metric: str) -> float:
        """How much more a test shows than at its condition, by the CAE model; 0 if it is there."""
        return self._shifts.get(test_id, {}).get(metric, 0.0)

    @cached_property
    def _shifts(self) -> dict[str, dict[str, float]]:
        # by the emulator at both conditions, so that what is wrong in it is wrong in both
        off, planned = [test for test in self.at if self.is_off(test)], dict(self.earlier.matrix.items)
        if not off or not len(self.campaign.cae):
            return {}
        emulator = CaeModel(cache=Cache()).fit(self.campaign.cae).emulator_
        found = {}
        for test in off:
            there, here = (
                metric_values(emulator.predict(condition), condition.speed_mps, occupant=self.earlier.occupant)
                for condition in (self.campaign.test(test).condition, planned[self.at[test]])
            )
            shifts = {metric: float(there[metric] - here[metric]) for metric in SHIFTED}
            found[test] = {metric: shift for metric, shift in shifts.items() if np.isfinite(shift)}
        return found

    @cached_property
    def latest(self) -> tuple[Trial, ...]:
        """The earlier verdicts on metrics of tests that tell."""
        conditions, rows = dict(self.earlier.matrix.items), self.earlier.rows
        given = self.earlier.date, self.earlier.sealed
        return tuple(
            replace(
                trial_of(test, conditions[i], criterion, said, value, self.shift(test, criterion.metric)), given=given
            )
            for test, i in self.at.items()
            for criterion, said in zip(self.earlier.criteria.items, rows[i], strict=True)
            if (value := self.shown[test].get(criterion.metric)) is not None
        )

    @cached_property
    def is_older(self) -> dict[str, bool | None]:
        """Whether its verdict is older than each test, by the dates of both; None if one has none."""
        dates = {test.id: dict(test.about).get("about_date", "") for test in self.campaign.tests}
        older: dict[str, bool | None] = {}
        for trial in self.all_trials:
            older[trial.held_out] = None
            with suppress(ValueError):
                verdict, test = trial.given[0][:10], dates.get(trial.held_out, "")
                older[trial.held_out] = date.fromisoformat(verdict) < datetime.fromisoformat(test).date()
        return older

    @property
    def all_trials(self) -> tuple[Trial, ...]:
        """The same after those of certifications before it: certifying twice forgets nothing that was wrong once."""
        return *self.earlier.trials, *self.latest

    def trials(self, criteria: Criteria) -> tuple[Trial, ...]:
        """Those on metrics of these criteria; open if given with less confidence than is asked for today."""
        metrics = {criterion.metric for criterion in criteria.items}
        return tuple(
            replace(trial, verdict=_as_of_today(trial.verdict, criteria.confidence))
            for trial in self.without_tuned(self.all_trials)
            if trial.verdict.criterion.metric in metrics
        )

    def without_tuned(self, trials: Sequence[Trial]) -> tuple[Trial, ...]:
        """Those that count: of tests that the CAE model was tuned to, only what was wrong."""
        return tuple(trial for trial in trials if trial.wrong or trial.held_out not in self.tuned)

    @cached_property
    def tuned(self) -> frozenset[str]:
        """Tests that the CAE model was tuned to."""
        return frozenset(test.id for test in self.campaign.tests if test.cae_tuned)

    @cached_property
    def gone_runs(self) -> tuple[RemovedTest, ...]:
        """Records of tests at its or earlier conditions that are gone, unless all are filtered otherwise."""
        used = set(self._digests.values())
        refiltered = not used & set(self.earlier.tests.values())
        changed: Sequence[str] = self.changed if refiltered else ()
        other = OCCUPANT_METRICS if self.campaign.occupant != self.earlier.occupant else ()
        return tuple(
            replace(test, measured={name: value for name, value in test.measured.items() if name not in other})
            for test in self.earlier.records
            if test.digest not in used and test.test not in changed
        )


def _as_of_today(verdict: Verdict, confidence: float) -> Verdict:
    p = verdict.probability
    sure = p is not None and reaches(max(p, 1 - p), confidence)
    return verdict if sure or not verdict.decided else replace(verdict, word="open")
