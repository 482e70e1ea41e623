"""How the report is to be: short or whole, with which tests one by one."""

from collections.abc import Sequence

import streamlit as st

from crashfuse.reporting.report import REPORT_FORMS, ReportForm, ReportOptions
from crashfuse.ui.chosen import View
from crashfuse.ui.kept import kept_choice
from crashfuse.ui.notes import notes_of

_LABELS: dict[ReportForm, str] = {"whole": "Whole", "short": "Short"}
_HELP = "Short: two or three pages with {}. Whole: {}, too. Both in the units and the window of the pages."
_OF_STUDY = (
    "the recommendation, all ratings and the test that was predicted worst",
    "each test, the data, the method and its settings",
)


def choose_form(short: str, whole: str) -> ReportForm:
    """Ask for the form of the report, and tell what it then has."""
    st.segmented_control(
        "Report", REPORT_FORMS, required=True, format_func=_LABELS.__getitem__,
        key="report_form", persist_state="session", help=_HELP.format(short, whole),
    )  # fmt: skip
    form: ReportForm = st.session_state["report_form"]
    return form


def choose_report(view: View, tests: Sequence[str]) -> ReportOptions:
    """Ask for the form of the report and, of several tests, which are shown one by one."""
    with st.container(horizontal=True, vertical_alignment="bottom"):
        form = choose_form(*_OF_STUDY)
        shown: list[str] = []
        if len(tests) > 1:
            shown = kept_choice(
                "report_tests", tests, st.multiselect, "Tests shown one by one",
                placeholder="all tests" if form == "whole" else "the worst",
                help="Means are over all tests, whichever are shown.",
            )  # fmt: skip
    return ReportOptions(form, tuple(test for test in tests if test in shown), notes_of(view))
