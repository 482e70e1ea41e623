"""Figures: functions that take data in SI and return a Plotly figure in the reader's units, with its drawing."""

import pandas as pd  # noqa: F401  (before Plotly, which otherwise imports it piecemeal, in several threads at once)
