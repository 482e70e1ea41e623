"""Compare: the held-out test against every prediction of it."""

from crashfuse.ui import compare
from crashfuse.ui.kit import frame
from crashfuse.ui.kit.text import plain

view = frame.enter_with_campaign(
    "Compare", lambda view: f"Test {plain(view.held_out.id)}: {plain(view.held_out.condition)}"
)
compare.show(view)
