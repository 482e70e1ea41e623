"""Predict: the pulse at a condition that was never tested, over speed, and which test to run next."""

from crashfuse.ui import predict
from crashfuse.ui.kit import frame

view = frame.enter_with_campaign("Predict", lambda _: "")
predict.show(view)
