"""Tests beside an earlier certification: verdicts given before they were run, and tests that are gone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.earlier import Earlier, RemovedTest, trial_of
from crashfuse.certification.track_record import Trial
from crashfuse.certification.verdict import Verdict, reaches
from crashfuse.execution.run import Run
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
        """The condition then that a new test was made for, by test; where it knew a test there, it is a repeat."""
        return self.earlier.matrix.made_for((test, self.campaign.test(test).condition) for test in self.new)

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Verdicts on metrics of tests that were run later, by the occupant model of then.

        First those of certifications before it: certifying twice forgets nothing that was wrong once.
        """
        then, found = replace(self.campaign, occupant=self.earlier.occupant), list(self.earlier.trials)
        for test, condition in self._at.items():
            shown = {metric.name: metric.value for metric in then.metrics_of(then.test(test))}
            shifts = self._shifts(test, condition)
            for criterion, said in zip(self.earlier.criteria.items, self.earlier.rows[condition], strict=True):
                if (value := shown.get(criterion.metric)) is not None:  # none of a rating
                    shift, planned = shifts.get(criterion.metric, 0.0), dict(self.earlier.matrix.items)[condition]
                    found.append(trial_of(test, planned, criterion, said, value - shift, shift))
        return tuple(found)

    @property
    def counted(self) -> tuple[Trial, ...]:
        """Those that count: of tests that the CAE model was tuned to, only what was wrong."""
        return tuple(trial for trial in self.trials if trial.wrong or trial.held_out not in self._tuned)

    @property
    def with_intervals(self) -> tuple[Trial, ...]:
        """Those whose intervals count: of tuned tests, only what they missed."""
        return tuple(t for t in self.trials if t.wrong or not t.held or t.held_out not in self._tuned)

    def held_against(self, criteria: Criteria) -> tuple[Trial, ...]:
        """Those on metrics of these criteria; open if given with less confidence than is asked for today."""
        metrics = {criterion.metric for criterion in criteria.items}
        return tuple(
            replace(trial, verdict=_as_of_today(trial.verdict, criteria.confidence))
            for trial in self.counted
            if trial.verdict.criterion.metric in metrics
        )

    @property
    def waived(self) -> dict[str, bool]:
        """Tests run where none was needed, and whether each missed a criterion; without those that cannot tell."""
        found = dict(self.earlier.waived_before)
        for test, condition in self._at.items():
            if condition in self.earlier.waived:
                own = [trial for trial in self.trials[len(self.earlier.trials) :] if trial.held_out == test]
                missed, are_all = any(trial.wrong for trial in own), len(own) == len(self.earlier.criteria.items)
                if missed or (are_all and test not in self._tuned):
                    found[test] = missed
        return found

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

    @property
    def _at(self) -> dict[str, str]:
        return {test: condition for test, condition in self.made_for.items() if condition not in self.earlier.run}

    @cached_property
    def _tuned(self) -> frozenset[str]:
        return frozenset(test.id for test in self.campaign.tests if test.cae_tuned)

    def _shifts(self, test: str, condition: str) -> dict[str, float]:
        """How much more a test shows than at its condition, by the emulator at both."""
        planned, run = dict(self.earlier.matrix.items)[condition], self.campaign.test(test).condition
        if run.is_at(planned) or not len(self.campaign.cae):
            return {}
        emulator = CaeModel().fit(self.campaign.cae, Run.of(self.campaign)).emulator_
        there, here = (
            metric_values(emulator.predict(at), at.speed_mps, occupant=self.earlier.occupant) for at in (run, planned)
        )
        shifts = {metric: float(there[metric] - here[metric]) for metric in SHIFTED}
        return {metric: shift for metric, shift in shifts.items() if np.isfinite(shift)}


def _as_of_today(verdict: Verdict, confidence: float) -> Verdict:
    p = verdict.probability
    sure = p is not None and reaches(max(p, 1 - p), confidence)
    return verdict if sure or not verdict.decided else replace(verdict, word="open")
