"""The numbers that a figure was drawn from, as a table: of its visible curves and bands, in its own units.

A trace's arrays are its data; where it draws less, or elsewhere, its ``meta`` has them. A curve that is hidden, by a
click in the legend, say, is not in the table.
"""

import base64
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from crashfuse.signals.pulse import FloatArray

_TAG = re.compile(r"<[^>]*>")
_UNIT = re.compile(r"(?P<quantity>.*\S)\s+(?P<unit>\([^()]*\))")
_BAND_IN_NAME = re.compile(r" \(95 % band\)")
_ROUNDING = 0.01  # of a number in words


@dataclass(frozen=True, eq=False, slots=True)
class _Shown:
    """One curve, band or set of points: values by the column they belong to, all over the same positions."""

    name: str
    axis: str
    x: pd.Series
    y: dict[str, FloatArray]
    is_band: bool = False
    beside: dict[str, Sequence[object]] = field(default_factory=dict)
    plot: str = ""  # heading of its plot, of several above each other

    @property
    def names(self) -> dict[str, str]:
        """What it is, and in which of several plots."""
        return {"Curve": self.name, **({"Plot": self.plot} if self.plot else {})}


def figure_table(figure: go.Figure | Mapping[str, Any], hidden: Collection[int] = ()) -> pd.DataFrame:
    """The numbers of a figure, one row a position on its x axis; units are in the names of the columns.

    Curves over the same positions stand side by side, one column each and two for a band. Where positions differ, or
    points carry names, the table is long: the first column names the curve, the next its plot, of several.
    A heat map is a table of its cells.

    Parameters
    ----------
    figure : Figure or mapping
        Any figure of this library, or one read from a report.
    hidden : collection of int
        Places of traces that the reader has hidden.
    """
    drawn = figure.to_plotly_json() if isinstance(figure, go.Figure) else figure
    layout, traces = drawn["layout"], drawn["data"]
    shown = [
        trace
        for place, trace in enumerate(traces)
        if place not in hidden and trace.get("visible", True) is True and not _is_invisible(trace)
    ]
    for trace in shown:
        if trace["type"] == "heatmap":
            return _matrix(trace)
    shown = list(_named(shown))
    read = [_band(trace, layout) if "lower" in trace else _points(trace, layout) for trace in shown]
    headings = _headings(layout)
    curves = _named_apart([replace(curve, plot=headings.get(curve.axis, "")) for curve in read if len(curve.x)])
    return _side_by_side(curves) if _have_one_axis(curves) else _long(curves)


def _named(traces: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Traces by their own names, without markup; what the legend does not list says whose it is."""
    listed: dict[str, str] = {}
    for trace in traces:
        if trace.get("showlegend", True) and trace.get("legendgroup"):
            listed.setdefault(trace["legendgroup"], _name(trace))
    for trace in traces:
        whose, name = listed.get(trace.get("legendgroup", ""), ""), _name(trace)
        yield {**trace, **trace.get("meta", {}), "name": name if whose in ("", name) else f"{whose}: {name}"}


def _name(trace: Mapping[str, Any]) -> str:
    return _BAND_IN_NAME.sub("", _text(trace.get("name")))


def _is_invisible(trace: Mapping[str, Any]) -> bool:
    """True for marks that only take clicks, and for entries of the legend alone."""
    marker = trace.get("marker", {})
    entry = all(value is None for value in trace["x"]) if isinstance(trace.get("x"), list | tuple) else False
    return entry or (trace.get("mode") == "markers" and marker.get("opacity") == 0)


def unpacked(packed: Mapping[str, Any]) -> np.ndarray[Any, Any]:
    """An array that Plotly holds packed."""
    values = np.frombuffer(base64.b64decode(packed["bdata"]), dtype=np.dtype(packed["dtype"]).newbyteorder("<"))
    shape = packed.get("shape")
    return values.reshape([int(n) for n in str(shape).split(",")]) if shape else values


def _values(data: object) -> np.ndarray[Any, Any]:
    """Values of a trace, which Plotly may hold packed."""
    return unpacked(data) if isinstance(data, Mapping) else np.array([] if data is None else data)


def _numbers(data: object) -> FloatArray:
    return _values(data).astype(np.float64)


def _text(words: object) -> str:
    """Words of a figure without their markup."""
    return " ".join(_TAG.sub(" ", str(words or "")).split())


def _axis(layout: Mapping[str, Any], reference: str) -> Mapping[str, Any]:
    """The axis ``x2`` of a layout, say."""
    found: Mapping[str, Any] = layout.get(f"{reference[0]}axis{reference[1:]}", {})
    return found


def _title(layout: Mapping[str, Any], reference: str) -> str:
    """Title of an axis; of plots above or beside each other one may carry it for all."""
    direction = reference[0]
    others = [layout[key] for key in layout if key.startswith(f"{direction}axis")]
    titles = [_text(axis.get("title", {}).get("text")) for axis in (_axis(layout, reference), *others)]
    return next(filter(None, titles), direction)


def _positions(trace: Mapping[str, Any], layout: Mapping[str, Any]) -> pd.Series:
    """Positions on the x axis, numbers or names."""
    values = _values(trace.get("x"))
    if values.dtype.kind not in "fiu":
        values = np.array([_text(each) for each in values], dtype=object)
    return pd.Series(values, name=_title(layout, trace.get("xaxis") or "x"))


def _headings(layout: Mapping[str, Any]) -> dict[str, str]:
    """What stands above each plot, by its y axis, where something does."""
    tops = {f"y{key[5:]}": axis["domain"][1] for key, axis in layout.items() if key[:5] == "yaxis" and "domain" in axis}
    texts = {note["y"]: _text(note["text"]) for note in layout.get("annotations", ()) if note.get("yref") == "paper"}
    found = {"y" if axis == "y1" else axis: texts[top] for axis, top in tops.items() if top in texts}
    return found if len(found) > 1 else {}


def _points(trace: Mapping[str, Any], layout: Mapping[str, Any]) -> _Shown:
    """A curve or points, with the ends of their intervals."""
    axis, x = trace.get("yaxis") or "y", _positions(trace, layout)
    title, values = _title(layout, axis), _numbers(trace.get("y"))
    beside: dict[str, Sequence[object]] = {}
    if isinstance(trace.get("text"), list | tuple):
        beside["Label"] = [_text(each) for each in trace["text"]]
    y = {title: values}
    if trace["type"] == "bar" and trace.get("base") is not None:  # from its base to its end
        base = _numbers(trace["base"])
        y = _ends(title, base, base + values)
    elif (ends := _interval(trace.get("error_y", {}), values)) is not None:
        y |= _ends(title, *ends)
    if (ends := _interval(trace.get("error_x", {}), _values(trace.get("x")))) is not None:
        beside |= {name: list(each) for name, each in _ends(str(x.name), *ends).items()}
    return _Shown(trace["name"], axis, x, y, beside=beside)


def _interval(error: Mapping[str, Any], values: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Lower and upper ends of error bars, if there are any."""
    if error.get("array") is None:
        return None
    up = _numbers(error["array"])
    return values - (up if error.get("arrayminus") is None else _numbers(error["arrayminus"])), values + up


def _band(trace: Mapping[str, Any], layout: Mapping[str, Any]) -> _Shown:
    """A band by its ends."""
    axis = trace.get("yaxis") or "y"
    ends = _ends(_title(layout, axis), _numbers(trace["lower"]), _numbers(trace["upper"]))
    return _Shown(trace["name"], axis, _positions(trace, layout), ends, is_band=True)


def _ends(title: str, lower: FloatArray, upper: FloatArray) -> dict[str, FloatArray]:
    """Both ends of an interval by their columns: ``Acceleration, lower (g)``."""
    parts = _UNIT.fullmatch(title)
    name, unit = (parts["quantity"], f" {parts['unit']}") if parts else (title, "")
    return {f"{name}, lower{unit}": lower, f"{name}, upper{unit}": upper}


def _named_apart(curves: Iterable[_Shown]) -> list[_Shown]:
    """Curves as they first appear, each before its band; where several in a plot have one name, they are numbered."""
    taken: set[tuple[str, ...]] = set()
    order: dict[tuple[str, str], list[_Shown]] = {}
    for curve in curves:
        name, number = curve.name, 1
        while (name, curve.axis, *curve.y) in taken:
            number += 1
            name = f"{curve.name} {number}"
        taken.add((name, curve.axis, *curve.y))
        order.setdefault((curve.axis, name), []).append(replace(curve, name=name))
    return [curve for same in order.values() for curve in sorted(same, key=lambda own: own.is_band)]


def _have_one_axis(curves: Sequence[_Shown]) -> bool:
    """True if all positions are numbers that rise, and among those of the longest curve."""
    if not curves or any(curve.beside or curve.x.dtype.kind not in "fiu" or curve.x.name == "x" for curve in curves):
        return False
    longest = max((curve.x for curve in curves), key=len)
    return all(
        curve.x.is_monotonic_increasing and curve.x.is_unique and curve.x.isin(longest).all() for curve in curves
    )


def _side_by_side(curves: Sequence[_Shown]) -> pd.DataFrame:
    longest = max((curve.x for curve in curves), key=len)
    columns: dict[str, pd.Series] = {}
    for curve in curves:
        for title, values in curve.y.items():
            columns[f"{curve.name}: {title}" if curve.name else title] = pd.Series(values, index=curve.x)
    table = pd.DataFrame(columns).reindex(longest)
    return table.rename_axis(longest.name).reset_index()


def _long(curves: Sequence[_Shown]) -> pd.DataFrame:
    parts = [
        pd.DataFrame({**curve.names, str(curve.x.name): curve.x.to_numpy(), **curve.y, **curve.beside})
        for curve in curves
    ]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def _matrix(trace: Mapping[str, Any]) -> pd.DataFrame:
    """The cells of a heat map: their numbers if its words begin with them, else the words; and what is beside rows."""
    cells = _numbers(trace["z"]).astype(object)
    words = _values(trace.get("text"))
    if words.size and not all(map(_begins_with, words.flat, cells.flat)):
        cells = np.array([_text(each) for each in words.flat], dtype=object).reshape(cells.shape)
    table = pd.DataFrame(cells, columns=[_text(each) for each in _values(trace["x"])]).infer_objects()
    table.insert(0, "Row", [_text(each) for each in _values(trace["y"])])
    return table.assign(**trace.get("meta", {}))


def _begins_with(words: str, number: float) -> bool:
    try:
        return abs(float(words.split()[0]) - number) < _ROUNDING
    except (ValueError, IndexError):
        return False
