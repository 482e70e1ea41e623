"""Certification as commands, pages and scripts call it: files, mappings or tables in, tables and figures out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, Unpack

import pandas as pd
import plotly.graph_objects as go

from crashfuse import views
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import APPROACH, Certification, certify_matrix, without_each_test
from crashfuse.certification.criteria import COSTS, CriteriaGiven, criteria_given, with_costs
from crashfuse.certification.earlier import read_earlier
from crashfuse.certification.matrix import MatrixGiven, matrix_given
from crashfuse.errors import UsageError, one_of, require_a, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.reporting import certification_tables as tables
from crashfuse.reporting.credibility import credibility_table
from crashfuse.reporting.notebook import card, facts_words
from crashfuse.reporting.plots.certification import record_figure, reliability, validated_domain, verdict_matrix
from crashfuse.reporting.plots.display import Display, DisplayOptions
from crashfuse.study.config import StudyConfig


@dataclass(frozen=True, eq=False, repr=False)
class Verdicts:
    """Verdicts of a certification as tables; ``certification`` has them as objects."""

    certification: Certification

    @property
    def table(self) -> pd.DataFrame:
        """One row a condition and criterion, as ``certification.csv``."""
        return tables.certification_table(self.certification)

    @property
    def track_record(self) -> pd.DataFrame:
        """One row a left-out test and criterion, as ``track_record.csv``."""
        return tables.track_record_table(self.certification)

    @property
    def credibility(self) -> pd.DataFrame:
        """One row a factor of ASME V&V 40, as ``credibility.csv``."""
        return credibility_table(self.certification)

    @property
    def counts(self) -> pd.DataFrame:
        """Number of verdicts of each kind, one row a criterion."""
        return tables.counts_frame(self.certification)

    def beside(self, earlier: str | Path) -> Self:
        """The verdicts held against an earlier certification, by its file or folder; a DataError if that is none."""
        return replace(self, certification=self.certification.beside(read_earlier(Path(earlier))))

    def since(self, earlier: str | Path) -> pd.DataFrame:
        """Verdicts that were given before their tests were run, as in ``track_record.csv``."""
        return self.beside(earlier).track_record.query("left_out == 'planned'")

    def write(
        self,
        folder: str | Path,
        *,
        since: str | Path | None = None,
        notes: Sequence[Note] = (),
        **display: Unpack[DisplayOptions],
    ) -> None:
        """Write what ``crashfuse certify`` writes; with :meth:`since` and with notes in the report."""
        for note in notes:
            require_a(Note, note, "crashfuse.Note(test, text)")
        shown = Display.of(self.certification.campaign.units, **display)
        beside = self if since is None else self.beside(since)
        views.write_result("certification", folder, beside.certification, shown, notes)

    def plot(self, figure: str = "verdicts", **display: Unpack[DisplayOptions]) -> go.Figure:
        """A figure of the page Certify.

        Parameters
        ----------
        figure : {"verdicts", "record", "reliability", "domain"}
            The verdicts in colours, conditions by criteria; what left-out tests were predicted to show and showed; how
            often probabilities came true; where predictions are checked.
        """
        shown = Display.of(self.certification.campaign.units, **display)
        return one_of("figure of verdicts", figure, FIGURES)(self.certification, shown)

    def __repr__(self) -> str:
        counts = ", ".join(f"{n} {word}" for word, n in self.certification.counts.items() if n)
        n = len(self.certification.matrix.ids)
        return f"<Verdicts on {n} condition{'s' * (n > 1)} of {self.certification.campaign.name!r}: {counts}>"

    def _repr_html_(self) -> str:
        display = Display(system=self.certification.campaign.units)
        table = tables.SHOWN["verdicts"](self.certification, display).without("Reason")
        return card(repr(self)[1:-1], table, facts_words(self.certification.campaign, display), display)


FIGURES: Mapping[str, Callable[[Certification, Display], go.Figure]] = {
    "verdicts": verdict_matrix,
    "record": lambda own, display: record_figure(own.record, own.criteria.items, display),
    "reliability": lambda certification, _: reliability(certification.record),
    "domain": validated_domain,
}


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
) -> Verdicts:
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
    computing: dict[str, Any] = {"cache": cache, "watch": watch, "workers": workers, "scheduler": scheduler}
    certification = certify_matrix(campaign, limits, conditions, config, **computing)
    return Verdicts(without_each_test(certification, **computing) if robustness else certification)
