"""Pinned predictions: conditions that stay, to be seen beside each other, in one link and one report."""

from collections.abc import Callable, Sequence

import streamlit as st

from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.ui.chosen import View
from crashfuse.ui.text import plain

_MOST = 6  # each takes ten megabytes, and a column of the table


def pinned() -> dict[str, Condition]:
    """The pinned conditions by their texts, in the order in which they were pinned."""
    found = {}
    for text in st.session_state["pins"]:
        try:
            found[text] = Condition.parse(text)
        except UsageError:  # the link has been cut or changed
            continue
    return dict(list(found.items())[:_MOST])


def pin_all(conditions: Sequence[Condition]) -> None:
    """Pin conditions beside those that are; if they are too many, the oldest go."""
    new = [condition.text for condition in conditions]
    st.session_state["pins"] = [*(text for text in pinned() if text not in new), *new][-_MOST:]


def show_pins(view: View, condition: Condition, remember: Callable[[], None]) -> None:
    """Offer to pin the condition shown, and to unpin others; ``remember`` is called when it is pinned."""
    texts = pinned()

    def pin() -> None:
        st.session_state["pins"] = list(dict.fromkeys([*pinned(), condition.text]))
        remember()

    st.button(
        "Pin this prediction", icon=":material/keep:", on_click=pin,
        disabled=condition.text in texts or len(texts) >= _MOST,
        help="Keeps it in the figures, a table of differences, the link, the report, and the list on History; up to "
        f"{_MOST}.",
    )  # fmt: skip
    if not texts:
        return
    with st.popover(f"{len(texts)} pinned", key="pinned"):
        for text, other in texts.items():
            st.button(
                plain(view.display.briefly(other)), icon=":material/close:", key=f"unpin {text}", on_click=_unpin,
                args=(text,), help="Unpin", type="tertiary",
            )  # fmt: skip


def _unpin(text: str) -> None:
    st.session_state["pins"] = [other for other in pinned() if other != text]
