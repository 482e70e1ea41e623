"""Certification as commands, pages and scripts call it: files, mappings or tables in, tables and figures out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Unpack

from crashfuse.campaign import Campaign
from crashfuse.certification.certify import APPROACH, Answer, Certification, certify_matrix, without_each_test
from crashfuse.certification.criteria import COSTS, CriteriaGiven, criteria_given, with_costs
from crashfuse.certification.matrix import MatrixGiven, matrix_given
from crashfuse.certification.verdict import Verdict
from crashfuse.condition import Condition
from crashfuse.errors import UsageError, one_of, require_a, several
from crashfuse.execution.cache import Cache, remembered
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.workers import running
from crashfuse.results import certification_tables as tables
from crashfuse.results.certification_facts import new_together, unused_at
from crashfuse.results.display import Display, DisplayOptions
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots.certification import record_figure, reliability, validated_domain, verdict_matrix
from crashfuse.results.render.notebook import card, facts_words
from crashfuse.results.table import CONDITION, Table, of_condition
from crashfuse.study.config import StudyConfig
from crashfuse.study.outliers import departures_near
from crashfuse.units import Sentence, joined, read_out

FIGURES: Mapping[str, Callable[[Certification, Display], Drawing]] = {
    "verdicts": verdict_matrix,
    "record": lambda own, display: record_figure(own.record, own.criteria.items, display),
    "reliability": lambda certification, _: reliability(certification.record),
    "domain": validated_domain,
}


def certification_figure(certification: Certification, figure: str, **display: Unpack[DisplayOptions]) -> Drawing:
    """A figure of a certification, as :meth:`Certification.plot` has them."""
    shown = Display.of(certification.campaign.units, **display)
    return one_of("figure of verdicts", figure, FIGURES)(certification, shown)


def certification_html(certification: Certification) -> str:
    """A certification in a notebook."""
    display = Display(system=certification.campaign.units)
    table = tables.SHOWN["verdicts"](certification, display).without("Reason")
    return card(repr(certification)[1:-1], table, facts_words(certification.campaign, display), display)


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
    cache: Cache | None = None,
    watch: Watch = SILENT,
    workers: int | None = None,
    scheduler: str | None = None,
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
        Whether to judge without each test, too. It computes all of it again.
    approach : str
        Whose predictions are judged.
    config : StudyConfig
        Preset, seed and device; its approaches do not matter.
    workers, scheduler
        As in :func:`crashfuse.study.running.run_study`.

    Raises
    ------
    DataError, UsageError
        If the criteria or the matrix are wrong, or the campaign cannot be judged by them.
    """
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    require_a(StudyConfig, config, "crashfuse.StudyConfig()")
    require_a(bool, robustness, "robustness=True judges without each test, too")
    conditions, limits = matrix_given(matrix, campaign.factors), criteria_given(criteria, confidence)
    if costs is not None and len(several(costs)) != len(COSTS):
        raise UsageError("Costs are that of a test and that of a wrong answer, such as (60_000, 1_200_000).")
    limits = limits if costs is None else with_costs(limits, dict(zip(COSTS, costs, strict=True)))
    config = replace(config, approaches=(approach,))
    with running(campaign, cache, watch, workers, scheduler) as run:
        certification = certify_matrix(campaign, limits, conditions, config, run)
        return without_each_test(certification, run) if robustness else certification


class Planned(NamedTuple):
    """A planned test: the answer, and what decides it."""

    id: str
    condition: Condition
    word: Answer
    why: Sentence


@remembered  # asked for by three parts of a page
def planned(certification: Certification) -> tuple[Planned, ...]:
    """The answer at every planned test, in the order of speed."""
    domain, unused, together = certification.domain, unused_at(certification), new_together(certification)
    rows = []
    for i, condition in sorted(certification.matrix.items, key=lambda item: item[1].speed_mps):
        given = {name for name, value in condition.factors if value}
        why = [_why(certification, i), *(f"{name} not given" for name in domain.factors if name not in given)]
        if i in together:
            why.append(f"{together[i]} in no test together")
        if apart := [departure.test for departure in departures_near(certification.campaign, condition)]:
            why.append(f"{read_out(apart)} stands apart there")
        if i in unused:
            why.append(f"run as {read_out(unused[i])}, not used")
        if i in certification.counted_once:
            why.append(f"counts as {certification.counted_once[i]}")
        rows.append(Planned(i, condition, certification.answers[i], joined(why, "; ")))
    return tuple(rows)


def planned_table(certification: Certification, _: Display) -> Table:
    """The same as a table for readers."""
    rows = (
        {"Planned test": own.id, **of_condition(own.condition), "Answer": own.word, "Why": own.why}
        for own in planned(certification)
    )
    return Table.of("planned tests", rows, *CONDITION)


def _why(certification: Certification, i: str) -> str:
    answer, row = certification.answers[i], certification.rows[i]
    if answer == "was run":
        return _tests_there(certification, row)
    if answer == "skip" or i in certification.uncertain:
        return tables.at_once_text(certification, i)
    if answer == "cannot say" and any(verdict.word == "outside" for verdict in row):
        return "outside what the tests check"
    template = {"would miss": "misses {}", "run": "open: {}", "cannot say": "records too short for {}"}[answer]
    word, unknown = "not met" if answer == "would miss" else "open", answer == "cannot say"
    return template.format(
        ", ".join(v.criterion.name for v in row if v.word == word and (v.probability is None) is unknown)
    )


def _tests_there(certification: Certification, row: Sequence[Verdict]) -> str:
    tests = []
    for test_id in row[0].run:
        test = certification.campaign.test(test_id)
        parts: list[str] = [f"test {test_id}"]
        if not test.condition.is_at(row[0].condition):
            parts.append(Sentence("at {}", test.condition))
        shown = [(verdict.criterion, verdict.run[test_id]) for verdict in row]
        if missed := [criterion.name for criterion, v in shown if v is not None and not criterion.is_met_by(v)]:
            parts.append(f"which missed {', '.join(missed)}")
        if test.faults:
            parts.append(Sentence("in doubt as {}", joined([fault.text for fault in test.faults], "; ")))
        tests.append(joined(parts, ", "))
    unsettled = ", ".join(verdict.criterion.name for verdict in row if verdict.word == "open")
    return joined([*tests, *([f"open: {unsettled}"] if unsettled else [])], "; ")
