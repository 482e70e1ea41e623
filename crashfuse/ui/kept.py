"""Choices of several that are kept whole, even where a page offers only some of them."""

from collections.abc import Callable, Sequence

import streamlit as st


def kept_choice(
    key: str, options: Sequence[str], widget: Callable[..., object], label: str, **look: object
) -> list[str]:
    """What is chosen of these options, first what was chosen first, with a widget of Streamlit and its look.

    The session holds the whole choice under ``key``. A widget of that key would lose what this page does not offer: an
    approach that has not been fitted yet, a test of another campaign.
    """
    state = st.session_state
    chosen, shown = [name for name in state[key] if name in options], f"{key} shown"
    said, widgets = state.get(shown, (None, 0))
    if said != chosen:
        # Set by a link, a button or another page: a widget in a closed popover would not hear of it, and would send
        # what it showed before with the next click, as if that was chosen. Another widget begins with it.
        widgets += 1
    state[shown] = chosen, widgets
    here = f"{key} {widgets} in {state['system']} here"  # a browser keeps what is chosen by its label, with its unit
    # with every run: in a closed popover there is nothing yet that would keep what is sent
    state[here] = chosen

    def keep() -> None:
        if state[shown][1] == widgets:
            now = state[here]
            before = [name for name in state[key] if name in now or name not in options]
            state[key] = [*before, *(name for name in now if name not in before)]
            state[shown] = [name for name in state[key] if name in options], widgets

    widget(label, options, key=here, on_change=keep, **look)
    return [name for name in state[key] if name in options]
