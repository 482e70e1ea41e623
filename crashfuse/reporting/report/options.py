"""How a report is to be: short or whole, with which tests one by one, with which notes."""

from dataclasses import dataclass
from typing import Literal, get_args

from crashfuse.campaign_folder.notes import Note
from crashfuse.errors import one_of, require_a, several

ReportForm = Literal["short", "whole"]
REPORT_FORMS: tuple[ReportForm, ...] = get_args(ReportForm)


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """Form and content of a report.

    Parameters
    ----------
    form : {"whole", "short"}
        Short: two or three pages with result, recommendation, ratings, and the test that was predicted worst.
    tests : tuple of str
        Tests that are shown one by one; none: the worst in a short report, every test in a whole one.
    notes : tuple of Note
        On the campaign's tests; those with a time are drawn on the figures over time.

    Raises
    ------
    UsageError
        If there is no such form.
    """

    form: ReportForm = "whole"
    tests: tuple[str, ...] = ()
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        one_of("form of a report", self.form, dict.fromkeys(REPORT_FORMS))
        object.__setattr__(self, "tests", several(self.tests))
        for note in self.notes:
            require_a(Note, note, "crashfuse.Note(test, text)")
