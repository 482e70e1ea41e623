"""Files of a study: its tables and the report."""

import streamlit as st

from crashfuse.reporting.report import study_report
from crashfuse.ui.downloads import download_report, download_table
from crashfuse.ui.report_options import choose_report
from crashfuse.ui.study.outcome import Outcome


def show(outcome: Outcome) -> None:
    """Offer what the study rests on, and the report once every approach is known."""
    study, view = outcome.study, outcome.view
    of = view.campaign.name
    report = choose_report(view, view.campaign.test_ids)
    with st.container(horizontal=True):
        download_table("scores.csv", lambda: study.scores, of)
        download_table("metrics.csv", lambda: study.metrics, of)
        if (groups := study.speed_groups) is not None:
            download_table("speed_groups.csv", lambda: groups.scores, of)
        if outcome.whole:
            download_report(
                lambda: study_report(study, view.display, report), f"{of} {report.form} {' '.join(report.tests)}"
            )
