"""Train: fit to all tests, to predict new conditions; or leave tests out, to see how good such predictions are."""

from crashfuse.ui import train
from crashfuse.ui.kit import frame

train.show(frame.enter_with_campaign("Train"))
