"""A certification as shown: its figures, its card in a notebook, and the answer at every planned test."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Unpack

from crashfuse.certification.certify import Answer, Certification
from crashfuse.certification.verdict import Verdict
from crashfuse.condition import Condition
from crashfuse.errors import one_of
from crashfuse.execution.cache import remembered
from crashfuse.results import certification_tables as tables
from crashfuse.results.certification_facts import new_together, unused_at
from crashfuse.results.display import Display, DisplayOptions
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots.certification import record_figure, reliability, validated_domain, verdict_matrix
from crashfuse.results.render.notebook import card, facts_words
from crashfuse.results.table import CONDITION, Table, of_condition
from crashfuse.study.outliers import departures_near
from crashfuse.units import Sentence, joined, read_out

FIGURES: Mapping[str, Callable[[Certification, Display], Drawing]] = {
    "verdicts": verdict_matrix,
    "record": lambda own, display: record_figure(own.record, own.criteria.items, display),
    "reliability": lambda certification, _: reliability(certification.record),
    "domain": validated_domain,
}


def certification_figure(certification: Certification, figure: str, **display: Unpack[DisplayOptions]) -> Drawing:
    """A figure of a certification, as :meth:`Certification.plot` has them."""
    shown = Display.of(certification.campaign.units, **display)
    return one_of("figure of verdicts", figure, FIGURES)(certification, shown)


def certification_html(certification: Certification) -> str:
    """A certification in a notebook."""
    display = Display(system=certification.campaign.units)
    table = tables.SHOWN["verdicts"](certification, display).without("Reason")
    return card(repr(certification)[1:-1], table, facts_words(certification.campaign, display), display)


class Planned(NamedTuple):
    """A planned test: the answer, and what decides it."""

    id: str
    condition: Condition
    word: Answer
    why: Sentence


@remembered  # asked for by three parts of a page
def planned(certification: Certification) -> tuple[Planned, ...]:
    """The answer at every planned test, in the order of speed."""
    domain, unused, together = certification.domain, unused_at(certification), new_together(certification)
    rows = []
    for i, condition in sorted(certification.matrix.items, key=lambda item: item[1].speed_mps):
        given = {name for name, value in condition.factors if value}
        why = [_why(certification, i), *(f"{name} not given" for name in domain.factors if name not in given)]
        if i in together:
            why.append(f"{together[i]} in no test together")
        if apart := [departure.test for departure in departures_near(certification.campaign, condition)]:
            why.append(f"{read_out(apart)} stands apart there")
        if i in unused:
            why.append(f"run as {read_out(unused[i])}, not used")
        if i in certification.counted_once:
            why.append(f"counts as {certification.counted_once[i]}")
        rows.append(Planned(i, condition, certification.answers[i], joined(why, "; ")))
    return tuple(rows)


def planned_table(certification: Certification, _: Display) -> Table:
    """The same as a table for readers."""
    rows = (
        {"Planned test": own.id, **of_condition(own.condition), "Answer": own.word, "Why": own.why}
        for own in planned(certification)
    )
    return Table.of("planned tests", rows, *CONDITION)


def _why(certification: Certification, i: str) -> str:
    answer, row = certification.answers[i], certification.rows[i]
    if answer == "was run":
        return _tests_there(certification, row)
    if answer == "skip" or i in certification.uncertain:
        return tables.at_once_text(certification, i)
    if answer == "cannot say" and any(verdict.word == "outside" for verdict in row):
        return "outside what the tests check"
    template = {"would miss": "misses {}", "run": "open: {}", "cannot say": "records too short for {}"}[answer]
    word, unknown = "not met" if answer == "would miss" else "open", answer == "cannot say"
    return template.format(
        ", ".join(v.criterion.name for v in row if v.word == word and (v.probability is None) is unknown)
    )


def _tests_there(certification: Certification, row: Sequence[Verdict]) -> str:
    tests = []
    for test_id in row[0].run:
        test = certification.campaign.test(test_id)
        parts: list[str] = [f"test {test_id}"]
        if not test.condition.is_at(row[0].condition):
            parts.append(Sentence("at {}", test.condition))
        shown = [(verdict.criterion, verdict.run[test_id]) for verdict in row]
        if missed := [criterion.name for criterion, v in shown if v is not None and not criterion.is_met_by(v)]:
            parts.append(f"which missed {', '.join(missed)}")
        if test.faults:
            parts.append(Sentence("in doubt as {}", joined([fault.text for fault in test.faults], "; ")))
        tests.append(joined(parts, ", "))
    unsettled = ", ".join(verdict.criterion.name for verdict in row if verdict.word == "open")
    return joined([*tests, *([f"open: {unsettled}"] if unsettled else [])], "; ")
