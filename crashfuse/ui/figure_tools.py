"""Below each figure: buttons that save it as SVG or PNG, and the numbers that it shows as CSV."""

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
const taken = new WeakMap();
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
