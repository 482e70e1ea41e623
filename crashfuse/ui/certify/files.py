"""Files of a certification: verdicts, their record, what was asked, and the report."""

import streamlit as st

from crashfuse.certification.changes import Changes
from crashfuse.certification.criteria import criteria_text
from crashfuse.reporting.certification_changes import changes_table
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_tables import csv_as_given, matrix_table
from crashfuse.reporting.report import certification_report
from crashfuse.ui.certify.judgement import Judgement
from crashfuse.ui.kit.files import download_bytes, download_report, download_table


def show(judgement: Judgement) -> None:
    """Offer them; criteria and matrix ask for the same again."""
    verdicts, certification = judgement.verdicts, judgement.certification
    of = certification.campaign.name
    with st.container(horizontal=True):
        download_bytes("certification.csv", lambda: csv_as_given(verdicts.table), of)
        download_table("track_record.csv", lambda: verdicts.track_record, of)
        if certification.since is not None:
            download_bytes("changes.csv", lambda: csv_as_given(changes_table(Changes.of(certification))), of)
        download_bytes("criteria.toml", lambda: criteria_text(certification.criteria).encode(), of)
        download_bytes("matrix.csv", lambda: csv_as_given(matrix_table(certification.matrix)), of)
        download_bytes("certification.json", lambda: certification_json(certification), of)
        download_report(lambda: certification_report(certification, judgement.display, judgement.notes), of)
