"""Certification of a campaign: a verdict for every condition and criterion, and the record of left-out tests."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Literal, NamedTuple, Self, Unpack, cast

import numpy as np

from crashfuse import views
from crashfuse.approaches.mixture import AboutFused
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification import seal
from crashfuse.certification.criteria import WINDOW_MS, Criteria, CriteriaGiven, criteria_given, varied, with_costs
from crashfuse.certification.domain import Domain
from crashfuse.certification.earlier import COMPARED, Earlier, LaterTests, compared, read_earlier, recorded
from crashfuse.certification.forecasts import SEEDS, Plan
from crashfuse.certification.matrix import Matrix, MatrixGiven, matrix_given
from crashfuse.certification.track_record import TrackRecord, left_out_tests
from crashfuse.certification.verdict import WORDS, AllMet, Verdict, Word, all_met, judge, needs_no_test
from crashfuse.condition import Condition
from crashfuse.errors import UsageError, require_a, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run, RunOptions
from crashfuse.execution.workers import running
from crashfuse.study.config import StudyConfig, check_window
from crashfuse.study.outliers import departures_near
from crashfuse.units import Sentence, probability_text, read_out

if TYPE_CHECKING:
    import pandas as pd

APPROACH = AboutFused.name  # whose predictions are judged if no other is asked for
_LEARN, _JUDGE = "Left-out tests", "Planned tests"  # steps
Rows = tuple[tuple[Verdict, ...], ...]
Answer = Literal["was run", "skip", "run", "would miss", "cannot say"]
"""The first that is true: a test was made for it; it would meet all criteria at once, and skipping pays; it would miss
one; a test or another design can tell, or skipping it does not pay; it was not checked, or records end too early."""


class Variant(NamedTuple):
    """The answers if something is other, earlier verdicts aside: both, where they differ."""

    name: str
    saved: tuple[int, int]
    changed: Mapping[str, tuple[Answer, Answer]]
    left_out: str = ""  # the test without which all was computed again, if one was

    @classmethod
    def of(cls, name: str, usual: Certification, other: Certification) -> Self:
        """Compare two certifications of the same conditions."""
        pairs = {i: (answer, other.answers[i]) for i, answer in usual.answers.items()}
        left_out = " ".join(test for test in usual.campaign.test_ids if test not in other.campaign.test_ids)
        return cls(name, other.saved, {i: pair for i, pair in pairs.items() if pair[0] != pair[1]}, left_out)


@dataclass(frozen=True, eq=False)
class Certification:
    """Verdicts on a matrix, by condition, then by criterion."""

    campaign: Campaign
    criteria: Criteria
    matrix: Matrix
    config: StudyConfig  # with one approach, whose predictions were judged, and the windows of the criteria
    domain: Domain
    judged: Rows  # as the prediction alone has them
    verdicts: Rows  # held against the record and against tests at the condition, open where these contradict
    record: TrackRecord
    seconds: dict[str, float]  # to learn, leaving tests out included, and to judge the matrix
    since: LaterTests | None = None  # an earlier certification, with what tests that were run after it say of it
    variants: tuple[Variant, ...] = ()  # other limits and confidences, and without each test if asked for
    key: str = ""  # that seals its files, if one does
    # by the first seed, its error not counted, each test with its paired CAE run; None where the record has these, too
    record_with_runs: TrackRecord | None = None
    # by condition inside the domain that no test was made for: the probability that a pulse there passes a spot check
    spot_checks: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        counts = ", ".join(f"{n} {word}" for word, n in self.n_by_word.items() if n)
        n = len(self.matrix.ids)
        return f"<Certification of {self.campaign.name!r}, {n} condition{'s' * (n > 1)}: {counts}>"

    def _repr_html_(self) -> str:
        return views.result_html(views.certification_result(self))

    @property
    def table(self) -> pd.DataFrame:
        """One row a condition and criterion, as ``certification.csv``."""
        return views.certification_table(self)

    @property
    def track_record(self) -> pd.DataFrame:
        """One row a left-out test and criterion, as ``track_record.csv``."""
        return views.track_record_table(self)

    @property
    def credibility(self) -> pd.DataFrame:
        """One row a factor of ASME V&V 40, as ``credibility.csv``."""
        return views.credibility_table(self)

    @property
    def counts(self) -> pd.DataFrame:
        """Number of verdicts of each kind, one row a criterion."""
        return views.counts_frame(self)

    def draw(self, figure: str = "verdicts", **display: Unpack[views.DisplayOptions]) -> views.Drawing:
        """A figure of the page Certify.

        Parameters
        ----------
        figure : {"verdicts", "planned", "record", "reliability", "domain"}
            The verdicts in colours, conditions by criteria; how close to the limits; what left-out tests were predicted
            to show and showed; how often probabilities came true; where predictions are checked.
        """
        return views.certification_figure(self, figure, **display)

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def write(self, folder: str | Path, *, notes: Sequence[Note] = (), **display: Unpack[views.DisplayOptions]) -> None:
        """Write what ``crashfuse certify`` writes; with notes in the report."""
        for note in notes:
            require_a(Note, note, "crashfuse.Note(test, text)")
        shown = views.Display.of(self.campaign.units, **display)
        views.write_result(views.certification_result(self, notes), folder, shown)

    def beside(self, earlier: Earlier | str | Path) -> Self:
        """The same held against an earlier one, or its file or folder; a DataError if that is another vehicle's."""
        earlier = earlier if isinstance(earlier, Earlier) else read_earlier(Path(earlier))
        earlier.require_of(self.campaign)
        since = LaterTests(earlier, self.campaign)
        record = replace(self.record, since=since.held_against(self.criteria))
        verdicts = _hold(self.judged, self.campaign, self.criteria, record)
        return replace(self, verdicts=verdicts, record=record, since=since)

    def without(self, test: str) -> Campaign:
        """The campaign as if a test had not been run, by :meth:`Plan.without`."""
        return Plan.of(self.campaign, self.criteria, self.matrix, self.config, Run.of(self.campaign)).without(test)

    @cached_property
    def rows(self) -> dict[str, tuple[Verdict, ...]]:
        """The verdicts of each condition, by its id."""
        return dict(zip(self.matrix.ids, self.verdicts, strict=True))

    @property
    def cells(self) -> tuple[tuple[str, Verdict], ...]:
        """All verdicts, each with the id of its condition."""
        return tuple((i, verdict) for i, row in self.rows.items() for verdict in row)

    @property
    def n_by_word(self) -> dict[Word, int]:
        """Number of verdicts of each kind."""
        words = [verdict.word for _, verdict in self.cells]
        return {word: words.count(word) for word in WORDS}

    @property
    def run(self) -> dict[str, tuple[str, ...]]:
        """The tests made for a condition, by its id; of conditions with any."""
        return {i: tuple(row[0].run) for i, row in self.rows.items() if row[0].run}

    @cached_property
    def answers(self) -> dict[str, Answer]:
        """The answer at each condition, by its id."""
        return {i: self._answer(i, row) for i, row in self.rows.items()}

    def _answer(self, i: str, row: tuple[Verdict, ...]) -> Answer:
        words = {verdict.word for verdict in row}
        if row[0].run:
            return "was run"
        if words == {"met"}:
            return "skip" if i in self.sure and not self.skipping_loses else "run"
        if "not met" in words:
            return "would miss"
        decidable = any(verdict.word == "open" and verdict.probability is not None for verdict in row)
        return "run" if decidable else "cannot say"

    @cached_property
    def sure(self) -> tuple[str, ...]:
        """Conditions, not run, that would meet all criteria at once."""
        confidence = self.criteria.confidence
        return tuple(i for i, row in self.rows.items() if not row[0].run and needs_no_test(row, confidence))

    @cached_property
    def cautious_saving(self) -> float | None:
        """Saving by each skipped test if as many answers are wrong as the record allows; None without costs."""
        costs, most = self.criteria.costs, self.record.bounds()["tests"].at_most
        return None if costs is None or most is None else costs.saving(most)

    @property
    def skipping_loses(self) -> bool:
        """Whether that is a loss."""
        return self.cautious_saving is not None and self.cautious_saving < 0

    @cached_property
    def waived(self) -> dict[str, AllMet]:
        """Conditions to be skipped, with :func:`all_met` of each."""
        return self._all_met("skip")

    @property
    def uncertain(self) -> dict[str, AllMet]:
        """Conditions that take a test though each criterion is met; as ``waived``."""
        return self._all_met("run")

    def _all_met(self, answer: Answer) -> dict[str, AllMet]:
        met = {i for i, row in self.rows.items() if all(verdict.word == "met" for verdict in row)}
        return {i: all_met(self.rows[i]) for i, own in self.answers.items() if own == answer and i in met}

    @cached_property
    def counted_once(self) -> dict[str, str]:
        """:meth:`Matrix.alike`: those that still take a test stand for others, then those run."""
        settled = ("was run", "skip")
        return self.matrix.alike([i for i, answer in self.answers.items() if answer not in settled], list(self.run))

    @property
    def saved(self) -> tuple[int, int]:
        """How many tests need not be run, and of how many."""
        n = len(self.matrix.ids) - len(self.counted_once)
        return len(self.waived.keys() - self.counted_once.keys()), n

    @property
    def run_first(self) -> str | None:
        """The fastest of two or more conditions that a test can settle; or None."""
        speeds = {}
        for i, answer in self.answers.items():
            if answer == "run" and all(v.word != "open" or v.probability is not None for v in self.rows[i]):
                speeds[i] = self.rows[i][0].condition.speed_mps
        return max(speeds, key=lambda i: (speeds[i], i)) if len(speeds) > 1 else None


def certify(
    campaign: Campaign,
    criteria: CriteriaGiven,
    matrix: MatrixGiven,
    *,
    confidence: float | None = None,
    costs: tuple[float, float] | None = None,
    robustness: bool = False,
    approach: str = APPROACH,
    config: StudyConfig = StudyConfig(),
    **run: Unpack[RunOptions],
) -> Certification:
    """Judge acceptance criteria at every condition of a matrix, and the record of the tests, left out in turn.

    Parameters
    ----------
    criteria : path, DataFrame, mapping or sequence of mappings, or Criteria
        ``criteria.toml``, or its tables, one row each in a frame: name, metric, window_ms, at_least, at_most.
    matrix : path, DataFrame or Matrix
        ``matrix.csv``, or its columns: id, speed, weights, factors, each name ending in its unit.
    confidence : float, optional
        Of criteria given as mappings or rows; else as the costs ask for, or 0.95.
    costs : (float, float), optional
        Of a test and of a wrong answer, in one currency, in place of those of the criteria.
    robustness : bool
        Whether to judge without each test, too.
    approach : str
        Whose predictions are judged.
    config : StudyConfig
        Preset, seed and device; its approaches do not matter.
    **run
        See :class:`crashfuse.execution.run.RunOptions`.

    Raises
    ------
    DataError, UsageError
        If the criteria or the matrix are wrong, or the campaign cannot be judged by them.
    """
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    require_a(StudyConfig, config, "crashfuse.StudyConfig()")
    require_a(bool, robustness, "robustness=True judges without each test, too")
    conditions, limits = matrix_given(matrix, campaign.factors), criteria_given(criteria, confidence)
    if costs is not None and len(several(costs)) != 2:
        raise UsageError("Costs are that of a test and that of a wrong answer, such as (60_000, 1_200_000).")
    limits = limits if costs is None else with_costs(limits, dict(zip(("test", "wrong_answer"), costs, strict=True)))
    config = replace(config, approaches=(approach,))
    with running(campaign, **run) as started:
        certification = certify_matrix(campaign, limits, conditions, config, started)
        return without_each_test(certification, started) if robustness else certification


def certify_matrix(
    campaign: Campaign,
    criteria: Criteria,
    matrix: Matrix,
    config: StudyConfig = StudyConfig(approaches=(APPROACH,)),
    run: Run | None = None,
) -> Certification:
    """Judge every criterion at every condition by the first approach, and keep the record of tests, left out in turn.

    Forecasts are cached: other limits take no time. Raises a UsageError without tests, a DataError if a record is
    shorter than the window of a rating.
    """
    run = run or Run.of(campaign)
    campaign = run.bind(campaign)
    if not campaign.tests:
        raise UsageError("A verdict takes a test at least; this campaign has none.")
    windows_ms = criteria.windows_ms or (WINDOW_MS,)
    config = replace(config, approaches=config.approaches[:1], seed=SEEDS[0], windows_ms=windows_ms, leave_out="both")
    config.check()
    for window in criteria.windows_ms:
        for test in campaign.tests:
            check_window(test, window)
    plan = Plan.of(campaign, criteria, matrix, config, run)
    forecasts, start = plan.forecasts, time.perf_counter()
    at_trials = forecasts.averaged(plan.trials, _LEARN, learn_for=plan.cells)
    with_runs = forecasts.all(plan.with_runs, _LEARN)
    learned = time.perf_counter()
    at_cells = plan.widened(forecasts.averaged(plan.cells, _JUDGE), criteria.tolerances)
    seconds = {"learn": learned - start, "judge": time.perf_counter() - learned}
    domain, tests_run = Domain.of(campaign), matrix.run((test.id, test.condition) for test in campaign.tests)
    asked = campaign, criteria, plan.splits, config.approaches[0]
    left_out, left_out_with_runs = ([*left_out_tests(*asked, own)] for own in (at_trials, at_trials | with_runs))

    def by(criteria: Criteria, *, is_variant: bool = True) -> Certification:
        record = TrackRecord.of_tests(criteria, left_out)
        flattered = TrackRecord.of_tests(criteria, left_out_with_runs) if with_runs else None
        judged = tuple(
            judge(at_cells[cell], at, criteria, domain.outside(at), tests, domain.unshown(at))
            for cell, at, tests in zip(plan.cells, matrix.conditions, tests_run, strict=True)
        )
        if not is_variant:
            pairs = zip(plan.cells, judged, strict=True)
            judged = tuple(tuple(v.with_interval(at_cells[cell]) for v in row) for cell, row in pairs)
        verdicts = _hold(judged, campaign, criteria, record)
        found = Certification(campaign, criteria, matrix, config, domain, judged, verdicts, record, seconds)
        return replace(found, record_with_runs=flattered)

    checks = {
        i: float(np.mean(chances))
        for (i, at), cell, tests in zip(matrix.items, plan.cells, tests_run, strict=True)
        if not (tests or domain.outside(at) or domain.unshown(at))
        and (chances := at_cells[cell].chances(criteria.spot_check))
    }
    found = replace(by(criteria, is_variant=False), spot_checks=checks)
    return replace(found, variants=tuple(Variant.of(name, found, by(own)) for name, own in varied(criteria).items()))


def without_each_test(certification: Certification, run: Run) -> Certification:
    """The certification with the variants that lack a test."""
    asked = certification.criteria, certification.matrix, certification.config, run
    tests = certification.campaign.test_ids if len(certification.campaign.tests) > 1 else ()
    others = {f"without {i}": certify_matrix(certification.without(i), *asked) for i in tests}
    added = (Variant.of(name, certification, other) for name, other in others.items())
    return replace(certification, variants=(*certification.variants, *added))


def recompute(folder: str | Path, campaign: Campaign, **run: Unpack[RunOptions]) -> pd.DataFrame:
    """Certify again by the settings in a folder that ``crashfuse certify`` wrote, and compare each value.

    Tests run since are put aside. Without a ``cache`` nothing kept before is believed.

    Returns
    -------
    DataFrame
        file, place, recorded, recomputed, and agreement: ``to the last digit``, ``within rounding`` (1e-5 of the
        value), ``not``, or ``not derived``, such as of the date.

    Raises
    ------
    DataError
        If it is no certification of this campaign as it is.
    """
    import pandas as pd

    earlier, config, campaign = recorded(folder := Path(folder), campaign)
    with TemporaryDirectory() as kept, running(campaign, **(RunOptions(cache=Cache(Path(kept))) | run)) as started:
        again = certify_matrix(campaign, earlier.criteria, earlier.matrix, config, started)
        record = replace(again.record, since=LaterTests(earlier, campaign).held_against(again.criteria))
        again = replace(again, verdicts=_hold(again.judged, again.campaign, again.criteria, record), record=record)
        made = views.certification_result(again).files
        pairs = {name: (seal.read(folder / name, "this file"), cast(bytes, made[name]())) for name in COMPARED}
        rows = [row for name, pair in pairs.items() for row in compared(name, *pair)]
    return pd.DataFrame(rows, columns=["file", "place", "recorded", "recomputed", "agreement"])


def is_computed(campaign: Campaign, criteria: Criteria, matrix: Matrix, config: StudyConfig) -> bool:
    """Whether the cache has every forecast that a certification takes."""
    config = replace(config, approaches=config.approaches[:1])
    plan = Plan.of(campaign, criteria, matrix, config, Run.of(campaign))
    return all(map(plan.forecasts.is_known, plan.with_runs)) and plan.forecasts.are_known((*plan.cells, *plan.trials))


def _hold(judged: Rows, campaign: Campaign, criteria: Criteria, record: TrackRecord) -> Rows:
    supports = {criterion: record.support(criterion) for criterion in criteria.items}

    def held(verdict: Verdict, apart: Sequence[str]) -> Verdict:
        support = supports[verdict.criterion]
        if verdict.decided and (shortfall := support.shortfall(criteria.confidence)):
            verdict = verdict.with_reason(shortfall, contradicted=True)
        elif verdict.decided and (reservation := support.reservation(criteria.confidence)):
            verdict = verdict.with_reason(reservation)
        if verdict.run:
            verdict = verdict.beside_tests(*_measured(verdict, record))
        if apart:
            may = Sentence("another test may come out as it did.")
            if verdict.folds:
                alike, otherwise = (probability_text(share, criteria.confidence) for share in verdict.folds)
                which = "{} either way." if alike == otherwise else "{} if a test comes out as it did, else {}."
                may = Sentence(f"met with probability {which}", otherwise, alike)
            verdict = verdict.with_reason(Sentence("{} stands apart at about this speed: {}", read_out(apart), may))
        return verdict

    apart = ([departure.test for departure in departures_near(campaign, row[0].condition)] for row in judged)
    return tuple(tuple(held(verdict, tests) for verdict in row) for row, tests in zip(judged, apart, strict=True))


def _measured(verdict: Verdict, record: TrackRecord) -> tuple[dict[str, float | None], dict[str, Condition]]:
    alone = (trial for trial in (*record.trials, *record.tuned) if trial.left_out == "test")
    trials = {t.held_out: t for t in alone if t.held_out in verdict.run and t.verdict.criterion == verdict.criterion}
    off = {i: t.verdict.condition for i, t in trials.items() if not t.verdict.condition.is_at(verdict.condition)}
    return {test: trials[test].measured if test in trials else None for test in verdict.run}, off
