"""The track record: the verdicts that left-out tests got from the others alone, compared with what was measured."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal, NamedTuple, Self

import numpy as np
from scipy.special import betainc, betaincinv

from crashfuse.approaches.base import holds_whole
from crashfuse.approaches.registry import BASELINE
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.forecasts import Forecast, Query, Split, quantity
from crashfuse.certification.verdict import WORDS, Verdict, judge, needs_no_test, reaches
from crashfuse.crash_test import CrashTest
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import Quantity, Sentence, counted, probability_text

_LEVEL = 0.95
MOST_OF_A_TEST = 5  # verdicts that count, however often it was left out: its metrics vary together
SUPPORTED_AT_ALL = {"rebound_velocity": 0.85, "restitution": 0.85}
"""By metric: 9 and 12 % of decided verdicts on random vehicles are wrong (``benchmarks/certification.py``)."""


def share_bounds(count: int, n: int) -> tuple[float, float]:
    """Exact two-sided 95 % bounds of a share, ``count`` in ``n`` seen (Clopper & Pearson 1934)."""
    tail = (1 - _LEVEL) / 2
    lower = float(betaincinv(count, n - count + 1, tail)) if count else 0.0
    upper = float(betaincinv(count + 1, n - count, 1 - tail)) if count < n else 1.0
    return lower, upper


def largest_share(count: int, n: int) -> float:
    """Exact one-sided 95 % upper bound of such a share."""
    return float(betaincinv(count + 1, n - count, _LEVEL)) if count < n else 1.0


def percent_at_most(wrong: int, n: int) -> str:
    """That bound for readers: ``4.5 %``, ``35 %``."""
    share = largest_share(wrong, n)
    return f"{100 * share:.{int(share < 0.0995)}f} %"


def counted_wrong(wrong: int) -> str:
    """How many are wrong, in words."""
    return f"{wrong} wrong" if wrong else "none wrong"


class WrongShare(NamedTuple):
    """How many of ``n`` verdicts were wrong, or of ``n`` tests or vehicles have a wrong one."""

    wrong: int
    n: int

    @property
    def at_most(self) -> float | None:
        """:func:`largest_share` to four digits; None without any."""
        return round(largest_share(*self), 4) if self.n else None


def wrong_shares(wrong: Sequence[bool], **units: Sequence[Hashable]) -> dict[str, WrongShare]:
    """Of ``verdicts``, and of each unit (``tests``, ``vehicles``), which is wrong if any verdict on it is."""
    shares = {"verdicts": WrongShare(sum(wrong), len(wrong))}
    for name, labels in units.items():
        contradicted = {label for label, is_wrong in zip(labels, wrong, strict=True) if is_wrong}
        shares[name] = WrongShare(len(contradicted), len({*labels}))
    return shares


def _expected_right(decided: int, wrong: int) -> float:
    return 1 - (wrong + 0.5) / (decided + 1)  # Jeffreys' prior


@dataclass(frozen=True, slots=True)
class Support:
    """What the record says of one criterion, from its own trials and those of criteria with a test near the limit.

    A test counts with one verdict a metric each time it was left out or planned, five in all, wrong ones first.
    """

    decided: int
    wrong: int
    own_decided: int  # on the criterion itself, and on its metric before tests were run; one a test
    own_wrong: int
    near: bool
    most: float = 1.0  # highest confidence that any record supports in this metric, by its verdicts on random vehicles
    before: int = 0  # given on tests before these were run, on any metric
    wrong_before: int = 0

    @property
    def confidence(self) -> float:
        """Highest that the record supports: the expected share of right verdicts, ``most`` at most."""
        return min(_expected_right(self.decided, self.wrong), self.most)

    def shortfall(self, confidence: float) -> str | None:
        """What record would support this confidence, or what refutes it; None if this one supports it."""
        for n, wrong, of in (
            (self.own_decided, self.own_wrong, "on this metric, one a test,"),
            (self.before, self.wrong_before, "given before the tests were run"),
        ):
            if wrong and float(betainc(wrong, n - wrong + 1, 1 - confidence)) < 1 - _LEVEL:
                return f"{wrong} of {n} verdicts {of} were wrong: too many for a confidence of {confidence:g}."
        if reaches(self.confidence, confidence):
            return None
        if not reaches(self.most, confidence):
            why = "On random vehicles about one verdict in ten on this metric was wrong"
            return f"{why}, so no record supports a confidence above {self.most:g}."
        needed = int(np.ceil((self.wrong + 0.5) / (1 - confidence) - 1 - 1e-9))
        return (
            f"{counted(self.decided, 'verdict')} on hidden tests, {counted_wrong(self.wrong)}: enough for a confidence "
            f"of {probability_text(self.confidence, confidence)}, not of {confidence:g}, which takes {needed} with "
            f"{f'at most {self.wrong}' if self.wrong else 'none'} wrong."
        )

    def reservation(self, confidence: float) -> str | None:
        """What supports this confidence where the criterion's own verdicts do not; None where they do."""
        if self.near and reaches(_expected_right(self.own_decided, self.own_wrong), confidence):
            return None
        tests, alone = counted(self.own_decided, "hidden test"), "Not checked on any hidden test."
        if self.own_decided:
            alone = f"Checked on {tests}, {counted_wrong(self.own_wrong)}: alone too few."
        if not self.near:
            alone = "No hidden test came near this limit, so its own verdicts prove nothing."
        if not reaches(self.confidence, confidence):
            return alone
        verdicts = f"{counted(self.decided, 'verdict')}, {counted_wrong(self.wrong)}"
        return f"{alone} With other criteria it is {verdicts}: enough for a confidence of {confidence:g}."

    def text(self, confidence: float) -> str:
        """What it says at this confidence."""
        verdicts, wrong = counted(self.own_decided, "verdict"), counted_wrong(self.own_wrong)
        supported = f"{verdicts}, one a test, {wrong}: enough for this confidence."
        return self.shortfall(confidence) or self.reservation(confidence) or supported


LeftOut = Literal["test", "speed group", "planned"]

_BINS = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


@dataclass(frozen=True, slots=True)
class Trial:
    """The verdict on one criterion of a test, left out or only planned, and what was measured."""

    held_out: str
    left_out: LeftOut  # planned: an earlier certification gave the verdict before the test was run
    verdict: Verdict
    measured: float
    cae_probability: float | None  # by the raw CAE model, with its error in the other tests as band; None for ratings
    shift: float = 0.0  # what it showed beyond ``measured`` as it was not quite at the condition, by the CAE model

    @property
    def met(self) -> bool:
        """Whether the test met the criterion."""
        return self.verdict.criterion.is_met_by(self.measured)

    @property
    def wrong(self) -> bool:
        """Whether a verdict was given that the test contradicts."""
        return self.verdict.decided and (self.verdict.word == "met") != self.met

    @property
    def measured_text(self) -> Quantity | Sentence:
        """What the test measured and, if run off its condition, what that is there by the CAE model."""
        shown = self.verdict.criterion.shown
        if not self.shift:
            return shown(self.measured)
        off = shown(self.measured + self.shift), shown(self.measured)
        return Sentence("{} ({} at its condition, by the CAE model)", *off)

    @property
    def held(self) -> bool:
        """Whether the measured value lies in the 95 % interval."""
        lower, upper = self.verdict.lower, self.verdict.upper
        return (lower is None or lower <= self.measured) and (upper is None or self.measured <= upper)

    @property
    def near(self) -> bool:
        """Whether the measured value lies within one width of the 95 % interval of the limit."""
        verdict = self.verdict
        ends = [end for end in (verdict.lower, verdict.upper) if end is not None]
        if not ends or (len(ends) == 1 and verdict.value is None):
            return False
        # where one end is not known, the interval is taken to reach as far to that side of the value
        width = max(ends) - min(ends) if len(ends) > 1 else 2 * abs(ends[0] - (verdict.value or 0.0))
        return verdict.criterion.margin(self.measured) <= width


def _decided(trials: Sequence[Trial]) -> tuple[int, int]:
    return sum(trial.verdict.decided for trial in trials), sum(trial.wrong for trial in trials)


def _with_interval(trials: Sequence[Trial]) -> list[Trial]:
    return [t for t in trials if (t.verdict.lower, t.verdict.upper) != (None, None)]


def _held(trials: Sequence[Trial]) -> tuple[int, int]:
    n = len(strictest_per_metric(trials))
    return n - len(strictest_per_metric([trial for trial in trials if not trial.held])), n


def trial_bounds(trials: Sequence[Trial]) -> dict[str, WrongShare]:
    """:func:`wrong_shares` of the decided ones of these trials, and of their tests."""
    decided = [trial for trial in trials if trial.verdict.decided]
    return wrong_shares([trial.wrong for trial in decided], tests=[trial.held_out for trial in decided])


def strictest_per_metric(trials: Sequence[Trial], *, each_time: bool = True) -> tuple[Trial, ...]:
    """One verdict a metric of a test, each time or in all: a wrong one if any is, or else a decided one."""
    worst_last = sorted(trials, key=lambda trial: (trial.wrong, trial.verdict.decided))
    found = {(t.held_out, each_time and t.left_out, quantity(t.verdict.criterion)): t for t in worst_last}
    return tuple(found.values())


def _capped_per_test(trials: Sequence[Trial]) -> tuple[Trial, ...]:
    by_test: dict[str, list[Trial]] = {}
    for trial in sorted(trials, key=lambda trial: (not trial.wrong, not trial.verdict.decided)):
        by_test.setdefault(trial.held_out, []).append(trial)
    return tuple(trial for some in by_test.values() for trial in some[:MOST_OF_A_TEST])


@dataclass(frozen=True, slots=True)
class Bin:
    """Verdicts in a bin of probability: its mean, and the share of tests that ``met``, with 95 % bounds."""

    low: float
    high: float
    n: int
    probability: float
    met: float
    lower: float
    upper: float

    @property
    def holds(self) -> bool:
        """Whether the mean probability lies within the bounds."""
        return self.lower <= self.probability <= self.upper


class LeftOutTest(NamedTuple):
    """A test that was left out, what was forecast of it, and what it showed."""

    test: CrashTest
    way: LeftOut
    forecast: Forecast
    cae: Forecast
    outside: tuple[str, ...]
    unshown: tuple[str, ...]
    measured: dict[str, float | None]  # by :func:`quantity`
    whole: bool | None  # whether its pulse lies in the band of whole pulses; None if there is none, or it counts once


def left_out_tests(
    campaign: Campaign, criteria: Criteria, splits: Sequence[Split], approach: str, forecasts: Mapping[Query, Forecast]
) -> Iterator[LeftOutTest]:
    """The tests as they were left out, each way, with their forecasts by an approach and by the raw CAE model."""
    by_key = {(asked.held_out, asked.approach, asked.condition): own for asked, own in forecasts.items()}
    for test, way, held_out in splits:
        domain = Domain.of(campaign.without(held_out), for_record=True)
        outside = domain.exceeded_by(test.condition), domain.unshown(test.condition)
        own, cae = (by_key[held_out, name, test.condition] for name in (approach, BASELINE))
        measured = {quantity(limit): own.measured(limit, test, campaign.occupant) for limit in criteria.items}
        band = own.whole_mps2.mean(axis=0)
        is_counted = len(band) and not test.cae_tuned and (way == "test" or len(held_out) > 1)
        whole = holds_whole((band[0], band[1]), test.pulse.accel_mps2) if is_counted else None
        yield LeftOutTest(test, way, own, cae, *outside, measured, whole)


@dataclass(frozen=True, eq=False)
class TrackRecord:
    """All trials of a campaign. Groups of a single test, whose verdict is the test's own, count once."""

    trials: tuple[Trial, ...]
    since: tuple[Trial, ...] = ()  # of tests run after they were judged; they support or refute, and count nowhere else
    whole: tuple[tuple[LeftOut, bool], ...] = ()  # whether tests lie inside their bands of whole pulses, if any
    tuned: tuple[Trial, ...] = ()  # of tests that the CAE model was tuned to; they count nowhere
    # of a test as it was left out, of shape (n_seeds, n_samples)
    predicted_mps2: Mapping[tuple[str, LeftOut], FloatArray] = field(default_factory=dict)

    @classmethod
    def of_tests(cls, criteria: Criteria, left_out: Sequence[LeftOutTest]) -> Self:
        """The verdicts on left-out tests, with what they showed."""
        trials, tuned = list[Trial](), list[Trial]()
        for test, way, forecast, cae, outside, unshown, measured, _ in left_out:
            for verdict in judge(forecast, test.condition, criteria, outside, unshown=unshown):
                criterion = verdict.criterion
                (raw,) = (cae.chances(criterion) if criterion.window_ms is None else ()) or (None,)
                if (value := measured[quantity(criterion)]) is not None:
                    (tuned if test.cae_tuned else trials).append(Trial(test.id, way, verdict, value, raw))
        whole = tuple((own.way, own.whole) for own in left_out if own.whole is not None)
        predicted = {(own.test.id, own.way): own.forecast.accel_mps2 for own in left_out}
        return cls(tuple(trials), whole=whole, tuned=tuple(tuned), predicted_mps2=predicted)

    def __repr__(self) -> str:
        decided, wrong = self.decided
        return f"<TrackRecord of {len(self.trials)} trials: {decided} decided, {wrong} of them wrong>"

    @cached_property
    def counted(self) -> tuple[Trial, ...]:
        """Trials without those that repeat another."""
        return tuple(trial for trial in self.trials if not self.repeats(trial))

    def repeats(self, trial: Trial) -> bool:
        """Whether it is another once more, as nothing else was left out with the test."""
        alone = self._alone.get((trial.held_out, trial.verdict.criterion.name))
        return trial.left_out != "test" and alone == trial.verdict

    @cached_property
    def _alone(self) -> dict[tuple[str, str], Verdict]:
        return {(t.held_out, t.verdict.criterion.name): t.verdict for t in self.trials if t.left_out == "test"}

    @property
    def _inside(self) -> list[Trial]:
        return [trial for trial in self.counted if trial.verdict.word != "outside"]

    def of(self, criterion: Criterion) -> tuple[Trial, ...]:
        """The counted trials of a criterion."""
        return tuple(trial for trial in self.counted if trial.verdict.criterion == criterion)

    def counts(self, criterion: Criterion | None = None) -> dict[str, tuple[int, int]]:
        """Number of verdicts by word, and of wrong ones; of one criterion or of all."""
        some = self.counted if criterion is None else self.of(criterion)
        by_word = {word: [trial for trial in some if trial.verdict.word == word] for word in WORDS}
        return {word: (len(trials), sum(trial.wrong for trial in trials)) for word, trials in by_word.items()}

    @property
    def decided(self) -> tuple[int, int]:
        """Number of verdicts *met* and *not met*, and of the wrong ones."""
        return _decided(self.counted)

    def bounds(self, criterion: Criterion | None = None) -> dict[str, WrongShare]:
        """:func:`trial_bounds` of one criterion or of all."""
        return trial_bounds(self.counted if criterion is None else self.of(criterion))

    @property
    def near_limit(self) -> "TrackRecord":
        """Verdicts *met* and *not met* on tests that came near the limit, or belied it; one a metric and test."""
        near = [trial for trial in self.counted if trial.verdict.decided and (trial.near or trial.wrong)]
        return TrackRecord(strictest_per_metric(near, each_time=False))

    @property
    def intervals(self) -> tuple[int, int]:
        """How many 95 % intervals inside the domain held what was measured, and of how many; one a metric each time."""
        return _held(_with_interval(self._inside))

    @property
    def intervals_outside(self) -> tuple[int, int]:
        """The same of tests outside what the others check."""
        return _held(_with_interval([trial for trial in self.counted if trial.verdict.word == "outside"]))

    @property
    def whole_pulses(self) -> dict[LeftOut, tuple[int, int]]:
        """How many tests lay inside the band of whole pulses, and of how many, by what was left out."""
        by_way = {way: [inside for other, inside in self.whole if other == way] for way, _ in self.whole}
        return {way: (sum(insides), len(insides)) for way, insides in by_way.items()}

    @property
    def missed_intervals(self) -> tuple[Trial, ...]:
        """Trials whose interval did not hold what was measured, inside and outside, one a metric each time."""
        return strictest_per_metric([trial for trial in _with_interval(self.counted) if not trial.held])

    @property
    def too_narrow(self) -> bool:
        """Whether too few intervals held for ones that hold 95 % of tests (exact 95 % bound)."""
        inside, n = self.intervals
        return n > 0 and largest_share(inside, n) < _LEVEL

    def waived(self, criteria: Criteria) -> tuple[int, int, int]:
        """How many tests were left out, need not have been run, and of these missed a criterion."""
        tests, saved = {trial.held_out for trial in self.counted}, self.saved(criteria).values()
        return len(tests), len(saved), sum(any(ways.values()) for ways in saved)

    def saved(self, criteria: Criteria) -> dict[str, dict[LeftOut, bool]]:
        """Tests that need not have been run, by how they were left out, and whether each then missed a criterion."""
        rows: dict[tuple[str, LeftOut], list[Trial]] = {}
        for trial in self.counted:
            rows.setdefault((trial.held_out, trial.left_out), []).append(trial)
        saved: dict[str, dict[LeftOut, bool]] = {}
        for (test, way), row in rows.items():
            if len(row) == len(criteria.items) and needs_no_test([t.verdict for t in row], criteria.confidence):
                saved.setdefault(test, {})[way] = any(trial.wrong for trial in row)
        return saved

    def support(self, criterion: Criterion) -> Support:
        """What the record says of a criterion."""
        own = self.of(criterion)
        later = [trial for trial in self.since if quantity(trial.verdict.criterion) == quantity(criterion)]
        near_ones = {trial.verdict.criterion for trial in self.counted if trial.near or trial.wrong}
        counted = [trial for trial in self.counted if trial.verdict.criterion in {criterion, *near_ones}]
        every = _capped_per_test(strictest_per_metric((*counted, *self.since)))
        of_its_own = _decided(strictest_per_metric((*own, *later), each_time=False))
        before = _decided(strictest_per_metric(self.since, each_time=False))
        near = any(trial.near for trial in (*own, *(trial for trial in later if trial.verdict.criterion == criterion)))
        most = SUPPORTED_AT_ALL.get(criterion.metric, 1.0)
        return Support(*_decided(every), *of_its_own, near, most, *before)

    @property
    def brier(self) -> tuple[float, float] | None:
        """Mean squared error of the probabilities, and of the raw CAE's, over pulse metrics; None without any."""
        said = [(trial.verdict.probability, trial.cae_probability, trial.met) for trial in self._inside]
        rows = np.array(said, dtype=np.float64).reshape(-1, 3)  # None is NaN
        if not len(known := rows[~np.isnan(rows).any(axis=1)]):
            return None
        ours, cae, met = known.T
        return float(((ours - met) ** 2).mean()), float(((cae - met) ** 2).mean())

    @property
    def reliability(self) -> tuple[Bin, ...]:
        """Probabilities in bins, against the share of tests that met the criterion."""
        known = [(t.verdict.probability, t.met) for t in self._inside if t.verdict.probability is not None]
        said, met = np.array(known, dtype=np.float64).reshape(-1, 2).T
        bins = []
        number = np.clip(np.searchsorted(_BINS, said, side="right") - 1, 0, len(_BINS) - 2)
        for i, (low, high) in enumerate(pairwise(_BINS)):
            if n := int((number == i).sum()):
                count = int(met[number == i].sum())
                bins.append(Bin(low, high, n, float(said[number == i].mean()), count / n, *share_bounds(count, n)))
        return tuple(bins)
