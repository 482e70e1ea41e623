"""What became of an earlier certification, as a table and in words."""

from collections.abc import Iterator

import pandas as pd

from crashfuse.certification.changes import Changes
from crashfuse.certification.earlier import EarlierVerdict
from crashfuse.certification.verdict import Verdict
from crashfuse.reporting.certification_sentences import at_most, counted, listed
from crashfuse.reporting.certification_tables import probability_text
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.version import __version__
from crashfuse.wording import Sentence

_DIGEST = 12  # characters of it that are shown


def changes_table(changes: Changes) -> pd.DataFrame:
    """All verdicts of both, one row a condition and criterion, as ``changes.csv``."""
    rows = [
        {
            "id": cell.condition_id,
            "criterion": cell.criterion.name,
            "metric": cell.criterion.metric,
            "window_ms": cell.criterion.window_ms,
            "at_least": cell.criterion.at_least,
            "at_most": cell.criterion.at_most,
            "unit": cell.criterion.unit,
            "earlier_probability": None if cell.before is None else cell.before.probability,
            "earlier_verdict": "" if cell.before is None else cell.before.word,
            "probability": None if cell.now is None else cell.now.probability,
            "verdict": "" if cell.now is None else cell.now.word,
            "test": test,
            "measured": measured,
            "came_true": cell.came_true.get(test, ""),
        }
        for cell in changes.cells
        for test, measured in (cell.since or {"": None}).items()
    ]
    numbers = ("window_ms", "at_least", "at_most", "earlier_probability", "probability", "measured")
    return pd.DataFrame(rows).astype(dict.fromkeys(numbers, float))


def shown_changes(changes: Changes, display: Display = DEFAULT) -> pd.DataFrame:
    """The same for readers: first what tests run since tell of, then verdicts that are not as they were."""
    return pd.DataFrame(
        {
            "Condition": cell.condition_id,
            "Criterion": cell.criterion.name,
            "Limit": display.words(cell.criterion.limits),
            "Then": _said(cell.before),
            "Now": _said(cell.now),
            "Measured since": "; ".join(
                display.words(Sentence("{} {}", test, cell.criterion.shown(value)))
                for test, value in cell.since.items()
            )
            or "–",
            "Came true": ", ".join("yes" if true else "no" for true in cell.came_true.values()) or "–",
        }
        for cell in sorted(changes.cells, key=lambda cell: not cell.since)
        if cell.since or cell.before is None or cell.now is None or cell.before.word != cell.now.word
    )


def change_sentences(changes: Changes) -> tuple[str, ...]:
    """Whether what was said came true, and what is said otherwise today, in a few sentences."""
    return (*_beside(changes), *_outcomes(changes), *_changed(changes))


def _said(verdict: EarlierVerdict | Verdict | None) -> str:
    return "not asked" if verdict is None else f"{verdict.word} ({probability_text(verdict.probability)})"


def _beside(changes: Changes) -> Iterator[str]:
    """Which certification is compared, and what was otherwise besides the tests."""
    earlier, later = changes.earlier, changes.later
    new, gone = changes.new_tests, [test for test in earlier.tests if test not in later.campaign.test_ids]
    told = f"new since: {listed(new)}" if new else "no test is new"
    if gone:
        told += f"; no longer used: {listed(gone)}"
    of = f"{counted(len(earlier.matrix.ids), 'condition')} from {counted(len(earlier.tests), 'test')}"
    yield f"Beside the earlier certification of {of} (SHA-256 {earlier.digest[:_DIGEST]}…); {told}."
    config = later.config
    today = {
        "campaign": later.campaign.name,
        "version": __version__,
        "approach": later.approach,
        "preset": config.preset,
        "seed": config.seed,
        "confidence": later.criteria.confidence,
    }
    then = {**earlier.settings, "confidence": earlier.criteria.confidence}
    if differ := [f"{name} {own} (then {then[name]})" for name, own in today.items() if own != then[name]]:
        yield f"Made otherwise: {'; '.join(differ)}."


def _outcomes(changes: Changes) -> Iterator[str]:
    """Whether tests run since showed what was said."""
    if not changes.run_since:
        yield "No test was run at its conditions since, so none tells whether its verdicts came true."
        return
    there = [f"{i} (test {' and '.join(tests)})" for i, tests in changes.run_since.items()]
    n, wrong = changes.outcomes
    came = f"{counted(n, 'verdict')} met or not met, {wrong} wrong ({at_most(wrong, n)}, exact 95 % bound)"
    inside, intervals = changes.intervals
    yield (
        f"Run since at its conditions: {listed(there)}. Said there: {came if n else 'nothing that was decided'}; "
        f"{inside} of {counted(intervals, 'interval')} held what was measured (made to hold 95 %)."
    )
    if waived := changes.waived_outcomes:
        missed = [
            f"{i} ({', '.join(names)} by {test})" for i, own in waived.items() for test, names in own.items() if names
        ]
        came = f"yet missed: {listed(missed)}" if missed else "and every test met every criterion"
        yield f"Of these {counted(len(waived), 'condition')} needed no test, {came}."
    for cell in changes.cells:
        for test, came_true in cell.came_true.items():
            if not came_true:
                yield Sentence(
                    "{}: {} ({}) was said to be {}; {} measured {}.",
                    cell.condition_id, cell.criterion.name, cell.criterion.limits, _said(cell.before), test,
                    cell.criterion.shown(cell.since[test]),
                )  # fmt: skip


def _changed(changes: Changes) -> Iterator[str]:
    """How the verdicts of both differ."""
    pairs = changes.compared
    same = sum(before.word == now.word for _, before, now in pairs)
    gained = sum(now.decided and not before.decided for _, before, now in pairs)
    lost = sum(before.decided and not now.decided for _, before, now in pairs)
    yield (
        f"Of {counted(len(pairs), 'verdict')} that both have, {same} are as they were; {gained} are decided since, "
        f"{lost} no longer."
    )
    turned = [
        f"{cell.condition_id} ({cell.criterion.name})"
        for cell, before, now in pairs
        if before.decided and now.decided and before.word != now.word
    ]
    for told, some in (
        ("Turned round", turned),
        ("Need not be run any more", changes.newly_waived),
        ("Needed no test then, and do now", changes.withdrawn),
    ):
        if some:
            yield f"{told}: {listed(some)}."
    gone, added = sum(cell.now is None for cell in changes.cells), sum(cell.before is None for cell in changes.cells)
    if gone or added:
        yield f"Not compared, as a condition or a limit is another: {counted(gone, 'verdict')} of then, {added} of now."
