"""Curves common to figures over any axis: a test with its predictions, whatever is put beside, and tests by speed."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from textwrap import shorten, wrap
from typing import Any

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.registry import CLASSES, by_preference, label_of
from crashfuse.campaign_folder.notes import Note
from crashfuse.crash_test import CrashTest
from crashfuse.reporting.plots.canvas import add_band, add_line
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS, CURSOR, DASHES, MEASURED_COLOUR, further_line, speed_lines
from crashfuse.signals.pulse import FloatArray

TEST = "test"  # key of the measured curve among those of the approaches
POINTWISE, WHOLE = "95 of 100 tests inside at each point", "9 of 10 tests inside as a whole, 0–60 ms"

Band = tuple[FloatArray, FloatArray, FloatArray]


class LegendName(str):
    """The name of a curve that is drawn with a line of its choice."""

    line: dict[str, Any]

    @classmethod
    def of(cls, name: str, line: dict[str, Any]) -> "LegendName":
        """A name with its line."""
        named = cls(name)
        named.line = line
        return named


@dataclass(frozen=True, eq=False, slots=True)
class Curve:
    """Values over an axis, in the figure's units; its bands (positions, lower, upper), and what its name adds."""

    x: FloatArray
    y: FloatArray
    band: Band | None = None
    remark: str = ""
    whole: Band | None = None


def draw_curves(
    figure: go.Figure, curves: Mapping[str, Curve], yaxis: str = "y", filled: str | None = None, **style: object
) -> None:
    """Draw curves by name: of approaches, of the :data:`TEST`, and of anything else; the last is on top.

    Filled are one band, by default the preferred approach's, and that of a single curve beside the approaches; of the
    others the edges are drawn.
    """
    lines, labels = curve_lines(curves), {name: _label(name, curve) for name, curve in curves.items()}
    filled = with_filled_band(curves, filled)
    beside = [
        name for name, curve in curves.items() if curve.band is not None and name != filled and name not in COLOURS
    ]
    alike = (filled, *beside) if len(beside) == 1 else (filled,)
    for name, curve in curves.items():
        colour: str = lines[name]["color"]
        key: dict[str, Any] = {"name": labels[name], "legendgroup": name, "showlegend": False}
        listed = {"legendrank": 2000, "showlegend": style.get("showlegend", True)}  # behind all curves
        if name == filled:
            key = {"name": POINTWISE, "legendgroup": f"band of {name}", "whose": labels[name], **listed}
        if curve.band is not None:
            add_band(figure, *curve.band, colour=colour, filled=name in alike, yaxis=yaxis, **key)
        if curve.whole is not None:
            key = {"name": WHOLE, "legendgroup": f"whole of {name}", "whose": f"{labels[name]}, {WHOLE}", **listed}
            dashed = {"width": 1.5, "dash": "dash", "color": colour}
            add_band(figure, *curve.whole, colour=colour, filled=False, line=dashed, yaxis=yaxis, **key)
    ranks = {name: rank for rank, name in enumerate((TEST, *CLASSES.declared))}
    for number, (name, curve) in enumerate(curves.items()):
        add_line(
            figure, curve.x, curve.y, line=lines[name], name=labels[name], legendgroup=name,
            legendrank=1 + ranks.get(name, len(ranks) + number), yaxis=yaxis, **style,
        )  # fmt: skip


def with_filled_band(curves: Mapping[str, Curve], asked: str | None = None) -> str | None:
    """The curve whose band is filled: the one asked for if it has a band, else that of the preferred approach."""
    bands = [name for name, curve in curves.items() if curve.band is not None]
    return asked if asked in bands else next(iter(by_preference(bands)), None)


def curve_line(name: str) -> dict[str, Any]:
    """Colour, width and dash of an approach's line, of the :data:`TEST`'s, or of a name that brings its own."""
    if isinstance(name, LegendName):
        return name.line
    if name == TEST:
        return {"color": MEASURED_COLOUR, "width": 2.5}
    return {"color": COLOURS[name], "width": 2, "dash": DASHES[name]}


def curve_lines(names: Collection[str]) -> dict[str, dict[str, Any]]:
    """Lines of several curves by name, whatever is put beside approaches and test among them."""
    further = [name for name in names if name != TEST and name not in COLOURS and not isinstance(name, LegendName)]
    return {name: further_line(further.index(name)) if name in further else curve_line(name) for name in names}


def by_speed(
    tests: Sequence[CrashTest],
    highlight: str | None = None,
    display: Display = DEFAULT,
    speeds_mps: Mapping[str, float] | None = None,
) -> Iterator[tuple[CrashTest, dict[str, Any]]]:
    """Tests by increasing speed, each with its name and its style among all speeds; the highlight is thick."""
    styles = speed_lines(speeds_mps or {test.id: test.condition.speed_mps for test in tests})
    for test in sorted(tests, key=lambda test: test.condition.speed_mps):
        thick = test.id == highlight
        yield (
            test,
            {
                "name": f"{test.id} · {display.speed(test.condition.speed_mps)}" + (" (held out)" if thick else ""),
                **styles[test.id],
                "line": {**styles[test.id]["line"], "width": 4 if thick else 1.7},
                "legendgroup": test.id,  # in a group of its own, each name is spaced as closely as possible
            },
        )


def _label(name: str, curve: Curve) -> str:
    label = "Test" if name == TEST else label_of(name)
    return f"{label}{curve.remark}"


_WIDTH, _LINES = 36, 2  # characters and lines of a mark's text; all of it is in the list of notes
_STEPS, _STEP_PX = 3, 32  # texts of marks near each other stand at different heights
_BEHIND = "rgba(255, 255, 255, 0.7)"


def add_marks(figure: go.Figure, notes: Sequence[Note]) -> go.Figure:
    """Draw the notes that have a time into every row of a figure over time; returns the same figure."""
    marks = sorted((note for note in notes if note.start_ms is not None), key=lambda note: note.start_ms or 0.0)
    rows = sorted({trace.yaxis or "y" for trace in figure.data})
    if not (marks and rows):
        return figure
    middle = sum(figure.layout.xaxis.range) / 2  # beyond it a text stands before its mark, inside the figure
    last = np.concatenate([trace.y for trace in figure.data if (trace.yaxis or "y") == rows[-1]])
    zero_is_below = bool(np.nanmax(last) > -np.nanmin(last))
    for number, mark in enumerate(marks):
        start, end, step = mark.start_ms or 0.0, mark.end_ms, number % _STEPS
        late = start > middle
        on_top = zero_is_below and not late
        inside_px = _STEP_PX * (-step if on_top else step + zero_is_below)
        for row in rows:
            place = {"xref": "x", "yref": f"{row} domain", "x0": start, "y0": 0, "y1": 1}
            if end is None:
                figure.add_shape(type="line", **place, x1=start, line_color=CURSOR, line_width=1.5, line_dash="dot")
            else:
                figure.add_shape(
                    type="rect", **place, x1=end, fillcolor=CURSOR, opacity=0.15, line_width=0, layer="below"
                )
        lines = wrap(shorten(mark.text, _WIDTH * _LINES, placeholder=" …"), _WIDTH, max_lines=_LINES, placeholder=" …")
        figure.add_annotation(
            x=start, xref="x", y=int(on_top), yref=f"{rows[-1]} domain", yshift=inside_px,
            xanchor="right" if late else "left", align="left",
            yanchor="top" if on_top else "bottom", showarrow=False, font_size=12, font_color=CURSOR,
            bgcolor=_BEHIND, borderpad=1, text="<br>".join(escape(line, quote=False) for line in lines),
        )  # fmt: skip
    return figure
