"""Files of a prediction: tables, report, and pulses for an occupant model."""

import pandas as pd
import streamlit as st

from crashfuse.reporting.exports import parquet_bytes
from crashfuse.reporting.report import prediction_report
from crashfuse.reporting.result_tables import metrics_table, pulses_table
from crashfuse.reporting.side_by_side import conditions_table
from crashfuse.ui.downloads import download_bytes, download_report, download_table
from crashfuse.ui.occupant_model import offer_pulses
from crashfuse.ui.predict.answer import Answer


def show(answer: Answer) -> None:
    """Offer the pulses and their metrics; the report, and pulses for others, once every approach is known."""
    campaign, estimates, config = answer.campaign, answer.estimates, answer.config

    pinned = answer.pinned

    def pulses() -> pd.DataFrame:
        return pulses_table(("", estimate) for estimate in estimates)

    with st.container(horizontal=True):
        download_table("pulses.csv", pulses)
        download_table(
            "metrics.csv", lambda: metrics_table((("", each.approach, each.metrics) for each in estimates), campaign)
        )
        if pinned:
            download_table("side_by_side.csv", lambda: conditions_table([estimates, *pinned]))
        download_bytes("pulses.parquet", lambda: parquet_bytes(pulses()))
        if answer.whole:
            download_report(lambda: prediction_report(campaign, estimates, config, answer.view.display, pinned))
    if answer.recommended is not None:
        offer_pulses(campaign, estimates, answer.recommended, config.seed)
