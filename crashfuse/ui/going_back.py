"""Back, in the browser, returns to the view that was left."""

import streamlit as st

_JS = """
// Streamlit opens a page in two steps of history, of which the first has the old page with the choices of the new one:
// it gets back its own.
const WITHIN_MS = 3000, push = history.pushState.bind(history);
let last = {};
if (!window.crashfuseHistory) {
  window.crashfuseHistory = true;
  history.pushState = (state, title, url) => {
    const from = location.href, to = new URL(url, from);
    const opens = to.pathname !== location.pathname && to.search === location.search;
    const justNow = last.to === from && Date.now() - last.at < WITHIN_MS;
    if (opens && justNow) history.replaceState(history.state, "", last.from);
    push(state, title, url);
    last = { from, to: location.href, at: Date.now() };
  };
}
export default () => {};
"""
_component = st.components.v2.component("crashfuse_going_back", js=_JS)


def keep_views() -> None:
    """Let the browser remember each page as it was when another was opened from it."""
    _component(key="going back")
