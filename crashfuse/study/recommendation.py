"""Recommendation of an approach, for one prediction or a whole campaign, with reasons that an engineer can check.

A recommendation for one test rests on the other tests alone; only that for a campaign uses the results of left-out
tests, of two at least: one alone cannot tell approaches apart. It is decided by a proper score of the whole band
(CRPS), and explained in ratings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from crashfuse.approaches.calibration import STRIDE
from crashfuse.approaches.mixture import Scores
from crashfuse.approaches.registry import BASELINE, CLASSES, by_preference
from crashfuse.approaches.time_domain.config import AboutTimeDomain
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import require_a
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.signals.rating import grade
from crashfuse.study.estimate import Estimate
from crashfuse.study.expected_rating import ExpectedRating, expected_rating
from crashfuse.study.study import Fold, Study
from crashfuse.units import MPH, G
from crashfuse.wording import Quantity, Sentence, joined, speed

_CLEARLY = 0.02  # in rating: a handful of tests cannot separate approaches closer than this
_NEAR_MPS = 3 * MPH
_GOOD = 0.80


@dataclass(frozen=True, slots=True)
class Recommendation:
    """A recommended approach, with reasons.

    Attributes
    ----------
    sentences : tuple of str
        The recommendation, its basis, and cautions.
    expected : ExpectedRating, optional
        Expected rating of that approach, for a single prediction.
    """

    approach: str
    sentences: tuple[str, ...]
    expected: ExpectedRating | None = None

    def __repr__(self) -> str:
        return f"<Recommendation: {self.sentences[0]}>"

    def after(self, rating: float) -> tuple[str, ...]:
        """The sentences once the test is known: how the expectation came out is told first."""
        if self.expected is None:
            return self.sentences
        first, *reasons = self.sentences
        use = first.partition(". ")[0].removeprefix("Use ")
        return f"Recommended was {use}. {self.expected.outcome(rating)}", self.expected.sentence, *reasons


def recommend_for(
    estimates: Sequence[Estimate], campaign: Campaign, condition: Condition, window_ms: float = 60.0
) -> Recommendation:
    """Recommend an approach for one condition, from how each predicted nearby tests that it had not seen.

    The estimates, one for each approach, are at this condition; the campaign is the one they learned from, without the
    test itself if the condition is that of a held-out test. Ratings are over [0, window_ms).
    """
    by_name = {estimate.approach: estimate for estimate in estimates}
    names = by_preference(by_name)
    expected = {
        name: found for name in names if (found := expected_rating(by_name[name], campaign, window_ms)) is not None
    }
    if len(campaign.tests) == 1:  # not enough to learn the weights of a mixture either
        return _by_the_paper([name for name in names if not CLASSES[name].made_of] or names, campaign, condition)
    if len(expected) < len(names) and not any(CLASSES[name].learns_from_tests for name in expected):
        return _by_the_paper(names, campaign, condition)
    most = max(expected.values(), key=lambda e: e.mean).mean
    chosen = next(name for name in expected if expected[name].mean > most - _CLEARLY)
    sentences: list[str] = [joined([f"Use {_in_words(chosen)}.", expected[chosen].sentence])]
    if expected[chosen].farther:
        sentences.append(
            "The condition is farther in speed from all tests than any of these was from the others; only the width of "
            "the band tells what that costs."
        )
    if chosen != BASELINE and BASELINE in expected:
        raw = expected[BASELINE].mean
        worse = " No better than that is to be expected here." * (expected[chosen].mean <= raw)
        sentences.append(f"The raw CAE model rated {raw:.2f} on the same tests.{worse}")
    if CLASSES[chosen].made_of:
        sentences.append(by_name[chosen].prediction.notes[0])
    if expected[chosen].median <= _GOOD:
        good = grade(_GOOD + 1e-9)
        likely = "to be expected" if expected[chosen].upper <= _GOOD else "likely"
        sentences.append(f"Less than {good} is {likely}: a guide, not a proof.")
    sentences.append(
        "Here tests are left out of this one fit; a study fits anew without each, and rates them otherwise."
    )
    return Recommendation(chosen, (*sentences, *campaign.cae.extrapolation(condition)), expected[chosen])


def _by_the_paper(names: Sequence[str], campaign: Campaign, condition: Condition) -> Recommendation:
    """The paper's own advice (Sect. 4.3), for use when no left-out predictions are available."""
    away = min(abs(test.condition.speed_mps - condition.speed_mps) for test in campaign.tests)
    beside = AboutTimeDomain.name in names and away <= _NEAR_MPS
    chosen = AboutTimeDomain.name if beside else names[0]
    reason = Sentence(
        "Use {}: the nearest test is {} away, and the paper (Sect. 4.3) trusts the time domain beside a test of about "
        "the same speed, else the displacement domain.",
        _in_words(chosen),
        speed(away),
    )
    unknown = "How it predicts tests that it has not seen was not asked under these settings."
    if len(campaign.tests) == 1:
        unknown = "There is only one test, which cannot be left out: what rating to expect is not known."
    return Recommendation(chosen, (reason, unknown, *campaign.cae.extrapolation(condition)))


def recommend(study: Study) -> Recommendation:
    """Recommend an approach for a campaign, from how each predicted the tests that were left out.

    The lowest mean CRPS wins; approaches within one standard error of it, test by test, count as equal, and among
    these the mixture comes first, then the displacement domain, which the paper prefers (Sect. 4.3). Of a study of a
    single test it is the recommendation that was made without that test, with how it came out.
    """
    require_a(Study, study, "crashfuse.run_study(campaign)")
    if study not in _recommended:  # requested by files, report, and terminal or page
        _recommended[study] = _recommendation(study) if len(study.folds) > 1 else _recommendation_for_one(study)
    return _recommended[study]


_recommended: WeakKeyDictionary[Study, Recommendation] = WeakKeyDictionary()


def recommend_without(study: Study, fold: Fold, window_ms: float) -> Recommendation:
    """The recommendation for a held-out test, made without it."""
    rest = study.config.training_campaign(study.campaign, fold.held_out)
    return recommend_for(fold.estimates, rest, fold.test.condition, window_ms)


def _recommendation_for_one(study: Study) -> Recommendation:
    (fold,), window_ms = study.folds, max(study.config.windows_ms)
    advice = recommend_without(study, fold, window_ms)
    return replace(advice, sentences=advice.after(fold.ratings[advice.approach][window_ms].overall))


def _recommendation(study: Study) -> Recommendation:
    verdict = _Verdict(study)
    chosen = verdict.equal[0]  # the preferred one
    others = [name for name in verdict.names if name != chosen]
    crps = {name: Quantity((mean,), "g", ".2f") for name, mean in verdict.mean_crps_g.items()}
    compared = [Sentence("{} {}", _in_words(name), crps[name]) for name in others]
    n = len(study.folds)
    sentences: list[str] = [
        Sentence(
            f"Use {{}} for this campaign. Over 0–{verdict.window_ms:g} ms, on {n} tests that were left out, its mean "
            "distance from what was measured (CRPS, less is better) is {}{}{}.",
            _in_words(chosen),
            crps[chosen],
            "; " if compared else "",
            joined(compared, ", "),
        ),
        joined(["Mean", verdict.ratings_of(chosen)]),
    ]
    if equal := [name for name in verdict.equal if name != chosen]:
        sentences.append(f"These tests can't tell it from {' and '.join(_in_words(name) for name in equal)}.")
    if chosen in study.coverage:
        found = study.coverage[chosen]
        n = len(found.tests)
        sentences.append(
            f"95 % model band: {100 * found.share('accel'):.0f} % of a(t) up to the time of zero velocity (TTZV) "
            f"inside, maximum crush in {found.count('crush')} of {n} left-out tests, peak in "
            f"{found.count('peak')} of {n}."
        )
    if study.speed_groups is not None:
        apart = _Verdict(study.speed_groups)
        apart_ratings = apart.ratings_of(chosen)
        sentences.append(
            Sentence("Where no test of about the same speed was left to learn from: mean {}", apart_ratings)
        )
    return Recommendation(chosen, tuple(sentences))


class _Verdict:
    """Comparison of the approaches on the left-out tests of a study."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.window_ms = max(study.config.windows_ms)
        self.names = by_preference(study.config.approaches)

    @cached_property
    def crps_g(self) -> Mapping[str, FloatArray]:
        """CRPS of each approach's predictions of the tests, in g, shape (n_tests,)."""
        return {name: np.array([self._crps(fold, name) for fold in self.study.folds]) / G for name in self.names}

    def _crps(self, fold: Fold, approach: str) -> float:
        prediction = fold.estimate(approach).prediction
        rated = slice(0, round(self.window_ms / 1e3 / DT_S), STRIDE)
        draws = prediction.accel_mps2[None] if prediction.draws_mps2 is None else prediction.draws_mps2
        measured = fold.test.pulse.accel_mps2
        return Scores.of(measured[rated], [draws[:, rated]]).crps(np.ones(1))

    @cached_property
    def mean_crps_g(self) -> Mapping[str, float]:
        """Mean CRPS of each approach over the tests, in g."""
        return {name: float(values.mean()) for name, values in self.crps_g.items()}

    @cached_property
    def equal(self) -> list[str]:
        """The best approach by CRPS and all within a standard error of it."""
        best = self.crps_g[min(self.names, key=lambda name: self.mean_crps_g[name])]
        n = best.size
        excess = {name: values - best for name, values in self.crps_g.items()}
        return [name for name, e in excess.items() if e.mean() <= e.std(ddof=1) / np.sqrt(n)]

    def ratings_of(self, name: str) -> str:
        """The mean rating, the worst rating and the harm of an approach, to follow "mean"."""
        overall = {f.held_out: f.ratings[name][self.window_ms].overall for f in self.study.folds}
        mean, worst = float(np.mean(list(overall.values()))), min(overall, key=lambda test: overall[test])
        v0 = speed(self.study.campaign.test(worst).condition.speed_mps)
        told = Sentence(f"rating {mean:.3f} ({grade(mean)}), worst {overall[worst]:.3f} ({{}}, {{}})", worst, v0)
        if name == BASELINE or BASELINE not in self.names:
            return joined([told, "."], "")
        raw = {f.held_out: f.ratings[BASELINE][self.window_ms].overall for f in self.study.folds}
        below = [test for test in overall if overall[test] < raw[test]]
        harm = max((raw[test] - overall[test] for test in below), default=0.0)
        most = f"{'up to ' if len(below) > 1 else ''}{harm:.3f}"
        compared = f"better than this in {', '.join(below)} (by {most})" if below else "better in no test"
        return Sentence(f"{{}}; the raw CAE model {np.mean(list(raw.values())):.3f}, {{}}.", told, compared)


def _in_words(approach: str) -> str:
    return CLASSES[approach].in_words
