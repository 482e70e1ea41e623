"""Planning as the library offers it: metrics over impact speed, and which test to run next."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Unpack, cast

import pandas as pd
import plotly.graph_objects as go

from crashfuse import views
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError, one_of, printable, require_a, require_number, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import Run
from crashfuse.reporting.notebook import card
from crashfuse.reporting.plots.conditions import BEST, next_tests, sweep_figure
from crashfuse.reporting.plots.display import Display, DisplayOptions
from crashfuse.reporting.predicted import check_factors, fits_of
from crashfuse.reporting.result_tables import interval_frame, next_tests_file, next_tests_table, sweep_table
from crashfuse.reporting.table import Column, Table
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_LABELS, METRIC_UNITS
from crashfuse.study import planning
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import FASTEST_MPS, Fit
from crashfuse.units import MPH, speed


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """What a campaign's models say of tests that were not run."""

    campaign: Campaign
    kind: ClassVar[str]

    def write(self, folder: str | Path, **display: Unpack[DisplayOptions]) -> None:
        """Write what the command writes: its table as CSV and ``report.html``."""
        views.write_result(self.kind, folder, self, Display.of(self.campaign.units, **display))


@dataclass(frozen=True, eq=False, repr=False)
class SpeedSweep(Plan):
    """Pulse metrics over impact speed; ``sweeps`` has them by approach, as objects."""

    sweeps: tuple[planning.Sweep, ...]
    config: StudyConfig = StudyConfig()
    kind = "sweep"

    def __post_init__(self) -> None:
        names = tuple(sweep.approach for sweep in self.sweeps)
        object.__setattr__(self, "config", replace(self.config, approaches=names))

    @property
    def table(self) -> pd.DataFrame:
        """One row a speed, approach (or ``test``) and metric, as ``sweep.csv``."""
        return sweep_table(self.sweeps, self.campaign)

    def plot(self, metric: str = MAIN_METRICS[0], **display: Unpack[DisplayOptions]) -> go.Figure:
        """A metric over impact speed, every approach with its band, the tests as points."""
        one_of("metric", metric, METRIC_LABELS)
        return sweep_figure(self.sweeps, metric, self.campaign, Display.of(self.campaign.units, **display))

    def __repr__(self) -> str:
        names, speeds = ", ".join(sweep.approach for sweep in self.sweeps), self.sweeps[0].speeds_mps
        ends = speed(float(speeds[0]), float(speeds[-1]), between=" to ")
        return f"<SpeedSweep, {names}, {len(speeds)} speeds from {ends}>"

    def _repr_html_(self) -> str:
        shown, headings = self.sweeps[-1], self.campaign.metric_headings
        frame = interval_frame({headings[name]: shown.over_speed(name) for name in MAIN_METRICS})
        columns = (Column(headings[name], "interval", METRIC_UNITS[name]) for name in MAIN_METRICS)
        frame["Speed"] = [*map(speed, shown.speeds_mps.tolist())]
        table = Table("sweep", frame, (Column("Speed"), *columns))
        return card(repr(self)[1:-1], table, (f"By {shown.approach}.",), Display(system=self.campaign.units))


@dataclass(frozen=True, eq=False, repr=False)
class NextTests(Plan):
    """Tests that might be run next, by how much each would narrow the band; ``ranked`` has them as objects."""

    over: planning.ConditionRange
    ranked: tuple[planning.NextTest, ...]
    config: StudyConfig = StudyConfig()
    kind = "ranking of next tests"

    @property
    def table(self) -> pd.DataFrame:
        """One row a candidate, the best first, as ``next_tests.csv``."""
        return next_tests_file(self.ranked)

    def plot(self, **display: Unpack[DisplayOptions]) -> go.Figure:
        """How much each candidate would narrow the band over its speed, as the page Predict shows it."""
        return next_tests(self.ranked, self.campaign.tests, Display.of(self.campaign.units, **display))

    def __repr__(self) -> str:
        best = self.ranked[0]
        return f"<NextTests, the best of {len(self.ranked)} at {best.condition}: {100 * best.gain:.0f} % narrower>"

    def _repr_html_(self) -> str:
        display = Display(system=self.campaign.units)
        low, high = map(display.condition, (self.over.low, self.over.high))
        title = f"The band over {low} to {high}: which test would narrow it most"
        return card(title, next_tests_table(self.ranked[:BEST]), (), display)


def sweep(
    campaign: Campaign,
    condition: Condition,
    speeds_mph: tuple[float, float] | None = None,
    approach: str | Fit | Sequence[str | Fit] = "fused",
    config: StudyConfig = StudyConfig(),
    *,
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> SpeedSweep:
    """Predict the pulse metrics over impact speed; otherwise as :func:`crashfuse.reporting.predicted.predict`.

    Parameters
    ----------
    condition : Condition
        Its weights and factors hold at all speeds; its own speed does not matter.
    speeds_mph : tuple of float, optional
        The lowest and the highest speed, by default those of the CAE runs and tests; every full mph between them.
    """
    check_factors(campaign, condition)
    require_a(StudyConfig, config, "crashfuse.StudyConfig()")
    speeds = planning.usual_speeds(campaign)
    if speeds_mph is not None:
        for end in several(speeds_mph):
            require_number("A speed of a sweep", end)
        ends = [float(end) * MPH for end in several(speeds_mph)]
        if len(ends) != 2 or not 0 < ends[0] < ends[1] <= FASTEST_MPS:
            found, most = printable(repr(speeds_mph), 60), f"{FASTEST_MPS / MPH:.0f}"
            raise UsageError(f"A sweep takes a speed above 0 and a higher one, up to {most} mph, not {found}.")
        speeds = planning.speeds_between(*ends)
    run, asked = Run.of(campaign, cache, watch), (approach,) if isinstance(approach, Fit) else several(approach)
    campaign = run.bind(campaign)
    fits = fits_of(campaign, asked, config, run)
    return SpeedSweep(campaign, planning.sweep_speed(fits, condition, speeds, watch), fits[0].config)


def next_test(
    campaign: Campaign,
    low: Condition | None = None,
    high: Condition | None = None,
    *,
    candidates: Sequence[Condition] | None = None,
    planned: Sequence[Condition] = (),
    config: StudyConfig = StudyConfig(),
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> NextTests:
    """Rank tests that might be run next by how much each would narrow the band of the displacement domain.

    Parameters
    ----------
    low, high : Condition, optional
        The range of speeds and weights of interest, by default that of the tests.
    candidates : sequence of Condition, optional
        The tests that could be run; by default speeds over the range, at the middle weights.
    planned : sequence of Condition
        Tests that are going to be run anyway.
    """
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    require_a(StudyConfig, config, "crashfuse.StudyConfig()")
    usual = planning.ConditionRange.of(campaign.tests)
    low, high = usual.low if low is None else low, usual.high if high is None else high
    planned = cast(tuple[Condition, ...], several(planned))
    candidates = None if candidates is None else cast(tuple[Condition, ...], several(candidates))
    for condition in (low, high, *planned, *(candidates or ())):
        check_factors(campaign, condition)
    if candidates == ():
        raise UsageError("There is no candidate: name one, or leave candidates out.")
    over = planning.ConditionRange(low, high)
    fit = Fit.of(campaign, DisplacementDomain.name, config, Run.of(campaign, cache, watch))
    campaign = fit.campaign
    assert isinstance(fit.approach, DisplacementDomain)  # noqa: S101 - for the type checker
    return NextTests(campaign, over, planning.rank_next_tests(fit.approach, over, candidates, planned), config)
