"""Figure of a sweep: a pulse metric over impact speed, with the tests beside it."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.canvas import new_figure
from crashfuse.reporting.plots.curves import Curve, draw_curves
from crashfuse.reporting.plots.palette import MEASURED_COLOUR
from crashfuse.signals.metrics import Metric
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.sweep import Sweep, uncovered_speeds
from crashfuse.units import KPH, LB, MPH


def sweep_figure(sweeps: Sequence[Sweep], metric: str, campaign: Campaign) -> go.Figure:
    """Draw a metric over impact speed: line and 95 % band of each approach, tests as black points.

    The line has a gap where a pulse lacks the metric because its record is too short. Speeds without CAE runs are
    shaded; a tick on the axis marks the speed of each test. All sweeps have the same speeds and weights;
    the tests have their own weights.
    """
    figure = new_figure(height=460)
    readings = {sweep.approach: sweep.over_speed(metric) for sweep in sweeps}
    speeds = sweeps[0].speeds_mps
    draw_curves(
        figure,
        {name: _curve(speeds, own) for name, own in readings.items()},
        mode="lines+markers",
        marker={"size": 4},
        connectgaps=False,
    )
    for name, own in readings.items():
        figure.update_traces(
            customdata=[_text(*reading) for reading in zip(speeds.tolist(), own, strict=True)],
            hovertemplate=f"<b>{LABELS[name]}</b><br>%{{customdata[0]}}<br>%{{customdata[1]}}<extra></extra>",
            selector={"legendgroup": name, "mode": "lines+markers"},
        )
    _points(figure, campaign, metric)
    speeds = np.concatenate([speeds, [test.condition.speed_mps for test in campaign.tests]])
    margin = 0.02 * np.ptp(speeds) + 0.1 * MPH
    low, high = float(speeds.min() - margin), float(speeds.max() + margin)
    _mark_speeds(figure, campaign, low, high)
    figure.update_layout(hovermode="closest")
    figure.update_xaxes(title="Impact speed (mph)", range=[low / MPH, high / MPH], showspikes=False)
    figure.update_yaxes(title=campaign.metric_headings[metric])
    return figure


def _curve(speeds_mps: FloatArray, metrics: Sequence[Metric]) -> Curve:
    """A metric over speed in mph, with gaps where it or a bound of its interval is missing."""
    value, lower, upper = (
        np.array([getattr(metric, name) for metric in metrics], dtype=np.float64)
        for name in ("value", "lower", "upper")
    )
    speeds = speeds_mps / MPH
    return Curve(speeds, value, (speeds, lower, upper) if np.isfinite(lower).any() else None)


def _points(figure: go.Figure, campaign: Campaign, metric: str) -> None:
    found = [(test, own) for test in campaign.tests for own in campaign.metrics_of(test) if own.name == metric]
    figure.add_scatter(
        x=np.array([test.condition.speed_mps / MPH for test, _ in found], dtype=np.float32),
        y=np.array([own.value for _, own in found], dtype=np.float32),
        name="Tests (each with its own weights)",
        mode="markers",
        marker={"color": MEASURED_COLOUR, "size": 9},
        customdata=[
            [
                test.id,
                *_text(test.condition.speed_mps, own),
                f"front {test.condition.front_weight_kg / LB:.0f} lb, rear {test.condition.rear_weight_kg / LB:.0f} lb",
            ]
            for test, own in found
        ],
        hovertemplate="<b>Test %{customdata[0]}</b><br>%{customdata[1]}, %{customdata[3]}<br>%{customdata[2]}"
        "<extra></extra>",
    )


def _mark_speeds(figure: go.Figure, campaign: Campaign, low_mps: float, high_mps: float) -> None:
    """Shade speeds without CAE runs, and mark those of the tests with ticks."""
    for number, (start, end) in enumerate(uncovered_speeds(campaign.cae, low_mps, high_mps)):
        figure.add_shape(
            type="rect", xref="x", yref="y domain", x0=start / MPH, x1=end / MPH, y0=0, y1=1, layer="below",
            fillcolor="#EEF0F3", line_width=0, name="No CAE runs: extrapolation", showlegend=number == 0,
            legendgroup="extrapolation",
        )  # fmt: skip
    for test in campaign.tests:
        speed = test.condition.speed_mps / MPH
        figure.add_shape(
            type="line", xref="x", yref="y domain", x0=speed, x1=speed, y0=0, y1=0.03,
            line={"color": MEASURED_COLOUR, "width": 1.5},
        )  # fmt: skip


def _text(speed_mps: float, metric: Metric) -> tuple[str, str]:
    """Speed in both units, and the metric with its interval."""
    return f"{speed_mps / MPH:.1f} mph ({speed_mps / KPH:.1f} km/h)", f"{metric.text} {metric.unit}"
