"""Curves common to figures over any axis: a test with its predictions, and tests by speed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import plotly.graph_objects as go

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import CrashTest
from crashfuse.reporting.plots.canvas import add_band, add_line
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS, DASHES, MEASURED_COLOUR, speed_lines
from crashfuse.signals.pulse import FloatArray

TEST = "test"
"""Key of the measured curve among those of the approaches."""


@dataclass(frozen=True, eq=False, slots=True)
class Curve:
    """Values over an axis, in the figure's units.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
    band : tuple of ndarray of shape (m,), optional
        Points on the same axis, and the lower and upper bounds of the 95 % band there.
    remark : str
        Text that the legend adds to the name.
    """

    x: FloatArray
    y: FloatArray
    band: tuple[FloatArray, FloatArray, FloatArray] | None = None
    remark: str = ""


def draw_curves(figure: go.Figure, curves: Mapping[str, Curve], yaxis: str = "y", **style: object) -> None:
    """Draw the curves of approaches and of the :data:`TEST`, each in its own colour, the last on top, above all bands.

    ``yaxis`` is ``"y2"`` for the second of stacked plots; the style applies to all lines.
    """
    for name, curve in curves.items():
        if curve.band is not None:
            add_band(
                figure, *curve.band, colour=curve_line(name)["color"], name=_label(name, curve), legendgroup=name,
                showlegend=False, yaxis=yaxis,
            )  # fmt: skip
    for name, curve in curves.items():
        add_line(
            figure, curve.x, curve.y, line=curve_line(name), name=_label(name, curve), legendgroup=name,
            legendrank=1 if name == TEST else 2 + list(LABELS).index(name), yaxis=yaxis, **style,
        )  # fmt: skip


def curve_line(name: str) -> dict[str, Any]:
    """Colour, width and dash of an approach's line, or of the :data:`TEST`'s."""
    if name == TEST:
        return {"color": MEASURED_COLOUR, "width": 2.5}
    return {"color": COLOURS[name], "width": 2, "dash": DASHES[name]}


def by_speed(
    tests: Sequence[CrashTest], highlight: str | None = None, display: Display = DEFAULT
) -> Iterator[tuple[CrashTest, dict[str, Any]]]:
    """Tests by increasing speed, each with the name, colour and dash of its line; the highlighted one is thick."""
    lines = speed_lines(tests)
    for test in sorted(tests, key=lambda test: test.condition.speed_mps):
        thick = test.id == highlight
        yield (
            test,
            {
                "name": f"{test.id} · {display.speed(test.condition.speed_mps)}" + (" (held out)" if thick else ""),
                "line": {**lines[test.id], "width": 4 if thick else 1.7},
                "legendgroup": test.id,  # in a group of its own, each name is spaced as closely as possible
            },
        )


def _label(name: str, curve: Curve) -> str:
    label = "Test" if name == TEST else LABELS[name]
    return f"{label}{' (95 % band)' if curve.band else ''}{curve.remark}"
