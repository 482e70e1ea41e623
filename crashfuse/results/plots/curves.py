"""Curves common to figures over any axis: a test with its predictions, whatever is put beside, and tests by speed."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from textwrap import shorten, wrap
from typing import Any

import numpy as np

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import CLASSES, by_preference, label_of
from crashfuse.campaign_folder.notes import Note
from crashfuse.crash_test import CrashTest
from crashfuse.results.display import DEFAULT, Display
from crashfuse.results.drawing import Drawing, Look, Sheer
from crashfuse.results.plots.palette import COLOURS, CURSOR, DASHES, MEASURED_COLOUR, PAPER, further_line, speed_lines
from crashfuse.signals.pulse import FloatArray

TEST = "test"  # key of the measured curve among those of the approaches
POINTWISE, WHOLE = "95 of 100 tests at each point", "9 of 10 tests as a whole, 0–60 ms"
_WHOLE_ALPHA, _SMOOTH = 0.11, 15  # of the shade of whole curves; samples to either side, 1.2 ms

Band = tuple[FloatArray, FloatArray, FloatArray]
Predictions = Mapping[str, Prediction]  # by approach, or another name in the legend
NONE: Predictions = {}
StyledTests = Sequence[tuple[CrashTest, dict[str, Any]]]


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
    drawing: Drawing, curves: Mapping[str, Curve], yaxis: str = "y", filled: str | None = None, **style: object
) -> None:
    """Draw curves by name: of approaches, of the :data:`TEST`, and of anything else; the last is on top.

    One band is filled, by default the preferred approach's, and that of a single further curve; others are edges.
    """
    lines, labels = curve_lines(curves), {name: f"{label(name)}{curve.remark}" for name, curve in curves.items()}
    filled = with_filled_band(curves, filled)
    beside = [name for name, own in curves.items() if own.band is not None and name not in (filled, *COLOURS)]
    alike = (filled, *beside) if len(beside) == 1 else (filled,)
    for name, curve in curves.items():
        colour: str = lines[name]["color"]
        key: dict[str, Any] = {"name": labels[name], "legendgroup": name, "showlegend": False}
        listed = {"legendrank": 2000, "showlegend": style.get("showlegend", True)}  # behind all curves
        if name == filled:
            key |= {"legend": POINTWISE, "legendgroup": f"band of {name}", **listed}
        if curve.band is not None:
            drawing.band(*curve.band, colour=colour, filled=name in alike, yaxis=yaxis, **key)
        if curve.whole is not None:
            key = {"name": f"{labels[name]}, {WHOLE}", "legend": WHOLE, "legendgroup": f"whole of {name}", **listed}
            key |= {"fillcolor": Sheer(colour, _WHOLE_ALPHA), "zorder": -1}
            drawing.band(*curve.whole, colour=colour, smooth=_SMOOTH, yaxis=yaxis, **key)
    ranks = {name: rank for rank, name in enumerate((TEST, *CLASSES.declared))}
    for number, (name, curve) in enumerate(curves.items()):
        rank = 1 + ranks.get(name, len(ranks) + number)
        key = {"name": labels[name], "legendgroup": name, "legendrank": rank, "line": lines[name]}
        drawing.line(curve.x, curve.y, yaxis=yaxis, **key, **style)


def with_filled_band(curves: Mapping[str, Curve], asked: str | None = None) -> str | None:
    """The curve whose band is filled: the one asked for if it has one, else the preferred approach's."""
    bands = [name for name, curve in curves.items() if curve.band is not None]
    return asked if asked in bands else next(iter(by_preference(bands)), None)


def curve_line(name: str) -> dict[str, Any]:
    """Line of an approach, of the :data:`TEST`, or of a name that brings its own."""
    if isinstance(name, LegendName):
        return name.line
    if name == TEST:
        return {"color": MEASURED_COLOUR, "width": 2.5}
    return {"color": COLOURS[name], "width": 2, "dash": DASHES[name]}


def curve_lines(names: Collection[str]) -> dict[str, dict[str, Any]]:
    """Lines of several curves by name."""
    further = [name for name in names if name != TEST and name not in COLOURS and not isinstance(name, LegendName)]
    return {name: further_line(further.index(name)) if name in further else curve_line(name) for name in names}


def by_speed(
    tests: Sequence[CrashTest],
    display: Display = DEFAULT,
    *,
    highlight: str | None = None,
    speeds_mps: Mapping[str, float] | None = None,
) -> StyledTests:
    """Tests by speed, each with its name and style; the highlight is thick."""
    lines = speed_lines(speeds_mps or {test.id: test.condition.speed_mps for test in tests})

    def style(test: CrashTest) -> dict[str, Any]:
        width, words = (4, " (held out)") if test.id == highlight else (1.7, "")
        name, line = f"{test.id} · {display.speed(test.condition.speed_mps)}{words}", lines[test.id]
        # in a group of its own, each name is spaced as closely as possible
        return {**line, "name": name, "line": {**line["line"], "width": width}, "legendgroup": test.id}

    return [(test, style(test)) for test in sorted(tests, key=lambda test: test.condition.speed_mps)]


def label(name: str) -> str:
    """Name of a curve in legends: of an approach, of the :data:`TEST`, or as it is."""
    return "Test" if name == TEST else label_of(name)


_WIDTH, _LINES = 36, 2  # characters and lines of a mark's text; all of it is in the list of notes
_STEPS, _STEP_PX = 3, 32  # texts of marks near each other stand at different heights
_BEHIND = Sheer(PAPER, 0.7)


def add_marks(drawing: Drawing, notes: Sequence[Note]) -> None:
    """Mark the notes that have a time in every row of a drawing over time."""
    marks = sorted((note for note in notes if note.start_ms is not None), key=lambda note: note.start_ms or 0.0)
    rows = sorted({mark.look.get("yaxis", "y") for mark in drawing.marks})
    if not (marks and rows):
        return
    middle = sum(drawing.axes["x"].look["range"]) / 2  # beyond it a text stands before its mark, inside the figure
    last = np.concatenate([mark.look["y"] for mark in drawing.marks if mark.look.get("yaxis", "y") == rows[-1]])
    zero_is_below = bool(np.nanmax(last) > -np.nanmin(last))
    for number, mark in enumerate(marks):
        start, end, step = mark.start_ms or 0.0, mark.end_ms, number % _STEPS
        late = start > middle
        on_top = zero_is_below and not late
        for row in rows:
            if end is None:
                dotted = Look(type="line", line_color=CURSOR, line_width=1.5, line_dash="dot", layer=None)
                drawing.shade(start, start, row, **dotted)
            else:
                drawing.shade(start, end, row, fillcolor=CURSOR, opacity=0.15)
        lines = wrap(shorten(mark.text, _WIDTH * _LINES, placeholder=" …"), _WIDTH, max_lines=_LINES, placeholder=" …")
        drawing.note(
            "<br>".join(escape(line, quote=False) for line in lines), start, int(on_top), f"{rows[-1]} domain",
            yshift=_STEP_PX * (-step if on_top else step + zero_is_below), xanchor="right" if late else "left",
            yanchor="top" if on_top else "bottom", align="left", font_size=12, font_color=CURSOR, bgcolor=_BEHIND,
            borderpad=1,
        )  # fmt: skip
