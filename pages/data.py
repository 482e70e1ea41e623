"""Data: open a campaign and see its content."""

from crashfuse.ui import data
from crashfuse.ui.kit import frame

data.show(frame.enter())
