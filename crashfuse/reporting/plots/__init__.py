"""Figures: functions that take data and return a Plotly figure; each approach has the same colour everywhere.

Data are in SI up to here; figures show ms, mm, kJ, and the reader's choice of units for accelerations, speeds and
weights (:class:`~crashfuse.reporting.plots.display.Display`). A curve has one point per sample; many
pulses are shown as a band, never one by one. Where a trace draws less than its data, or elsewhere (fewer points, points
beside each other at a test), its ``meta`` has the data, by ``x``, ``lower`` and ``upper``.
"""

import pandas as pd  # noqa: F401  (before Plotly, which otherwise imports it piecemeal, in several threads at once)
