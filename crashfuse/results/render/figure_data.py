"""The numbers that a figure was drawn from, as a table: of its visible curves and bands, in its own units."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from crashfuse.results.drawing import Drawing, Numbers, drawing_of

_Curve = tuple[str, Numbers, pd.DataFrame]


def figure_table(figure: go.Figure) -> pd.DataFrame:
    """The numbers of any figure of this library, but for traces that are not visible.

    One row a position on its x axis; units are in the names of the columns. Curves over the same positions stand side
    by side, a band in two columns. Where positions differ, or points carry names, the table is long: the first column
    names the curve, the next its plot, of several. A heat map is a table of its cells.
    """
    drawing = drawing_of(figure)
    hidden = [place for place, trace in enumerate(figure.data) if trace.visible not in (None, True)]
    return drawing_table(drawing, hidden)


def drawing_table(drawing: Drawing, hidden: Collection[int] = ()) -> pd.DataFrame:
    """The numbers of a drawing, but for marks at ``hidden`` places, see :func:`figure_table`."""
    shown = [own for place, own in enumerate(drawing.numbers()) if own is not None and place not in hidden]
    for own in shown:
        if own.kind == "cells":
            return pd.DataFrame(own.columns).infer_objects()
    curves = _named_apart((own.name, own, _frame(own)) for own in shown)
    table = _side_by_side(curves)
    return _long(curves) if table is None else table


def _frame(numbers: Numbers) -> pd.DataFrame:
    position, *_ = numbers.columns
    frame = pd.DataFrame({heading: np.asarray(own) for heading, own in numbers.columns.items()})
    return frame.astype(dict.fromkeys(frame.columns.difference([position, "Label"]), np.float64))


def _named_apart(curves: Iterable[_Curve]) -> list[_Curve]:
    """Curves as they first appear, each before its band; where several in a plot have one name, they are numbered."""
    taken: set[tuple[str, ...]] = set()
    order: dict[tuple[str, str], list[_Curve]] = {}
    for first, own, frame in curves:
        if frame.empty:
            continue
        name, number = first, 1
        while (name, own.axis, *frame.columns[1:3]) in taken:
            number += 1
            name = f"{first} {number}"
        taken.add((name, own.axis, *frame.columns[1:3]))
        order.setdefault((own.axis, name), []).append((name, own, frame))
    return [curve for same in order.values() for curve in sorted(same, key=lambda curve: curve[1].kind == "band")]


def _side_by_side(curves: Sequence[_Curve]) -> pd.DataFrame | None:
    """None unless all are of one plot, and all positions numbers that rise, among those of the longest curve."""
    positions = [frame.iloc[:, 0] for _, _, frame in curves]
    if not curves or any(own.kind == "points" or own.plot for _, own, _ in curves):
        return None
    if any(x.dtype.kind not in "fiu" for x in positions):
        return None
    longest = max(positions, key=len)
    if not all(x.is_monotonic_increasing and x.is_unique and x.isin(longest).all() for x in positions):
        return None
    columns = {
        f"{name}: {heading}" if name else heading: pd.Series(frame[heading].to_numpy(), index=frame.iloc[:, 0])
        for name, _, frame in curves
        for heading in frame.columns[1:]
    }
    return pd.DataFrame(columns).reindex(longest).rename_axis(longest.name).reset_index()


def _long(curves: Sequence[_Curve]) -> pd.DataFrame:
    named = [{"Curve": name, **({"Plot": own.plot} if own.plot else {})} for name, own, _ in curves]
    parts = [pd.DataFrame({**names, **frame}) for names, (_, _, frame) in zip(named, curves, strict=True)]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
