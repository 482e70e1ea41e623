"""Certification as commands, pages and scripts call it: files, mappings or tables in."""

from dataclasses import replace

from crashfuse.campaign import Campaign
from crashfuse.certification.certify import APPROACH, Certification, certify_matrix, without_each_test
from crashfuse.certification.criteria import COSTS, CriteriaGiven, criteria_given, with_costs
from crashfuse.certification.matrix import MatrixGiven, matrix_given
from crashfuse.errors import UsageError, require_a, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.workers import running
from crashfuse.study.config import StudyConfig


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
