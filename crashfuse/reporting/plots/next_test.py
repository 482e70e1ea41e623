"""Figure of the next test: how much each candidate would narrow the band."""

from collections.abc import Sequence

import plotly.graph_objects as go

from crashfuse.crash_test import CrashTest
from crashfuse.reporting.plots.canvas import new_figure
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS, MEASURED_COLOUR
from crashfuse.study.next_test import NextTest

BEST = 5
"""How many of the best candidates are numbered in the figure, and listed beside it."""


def next_tests(ranked: Sequence[NextTest], tests: Sequence[CrashTest], display: Display = DEFAULT) -> go.Figure:
    """Draw by how much each candidate would narrow the band, over its speed; ticks mark the tests already run.

    Candidates, the largest gain first, are joined by a line if all have the same weights; otherwise each is
    a point. The best five are numbered, and those outside the CAE runs' range are drawn open.
    """
    figure, colour = new_figure(height=420), COLOURS["displacement_domain"]
    by_speed = sorted(enumerate(ranked, start=1), key=lambda ranked_test: ranked_test[1].condition.speed_mps)
    weights = [display.vectors(c.condition.vector)[1:].tolist() for _, c in by_speed]
    wide, units = 1 / display.units.in_si("g"), display.units
    figure.add_scatter(
        x=[display.speeds(c.condition.speed_mps) for _, c in by_speed],
        y=[100 * c.gain for _, c in by_speed],
        text=[f"{rank}" if rank <= BEST else "" for rank, _ in by_speed],
        customdata=[
            [*w, c.before_mps2 * wide, c.after_mps2 * wide] for w, (_, c) in zip(weights, by_speed, strict=True)
        ],
        name="Candidates, the best numbered",
        mode="lines+markers+text" if all(own == weights[0] for own in weights) else "markers+text",
        textposition="top center",
        cliponaxis=False,
        textfont={"size": 14},
        line={"color": colour, "width": 2},
        marker={
            "color": colour,
            "size": [11 if rank <= BEST else 7 for rank, _ in by_speed],
            "symbol": ["circle-open" if c.extrapolation else "circle" for _, c in by_speed],
            "line": {"width": 1.5},
        },
        hovertemplate=f"%{{x:.1f}} {units.speed}, front %{{customdata[0]:.0f}} {units.weight}, "
        f"rear %{{customdata[1]:.0f}} {units.weight}<br>band ± %{{customdata[2]:.2f}} {units.acceleration} now, "
        f"± %{{customdata[3]:.2f}} {units.acceleration} with this test (− %{{y:.1f}} %)<extra></extra>",
    )
    figure.add_scatter(
        x=[display.speeds(test.condition.speed_mps) for test in tests],
        y=[0.0] * len(tests),
        text=[test.id for test in tests],
        name="Tests that were run",
        mode="markers",
        marker={"color": MEASURED_COLOUR, "symbol": "line-ns-open", "size": 16, "line": {"width": 2}},
        hovertemplate=f"%{{text}}, %{{x:.1f}} {units.speed}<extra></extra>",
    )
    if any(test.extrapolation for test in ranked):
        figure.add_scatter(
            x=[None], y=[None], name="Outside the CAE runs", mode="markers",
            marker={"color": colour, "symbol": "circle-open", "size": 9, "line": {"width": 1.5}},
        )  # fmt: skip
    figure.update_layout(hovermode="closest")
    figure.update_xaxes(title=display.title("Impact speed", "mph"), range=None, unifiedhovertitle=None)
    figure.update_yaxes(title="Band shrinks by (%)", rangemode="tozero")
    return figure
