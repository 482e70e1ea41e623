"""The answer at a condition, in a word or two: whether its test need not be run, and if it is needed, what for."""

from typing import Literal

from crashfuse.certification.certify import Certification
from crashfuse.certification.verdict import Verdict

Answer = Literal[
    "run", "need not be run", "would miss", "test or redesign", "record for longer", "to be tested", "outside"
]
"""A test was made for it; it would meet all criteria at once; it would miss one; one is open, and only a test or
another design can tell; one is open as records end too early; each is met, but all at once not with the confidence; one
lies beyond what the campaign's tests check. The first that is true."""


def answers(certification: Certification) -> dict[str, Answer]:
    """The answer at each condition of the matrix, by its id."""
    waived, uncertain = certification.waived, certification.uncertain
    return {
        i: "need not be run" if i in waived else "to be tested" if i in uncertain else _answer(row)
        for i, row in certification.rows.items()
    }


def _answer(row: tuple[Verdict, ...]) -> Answer:
    if row[0].run:
        return "run"
    words = {own.word for own in row}
    if "not met" in words:
        return "would miss"
    if "open" not in words:
        return "outside"
    known = any(own.word == "open" and own.probability is not None for own in row)
    return "test or redesign" if known else "record for longer"
