"""Sections common to all reports with estimates: metrics, notes and fits of the estimates, and the CAE model's bias."""

from collections.abc import Sequence

import pandas as pd
import plotly.graph_objects as go

from crashfuse.approaches.displacement_domain.approach import measured_bias
from crashfuse.approaches.registry import LABELS
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import Cache
from crashfuse.reporting.fit_explanations import fit_sentences, fit_table, notes_by_makers
from crashfuse.reporting.plots.bias import bias_by_speed
from crashfuse.signals.metrics import METRIC_LABELS, Metric, missing_sentences
from crashfuse.study.estimate import Estimate


def details(estimates: Sequence[Estimate], measured: Sequence[Metric] = ()) -> dict[str, object]:
    """Metrics by approach (and of the test), notes of the approaches, quality of their fits."""
    columns = [("Measured", measured)] if measured else []
    columns += [(LABELS[estimate.approach], estimate.metrics) for estimate in estimates]
    metrics = pd.DataFrame(
        {who: {f"{METRIC_LABELS[metric.name]} ({metric.unit})": metric.text for metric in own} for who, own in columns}
    )
    return {
        "metrics": metrics.rename_axis("Pulse metric").reset_index(),
        "remarks": [
            *missing_sentences(columns),
            *(f"{', '.join(who)}: {note}" for note, who in notes_by_makers(estimates).items()),
        ],
        "fits": [
            (LABELS[estimate.approach], sentences, fit_table(estimate.state))
            for estimate in estimates
            if (sentences := fit_sentences(estimate.state))
        ],
    }


def bias(campaign: Campaign) -> go.Figure:
    """Figure of the CAE model's error in every test, by speed; its emulator is in the cache by now."""
    model = CaeModel(cache=Cache()).fit(campaign.cae)
    return bias_by_speed(campaign.tests, [measured_bias(test, model) for test in campaign.tests])
