"""What became of an earlier certification, as a table and in words."""

from collections.abc import Iterator

import pandas as pd

from crashfuse.certification.certify import Certification
from crashfuse.certification.changes import Changes
from crashfuse.certification.earlier import EarlierVerdict
from crashfuse.certification.tested_since import TestedSince
from crashfuse.certification.verdict import Verdict
from crashfuse.reporting.certification_tables import condition_columns, factors_of
from crashfuse.reporting.evidence_sentences import (
    at_most,
    counted,
    is_too_narrow,
    listed,
    listed_conditions,
    measured_words,
    missed_intervals,
)
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.provenance import certification_settings
from crashfuse.wording import Sentence, joined, probability_text

_DIGEST = 12  # characters of it in a sentence


def changes_table(changes: Changes) -> pd.DataFrame:
    """All verdicts of both, one row a condition, criterion and new test there, as ``changes.csv``."""
    factors = tuple(dict.fromkeys((*factors_of(changes.earlier.matrix), *factors_of(changes.later.matrix))))
    rows = [
        {
            **condition_columns(cell.later_id or "", cell.condition, factors, changes.later.matrix.conditions[0]),
            "earlier_id": cell.earlier_id or "",
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
            "shift": changes.since.shift(test, cell.criterion.metric),
            "came_true": cell.came_true.get(test, ""),
        }
        for cell in changes.cells
        for test, measured in (cell.measured or {"": None}).items()
    ]
    numbers = ("window_ms", "at_least", "at_most", "earlier_probability", "probability", "measured")
    return pd.DataFrame(rows).astype(dict.fromkeys(numbers, float))


def shown_changes(changes: Changes, display: Display = DEFAULT) -> pd.DataFrame:
    """The same for readers: first what did not come true, then what else was measured, then what is not as it was."""
    then, now = (own.criteria.confidence for own in (changes.earlier, changes.later))
    shown = [
        cell
        for cell in changes.cells
        if cell.measured or cell.before is None or cell.now is None or cell.before.word != cell.now.word
    ]
    return pd.DataFrame(
        {
            "Condition": cell.name,
            "Criterion": cell.criterion.name,
            "Limit": display.words(cell.criterion.limits),
            "Then": _word(cell.before),
            "Probability then": "–" if cell.before is None else probability_text(cell.before.probability, then),
            "Now": _word(cell.now),
            "Probability now": "–" if cell.now is None else probability_text(cell.now.probability, now),
            "Measured since": "; ".join(
                display.words(
                    Sentence("{} {}", test, measured_words(own, value, changes.since.shift(test, own.metric)))
                )
                for own in [cell.criterion]
                for test, value in cell.measured.items()
            )
            or "–",
            "Came true": "; ".join(f"{test} {'yes' if own else 'NO'}" for test, own in cell.came_true.items()) or "–",
        }
        for cell in sorted(shown, key=lambda cell: (all(cell.came_true.values()), not cell.measured))
    )


def change_sentences(changes: Changes) -> tuple[str, ...]:
    """Whether what was said came true, and what is said otherwise today, in a few sentences."""
    return (
        *_beside(changes),
        *_tested(changes),
        *outcome_sentences(changes),
        *wrong_since(changes),
        *_changed(changes),
    )


def saved_and_missed(certification: Certification) -> tuple[int, int]:
    """How many tests need not have been run by what was said without them, and how many of these missed a criterion.

    Of tests that were left out, and of those that were run after an earlier certification; each counts once.
    """
    told = certification.record.saved(certification.criteria)
    if certification.since is not None:
        for own in Changes.of(certification).waived_outcomes.values():
            known = {test: bool(missed) for test, (missed, unknown) in own.items() if missed or not unknown}
            told |= {test: told.get(test, False) or missed for test, missed in known.items()}
    return len(told), sum(told.values())


def _word(verdict: EarlierVerdict | Verdict | None) -> str:
    return "not asked" if verdict is None else verdict.word


def _beside(changes: Changes) -> Iterator[str]:
    """Which certification is compared, and what was otherwise besides the tests."""
    earlier, later = changes.earlier, changes.later
    of = f"{counted(len(earlier.matrix.ids), 'condition')} from {counted(len(earlier.tests), 'test')}"
    since = changes.since
    tests = [
        f"{told}: {listed(some)}"
        for told, some in (
            ("tests that it did not know", since.new),
            ("tests whose record or filter class is another since, which it had learned from", since.changed),
            ("no longer used", since.gone),
        )
        if some
    ]
    yield (
        f"Beside the earlier certification of {of}, by its own account of {earlier.date} (SHA-256 "
        f"{earlier.digest[:_DIGEST]}…); {'; '.join(tests) or 'it knew every test'}."
    )
    if earlier.before:
        digests = ", ".join(f"{own[:_DIGEST]}…" for own in earlier.before)
        yield f"It was beside others in its turn, the latest first, by SHA-256: {digests}."
    now = certification_settings(later.campaign, later.config, later.criteria.confidence)
    pairs = [(name, own, earlier.settings.get(name, "unknown")) for name, own in now.items()]
    if differ := [f"{name} {own} (then {then})" for name, own, then in pairs if own != then]:
        yield f"Made otherwise: {'; '.join(differ)}."


def _tested(changes: Changes) -> Iterator[str]:
    """Which tests tell whether verdicts came true, and which do not."""
    since = changes.since
    if changes.tested:
        there = [
            joined([f"{name} (", joined([_named(since, test) for test in tests], " and "), ")"], "")
            for name, tests in changes.tested.items()
        ]
        yield joined(["Tested since: ", joined(there, ", "), "."], "")
    elif since.new:
        yield "None of these tests was run where it judged a metric, so none tells whether its verdicts came true."
    yield from turned_by_the_move(changes)
    if since.repeats:
        known = [f"{i} (test {test})" for test, i in since.repeats.items()]
        yield f"Run where it knew a test already, and not counted: {listed(known)}."
    if since.elsewhere:
        yield f"Run at none of its conditions (to 1 km/h and 2 % of each weight): {listed(since.elsewhere)}."


def turned_by_the_move(changes: Changes) -> Iterator[str]:
    """Verdicts that a test contradicts at its condition and not where it was run, or the other way round."""
    if turned := [
        Sentence(
            "{} {} ({}), said to be {}, {}, counts as {}",
            trial.held_out, own.name, own.limits, trial.verdict.word,
            measured_words(own, trial.measured, trial.shift), "wrong" if trial.wrong else "right",
        )
        for trial in changes.since.told
        for own in [trial.verdict.criterion]
        if trial.verdict.decided and own.is_met_by(trial.measured + trial.shift) is not trial.met
    ]:  # fmt: skip
        yield Sentence("Where a test was run decides whether its verdict came true: {}.", listed(turned))


def _named(since: TestedSince, test: str) -> str:
    """A test, with its speed and weights if they are not quite those of the condition that it was made for."""
    off = [since.campaign.test(test).condition] if since.is_off(test) else []
    return Sentence("test {}" + ", at {}" * len(off), test, *off)


def outcome_sentences(changes: Changes) -> tuple[str, ...]:
    """How often tests that were run since contradict what was said, and what conditions that needed none showed."""
    n, wrong, tests = changes.outcomes
    found = []
    if n:
        found.append(
            f"Tests run since, ratings aside: verdicts met or not met on {counted(n, 'metric')} of "
            f"{counted(tests, 'test')}, {wrong} wrong ({at_most(wrong, n)}, exact 95 % bound, as if metrics of a test "
            "were independent)."
        )
    elif changes.tested:
        found.append("Tests run since: no verdict was met or not met there.")
    n, wrong, tests = changes.outcomes_before
    if n:
        found.append(
            f"Certifications before it: verdicts met or not met on {counted(n, 'metric')} of {counted(tests, 'test')} "
            f"run since, {wrong} wrong; those on metrics of today's criteria count as well."
        )
    inside, intervals = changes.record.intervals
    if intervals:
        told = f"{inside} of {counted(intervals, 'interval')} held what tests run since measured (made to hold 95 %)"
        held = Sentence(f"{told}{{}}.", _missed(changes))
        found.append(next(narrow_sentence(changes), held))
    for name, own in changes.waived_outcomes.items():
        for test, (missed, unknown) in own.items():
            parts = [f"missed {', '.join(missed)}"] if missed else []
            parts += [f"cannot tell {', '.join(unknown)}"] if unknown else []
            outcome = " and ".join(parts) or "met every criterion"
            found.append(f"{name} needed no test by an earlier certification; {test} {outcome}.")
    return tuple(found)


def narrow_sentence(changes: Changes) -> Iterator[str]:
    """Which intervals did not hold what tests run since measured, if these are too many for intervals of 95 %.

    What one test alone missed hangs together, and is no sign of that.
    """
    inside, n = changes.record.intervals
    if is_too_narrow(inside, n) and len({trial.held_out for trial in changes.record.missed_intervals}) > 1:
        held = f"{inside} of {counted(n, 'interval')} held what tests run since measured"
        yield Sentence(f"{held}, made to hold 95 %: they were too narrow{{}}.", _missed(changes))


def _missed(changes: Changes) -> str:
    """The intervals that did not hold, and which tests were not quite where these were for."""
    off = [Sentence("{} at {}", test.id, test.condition) for test in changes.off_condition]
    said = Sentence("; not quite at its condition: {}", listed(off)) if off else ""
    return Sentence("{}{}", missed_intervals(changes.record.missed_intervals), said)


def wrong_since(changes: Changes) -> Iterator[str]:
    """Each verdict that a test run since contradicted."""
    for trial in changes.since.told:
        own = trial.verdict
        if trial.wrong:
            yield Sentence(
                "{}, before it was run: {} ({}) at {} was said to be {} (probability {}); measured {}.",
                trial.held_out, own.criterion.name, own.criterion.limits, own.condition, own.word,
                probability_text(own.probability, changes.earlier.criteria.confidence),
                measured_words(own.criterion, trial.measured, trial.shift),
            )  # fmt: skip


def gone_sentences(since: TestedSince) -> Iterator[str]:
    """What tests had shown at conditions of earlier certifications that are not used any more."""
    left_out, criteria = dict(since.campaign.unused), since.earlier.criteria.items
    for gone in since.gone_runs:
        told = [f"missed {', '.join(gone.missed(criteria)) or 'none'} of the criteria of the earlier certification"]
        told += [f"cannot tell {', '.join(unknown)}" for unknown in [gone.cannot_tell(criteria)] if unknown]
        told += [f"was not measured for {', '.join(others)}" for others in [gone.not_asked(criteria)] if others]
        why = f" ({since.campaign.reason_of(gone.test)})" if gone.test in left_out else ""
        said = "{} was run at {}, and its record of then is not used any more{}; it {}."
        yield Sentence(said, gone.test, gone.condition, why, ", and ".join(told))


def _changed(changes: Changes) -> Iterator[str]:
    """How the verdicts of both differ."""
    pairs = changes.compared
    same = sum(before.word == now.word for _, before, now in pairs)
    gained = sum(now.decided and not before.decided for _, before, now in pairs)
    lost = sum(before.decided and not now.decided for _, before, now in pairs)
    yield (
        f"Of {counted(len(pairs), 'verdict')} that both have, as they were: {same}; decided since: {gained}; no "
        f"longer decided: {lost}."
    )
    turned = [
        f"{cell.name} ({cell.criterion.name})"
        for cell, before, now in pairs
        if before.decided and now.decided and before.word != now.word
    ]
    if turned:
        yield f"Turned round: {listed(turned)}."
    withdrawn = {
        i: ", ".join(f"{own.criterion.name} {own.word}" for own in rest) or "each met, all at once uncertain"
        for i, rest in changes.withdrawn.items()
    }
    for told, answers in (
        ("Need not be run any more", dict.fromkeys(changes.newly_waived, "")),
        ("Said then to need no test, and not now", withdrawn),
    ):
        if answers:
            yield f"{told}: {listed_conditions(changes.later.matrix.ids, answers, 'changes.csv')}."
    gone, added = sum(cell.now is None for cell in changes.cells), sum(cell.before is None for cell in changes.cells)
    if gone or added:
        yield f"Not compared, as a condition or a limit is another: {counted(gone, 'verdict')} of then, {added} of now."
