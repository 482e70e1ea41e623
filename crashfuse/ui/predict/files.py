"""Files of a prediction: tables, report, and pulses for an occupant model."""

import streamlit as st

from crashfuse.reporting.certification_tables import csv_as_given
from crashfuse.reporting.exports import parquet_bytes
from crashfuse.reporting.report import prediction_report
from crashfuse.reporting.side_by_side import predictions_table
from crashfuse.ui.downloads import download_bytes, download_report, download_table
from crashfuse.ui.occupant_model import offer_pulses
from crashfuse.ui.other_seeds import show_missing
from crashfuse.ui.predict.answer import Answer
from crashfuse.ui.report_options import choose_form


def show(answer: Answer) -> None:
    """Offer the pulses and their metrics; the report, and pulses for others, once every approach is known."""
    campaign, estimates, config = answer.campaign, answer.estimates, answer.config
    prediction, beside = answer.prediction, answer.beside
    show_missing(campaign)
    of = f"{campaign.name} {answer.view.display.briefly(answer.condition)}"
    form = choose_form(
        "recommendation, pulses, metrics and limits",
        "the pulse over displacement, how the fits went, the data, the method and its settings",
    )
    with st.container(horizontal=True):
        download_table("pulses.csv", lambda: prediction.pulses, of)
        download_table("metrics.csv", lambda: prediction.metrics, of)
        if beside:
            download_bytes("side_by_side.csv", lambda: csv_as_given(predictions_table([prediction, *beside])), of)
        download_bytes("pulses.parquet", lambda: parquet_bytes(prediction.pulses), of)
        if answer.whole:
            display = answer.view.display
            download_report(
                lambda: prediction_report(campaign, estimates, config, display, beside, form), f"{of} {form}"
            )
    if answer.recommended is not None:
        offer_pulses(campaign, estimates, answer.recommended, config.seed)
