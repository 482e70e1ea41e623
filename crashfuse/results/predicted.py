"""A prediction as the library offers it: a campaign and a condition in, tables and a figure out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Unpack

import pandas as pd
import plotly.graph_objects as go

from crashfuse import views
from crashfuse.approaches.neighbours import Neighbour, nearest_sentences, nearest_tests
from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.campaign import Campaign
from crashfuse.certification.matrix import Matrix
from crashfuse.condition import Condition
from crashfuse.errors import require_a, several
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.execution.run import Run
from crashfuse.results import figures
from crashfuse.results.certification_tables import condition_columns, factors_of
from crashfuse.results.display import DEFAULT, Display, DisplayOptions
from crashfuse.results.render.notebook import card
from crashfuse.results.result_tables import metrics_shown, metrics_table, pulses_table
from crashfuse.results.table import Table
from crashfuse.signals.pulse import DT_S, motion
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, Fit, check_factors, estimate_at, estimates_at, fits_of
from crashfuse.study.expected_rating import ExpectedRating, expected_rating
from crashfuse.study.facts import Fact, campaign_facts, condition_facts, distinct
from crashfuse.study.recommendation import Recommendation, recommend_for
from crashfuse.units import KPH, Sentence

_MM = 1e-3
_WITH_WHOLE_PULSES = ("motion", "acceleration")


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
        return self.preferred.prediction.condition

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
        return tuple(dict.fromkeys(note for each in self.estimates for note in each.prediction.notes))

    @property
    def pulses(self) -> pd.DataFrame:
        """The pulse of every approach with its band, as ``pulses.csv``."""
        return pulses_table(self.estimates)

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """Pulse metrics of every approach with their 95 % intervals, as ``metrics.csv``."""
        return metrics_table((("", each.approach, each.metrics) for each in self.estimates), self.campaign)

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
        velocity, displacement = motion(self.preferred.prediction.accel_mps2, self.condition.speed_mps, DT_S)
        pulse = pulses_table([self.preferred])[["time_ms", "acceleration_g", "lower_g", "upper_g"]]
        return pulse.assign(velocity_kph=velocity / KPH, displacement_mm=displacement / _MM)

    def plot(
        self,
        figure: str = "motion",
        *,
        approaches: Sequence[str] | None = None,
        also: Sequence[figures.Further] = (),
        band: str | None = None,
        representative: bool = True,
        **display: Unpack[DisplayOptions],
    ) -> go.Figure:
        """A figure of the page Predict.

        Parameters
        ----------
        figure : {"motion", "acceleration", "displacement", "energy", "integration"}
            As the page names them; the rest as in :meth:`crashfuse.study.study.Study.plot`.
        representative : bool
            Whether figures over time show a pulse that looks like a test, too.
        """
        shown = Display.of(self.campaign.units, **display)
        estimates = figures.chosen({each.approach: each for each in self.estimates}, approaches, band)
        others = [other.beside(self) if isinstance(other, PredictedPulse) else other for other in several(also)]
        further = {**figures.other_fold(estimates, band), **figures.beside(self.campaign, others, shown)}
        lead = estimates.get(band or next(iter(by_preference(estimates)), ""))
        if representative and lead is not None and figure in _WITH_WHOLE_PULSES:
            further = {**lead.representative, **further}
        return figures.Curves(None, estimates | further, self.condition, band).draw(figure, shown)

    def write(
        self,
        folder: str | Path,
        *,
        export: "views.PulseExport | None" = None,
        report: "views.ReportForm" = "whole",
        **display: Unpack[DisplayOptions],
    ) -> None:
        """Write what ``crashfuse predict`` writes; a UsageError if there are fewer draws than are to be exported."""
        export = views.PulseExport() if export is None else export
        require_a(views.PulseExport, export, "crashfuse.PulseExport()")
        pulses, shown = export.files(self.campaign, self.estimates), Display.of(self.campaign.units, **display)
        views.write_old("prediction", folder, self, pulses, shown, report)

    def beside(self, other: "PredictedPulse") -> figures.OtherPrediction:
        """Itself in a figure of another one: at the same condition it is named by its settings."""
        if self.condition == other.condition and figures.otherwise(self.config, other.config):
            return figures.EarlierPrediction(self.preferred, self.config, other.config)
        return self

    def curve(self, display: Display) -> tuple[str, Estimate]:
        """The name of the preferred approach's prediction beside others, and itself."""
        return figures.prediction_name(self.preferred.approach, self.condition, display), self.preferred

    def __repr__(self) -> str:
        names = ", ".join(each.approach for each in self.estimates)
        return f"<PredictedPulse, {names}, at {self.condition}>"

    def _repr_html_(self) -> str:
        display = Display(system=self.campaign.units)
        columns = [(LABELS[estimate.approach], estimate.metrics) for estimate in self.estimates]
        table, _ = metrics_shown(columns, self.campaign, "Metric")
        notes = ("In brackets: the 95 % interval of a single test.", *map(display.words, self.sentences))
        return card(f"The pulse at {display.condition(self.condition)}", table, notes, display)


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
    return [
        replace(prediction, estimates=tuple(own for own in prediction.estimates if own.approach == approach))
        for prediction in predictions
    ]


def side_by_side(predictions: Sequence[PredictedPulse], display: Display = DEFAULT, base: int = 0) -> Table:
    """Main metrics by one approach, for readers: first the ``base``, then each other with its differences from it."""
    metrics = [[replace(metric, folds={}) for metric in own.preferred.metrics] for own in predictions]
    shown = list(zip(column_names(predictions, display), metrics, strict=True))
    shown.insert(0, shown.pop(base))
    table, _ = metrics_shown(shown, predictions[0].campaign)
    label, first, *others = table.columns
    minus = [
        replace(own, title=f"{own.title} − {first.title}", kind="difference", source=own.title, further=(first.title,))
        for own in others
    ]
    return replace(table, columns=(label, first, *chain.from_iterable(zip(others, minus, strict=True))))


def column_names(predictions: Sequence[PredictedPulse], display: Display) -> list[str]:
    """Names of predictions beside each other: their conditions, and their settings if these are not the first's."""
    names = display.apart([prediction.condition for prediction in predictions])
    settings = [figures.otherwise(prediction.config, predictions[0].config) for prediction in predictions]
    return [", ".join(filter(None, pair)) for pair in zip(names, settings, strict=True)]


def cautions(predictions: Sequence[PredictedPulse], display: Display = DEFAULT) -> list[str]:
    """At which conditions after the first a prediction is an extrapolation."""
    first, *others = predictions
    return [
        Sentence("{}: {}", name, note)
        for name, prediction in zip(column_names(predictions, display)[1:], others, strict=True)
        for note in prediction.campaign.cae.extrapolation(prediction.condition)
        if prediction.condition != first.condition
    ]


def predictions_table(predictions: Sequence[PredictedPulse]) -> pd.DataFrame:
    """One row per prediction, approach and metric, with its difference from the first; for files."""
    first = {(own.approach, m.name): m.value for own in predictions[0].estimates for m in own.metrics}
    conditions = tuple(prediction.condition for prediction in predictions)
    ids = tuple(str(number) for number, _ in enumerate(conditions, start=1))
    factors = factors_of(Matrix(ids, conditions))
    return pd.DataFrame(
        {
            **condition_columns(number, condition, factors, conditions[0]),
            "preset": prediction.config.preset,
            "seed": prediction.config.seed,
            "approach": estimate.approach,
            "metric": m.name,
            **{name: getattr(m, name) for name in ("value", "lower", "upper", "unit")},
            "difference": None if m.value is None or base is None else m.value - base,
        }
        for number, condition, prediction in zip(ids, conditions, predictions, strict=True)
        for estimate in prediction.estimates
        for m in estimate.metrics
        for base in [first.get((estimate.approach, m.name))]
    )
