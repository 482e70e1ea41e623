"""Below each figure: buttons that save it as SVG or PNG, and the numbers that it shows as CSV; and its keys.

A figure that has the focus is read with the arrow keys, which move the cursor as a mouse does; Enter clicks, and Escape
takes the cursor away, as does leaving the figure.
"""

import re

import plotly.graph_objects as go
import streamlit as st

from crashfuse.files.csv_output import csv_bytes
from crashfuse.reporting.figure_data import figure_table
from crashfuse.ui.tables import BUTTON_CSS

_LONGEST_NAME = 90
_HTML = """
<div class=row>
<button type="button" data-format="svg" title="Save this figure as SVG: sharp at any size">SVG</button>
<button type="button" data-format="png" title="Save this figure as PNG: for any document">PNG</button>
<button type="button" data-format="csv" title="Save the numbers of the curves and bands that are visible">CSV</button>
</div>
"""
# the camera of Plotly draws the image; it reads its settings when it is pressed
_JS = """
const STEP = 0.01, WIDE = 0.1, taken = new WeakMap();
const point = (area, figure, kind) => {
  const box = area.getBoundingClientRect(), [right, down] = figure.cursor;
  const place = { clientX: box.left + right * box.width, clientY: box.top + down * box.height, bubbles: true };
  area.dispatchEvent(new MouseEvent(kind, { ...place, view: window, cancelable: true }));
};
const areaOf = figure => figure.matches?.(".js-plotly-plot") && figure.querySelector(".nsewdrag");
const leave = event => {
  const figure = event.target, area = areaOf(figure);
  if (area && figure.cursor) point(area, figure, "mouseout");
};
const follow = (from, tries) => {  // a page that a click opened gets the focus, which was lost with the figure
  const title = document.querySelector('[data-testid="stMain"] h1');
  if (location.pathname === from || !title || document.querySelector(".js-plotly-plot:focus")) {
    if (tries) setTimeout(follow, 200, from, tries - 1);
  } else if (document.activeElement === document.body) {
    title.tabIndex = -1;
    title.focus();
  }
};
const press = event => {
  const figure = event.target, area = areaOf(figure);
  if (!area || event.ctrlKey || event.altKey || event.metaKey) return;
  const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  figure.cursor ??= [0.5, 0.5];
  if (event.key in moves) {
    const step = event.shiftKey ? WIDE : STEP, within = at => Math.min(Math.max(at, 0.005), 0.995);
    figure.cursor = figure.cursor.map((at, axis) => within(at + step * moves[event.key][axis]));
    point(area, figure, "mousemove");
  } else if (event.key === "Enter") {
    for (const kind of ["mousemove", "mousedown", "mouseup"]) point(area, figure, kind);
    follow(location.pathname, 50);
  } else if (event.key === "Escape") {
    leave(event);
  } else {
    return;
  }
  event.preventDefault();
};
const reachable = () => {
  for (const figure of document.querySelectorAll(".js-plotly-plot:not([tabindex])")) {
    figure.tabIndex = 0;
    figure.setAttribute("aria-keyshortcuts", "ArrowLeft ArrowRight ArrowUp ArrowDown Enter Escape");
  }
};
if (!window.crashfuseKeys) {  // once for all figures, also those that are drawn later
  window.crashfuseKeys = true;
  document.addEventListener("keydown", press);
  document.addEventListener("focusout", leave);
  setInterval(reachable, 1000);
}
const nearest = host => [...document.querySelectorAll(".js-plotly-plot")]
  .filter(figure => figure.compareDocumentPosition(host) & Node.DOCUMENT_POSITION_FOLLOWING).at(-1);
export default ({ parentElement, data, setTriggerValue }) => {
  const host = parentElement.host ?? parentElement;
  for (const button of parentElement.querySelectorAll("button")) {
    button.onclick = () => {
      const figure = nearest(host), format = button.dataset.format;
      if (!figure?._fullData) return;
      if (format === "csv") {
        const hidden = figure._fullData.filter(trace => trace.visible !== true).map(trace => trace.index);
        setTriggerValue("csv", { hidden, at: Date.now() });
        return;
      }
      const scale = format === "png" ? 3 : 1, tools = [...figure.querySelectorAll(".modebar-btn")];
      Object.assign(figure._context.toImageButtonOptions, { format, filename: data.name, scale });
      tools.find(tool => /download plot/i.test(tool.dataset.title ?? ""))?.click();
    };
  }
  if (data.csv && taken.get(parentElement) !== data.at) {
    taken.set(parentElement, data.at);
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([data.csv], { type: "text/csv" }));
    link.download = `${data.name}.csv`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }
};
"""
_tools = st.components.v2.component("crashfuse_figure_tools", html=_HTML, css=BUTTON_CSS, js=_JS)


def file_name(*parts: str) -> str:
    """Name of a figure's files, without its ending: words, joined and safe on any disk."""
    return re.sub(r"[^\w.-]+", "-", "_".join(parts), flags=re.ASCII).strip("-._")[:_LONGEST_NAME]


@st.fragment
def offer_files(figure: go.Figure, name: str, key: str) -> None:
    """Show the buttons of the figure just above; the numbers are made when they are asked for."""
    key = f"files {key}"
    asked = st.session_state.get(key, {}).get("csv")
    data: dict[str, object] = {"name": name}
    if asked:
        table = figure_table(figure.to_plotly_json(), [int(place) for place in asked["hidden"]])
        data |= {"at": asked["at"], "csv": csv_bytes(table).decode()}
    _tools(data=data, key=key, on_csv_change=lambda: None)
