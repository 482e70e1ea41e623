"""A drawing as data: marks with their numbers over axes with a quantity and a unit, which Plotly draws.

Looks are in Plotly's words, as plain dicts. Files and tables of a drawing are made of its numbers, never of its looks.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb

from crashfuse.errors import UsageError, require_a
from crashfuse.results.plots.palette import in_the_dark
from crashfuse.signals.pulse import FloatArray

Values = Sequence[Any] | np.ndarray[Any, Any]
Ends = tuple[Values, Values]
Look = dict[str, Any]
"""How something is drawn, in Plotly's words; ``line_width``, say, is the width of the line."""

_BAND_POINTS = 320  # 0.32 ms apart: one to three pixels
_BAND_ALPHA, _BAND_ALPHA_IN_THE_DARK = 0.18, 0.25
_TITLE_PX = 14  # by default a fifth larger than all other words
_WITH_UNDERSCORE = ("error_x", "error_y", "paper_bgcolor", "plot_bgcolor")


class Sheer(NamedTuple):
    """A colour that what lies behind it shines through."""

    colour: str
    alpha: float = _BAND_ALPHA


@dataclass(eq=False, slots=True)
class Axis:
    """What an axis shows, the heading of its plot (of several), and its look."""

    look: Look
    quantity: str = ""
    unit: str = ""
    plot: str = ""

    def heading(self, end: str = "") -> str:
        """Quantity and unit as a heading."""
        return f"{self.quantity}{end}" + (f" ({self.unit})" if self.unit else "")


class Numbers(NamedTuple):
    """The numbers of a mark by the headings of their columns, positions first."""

    name: str
    columns: dict[str, Any]
    kind: str = "line"  # or a band, points or cells
    axis: str = "y"
    plot: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Mark:
    """What is drawn at once: its look, its name in tables, and its numbers, if any.

    These are ``x``, ``y``, ``lower``, ``upper``, ``x_lower``, ``x_upper`` and ``label``; those of cells go by columns.
    """

    look: Look
    name: str = ""
    numbers: Mapping[str, Any] = field(default_factory=dict)


class Drawing:
    """Marks over axes, as they are drawn and as they are read."""

    def __init__(self, layout: Look, axes: Mapping[str, Look]) -> None:
        """An empty one; ``axes`` has the look of horizontal axes, ``x``, and of vertical ones, ``y``."""
        self.layout = _merged({}, layout)
        self.marks: list[Mark] = []
        self.axes: dict[str, Axis] = {}
        self._looks = axes
        for name in axes:
            self.axis(name)

    def axis(
        self, name: str, quantity: str | None = None, unit: str = "", *, title: str | None = None, **look: object
    ) -> None:
        """Say what an axis, ``y2`` say, shows, and how; its title is that, or another, or none ("")."""
        axis = self.axes.setdefault(name, Axis(_merged({}, self._looks[name[0]])))
        if quantity is not None:
            axis.quantity, axis.unit = quantity, unit
            text = axis.heading() if title is None else title
            axis.look["title"] = {"text": text, "font": {"size": _TITLE_PX}} if text else None
        _merged(axis.look, look)

    def update(self, **layout: object) -> None:
        """Change parts of the layout."""
        _merged(self.layout, layout)

    def line(self, x: Values, y: Values, **look: object) -> None:
        """Draw one curve, see :meth:`points`; ``yaxis`` selects one of stacked plots."""
        # a template's own format, not yhoverformat, would write negative numbers with a hyphen
        usual = Look(mode="lines", hovertemplate="%{y}", yhoverformat=".1f")
        self.points(x, y, **usual | look)

    def points(
        self, x: Values, y: Values, *, ends: Ends | None = None, numbers: Mapping[str, Values] = {}, **look: object
    ) -> None:
        """Draw points with the ends of their intervals; tables have other ``numbers``, a place for ``x`` say.

        ``legend`` is a name in the legend other than that in tables.
        """
        shown: Look = {"x": x, "y": y, **numbers}
        if ends is not None:
            lower, values, upper = (np.asarray(own, dtype=np.float64) for own in (ends[0], y, ends[1]))
            shown |= {"lower": lower, "upper": upper}
            look |= Look(error_y_array=upper - values, error_y_arrayminus=values - lower)
        if "text" in look:
            shown["label"] = look["text"]
        self.add({"x": x, "y": y, **look}, shown)

    def band(
        self,
        x: FloatArray,
        lower: FloatArray,
        upper: FloatArray,
        *,
        colour: str,
        filled: bool = True,
        smooth: int = 0,
        **look: object,
    ) -> None:
        """Shade between two curves, or draw their edges, with a gap where either is unknown.

        It is drawn with edges smoothed over so many samples to either side, nowhere narrower; its numbers are not.
        """
        lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)  # deceleration turns them over
        is_finite = np.isfinite(lower) & np.isfinite(upper)
        numbers = {"x": x[is_finite], "lower": lower[is_finite], "upper": upper[is_finite]}
        lower, upper = -_smoothed(-lower, smooth), _smoothed(upper, smooth)
        some = np.append(np.arange(0, x.size - 1, -(-x.size // _BAND_POINTS)), x.size - 1)  # drawn, with both ends
        x, lower, upper, known = x[some], lower[some], upper[some], np.flatnonzero(is_finite[some])
        if not known.size:
            return
        outline: list[FloatArray] = []
        gap = np.full((2, 1), np.nan)
        for stretch in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
            forth, back = (np.array([x[stretch], end[stretch]]) for end in (lower, upper))
            outline += [forth, *([] if filled else [gap]), back[:, ::-1], gap]  # edges are joined by no line
        across, up = np.hstack(outline[:-1]).astype(np.float32)
        filling = Look(fill="toself", fillcolor=Sheer(colour), line_width=0) if filled else Look(line_width=1)
        trace = Look(x=across, y=up, mode="lines", line_color=colour, hoverinfo="skip")
        self.add(trace | filling | look, numbers)

    def entry(self, name: str, **look: object) -> None:
        """Add a name to the legend."""
        self.add(Look(x=[None], y=[None], name=name) | look)

    def rule(self, axis: str, at: float, colour: str, width: float | None = 1, dash: str | None = None) -> None:
        """Draw a line across a plot, at a place of its axis, ``y2`` say."""
        across, along = axis[0], "yx"[axis[0] == "y"]
        place = {f"{across}ref": axis, f"{across}0": at, f"{across}1": at}
        place |= {f"{along}ref": f"{along}{axis[1:]} domain", f"{along}0": 0, f"{along}1": 1}
        self._put("shapes", place | Look(type="line", line_color=colour, line_width=width, line_dash=dash))

    def shade(self, start: float, end: float, axis: str = "y", **look: object) -> None:
        """Shade a plot, by its vertical axis, between two positions."""
        place = Look(x0=start, x1=end, xref="x", y0=0, y1=1, yref=f"{axis} domain")
        self._put("shapes", Look(type="rect", layer="below", line_width=0) | place | look)

    def note(self, text: str, x: float, y: float, yref: str = "paper", **look: object) -> None:
        """Write words at ``x`` on its axis, or of the figure's width if ``y`` is of its height."""
        place = Look(x=x, y=y, xref="paper" if yref == "paper" else "x", yref=yref)
        self._put("annotations", Look(text=text, showarrow=False) | place | look)

    def _put(self, where: str, look: Look) -> None:
        self.layout.setdefault(where, []).append(_merged({}, look))

    def add(self, look: Look, numbers: Mapping[str, Any] = {}) -> None:
        """Draw what a trace of Plotly draws, usually points; without numbers it is in no table."""
        trace = _merged({} if "type" in look else Look(type="scatter", mode="markers"), look)
        name = trace.get("name", "")
        if legend := trace.pop("legend", ""):
            trace["name"] = legend
        self.marks.append(Mark(trace, name, numbers))

    def numbers(self) -> list[Numbers | None]:
        """What each mark shows, as columns; None for what shows no numbers."""
        return [self._columns(mark) if mark.numbers else None for mark in self.marks]

    def _columns(self, mark: Mark) -> Numbers:
        if mark.look["type"] == "heatmap":
            return Numbers("", dict(mark.numbers), "cells")
        x, y = (self.axes[mark.look.get(f"{way}axis", way)] for way in "xy")
        headings = {"x": x.heading() or "x", "y": y.heading() or "y", "label": "Label"}
        headings |= {"lower": y.heading(", lower"), "upper": y.heading(", upper")}
        headings |= {"x_lower": x.heading(", lower"), "x_upper": x.heading(", upper")}
        kind = "points" if {"label", "x_lower"} & {*mark.numbers} else "line" if "y" in mark.numbers else "band"
        columns = {headings[role]: values for role, values in mark.numbers.items()}
        return Numbers(mark.name, columns, kind, mark.look.get("yaxis", "y"), y.plot)

    def parts(self, *, dark: bool = False) -> tuple[list[Look], Look]:
        """Traces and layout for Plotly, in colours of a light or dark page."""
        colours = in_the_dark() if dark else {}
        axes = {f"{name[0]}axis{name[1:]}": axis.look for name, axis in self.axes.items()}
        return [_coloured(mark.look, colours) for mark in self.marks], _coloured(self.layout | axes, colours)

    def figure(self, *, dark: bool = False) -> "DrawnFigure":
        """A Plotly figure that holds the drawing, for a light or dark page; its curves have single precision."""
        data, layout = self.parts(dark=dark)
        for trace in data:
            doubles = [way for way in "xy" if getattr(trace.get(way), "dtype", None) == np.float64]
            trace |= {way: trace[way].astype(np.float32) for way in doubles}
        figure = DrawnFigure(data, {**layout, "template": {}})  # else Plotly would take its own
        figure.drawing = self
        return figure


class DrawnFigure(go.Figure):  # type: ignore[misc]  # Plotly has no types
    """A Plotly figure that holds the drawing that it shows."""

    drawing: Drawing | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return (*super().__reduce__(), {"drawing": self.drawing})


def drawing_of(figure: go.Figure) -> Drawing:
    """The drawing that a figure shows; a UsageError if it was not drawn here."""
    require_a(go.Figure, figure, "campaign.plot(), say")
    if getattr(figure, "drawing", None) is None:
        raise UsageError("This figure was not drawn by crashfuse.")
    drawing: Drawing = figure.drawing
    return drawing


def _smoothed(edge: FloatArray, n: int) -> FloatArray:
    """Nowhere below the edge, over n samples to either side."""

    def around(values: FloatArray) -> FloatArray:
        return np.lib.stride_tricks.sliding_window_view(np.pad(values, n, mode="edge"), 2 * n + 1)

    return around(around(edge).max(axis=-1)).mean(axis=-1) if n else edge


def _merged(look: Look, changes: Mapping[str, Any]) -> Look:
    for name, change in changes.items():
        whole = next((own for own in _WITH_UNDERSCORE if name.startswith(own)), name.partition("_")[0])
        if rest := name[len(whole) + 1 :]:
            change = {rest: change}
        if isinstance(change, Mapping):
            change = _merged(look.get(whole) or {}, change)
        look[whole] = change
    return look


def _coloured(part: Any, colours: Mapping[str, str], *, is_colour: bool = False) -> Any:  # noqa: ANN401 - any part
    if isinstance(part, Sheer):
        faint = _BAND_ALPHA_IN_THE_DARK if colours and part.alpha == _BAND_ALPHA else part.alpha
        return f"rgba{(*hex_to_rgb(colours.get(part.colour, part.colour)), faint)}"
    if isinstance(part, Mapping):
        named = ((name, own, name.endswith(("color", "colorscale"))) for name, own in part.items() if own is not None)
        return {name: _coloured(own, colours, is_colour=is_one) for name, own, is_one in named}
    if isinstance(part, list | tuple) and (is_colour or isinstance(part and part[0], Mapping)):  # the latter: shapes
        return [_coloured(own, colours, is_colour=is_colour) for own in part]
    return colours.get(part, part) if is_colour and isinstance(part, str) else part


_Curve = tuple[str, Numbers, pd.DataFrame]


def figure_table(figure: go.Figure) -> pd.DataFrame:
    """The numbers of any figure of this library, but for traces that are not visible.

    One row a position on its x axis, units in the names of columns. Curves over the same positions stand side by side,
    a band in two columns. Otherwise, or with named points, the table is long: the first column names the curve, the
    next its plot, of several. A heat map is a table of its cells.
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
    """Curves as they first appear, each before its band; equal names in a plot are numbered."""
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
    """None unless all are of one plot, with rising numbers as positions, among the longest curve's."""
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
