"""Pulse metrics over impact speed."""

import streamlit as st

from crashfuse.condition import Condition
from crashfuse.reporting.glossary import TTZV
from crashfuse.reporting.plots.sweep import sweep_figure
from crashfuse.reporting.report import sweep_report
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.study.sweep import missing_over_speed, sweep_table, weights_sentence
from crashfuse.ui.computation import FitRequest, Fitted, SweepRequest
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.figures import show_figure
from crashfuse.ui.frame import View
from crashfuse.ui.panel import result_or_none


def show(view: View, request: FitRequest, fitted: Fitted, condition: Condition) -> None:
    """Show every metric over speed, at the weights that were chosen above."""
    st.markdown("Predictions of every approach over impact speed, at the weights above, with the tests as points.")
    sweeps = result_or_none(
        SweepRequest(request, fitted, condition),
        invitation="About thirty speeds are predicted, which takes about ten seconds.",
        button="Predict over speed",
    )
    if sweeps is None:
        return
    metric = st.selectbox(
        "Pulse metric", list(METRIC_LABELS), format_func=METRIC_LABELS.__getitem__, key="sweep metric", help=TTZV
    )
    show_figure(
        sweep_figure(sweeps, metric, view.campaign),
        alt=f"{METRIC_LABELS[metric]} over impact speed, every approach with its band, tests as points",
    )
    st.caption(weights_sentence(condition, view.campaign.tests))
    for sentence in missing_over_speed(sweeps, metric):
        st.caption(sentence)
    with st.container(horizontal=True):
        download_table("sweep.csv", lambda: sweep_table(sweeps, view.campaign.tests))
        download_report(lambda: sweep_report(view.campaign, sweeps, request.config), "sweep.html")
