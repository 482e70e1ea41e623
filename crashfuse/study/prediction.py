"""The pulse at a condition that was never tested, as one or several approaches predict it from a whole campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from crashfuse import views
from crashfuse.approaches.neighbours import Neighbour, nearest_sentences, nearest_tests
from crashfuse.approaches.registry import by_preference
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import require_a, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import DT_S, motion
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit, check_factors, estimate_at, estimates_at, fits_of
from crashfuse.study.expected_rating import ExpectedRating, expected_rating
from crashfuse.study.facts import Fact, campaign_facts, condition_facts, distinct
from crashfuse.study.recommendation import Recommendation, recommend_for
from crashfuse.units import KPH

_MM = 1e-3

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class PredictedPulse:
    """The pulse at a condition as one or several approaches predict it, and its band; ``estimates`` have the draws."""

    campaign: Campaign
    estimates: tuple[Estimate, ...]
    config: StudyConfig = StudyConfig()

    def __post_init__(self) -> None:
        names = tuple(estimate.approach for estimate in self.estimates)
        # no test is left out: two predictions would seem to differ in how that is done
        object.__setattr__(self, "config", replace(self.config, approaches=names, leave_out="test"))

    @property
    def condition(self) -> Condition:
        """Where it is predicted."""
        return self.preferred.condition

    @property
    def text(self) -> str:
        """The condition in the shortest words."""
        return self.condition.text

    @property
    def preferred(self) -> Estimate:
        """The estimate of the preferred approach."""
        by_name = {estimate.approach: estimate for estimate in self.estimates}
        return by_name[by_preference(by_name)[0]]

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the reader: extrapolation, weights of a mixture."""
        return tuple(dict.fromkeys(note for each in self.estimates for note in each.notes))

    @property
    def pulses(self) -> pd.DataFrame:
        """The pulse of every approach with its band, as ``pulses.csv``."""
        return views.pulses_table(self.estimates)

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """Pulse metrics of every approach with their 95 % intervals, as ``metrics.csv``."""
        return views.metrics_table((("", own.approach, own.metrics) for own in self.estimates), self.campaign)

    @property
    def recommendation(self) -> Recommendation:
        """Which of its approaches to use here, and why."""
        return recommend_for(self.estimates, self.campaign, self.condition)

    def expected_rating(self, window_ms: float = 60.0) -> ExpectedRating | None:
        """The rating over [0, window_ms) to expect of the preferred approach against a test here; None if unknown."""
        return expected_rating(self.preferred, self.campaign, window_ms)

    @property
    def nearest_tests(self) -> tuple[Neighbour, ...]:
        """The tests nearest to the condition, nearest first."""
        return nearest_tests(self.campaign, self.condition)

    @property
    def facts(self) -> tuple[Fact, ...]:
        """The recommendation, what stands apart or is extrapolated here, the campaign's facts."""
        here = condition_facts(self.campaign, self.condition)
        return distinct([*self.recommendation.facts, *here, *campaign_facts(self.campaign)])

    @property
    def sentences(self) -> tuple[str, ...]:
        """What ``crashfuse predict`` prints: the facts in words, nearest tests and run, remarks."""
        near = nearest_sentences(self.campaign, self.condition)
        return tuple(dict.fromkeys((*(fact.sentence for fact in self.facts), *near, *self.notes)))

    def to_frame(self) -> pd.DataFrame:
        """Pulse, band and motion by the preferred approach, one row a sample, 1,250 in all.

        ``time_ms``, ``acceleration_g``, ``lower_g``, ``upper_g`` as in ``pulses.csv``; ``velocity_kph``,
        ``displacement_mm``.
        """
        velocity, displacement = motion(self.preferred.accel_mps2, self.condition.speed_mps, DT_S)
        pulse = views.pulses_table([self.preferred])[["time_ms", "acceleration_g", "lower_g", "upper_g"]]
        return pulse.assign(velocity_kph=velocity / KPH, displacement_mm=displacement / _MM)

    def draw(
        self,
        figure: str = "motion",
        *,
        approaches: Sequence[str] | None = None,
        also: Sequence[views.Further] = (),
        band: str | None = None,
        representative: bool = True,
        average: bool = True,
        **display: Unpack[views.DisplayOptions],
    ) -> views.Drawing:
        """A figure of the page Predict.

        Parameters
        ----------
        figure : {"motion", "acceleration", "displacement", "energy", "integration"}
            As the page names them; the rest as in :meth:`crashfuse.study.study.Study.plot`.
        representative : bool
            Whether figures over time show a pulse that looks like a test, with the peak of the metrics.
        average : bool
            Whether they show the average of the draws, too, whose peak is lower.
        """
        return views.prediction_figure(self, figure, approaches, also, band, representative, average, **display)

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def write(
        self,
        folder: str | Path,
        *,
        export: views.PulseExport | None = None,
        report: views.ReportForm = "whole",
        **display: Unpack[views.DisplayOptions],
    ) -> None:
        """Write what ``crashfuse predict`` writes; a UsageError if there are fewer draws than are to be exported."""
        export = views.PulseExport() if export is None else export
        require_a(views.PulseExport, export, "crashfuse.PulseExport()")
        result = views.prediction_result(self, form=report, export=export)
        views.write_result(result, folder, views.Display.of(self.campaign.units, **display))

    def curve(self, display: views.Display) -> tuple[str, Estimate]:
        """The name of the preferred approach's prediction beside others, and itself."""
        return views.prediction_name(self.preferred.approach, self.condition, display), self.preferred

    def __repr__(self) -> str:
        names = ", ".join(each.approach for each in self.estimates)
        return f"<PredictedPulse, {names}, at {self.condition}>"

    def _repr_html_(self) -> str:
        return views.result_html(views.prediction_result(self))


def predict(
    campaign: Campaign,
    condition: Condition,
    approach: str | Fit | Sequence[str | Fit] = "fused",
    config: StudyConfig = StudyConfig(),
    *,
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> PredictedPulse:
    """Predict the pulse at a condition from all tests and CAE runs of a campaign.

    Parameters
    ----------
    approach : str or Fit, or a sequence of these
        One approach, or several to be compared. Fits answer at once.
    config : StudyConfig
        Preset, seed and device of approaches that are named.

    Raises
    ------
    UsageError
        If an approach or a factor is unknown, a fit is of another campaign, or the condition is beyond barrier tests.
    """
    check_factors(campaign, condition)
    require_a(StudyConfig, config, "crashfuse.StudyConfig()")
    run = Run.of(campaign, cache, watch)
    campaign, asked = run.bind(campaign), (approach,) if isinstance(approach, Fit) else several(approach)
    names = tuple(dict.fromkeys(one for one in asked if isinstance(one, str)))
    if names and all(isinstance(one, str) for one in asked):  # what is predicted is cached, too
        replace(config, approaches=names).check()
        estimates = [estimate_at(campaign, condition, name, config, run) for name in names]
    else:
        fits = fits_of(campaign, asked, config, run)
        estimates, config = estimates_at(fits, condition), fits[0].config
    return PredictedPulse(campaign, tuple(estimates), config)


def by_one(approach: str, predictions: Sequence[PredictedPulse]) -> list[PredictedPulse]:
    """What one approach predicts in each of several predictions."""
    chosen = (tuple(own for own in prediction.estimates if own.approach == approach) for prediction in predictions)
    return [replace(prediction, estimates=own) for prediction, own in zip(predictions, chosen, strict=True)]
