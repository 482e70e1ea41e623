"""Figures: data in, Plotly figure out; one colour for each approach everywhere.

Data stay in SI up to here; figures show ms, mm, km/h and g (or m/s²). A curve has one point a sample and is handed over
as float32; many pulses are shown as a band, never one by one.
"""

import pandas as pd  # noqa: F401  (before Plotly, which otherwise imports it half-way, in several threads at once)
