"""A prediction as the library offers it: a campaign and a condition in, tables and a figure out."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch
from crashfuse.reporting.notebook import card
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.pulses import motion
from crashfuse.reporting.result_tables import metrics_table
from crashfuse.signals.pulse import DT_S
from crashfuse.signals.pulse import motion as motion_of
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, estimate_at
from crashfuse.units import KPH, MS, G

_MM = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class PredictedPulse:
    """The pulse that an approach predicts at a condition, with its band; ``estimate`` has the draws."""

    campaign: Campaign
    estimate: Estimate

    @property
    def condition(self) -> Condition:
        """Where it is predicted."""
        return self.estimate.prediction.condition

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the reader: extrapolation, weights of a mixture."""
        return self.estimate.prediction.notes

    def to_frame(self) -> pd.DataFrame:
        """Pulse, band and motion, one row a sample, as ``pulses.csv`` with the velocity and displacement.

        Returns
        -------
        DataFrame
            ``time_ms``, ``acceleration_g``, ``lower_g``, ``upper_g`` (central 95 %, NaN without a band),
            ``velocity_kph``, ``displacement_mm``; 1,250 rows.
        """
        prediction = self.estimate.prediction
        lower, upper = prediction.band() or (np.full(prediction.time_s.size, np.nan),) * 2
        velocity, displacement = motion_of(prediction.accel_mps2, self.condition.speed_mps, DT_S)
        return pd.DataFrame(
            {
                "time_ms": (prediction.time_s / MS).round(6),
                "acceleration_g": prediction.accel_mps2 / G,
                "lower_g": lower / G,
                "upper_g": upper / G,
                "velocity_kph": velocity / KPH,
                "displacement_mm": displacement / _MM,
            }
        )

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """Pulse metrics with their 95 % intervals, as ``metrics.csv``."""
        return metrics_table([("", self.estimate.approach, self.estimate.metrics)], self.campaign)

    def plot(self, **display: Any) -> go.Figure:  # noqa: ANN401 - fields of Display
        """The prediction over time, as the page Predict shows it; ``display`` takes the fields of ``Display``."""
        predictions = {self.estimate.approach: self.estimate.prediction}
        return motion(None, predictions, self.condition.speed_mps, Display(**display))

    def __repr__(self) -> str:
        return f"<PredictedPulse, {LABELS[self.estimate.approach].lower()}, at {self.condition}>"

    def _repr_html_(self) -> str:
        headings = self.campaign.metric_headings
        rows = pd.DataFrame(
            {"metric": headings[metric.name], "value, 95 % interval": metric.text} for metric in self.estimate.metrics
        )
        return card(f"{LABELS[self.estimate.approach]} at {self.condition}", rows, self.notes)


def predict(
    campaign: Campaign,
    condition: Condition,
    approach: str = "fused",
    config: StudyConfig = StudyConfig(),
    *,
    cache: Cache | None = None,
    watch: Watch = SILENT,
) -> PredictedPulse:
    """Predict the pulse at a condition from all tests and CAE runs of a campaign.

    Raises
    ------
    UsageError
        If there is no such approach, the campaign lacks a factor of the condition or its value, or speed or a weight
        is beyond any barrier test.
    """
    for name, value in condition.factors:
        if name not in campaign.factors:
            known = ", ".join(campaign.factors) or "none"
            raise UsageError(f"{campaign.name} has no factor {name!r}; its factors are: {known}.")
        if value and value not in campaign.factors[name]:
            raise UsageError(f"No test has {name} {value!r}; known are {', '.join(campaign.factors[name])}.")
    return PredictedPulse(campaign, estimate_at(campaign, condition, approach, config, cache=cache, watch=watch))
