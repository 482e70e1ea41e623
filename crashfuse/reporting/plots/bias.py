"""Figures of the CAE model's bias over displacement: its error, and the parts that explain it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.displacement_domain.bias import BiasPart, BiasPoints
from crashfuse.crash_test import CrashTest
from crashfuse.reporting.plots.canvas import add_band, add_line, height_under_names
from crashfuse.reporting.plots.curves import TEST, by_speed, curve_line
from crashfuse.reporting.plots.displacement import displacement_figure, fit_axis
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS
from crashfuse.signals.pulse import FloatArray

_MM = 1e-3
_PARTS: Mapping[str, str] = {
    "shared": "Shared",
    "by speed": "By speed",
    "by weight": "By weight",
    "ratio": "Ratio × CAE trend",
    "humps": "Ratio × CAE humps",
    "own": "The test's own",
    "total": "Total, the sum of the parts below",
}
_IN_A_ROW = 3  # with more, the titles overlap on a narrow page


def bias_by_speed(
    tests: Sequence[CrashTest],
    biases: Sequence[BiasPoints],
    *,
    among: Sequence[CrashTest] = (),
    highlight: str | None = None,
    display: Display = DEFAULT,
) -> go.Figure:
    """Draw the CAE model's error in each test, over displacement and coloured by speed ``among`` all tests (Fig. 16).

    ``biases`` are in the order of the tests; the test with the id ``highlight`` is drawn thick.
    """
    figure = displacement_figure(height_under_names(len(tests)))
    of_test = {test.id: bias for test, bias in zip(tests, biases, strict=True)}
    for test, style in by_speed(tests, highlight, display, among):
        bias = of_test[test.id]
        add_line(figure, bias.displacement_m / _MM, bias.bias_mps2 * display.accel_scale, **style)
    figure.update_yaxes(title=f"Bias, test − CAE ({display.unit})")
    return fit_axis(figure)


def bias_parts(
    parts: Sequence[BiasPart],
    displacement_m: FloatArray,
    measured: BiasPoints | None = None,
    display: Display = DEFAULT,
) -> go.Figure:
    """Draw the parts of the bias expected at a condition, and their total, each with its 95 % band.

    The y axes cover the range up to the measured maximum crush, if there is one: bands widen beyond it.

    Parameters
    ----------
    parts : sequence of BiasPart
        The total last.
    displacement_m : ndarray, shape (n,)
        Where the parts are given.
    measured : BiasPoints, optional
        The held-out test's own bias, drawn black over the total.
    """
    *some, total = parts
    rows = -(-len(some) // _IN_A_ROW)
    figure = displacement_figure(height=400 + 200 * rows)
    x_style, y_style = (axis.to_plotly_json() for axis in (figure.layout.xaxis, figure.layout.yaxis))
    places = [{"row": 1, "col": 1}]
    places += [{"row": 2 + number // _IN_A_ROW, "col": 1 + number % _IN_A_ROW} for number in range(len(some))]
    specs: list[list[dict[str, int] | None]] = [[None] * _IN_A_ROW for _ in range(1 + rows)]
    for place in places:
        specs[place["row"] - 1][place["col"] - 1] = {"colspan": _IN_A_ROW if place["row"] == 1 else 1}
    figure.set_subplots(
        1 + rows, _IN_A_ROW, specs=specs, row_heights=[1.7, *[1.0] * rows], horizontal_spacing=0.05,
        vertical_spacing=0.24 / (1 + rows),
        subplot_titles=[_PARTS.get(part.name, part.name[:1].upper() + part.name[1:]) for part in (total, *some)],
    )  # fmt: skip
    figure.update_annotations(font_size=14)
    figure.update_xaxes(x_style)
    figure.update_yaxes(y_style)
    at_mm = displacement_m / _MM
    scale, colour = display.accel_scale, COLOURS["displacement_domain"]
    for part, place in zip((total, *some), places, strict=True):
        style: dict[str, Any] = {"showlegend": part is total, **place}
        ends = part.lower_mps2 * scale, part.upper_mps2 * scale
        add_band(figure, at_mm, *ends, colour=colour, name="95 % band", legendgroup="band", **style)
        line = {"color": colour, "width": 2}
        add_line(figure, at_mm, part.mean_mps2 * scale, name="Expected", line=line, legendgroup="mean", **style)
    if measured is not None:
        add_line(
            figure, measured.displacement_m / _MM, measured.bias_mps2 * scale, name="Measured in this test",
            line=curve_line(TEST), **places[0],
        )  # fmt: skip
    figure.update_layout(margin={"t": 64})
    figure.update_xaxes(title=None, nticks=4)
    figure.update_xaxes(title="Displacement (mm)", row=1 + rows, col=min(2, len(some) - _IN_A_ROW * (rows - 1)))
    before = np.full(displacement_m.size, True) if measured is None else displacement_m <= measured.displacement_m.max()
    bounds = scale * np.array([[part.lower_mps2[before], part.upper_mps2[before]] for part in some])
    figure.update_yaxes(range=_with_margin(bounds), showticklabels=False)  # so that the parts can be compared
    figure.update_yaxes(title=f"Bias ({display.unit})", showticklabels=True, col=1)
    shown = [total.lower_mps2[before], total.upper_mps2[before]] + ([measured.bias_mps2] if measured else [])
    figure.update_yaxes(
        title=f"Bias, test − CAE ({display.unit})", range=_with_margin(scale * np.concatenate(shown)), row=1, col=1
    )
    return fit_axis(figure)


def _with_margin(values: FloatArray) -> list[float]:
    """Range of an axis that includes these values and zero."""
    low, high = min(values.min(), 0.0), max(values.max(), 0.0)
    margin = 0.05 * (high - low)
    return [low - margin, high + margin]
