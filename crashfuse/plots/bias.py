"""Figures of the CAE model's bias over displacement: what it got wrong, and the parts that explain it."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.bias import BiasPart, BiasPoints
from crashfuse.campaign import CrashTest
from crashfuse.plots.canvas import LEGEND_ABOVE, Unit, accel_scale
from crashfuse.plots.displacement import displacement_figure, draw_band, draw_line, fit_axis
from crashfuse.plots.palette import COLOURS, MEASURED_COLOUR, speed_lines
from crashfuse.pulse import FloatArray
from crashfuse.units import MPH

_PARTS: Mapping[str, str] = {
    "shared": "Shared",
    "by speed": "By speed",
    "by weight": "By weight",
    "ratio": "Ratio × CAE",
    "own": "The test's own",
    "total": "Total, the sum of the parts below",
}


def bias_by_speed(
    tests: Sequence[CrashTest],
    biases: Sequence[BiasPoints],
    *,
    highlight: str | None = None,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Draw what the CAE model got wrong in each test, over displacement and coloured by speed (Fig. 16).

    Parameters
    ----------
    tests : sequence of CrashTest
    biases : sequence of BiasPoints
        Of these tests, in their order.
    highlight : str, optional
        Id of the test to draw thick (the held-out one).
    unit, deceleration
        As in :func:`over_displacement`.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = displacement_figure(height=460)
    scale = accel_scale(unit, deceleration)
    lines = speed_lines(tests)
    for test, bias in sorted(zip(tests, biases, strict=True), key=lambda pair: pair[0].condition.speed_mps):
        thick = test.id == highlight
        draw_line(
            figure,
            bias.displacement_m,
            bias.bias_mps2 * scale,
            name=f"{test.id} · {test.condition.speed_mps / MPH:.1f} mph" + (" (held out)" if thick else ""),
            line={**lines[test.id], "width": 4 if thick else 1.7},
        )
    figure.update_layout(legend={"title": "Test · speed"})
    figure.update_yaxes(title=f"Bias, test − CAE ({unit})")
    return fit_axis(figure)


def bias_parts(
    parts: Sequence[BiasPart],
    displacement_m: FloatArray,
    measured: BiasPoints | None = None,
    *,
    unit: Unit = "g",
    deceleration: bool = False,
) -> go.Figure:
    """Draw the parts of the bias that is expected at a condition, and their total, each with its 95 % band.

    Parameters
    ----------
    parts : sequence of BiasPart
        The total last.
    displacement_m : ndarray, shape (n,)
        Where they are given, in m.
    measured : BiasPoints, optional
        The held-out test's own bias, black over the total: what was to be foreseen.
    unit, deceleration
        As in :func:`over_displacement`.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    figure = displacement_figure(height=640)
    x_style, y_style = (axis.to_plotly_json() for axis in (figure.layout.xaxis, figure.layout.yaxis))
    *some, total = parts
    figure.set_subplots(
        2, len(some), specs=[[{"colspan": len(some)}, *[None] * (len(some) - 1)], [{}] * len(some)],
        row_heights=[0.6, 0.4], horizontal_spacing=0.015, vertical_spacing=0.14,
        subplot_titles=[_PARTS.get(part.name, part.name) for part in (total, *some)],
    )  # fmt: skip
    figure.update_annotations(font_size=14)
    figure.update_xaxes(x_style)
    figure.update_yaxes(y_style)
    scale, colour = accel_scale(unit, deceleration), COLOURS["displacement_domain"]
    places = [{"row": 1, "col": 1}, *({"row": 2, "col": number + 1} for number in range(len(some)))]
    for part, place in zip((total, *some), places, strict=True):
        first = part is total
        draw_band(
            figure, displacement_m, part.lower_mps2, part.upper_mps2, scale, colour,
            name="95 % band", showlegend=first, legendgroup="band", **place,
        )  # fmt: skip
        draw_line(
            figure, displacement_m, part.mean_mps2 * scale, name="Expected", line={"color": colour, "width": 2},
            showlegend=first, legendgroup="mean", **place,
        )  # fmt: skip
    if measured is not None:
        draw_line(
            figure, measured.displacement_m, measured.bias_mps2 * scale, name="Measured in this test",
            line={"color": MEASURED_COLOUR, "width": 2.5}, **places[0],
        )  # fmt: skip
    figure.update_layout(LEGEND_ABOVE, margin={"t": 64}, legend={"y": 1.06})
    figure.update_xaxes(title=None)
    figure.update_xaxes(title="Displacement (mm)", row=2, col=(len(some) + 1) // 2)
    bounds = scale * np.array([[part.lower_mps2, part.upper_mps2] for part in some])
    figure.update_yaxes(range=[1.05 * bounds.min(), 1.05 * bounds.max()], showticklabels=False, row=2)  # to be compared
    figure.update_yaxes(title=f"Bias, test − CAE ({unit})", showticklabels=True, col=1)
    return fit_axis(figure)
