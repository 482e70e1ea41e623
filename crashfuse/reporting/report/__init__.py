"""The report: one HTML file that needs no network, opens anywhere and can be printed."""

from crashfuse.reporting.report.certification import certification_report
from crashfuse.reporting.report.page import REPORT_FORMS, ReportForm, ReportOptions
from crashfuse.reporting.report.prediction import (
    learning_curve_report,
    next_test_report,
    prediction_report,
    sweep_report,
)
from crashfuse.reporting.report.study import comparison_report, study_report

__all__ = [
    "REPORT_FORMS",
    "ReportForm",
    "ReportOptions",
    "certification_report",
    "comparison_report",
    "learning_curve_report",
    "next_test_report",
    "prediction_report",
    "study_report",
    "sweep_report",
]
