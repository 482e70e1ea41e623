"""Choices of several that are kept whole, even where a page offers only some of them."""

from collections.abc import Callable, Sequence

import streamlit as st


def kept_choice(
    key: str, options: Sequence[str], widget: Callable[..., object], label: str, **look: object
) -> list[str]:
    """What is chosen of these options, with a widget of Streamlit for several, such as ``st.pills``, and its look.

    The session holds the whole choice under ``key``. A widget of that key would lose what this page does not offer: an
    approach that has not been fitted yet, a test of another campaign.
    """
    state, whole = st.session_state, st.session_state[key]
    here = f"{key} in {state['system']} here"  # a browser keeps what is chosen by its label, which may have a unit
    # with every run: in a closed popover there is nothing yet that would keep what is sent
    state[here] = [name for name in options if name in whole]

    def keep() -> None:
        state[key] = [*(name for name in state[key] if name not in options), *state[here]]

    widget(label, options, key=here, on_change=keep, **look)
    chosen = state[here]
    return [name for name in options if name in chosen]
