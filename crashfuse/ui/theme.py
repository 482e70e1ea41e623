"""The page in the browser's theme: figures and cells, which the server colours, are asked for anew when it changes."""

import streamlit as st

_JS = """
export default ({ parentElement, setTriggerValue }) => {
  const ground = () => getComputedStyle(parentElement.host ?? parentElement).getPropertyValue("--st-background-color");
  let shown = ground();
  const look = setInterval(() => {
    if (ground() === shown) return;
    shown = ground();
    setTriggerValue("ground", shown);
  }, 200);  // ms
  return () => clearInterval(look);
};
"""
_component = st.components.v2.component("crashfuse_theme", js=_JS)


def follow_theme() -> None:
    """Run the page again as soon as the browser has another theme, by the system or by Streamlit's menu."""
    _component(key="theme")
