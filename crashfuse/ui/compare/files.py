"""Files of a comparison: tables, report, and pulses for an occupant model."""

import streamlit as st

from crashfuse.reporting.report import study_report
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.occupant_model import offer_pulses
from crashfuse.ui.report_options import choose_report


def show(comparison: Comparison) -> None:
    """Offer what this comparison rests on; a report, and pulses for others, once every approach is known."""
    test, study, estimates = comparison.test, comparison.study, comparison.fold.estimates
    of = f"{comparison.others.name} {test.id}"
    report = choose_report(comparison.view, [test.id])
    with st.container(horizontal=True):
        download_table("scores.csv", lambda: study.scores, of)
        download_table("pulses.csv", lambda: study.pulses, of)
        download_table("metrics.csv", lambda: study.metrics, of)
        if comparison.advice is not None:
            download_report(lambda: study_report(study, comparison.view.display, report), f"{of} {report.form}")
    if comparison.advice is not None:
        remark = f"Test {test.id}, at this condition, was left out."
        offer_pulses(comparison.others, estimates, comparison.advice.approach, comparison.config.seed, [remark])
