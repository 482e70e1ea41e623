"""The answer at a condition is the first that is true of its verdicts taken together."""

import pytest

from crashfuse.campaign import Campaign
from crashfuse.certification.answer import Answer, answers
from crashfuse.certification.certify import Certification
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import Verdict, Word
from crashfuse.study.config import StudyConfig

CRUSH, PEAK = Criterion("crush", "max_crush", at_most=500.0), Criterion("peak", "peak", at_most=30.0)
Said = tuple[Word, float | None]


def answer(campaign: Campaign, crush: Said, peak: Said, *tests: str) -> Answer:
    """The answer at a condition with these verdicts, where these tests were run; the confidence is 0.95."""
    here = campaign.tests[0].condition
    row = tuple(
        Verdict(here, criterion, 1.0, 0.9, 1.1, probability, word, "", dict.fromkeys(tests, 1.0))
        for criterion, (word, probability) in ((CRUSH, crush), (PEAK, peak))
    )
    criteria, domain = Criteria((CRUSH, PEAK)), Domain.of(campaign)
    config, record = StudyConfig(approaches=("fused",)), TrackRecord(())
    made = Certification(campaign, criteria, Matrix(("M",), (here,)), config, domain, (row,), (row,), record, {})
    return answers(made)["M"]


@pytest.mark.parametrize(
    ("crush", "peak", "said"),
    [
        (("met", 0.99), ("met", 0.98), "need not be run"),
        (("met", 0.96), ("met", 0.96), "to be tested"),  # both at once: 0.92 at least
        (("not met", 0.01), ("met", 0.99), "would miss"),
        (("not met", 0.01), ("open", 0.5), "would miss"),  # takes another design, whatever is open
        (("outside", 0.9), ("not met", 0.01), "would miss"),
        (("open", 0.5), ("met", 0.99), "test or redesign"),
        (("open", None), ("open", 0.5), "test or redesign"),
        (("open", None), ("met", 0.99), "record for longer"),
        (("outside", 0.9), ("outside", 0.9), "outside"),
    ],
)
def test_the_verdicts_of_a_condition_make_one_answer(campaign: Campaign, crush: Said, peak: Said, said: Answer) -> None:
    """A test need not be run only where all criteria are met at once with the confidence."""
    assert answer(campaign, crush, peak) == said


@pytest.mark.parametrize("word", ["met", "not met", "open", "outside"])
def test_a_condition_that_was_run_has_no_other_answer(campaign: Campaign, word: Word) -> None:
    """Whatever the verdict on another test there."""
    assert answer(campaign, (word, 0.99), (word, 0.99), "T1") == "run"
