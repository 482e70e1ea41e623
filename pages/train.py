"""Train: fit to all tests, to predict new conditions; or leave tests out, to see how good such predictions are."""

from crashfuse.ui import train
from crashfuse.ui.kit import frame
from crashfuse.ui.kit.figures import show_tabs

TABS = {"Train": train.show_form, "Diagnostics": train.show_diagnostics}

show_tabs(TABS, frame.enter_with_campaign("Train"), key="train_tab", export=train.show_files)
