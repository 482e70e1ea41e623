"""The numbers that a figure was drawn from, as a table: of its visible curves and bands, in its own units."""

import base64
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from crashfuse.errors import UsageError, require_a
from crashfuse.signals.pulse import FloatArray

_TAG = re.compile(r"<[^>]*>")
_UNIT = re.compile(r"(?P<quantity>.*\S)\s+(?P<unit>\([^()]*\))")
_ROUNDING = 0.01  # of a number in words


@dataclass(frozen=True, eq=False, slots=True)
class _Curve:
    name: str
    axis: str
    x: pd.Series
    y: dict[str, FloatArray]
    is_band: bool = False
    beside: dict[str, Any] = field(default_factory=dict)
    plot: str = ""  # heading of its plot, of several above each other


def figure_table(figure: go.Figure | Mapping[str, Any], hidden: Collection[int] = ()) -> pd.DataFrame:
    """The numbers of any figure of this library, or one read from a report, but for traces at ``hidden`` places.

    One row a position on its x axis; units are in the names of the columns. Curves over the same positions stand side
    by side, a band in two columns. Where positions differ, or points carry names, the table is long: the first column
    names the curve, the next its plot, of several. A heat map is a table of its cells.
    """
    require_a(go.Figure | Mapping, figure, "campaign.plot(), say")
    drawn = figure.to_plotly_json() if isinstance(figure, go.Figure) else figure
    if not {"data", "layout"} <= {*drawn}:
        raise UsageError("A figure has data and a layout; this mapping lacks one of them.")
    layout, traces = drawn["layout"], drawn["data"]
    shown = [
        trace
        for place, trace in enumerate(traces)
        if place not in hidden and trace.get("visible", True) is True and not _is_invisible(trace)
    ]
    for trace in shown:
        if trace["type"] == "heatmap":
            return _matrix(trace)
    headings = _headings(layout)
    read = (_read(trace, layout, headings) for trace in _named(shown))
    curves = _named_apart(curve for curve in read if len(curve.x))
    table = _side_by_side(curves)
    return _long(curves) if table is None else table


def _named(traces: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Traces by their names, without markup; what the legend does not list says whose it is."""
    names = [_text(trace.get("meta", {}).get("name") or trace.get("name")) for trace in traces]
    listed: dict[str, str] = {}
    for trace, name in zip(traces, names, strict=True):
        if trace.get("showlegend", True) and trace.get("legendgroup"):
            listed.setdefault(trace["legendgroup"], name)
    for trace, name in zip(traces, names, strict=True):
        whose = listed.get(trace.get("legendgroup", ""), "")
        yield {**trace, **trace.get("meta", {}), "name": name if whose in ("", name) else f"{whose}: {name}"}


def _is_invisible(trace: Mapping[str, Any]) -> bool:
    entry = isinstance(trace.get("x"), list | tuple) and all(value is None for value in trace["x"])
    return entry or (trace.get("mode") == "markers" and trace.get("marker", {}).get("opacity") == 0)


def unpacked(packed: Mapping[str, Any]) -> np.ndarray[Any, Any]:
    """An array that Plotly holds packed."""
    values = np.frombuffer(base64.b64decode(packed["bdata"]), dtype=np.dtype(packed["dtype"]).newbyteorder("<"))
    shape = packed.get("shape")
    return values.reshape([int(n) for n in str(shape).split(",")]) if shape else values


def _values(data: object) -> np.ndarray[Any, Any]:
    return unpacked(data) if isinstance(data, Mapping) else np.array([] if data is None else data)


def _numbers(data: object) -> FloatArray:
    return _values(data).astype(np.float64)


def _text(words: object) -> str:
    return " ".join(_TAG.sub(" ", str(words or "")).split())


def _title(layout: Mapping[str, Any], reference: str) -> str:
    """Title of an axis, ``x2`` say; of plots above or beside each other one may carry it for all."""
    direction = reference[0]
    axes = [layout.get(f"{direction}axis{reference[1:]}", {})]
    axes += [layout[key] for key in layout if key.startswith(f"{direction}axis")]
    titles = (_text(axis.get("title", {}).get("text")) for axis in axes)
    return next(filter(None, titles), direction)


def _headings(layout: Mapping[str, Any]) -> dict[str, str]:
    tops = {f"y{key[5:]}": axis["domain"][1] for key, axis in layout.items() if key[:5] == "yaxis" and "domain" in axis}
    texts = {note["y"]: _text(note["text"]) for note in layout.get("annotations", ()) if note.get("yref") == "paper"}
    headings = {"y" if axis == "y1" else axis: texts[top] for axis, top in tops.items() if top in texts}
    return headings if len(headings) > 1 else {}


def _read(trace: Mapping[str, Any], layout: Mapping[str, Any], headings: Mapping[str, str]) -> _Curve:
    axis, positions = trace.get("yaxis") or "y", _values(trace.get("x"))
    if positions.dtype.kind not in "fiu":
        positions = np.array([_text(name) for name in positions], dtype=object)
    x, title = pd.Series(positions, name=_title(layout, trace.get("xaxis") or "x")), _title(layout, axis)
    curve = _Curve(trace["name"], axis, x, {}, plot=headings.get(axis, ""))
    if "lower" in trace:
        return replace(curve, y=_ends(title, _numbers(trace["lower"]), _numbers(trace["upper"])), is_band=True)
    values = _numbers(trace.get("y"))
    if trace["type"] == "bar" and trace.get("base") is not None:  # from its base to its end
        curve.y.update(_ends(title, base := _numbers(trace["base"]), base + values))
    else:
        curve.y.update({title: values} | _interval(title, trace.get("error_y", {}), values))
    if isinstance(trace.get("text"), list | tuple):
        curve.beside["Label"] = [_text(label) for label in trace["text"]]
    curve.beside.update(_interval(str(x.name), trace.get("error_x", {}), _values(trace.get("x"))))
    return curve


def _interval(title: str, error: Mapping[str, Any], values: FloatArray) -> dict[str, FloatArray]:
    if error.get("array") is None:
        return {}
    up = _numbers(error["array"])
    down = up if error.get("arrayminus") is None else _numbers(error["arrayminus"])
    return _ends(title, values - down, values + up)


def _ends(title: str, lower: FloatArray, upper: FloatArray) -> dict[str, FloatArray]:
    parts = _UNIT.fullmatch(title)
    name, unit = (parts["quantity"], f" {parts['unit']}") if parts else (title, "")
    return {f"{name}, lower{unit}": lower, f"{name}, upper{unit}": upper}


def _named_apart(curves: Iterable[_Curve]) -> list[_Curve]:
    """Curves as they first appear, each before its band; where several in a plot have one name, they are numbered."""
    taken: set[tuple[str, ...]] = set()
    order: dict[tuple[str, str], list[_Curve]] = {}
    for curve in curves:
        name, number = curve.name, 1
        while (name, curve.axis, *curve.y) in taken:
            number += 1
            name = f"{curve.name} {number}"
        taken.add((name, curve.axis, *curve.y))
        order.setdefault((curve.axis, name), []).append(replace(curve, name=name))
    return [curve for same in order.values() for curve in sorted(same, key=lambda curve: curve.is_band)]


def _side_by_side(curves: Sequence[_Curve]) -> pd.DataFrame | None:
    """None unless all positions are numbers that rise, and among those of the longest curve."""
    if not curves or any(curve.beside or curve.x.dtype.kind not in "fiu" or curve.x.name == "x" for curve in curves):
        return None
    positions = [curve.x for curve in curves]
    longest = max(positions, key=len)
    if not all(x.is_monotonic_increasing and x.is_unique and x.isin(longest).all() for x in positions):
        return None
    columns = {
        f"{curve.name}: {title}" if curve.name else title: pd.Series(values, index=curve.x)
        for curve in curves
        for title, values in curve.y.items()
    }
    return pd.DataFrame(columns).reindex(longest).rename_axis(longest.name).reset_index()


def _long(curves: Sequence[_Curve]) -> pd.DataFrame:
    parts = []
    for curve in curves:
        names = {"Curve": curve.name, **({"Plot": curve.plot} if curve.plot else {})}
        parts.append(pd.DataFrame({**names, str(curve.x.name): curve.x.to_numpy(), **curve.y, **curve.beside}))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def _matrix(trace: Mapping[str, Any]) -> pd.DataFrame:
    """The cells of a heat map: their numbers if its words begin with them, else the words; and what is beside rows."""
    cells = _numbers(trace["z"]).astype(object)
    words = _values(trace.get("text"))
    if words.size and not all(map(_begins_with, words.flat, cells.flat)):
        cells = np.array([_text(cell) for cell in words.flat], dtype=object).reshape(cells.shape)
    table = pd.DataFrame(cells, columns=[_text(name) for name in _values(trace["x"])]).infer_objects()
    table.insert(0, "Row", [_text(name) for name in _values(trace["y"])])
    return table.assign(**trace.get("meta", {}))


def _begins_with(words: str, number: float) -> bool:
    try:
        return abs(float(words.split()[0]) - number) < _ROUNDING
    except (ValueError, IndexError):
        return False
