"""Tables on a page, with a button that copies them for a spreadsheet."""

import pandas as pd
import streamlit as st
from pandas.io.formats.style import Styler

from crashfuse.reporting.exports import spreadsheet_text

_CSS = """
button { font: inherit; font-size: 0.8rem; color: inherit; opacity: 0.7; background: none; cursor: pointer;
         border: 1px solid var(--st-border-color); border-radius: 4px; padding: 0 0.6rem }
button:hover, button:focus-visible { opacity: 1 }
"""
_JS = """
export default ({ parentElement, data }) => {
  const button = parentElement.querySelector("button");
  button.onclick = async () => {
    try {
      await navigator.clipboard.writeText(data);
    } catch {  // an address that is not secure, or a browser that refuses
      const area = Object.assign(document.createElement("textarea"), { value: data });
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  };
};
"""
_COPY = '<button type="button" title="Copy this table for a spreadsheet">Copy</button>'
_copy_button = st.components.v2.component("crashfuse_copy_table", html=_COPY, css=_CSS, js=_JS)


def show_table(table: Styler | pd.DataFrame, key: str) -> None:
    """Show a table without its index, and below it a button that copies it; the key is unique on the page."""
    styler = table if isinstance(table, Styler) else table.style.hide(axis="index")
    st.table(styler, border="horizontal")
    _copy_button(data=spreadsheet_text(styler.data), key=f"copy {key}")
