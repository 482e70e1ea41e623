"""Choices of several that are kept whole, even where a page offers only some of them."""

from collections.abc import Callable, Sequence

import streamlit as st


def kept_choice(key: str, options: Sequence[str], draw: Callable[[str, Callable[[], None]], object]) -> list[str]:
    """What is chosen of these options; ``draw`` shows the widget, given its key and its callback.

    The session holds the whole choice under ``key``. A widget of that key would lose what this page does not offer: an
    approach that has not been fitted yet, a test of another campaign.
    """
    state, widget = st.session_state, f"{key} here"
    whole = state[key]
    # with every run: in a closed popover there is nothing yet that would keep what is sent
    state[widget] = [name for name in options if name in whole]

    def keep() -> None:
        state[key] = [*(name for name in state[key] if name not in options), *state[widget]]

    draw(widget, keep)
    here = state[widget]
    return [name for name in options if name in here]
