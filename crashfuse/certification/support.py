"""What confidence a number of verdicts, some of them wrong, supports."""

from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, betaincinv

from crashfuse.certification.verdict import reaches
from crashfuse.wording import probability_text

_LEVEL = 0.95
MOST_OF_A_TEST = 5
"""Verdicts of a test that count, however often it was left out: its metrics vary together, so none supports 0.95."""
SUPPORTED_AT_ALL = {"rebound_velocity": 0.85, "restitution": 0.85}
"""By metric: 9 and 12 % of decided verdicts on random vehicles are wrong (``benchmarks/certification.py``)."""


def share_bounds(count: int, n: int) -> tuple[float, float]:
    """Exact two-sided 95 % bounds of a share of which ``count`` in ``n`` were seen (Clopper & Pearson 1934)."""
    tail = (1 - _LEVEL) / 2
    lower = float(betaincinv(count, n - count + 1, tail)) if count else 0.0
    upper = float(betaincinv(count + 1, n - count, 1 - tail)) if count < n else 1.0
    return lower, upper


def _expected_right(decided: int, wrong: int) -> float:
    """Expected share of right verdicts (Jeffreys' prior)."""
    return 1 - (wrong + 0.5) / (decided + 1)


def largest_share(count: int, n: int) -> float:
    """Exact one-sided 95 % upper bound of such a share."""
    return float(betaincinv(count + 1, n - count, _LEVEL)) if count < n else 1.0


@dataclass(frozen=True, slots=True)
class Support:
    """What the record says of one criterion, from its own trials and those of all criteria with a test near the limit.

    Of a test one verdict a metric counts each time it was left out or planned, and five in all, wrong ones first.

    Attributes
    ----------
    decided, wrong : int
        Verdicts *met* and *not met*, and those that a test contradicted.
    own_decided, own_wrong : int
        Those on the criterion itself, and on its metric before tests were run; one a test.
    near : bool
        Whether a test came near the limit.
    most : float
        Highest confidence that any record supports in this metric, by its verdicts on random vehicles.
    before, wrong_before : int
        Verdicts that were given on tests before these were run, on any metric, and the wrong ones.
    """

    decided: int
    wrong: int
    own_decided: int
    own_wrong: int
    near: bool
    most: float = 1.0
    before: int = 0
    wrong_before: int = 0

    @property
    def confidence(self) -> float:
        """Highest confidence that the record supports: the expected share of right verdicts, ``most`` at most."""
        return min(_expected_right(self.decided, self.wrong), self.most)

    def shortfall(self, confidence: float) -> str | None:
        """A sentence on what record would support this confidence; None if this one does.

        What was wrong on its own metric, or before tests were run, can refute it (exact, at 95 %): right ones on other
        criteria, or on left-out tests, do not make up for that.
        """
        for n, wrong, told in (
            (self.own_decided, self.own_wrong, "verdicts on this metric, one a test,"),
            (self.before, self.wrong_before, "verdicts that were given on tests before they were run"),
        ):
            if wrong and float(betainc(wrong, n - wrong + 1, 1 - confidence)) < 1 - _LEVEL:
                refuted = f"that refutes a confidence of {confidence:g}, whatever else was right"
                return f"{wrong} of {n} {told} were wrong: {refuted}."
        if reaches(self.confidence, confidence):
            return None
        if not reaches(self.most, confidence):
            told = "About every tenth verdict on this metric was wrong on random vehicles: whatever the record, it"
            return f"{told} supports a confidence of {self.most:g}, not {confidence:g}."
        needed = int(np.ceil((self.wrong + 0.5) / (1 - confidence) - 1 - 1e-9))
        of = f"{self.wrong} of {self.decided} verdicts wrong" if self.decided else "no verdict"
        return (
            f"The campaign's record ({of}, at most {MOST_OF_A_TEST} a test) supports a confidence of "
            f"{probability_text(self.confidence, confidence)}, not {confidence:g}; it would take {needed} verdicts "
            f"with no more than {self.wrong} wrong."
        )

    def reservation(self, confidence: float) -> str | None:
        """A sentence on why a record that supports this confidence says little about the criterion itself."""
        if not self.near:
            return "No left-out test came near this limit: the record says nothing about it."
        if reaches(_expected_right(self.own_decided, self.own_wrong), confidence):
            return None
        own = "No verdict on this metric was held against a test"
        if self.own_decided:
            count = f"{self.own_decided} verdict{'s' * (self.own_decided > 1)}"
            most = f"at most {100 * largest_share(self.own_wrong, self.own_decided):.0f} %"
            own = f"Only {count} on this metric, one a test, 0 wrong ({most}): too few to support the confidence"
        if self.own_wrong:
            wrong = f"{self.own_wrong} of {count} on this metric, one a test, wrong"
            own = f"{wrong} ({most}): too many to support the confidence alone"
        all_of_them = f"{self.wrong} of {self.decided} wrong"
        return f"{own}; with those on other criteria, at most {MOST_OF_A_TEST} a test, {all_of_them}."
