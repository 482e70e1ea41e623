"""Marks of a reader on figures over time: a moment or a stretch, with a text."""

from collections.abc import Sequence
from html import escape
from textwrap import shorten, wrap

import numpy as np
import plotly.graph_objects as go

from crashfuse.campaign_folder.notes import Note
from crashfuse.reporting.plots.palette import CURSOR

_WIDTH, _LINES = 36, 2  # characters and lines of a mark's text; all of it is in the list of notes
_STEPS, _STEP_PX = 3, 32  # texts of marks near each other stand at different heights
_BEHIND = "rgba(255, 255, 255, 0.7)"


def add_marks(figure: go.Figure, notes: Sequence[Note]) -> go.Figure:
    """Draw the notes that have a time into every row of a figure over time; returns the same figure.

    Their texts stand in the last row, and not on its zero line: of displacements early ones above the curves, late ones
    below.
    """
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
                figure.add_shape(type="line", **place, x1=start, line={"color": CURSOR, "width": 1.5, "dash": "dot"})
            else:
                figure.add_shape(
                    type="rect", **place, x1=end, fillcolor=CURSOR, opacity=0.15, line_width=0, layer="below"
                )
        lines = wrap(shorten(mark.text, _WIDTH * _LINES, placeholder=" …"), _WIDTH, max_lines=_LINES, placeholder=" …")
        figure.add_annotation(
            x=start, xref="x", y=int(on_top), yref=f"{rows[-1]} domain", yshift=inside_px,
            xanchor="right" if late else "left", align="left",
            yanchor="top" if on_top else "bottom", showarrow=False, font={"size": 12, "color": CURSOR},
            bgcolor=_BEHIND, borderpad=1, text="<br>".join(escape(line, quote=False) for line in lines),
        )  # fmt: skip
    return figure
