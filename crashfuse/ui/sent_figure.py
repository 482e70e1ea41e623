"""Figures in the form in which the browser draws each of them once.

Streamlit hands every figure to Plotly twice, the second time with its width. Plotly would then draw it all anew: packed
arrays and a template are to it other data whenever they are other objects; plain lists under one ``datarevision`` are
not. It also draws anew where the names above a figure need more room than its margin has.
"""

import hashlib
from collections.abc import Callable, Mapping
from typing import Any, TypeGuard

import numpy as np
import plotly.graph_objects as go

from crashfuse.reporting.figure_data import unpacked
from crashfuse.reporting.plots.canvas import AXIS_TITLE, band_points, room_above, without_links
from crashfuse.signals.pulse import FloatArray

_DIGITS = 5  # of the largest value of a curve, on a screen of thousands of pixels
_OFF = 1e-4  # share of a curve's range by which it may be off where it is drawn through fewer points
_STRAIGHT = 1e-6  # share of a grid's length by which its points may be off


class SentFigure(go.Figure):  # type: ignore[misc]  # Plotly has no types
    """A figure for ``st.plotly_chart``; its curves are rounded, and drawn through fewer points, where no eye sees it.

    Streamlit writes and reads what is sent four times before Plotly has it. And it copies a figure whenever it is
    shown, which takes longer than all else if there are plain lists: so a copy is made once, here.
    """

    def __init__(self, figure: go.Figure) -> None:
        super().__init__()
        digest, parts = hashlib.sha256(), figure.layout.to_plotly_json()
        traces = [{k: part for k, part in trace.to_plotly_json().items() if k != "meta"} for trace in figure.data]
        data = [_spaced(_fewer(_plain(trace, digest.update))) for trace in traces]
        layout = {name: _plain(part) for name, part in parts.items() if name != "template"}
        for name, axis in layout.items():
            if name[1:5] == "axis" and "title" in axis:
                axis["title"] = {**AXIS_TITLE, **axis["title"]}
        layout["datarevision"] = digest.hexdigest()[:16]
        if "margin" in layout:
            layout["margin"] = {**layout["margin"], "t": max(layout["margin"]["t"], room_above(figure))}
        self._sent = {"data": data, "layout": layout}

    def to_dict(self) -> dict[str, Any]:
        """What is sent."""
        return dict(self._sent)


def _plain(part: Any, take: Callable[[bytes], object] = bytes) -> Any:  # noqa: ANN401 - any part of a figure
    """The same with lists for arrays, packed or not; ``take`` is given all of it, as bytes."""
    if isinstance(part, Mapping) and "bdata" in part:
        part = unpacked(part)
    if isinstance(part, np.ndarray):
        if part.dtype.kind not in "biuf":
            return _plain(part.tolist(), take)
        take(np.ascontiguousarray(part).tobytes() if part.dtype.kind == "f" else repr(part.tolist()).encode())
        return _listed(part)
    if isinstance(part, Mapping):
        take(repr(list(part)).encode())
        return {name: _plain(own, take) for name, own in part.items()}
    if isinstance(part, list | tuple):
        return [_plain(own, take) for own in part]
    take(repr(part).encode())
    return without_links(part) if isinstance(part, str) else part


def _listed(values: np.ndarray[Any, Any]) -> list[Any]:
    """Values as numbers of few digits; None for none, which JSON cannot hold otherwise."""
    if values.dtype.kind != "f" or not values.size:
        return list(values.tolist())
    rounded = np.round(values.astype(np.float64), _decimals(values))
    if not (known := np.isfinite(rounded)).all():
        rounded = rounded.astype(object)
        rounded[~known] = None
    return list(rounded.tolist())


def _decimals(values: FloatArray) -> int:
    largest = np.nanmax(np.abs(values), initial=0.0)
    return _DIGITS - int(np.ceil(np.log10(largest))) if 0 < largest < np.inf else _DIGITS


def _fewer(trace: dict[str, Any]) -> dict[str, Any]:
    """A smooth curve, if the cursor does not read it, through as many points as a band."""
    x, y = trace.get("x"), trace.get("y")
    if trace.get("hoverinfo") != "none" or not (_is_known(x) and _is_known(y)):
        return trace
    (across, up), some = np.array([x, y]), band_points(len(x))
    if np.abs(np.interp(across, across[some], up[some]) - up).max() > _OFF * np.ptp(up):
        return trace
    return {**trace, "x": across[some].tolist(), "y": up[some].tolist()}


def _spaced(trace: dict[str, Any]) -> dict[str, Any]:
    """The same curve with first position and step for positions that are evenly spaced: half as much is sent."""
    x = trace.get("x")
    if trace["type"] != "scatter" or not _is_known(x):
        return trace
    step = (x[-1] - x[0]) / (len(x) - 1)
    if step <= 0 or np.abs(np.array(x) - x[0] - step * np.arange(len(x))).max() > _STRAIGHT * (x[-1] - x[0]):
        return trace
    return {name: own for name, own in trace.items() if name != "x"} | {"x0": x[0], "dx": step}


def _is_known(values: object) -> TypeGuard[list[float]]:
    """True for three numbers or more without a gap."""
    return isinstance(values, list) and len(values) >= 3 and {*map(type, values)} == {float}
