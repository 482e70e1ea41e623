"""Figures: functions that take data in SI and return a Plotly figure in the reader's units.

Where a trace draws less than its data, or elsewhere, its ``meta`` has the data, by ``x``, ``lower`` and ``upper``.
"""

import pandas as pd  # noqa: F401  (before Plotly, which otherwise imports it piecemeal, in several threads at once)
