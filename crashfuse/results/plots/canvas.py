"""Common style of all drawings: axes, rows, words and the rated window, independent of their content."""

from collections.abc import Collection, Mapping, Sequence
from itertools import product

from crashfuse.results.drawing import Drawing, Look, Sheer, Values
from crashfuse.results.plots.palette import AXIS, COLOURS, CURSOR, GRID, INK, PAPER, WINDOW, WINDOW_INK

_FONT = '"Source Sans", "Source Sans 3", "Source Sans Pro", "Segoe UI", system-ui, sans-serif'
_USUAL_NAMES = 6  # of the approaches and the test
_ROW_PX, _ROW_MARGIN_PX = 21, 23  # of names above a figure, and the room that ticks and Plotly's own spaces take
_LETTER_PX, _SYMBOL_PX = 6.4, 46  # of a name, on average, with the symbol and the space beside it
_NAMES_PX = 915  # in a window of 1440 px
_TICK_NAME = 24  # characters
_FEW_RUNS = 150  # more are a cloud, in which tests have to be seen

# tools that Plotly puts beside a figure: one would upload its pulses to somebody's cloud, the others are of no use
_UNWANTED_TOOLS = ["sendChartToCloud", "lasso2d", "select2d", "zoomIn2d", "zoomOut2d", "autoScale2d"]

# the names above leave half a line for the uppermost tick
_Y_AXIS = Look(gridcolor=GRID, zerolinecolor=AXIS, linecolor=AXIS, automargin="left")
_SPIKES = Look(showspikes=True, spikemode="across", spikesnap="cursor", spikethickness=1, spikecolor=CURSOR)
_OVER_TIME = Look(automargin=True, range=[0, 100], unifiedhovertitle={"text": "%{x:.1f} ms"}, ticks="outside")
PROMISED = Look(mode="lines", name="As promised", line_color=AXIS, line_dash="dot", hoverinfo="skip")
"""Look of the diagonal, on which what was promised came true."""

_NOT_OVER_TIME = Look(range=None, zeroline=False, showspikes=False, unifiedhovertitle=None)
_LAYOUT = Look(
    font={"family": _FONT, "size": 14, "color": INK},
    paper_bgcolor=PAPER,
    plot_bgcolor=PAPER,
    # with room for ticks, their title and a row of names: found too small, Plotly draws everything once more
    margin={"l": 64, "r": 44, "t": 44, "b": 56},
    modebar=Look(orientation="v", remove=_UNWANTED_TOOLS, color=CURSOR, activecolor=INK),
    hovermode="x unified",
    hoverlabel={"namelength": -1, "bgcolor": Sheer(PAPER, 0.92)},
    legend=Look(x=0, y=1, yref="container", xanchor="left", yanchor="top", orientation="h", tracegroupgap=0),
)


def new_drawing(height: int, quantity: str = "Time", unit: str = "ms", **x_axis: object) -> Drawing:
    """An empty drawing, usually over time, in the common style: legend above it, tools beside it."""
    drawing = Drawing({**_LAYOUT, "height": height}, {"x": _Y_AXIS | _OVER_TIME | _SPIKES | x_axis, "y": _Y_AXIS})
    drawing.axis("x", quantity, unit)
    return drawing


def drawing_of_points(height: int, quantity: str = "", unit: str = "", **x_axis: object) -> Drawing:
    """An empty drawing of points over anything but time, each of which tells what it is."""
    drawing = new_drawing(height, quantity, unit, **{**_NOT_OVER_TIME, **x_axis})
    drawing.update(hovermode="closest")
    return drawing


def drawing_over_tests(height: int, ticks: Sequence[str]) -> Drawing:
    """An empty drawing of points over held-out tests at 0, 1, 2 …, by their ticks."""
    places = Look(tickvals=list(range(len(ticks))), ticktext=list(ticks), range=[-0.6, len(ticks) - 0.4])
    return drawing_of_points(height, "Held-out test", showgrid=False, **places)


def rows_of_plots(spacing: float, heights: Sequence[float]) -> list[tuple[float, float]]:
    """Where plots above each other begin and end, from the top down, as shares of the height."""
    share = (1 - spacing * (len(heights) - 1)) / sum(heights)
    ends = [1 - spacing * row - share * sum(heights[:row]) for row in range(len(heights))]
    return [(end - share * height, end) for end, height in zip(ends, heights, strict=True)]


def stack(drawing: Drawing, count: int, spacing: float) -> None:
    """Stack plots above each other, with numbered axes that share what the horizontal ones show."""
    for number, domain in enumerate(rows_of_plots(spacing, [1.0] * count), start=1):
        x, y = (name if number == 1 else f"{name}{number}" for name in "xy")
        last = "x" if count == 1 else f"x{count}"
        upper = Look() if x == last else Look(matches=last, showticklabels=False)
        drawing.axis(x, anchor=y, domain=[0.0, 1.0], **upper)
        drawing.axis(y, anchor=x, domain=list(domain))


def tick_name(name: str) -> str:
    """A name at an axis: of a long one its beginning and end."""
    return name if len(name) <= _TICK_NAME else f"{name[: _TICK_NAME // 2]}…{name[1 - _TICK_NAME // 2 :]}"


def marks_of_runs(count: int) -> Look:
    """Marks of CAE runs behind tests: a few one by one, many as a cloud."""
    few = count <= _FEW_RUNS
    return {"color": COLOURS["cae"], "size": 6 if few else 4, "opacity": 0.7 if few else 0.35}


def marker(colour: object, symbol: object, size: object, width: float = 0, line: str | None = None) -> Look:
    """A mark and its edge; of open marks the edge is all."""
    return {"marker": {"color": colour, "symbol": symbol, "size": size, "line": {"width": width, "color": line}}}


def telling(texts: Sequence[object]) -> Look:
    """Let each point, or cell, show a text under the mouse."""
    return {"hovertext": texts, "hovertemplate": "%{hovertext}<extra></extra>"}


def draw_cells(
    drawing: Drawing,
    columns: Sequence[str],
    rows: Sequence[str],
    look: Look,
    numbers: Mapping[str, Values],
    told: Sequence[Sequence[str]],
    *,
    clicked: Sequence[str] = (),
    **marks: object,
) -> None:
    """Draw a heat map with names above that stays where it is.

    Cells can't be clicked: invisible marks on them, row by row, carry what is ``clicked`` and told, else the cells.
    """
    over = Look(hoverinfo="skip") if clicked else telling(told)
    drawing.add(Look(type="heatmap", x=columns, y=rows, showscale=False, xgap=2, ygap=2) | over | look, numbers)
    if clicked:
        x, y = [*columns] * len(rows), [row for row in rows for _ in columns]
        invisible = Look(x=x, y=y, customdata=clicked, marker_opacity=0, showlegend=False)
        drawing.add(invisible | telling([text for row in told for text in row]) | marks)
    tools = [*_UNWANTED_TOOLS, "zoom2d", "pan2d", "resetScale2d"]
    drawing.update(hoverdistance=-1, dragmode=False, modebar_remove=tools)
    plain = Look(type="category", ticks="", showline=False, zeroline=False, showgrid=False)
    drawing.axis("x", **plain, side="top", tickangle=0, range=[-0.5, len(columns) - 0.5])
    drawing.axis("y", **plain, range=[len(rows) - 0.5, -0.5])  # the marks would widen it


def height_under_names(count: int) -> int:
    """Height of a figure with this many names in the legend above it."""
    return 440 + 6 * count


def room_for_names(names: Collection[str]) -> int:
    """Height beyond the usual one, if the legend names more than the approaches."""
    return 7 * max(len(names) - _USUAL_NAMES, 0)


def room_above(drawing: Drawing) -> int:
    """Margin in pixels for rows of names above; with less, Plotly draws it all once more."""
    if drawing.layout.get("showlegend") is False:
        return 0
    rows, used = 1, 0.0
    looks = [mark.look for mark in drawing.marks]
    for name in dict.fromkeys(look["name"] for look in looks if "name" in look and look.get("showlegend") is not False):
        width = _LETTER_PX * len(name) + _SYMBOL_PX
        rows, used = (rows, used + width) if used + width <= _NAMES_PX else (rows + 1, width)
    return _ROW_PX * rows + _ROW_MARGIN_PX


def without_links(text: str) -> str:
    """Words of a figure, or its JSON, in which Plotly makes no link of laboratories' texts."""
    for begin, tag in product(("<", "\\u003c"), ("a", "A", "/a", "/A")):
        text = text.replace(f"{begin}{tag}", f"&lt;{tag}")
    return text


def shade_window(drawing: Drawing, window_ms: float, *, rows: int = 1) -> None:
    """Shade the rated window [0, window_ms) in every row, and label it."""
    for row in range(1, rows + 1):
        drawing.shade(0, window_ms, f"y{row if row > 1 else ''}", fillcolor=WINDOW, opacity=0.55)
    words, place = f"rated: 0–{window_ms:g} ms", Look(xanchor="right", yanchor="bottom")  # above all curves
    drawing.note(words, window_ms, 1, "y domain", font_size=12, font_color=WINDOW_INK, **place)
