"""Recommendation of an approach, for one prediction or a whole campaign, with reasons that an engineer can check.

A recommendation for one test rests on the other tests alone; only that for a campaign uses the results of left-out
tests, of two at least: one alone cannot tell approaches apart. It is decided by a proper score of the whole band
(CRPS), and explained in ratings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from crashfuse.approaches.calibration import STRIDE, Coverage
from crashfuse.approaches.mixture import Scores
from crashfuse.approaches.registry import BASELINE, CLASSES, by_preference
from crashfuse.approaches.time_domain.config import AboutTimeDomain
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import one_of, require_a, require_number
from crashfuse.execution.cache import remembered
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import DT_S, FloatArray
from crashfuse.signals.rating import grade
from crashfuse.study.config import WINDOWS_MS, StudyConfig
from crashfuse.study.estimate import Estimate, find_estimate
from crashfuse.study.expected_rating import ExpectedRating, expected_rating, mean_near, overall_rating
from crashfuse.study.facts import (
    Fact,
    campaign_facts,
    departure_fact,
    distinct,
    doubt_fact,
    extrapolation_facts,
    window_facts,
)
from crashfuse.study.outliers import LEAST, Departure, departure
from crashfuse.study.study import Fold, Study
from crashfuse.units import MPH, G, Quantity, Sentence, joined

_CHANGED = 0.02  # in rating: less is no difference


@dataclass(frozen=True, eq=False)
class Account:
    """What became of the prediction of a left-out test."""

    test: CrashTest
    approach: str
    rating: float  # overall, over [0, window_ms)
    window_ms: float
    expected: ExpectedRating | None
    neighbours: tuple[str, ...]  # other tests at about its speed
    departure: Departure | None  # from the neighbours, if they are enough to tell
    without_neighbours: float | None  # the rating if these are left out as well, where it is known
    inside: float | None  # share of a(t) up to the time of zero velocity inside the 95 % band, if there is one
    with_group: bool  # the neighbours were left out with it

    def __repr__(self) -> str:
        return f"<Account of {self.sentences[0]}>"

    @property
    def disappoints(self) -> bool:
        """Whether it came out below what was expected."""
        return self.expected is not None and self.expected.is_missed_by(self.rating)

    @property
    def facts(self) -> tuple[Fact, ...]:
        """How the expectation came out, and what the measurements say about the test itself."""
        outcome = f"It came out {self.rating:.3f} ({grade(self.rating)})."
        values = {
            "approach": self.approach,
            "rating": self.rating,
            "window_ms": self.window_ms,
            "speed_mps": self.test.condition.speed_mps,
            "left_out_with": self.neighbours if self.with_group else (),
            "outcome": outcome if self.expected is None else self.expected.outcome(self.rating),
        }
        return Fact("left_out.outcome", values, (self.test.id,)), *self.about_test

    @property
    def sentences(self) -> tuple[str, ...]:
        """The facts in words."""
        return tuple(fact.sentence for fact in self.facts)

    @property
    def about_test(self) -> tuple[Fact, ...]:
        """What the measurements say about the test itself."""
        facts = [doubt_fact(self.test)] if self.test.faults else []
        if self.departure is not None:
            facts.append(departure_fact(self.departure))
        else:
            facts.append(Fact("left_out.few_neighbours", {"neighbours": len(self.neighbours), "least": LEAST}))
        if (without := self.without_neighbours) is not None:
            code = "left_out.misled" if without > self.rating + _CHANGED else "left_out.without_neighbours"
            facts.append(Fact(code, {"rating": without}))
        if self.inside is not None:
            facts.append(Fact("left_out.inside", {"inside": self.inside}))
        return (*facts, *window_facts(self.test, self.window_ms))


def account(
    campaign: Campaign,
    config: StudyConfig,
    fold: Fold,
    window_ms: float = 60.0,
    *,
    approach: str | None = None,
    without_neighbours: float | None = None,
) -> Account:
    """Account of an approach's prediction of a left-out test, by default the approach recommended without its pulse.

    The rating ``without_neighbours`` is by default looked up in the campaign's cache.
    """
    run, test = Run.of(campaign), fold.test
    others = config.training_campaign(campaign, test.id)
    approach = approach or recommend_for(fold.estimates, others, test.condition, window_ms).approach
    estimate = fold.estimate(approach)
    neighbours = tuple(other for other in campaign.speed_group(test.id) if other != test.id)
    draws = estimate.draws_mps2
    with_group = config.leave_out == "speed group"
    if not neighbours or with_group:
        without_neighbours = None
    elif without_neighbours is None:
        rest = campaign.without(campaign.speed_group(test.id))
        if (alone := find_estimate(rest, test.condition, approach, config, run.cache)) is not None:
            without_neighbours = overall_rating(test.pulse, alone.accel_mps2, window_ms)
    apart = None
    if len(neighbours) >= LEAST:
        apart = departure(campaign, test.id, CaeModel().fit(campaign.cae, run), window_ms)
    rating, expected = fold.ratings[approach][window_ms].overall, expected_rating(estimate, others, window_ms)
    inside, group = None if draws is None else Coverage.of(test, draws).accel, (neighbours, apart, without_neighbours)
    return Account(test, approach, rating, window_ms, expected, *group, inside, with_group)


def worst_test(study: Study, window_ms: float | None = None, *, approach: str | None = None) -> Account:
    """Account of the test that an approach predicted worst, by default the recommended one over the longest window."""
    require_a(Study, study, "crashfuse.run_study(campaign)")
    window = max(study.config.windows_ms) if window_ms is None else window_ms
    require_number("window_ms", window)
    approach = recommend(study).approach if approach is None else approach
    one_of("approach of this study", approach, dict.fromkeys(study.config.approaches))
    return _worst(study, window, approach)


@remembered
def _worst(study: Study, window: float, approach: str) -> Account:
    fold = min(study.folds, key=lambda fold: fold.ratings[approach][window].overall)
    groups = () if study.speed_groups is None else study.speed_groups.folds
    # there is none while a study is running
    apart = next((group.ratings[approach][window].overall for group in groups if group.held_out == fold.held_out), None)
    config = study.config.split_configs[0]
    return account(study.campaign, config, fold, window, approach=approach, without_neighbours=apart)


def study_facts(study: Study) -> tuple[Fact, ...]:
    """Facts of a study, its campaign and the test that was predicted worst; none twice."""
    return distinct([*campaign_facts(study.campaign), *recommend(study).facts, *worst_test(study).facts])


_CLEARLY = 0.02  # in rating: a handful of tests cannot separate approaches closer than this
_TOLD = 0.005  # in rating: less is not worth a word
_NEAR_MPS = 3 * MPH
_GOOD = 0.80
_AGAINST = ("recommendation.farther", "recommendation.no_better", "recommendation.poor")
SPEED_GROUPS = "recommendation.speed_groups"  # the one fact that rests on other folds than the study's own


@dataclass(frozen=True, slots=True)
class Recommendation:
    """A recommended approach, with reasons."""

    approach: str
    facts: tuple[Fact, ...]  # the recommendation, what to expect of it, its basis, and cautions
    expected: ExpectedRating | None = None  # of that approach, for a single prediction
    ties: Mapping[str, object] = field(default_factory=dict)  # with approaches that the tests cannot tell it from

    @property
    def sentences(self) -> tuple[str, ...]:
        """The facts in words."""
        return tuple(fact.sentence for fact in self.facts)

    @property
    def brief(self) -> str:
        """What to use and to expect, and what speaks against it, in a line."""
        use, rated = f"Use {CLASSES[self.approach].in_words}", self.expected
        likely = "" if rated is None else f": rating {rated.range} expected (80 %, {rated.likely})"
        return joined([f"{use}{likely}.", *[fact.sentence for fact in self.facts if fact.code in _AGAINST]])

    def __repr__(self) -> str:
        return f"<Recommendation: {self.sentences[0]}>"

    def after(self, rating: float) -> tuple[Fact, ...]:
        """The facts once the test is known: how the expectation came out comes first."""
        if self.expected is None:
            return self.facts
        values = {"approach": self.approach, "rating": rating, "method": CLASSES[self.approach].in_words}
        told = {**values, **self.ties, "outcome": self.expected.outcome(rating)}
        return Fact("recommendation.outcome", told), *self.facts[1:]


def recommend_for(
    estimates: Sequence[Estimate], campaign: Campaign, condition: Condition, window_ms: float = 60.0
) -> Recommendation:
    """Recommend an approach for one condition, from how each predicted nearby tests that it had not seen.

    The estimates, one for each approach, are at this condition; the campaign is the one they learned from, without the
    test itself if the condition is that of a held-out test. Ratings are over [0, window_ms).
    """
    by_name = {estimate.approach: estimate for estimate in estimates}
    names = by_preference(by_name)
    asked = {name: expected_rating(by_name[name], campaign, window_ms) for name in names}
    expected = {name: rating for name, rating in asked.items() if rating is not None}
    if len(campaign.tests) == 1:  # not enough to learn the weights of a mixture either
        return _by_the_paper([name for name in names if not CLASSES[name].made_of] or names, campaign, condition)
    if len(expected) < len(names) and not any(CLASSES[name].learns_from_tests for name in expected):
        return _by_the_paper(names, campaign, condition)
    most = max(rating.mean for rating in expected.values())
    equal = [name for name, rating in expected.items() if rating.mean > most - _CLEARLY]
    name, best = equal[0], expected[equal[0]]
    ties: Mapping[str, object] = {}
    if len(equal) > 1:
        means = {w: [mean_near(by_name[other], campaign, best.tests, w) for other in equal] for w in WINDOWS_MS}
        ties = _ties(equal, means, [expected[other].lowest for other in equal], len(best.tests))
    rated = {**asdict(best), "sentence": best.sentence}
    facts = [_use(name, CLASSES[name].in_words, ties), Fact("recommendation.expected", rated)]
    if best.farther:
        facts.append(Fact("recommendation.farther"))
    if name != BASELINE and BASELINE in expected:
        raw = expected[BASELINE].mean
        facts.append(Fact("recommendation.raw_cae", {"mean_rating": raw}))
        if best.mean <= raw:
            facts.append(Fact("recommendation.no_better"))
    if CLASSES[name].made_of:
        facts.append(Fact("recommendation.mixture", {"sentence": by_name[name].notes[0]}))
    if best.median <= _GOOD:
        facts.append(Fact("recommendation.poor", {"likely": "to be expected" if best.upper <= _GOOD else "likely"}))
    return Recommendation(name, (*facts, *extrapolation_facts(campaign, condition)), best, ties)


def _use(approach: str, method: str, ties: Mapping[str, object]) -> Fact:
    return Fact("recommendation.use", {"approach": approach, "method": method, **ties})


def _ties(
    equal: Sequence[str], means: Mapping[float, Sequence[float]], lowest: Sequence[float], n_tests: int
) -> Mapping[str, object]:
    names, preferred = [CLASSES[other].in_words for other in equal], []
    by_part = {**{f"over 0–{w:g} ms": of_all for w, of_all in means.items()}, "in the worst test": lowest}
    for part, ratings in by_part.items():
        higher, lower = max(ratings), ratings[0]
        if higher - lower >= _TOLD:
            preferred.append(f"{names[ratings.index(higher)]} {part} ({higher:.3f}, not {lower:.3f})")
    return {"n_tests": n_tests, "equal": names[1:], "preferred": preferred}


def _by_the_paper(names: Sequence[str], campaign: Campaign, condition: Condition) -> Recommendation:
    away = min(abs(test.condition.speed_mps - condition.speed_mps) for test in campaign.tests)
    name = AboutTimeDomain.name if AboutTimeDomain.name in names and away <= _NEAR_MPS else names[0]
    why = "there is only one test" if len(campaign.tests) == 1 else "no test was left out under these settings"
    unknown = Fact("recommendation.expected", {"sentence": f"What rating to expect is not known: {why}."})
    facts = _use(name, CLASSES[name].in_words, {}), unknown, Fact("recommendation.by_the_paper", {"away_mps": away})
    return Recommendation(name, (*facts, *extrapolation_facts(campaign, condition)))


def recommend(study: Study) -> Recommendation:
    """Recommend an approach for a campaign, from how each predicted the tests that were left out.

    If all at about their speed were left out with them, it is one for speeds without a test. The lowest mean CRPS wins;
    approaches within one standard error of it, test by test, count as equal, and among these the mixture comes first,
    then the displacement domain, which the paper prefers (Sect. 4.3). Of a study of a single test it is the
    recommendation that was made without that test, with how it came out.
    """
    require_a(Study, study, "crashfuse.run_study(campaign)")
    return _recommendation(study)


@remembered
def _recommendation(study: Study) -> Recommendation:
    window_ms, n, grouped = max(study.config.windows_ms), len(study.folds), study.config.leave_out == "speed group"
    if n == 1:
        advice = recommend_without(study, study.folds[0], window_ms)
        return replace(advice, facts=advice.after(study.folds[0].ratings[advice.approach][window_ms].overall))
    crps = {name: crps_g(study, name, window_ms) for name in by_preference(study.config.approaches)}
    best = min(crps.values(), key=lambda values: float(values.mean()))
    excess = {name: values - best for name, values in crps.items()}
    # the best and all within a standard error of it, the preferred one first
    name, *equal = [name for name, e in excess.items() if e.mean() <= e.std(ddof=1) / np.sqrt(n)]
    ties: Mapping[str, object] = {}
    if equal:
        means = {w: [study.mean_rating(other, w) for other in (name, *equal)] for w in study.config.windows_ms}
        worst = [min(fold.ratings[other][window_ms].overall for fold in study.folds) for other in (name, *equal)]
        ties = _ties((name, *equal), means, worst, n)
    crps_of = {other: float(values.mean()) for other, values in crps.items()}
    by_use = sorted(crps_of.items(), key=lambda scored: scored[0] != name)
    distances = [Sentence("{} {}", CLASSES[own].in_words, Quantity((g,), "g", ".2f")) for own, g in by_use]
    method = f"{CLASSES[name].in_words} {'away from tested speeds' if grouped else 'for this campaign'}"
    distance = {"crps_g": crps_of, "window_ms": window_ms, "n": n, "distances": joined(distances, ", ")}
    facts = [_use(name, method, ties), _rated("recommendation.ratings", study, name, window_ms)]
    if (groups := study.speed_groups) is not None:
        facts.append(_rated(SPEED_GROUPS, groups, name, window_ms))
    if name in study.coverage:
        coverage = study.coverage[name]
        shown = {"inside": coverage.share("accel"), "n": len(coverage.tests)}
        shown |= {part: coverage.count(part) for part in ("crush", "peak")}
        facts.append(Fact("recommendation.coverage", {"coverage": coverage.counts, **shown}))
    facts.append(Fact("recommendation.distance", distance))
    decays = [bool(own.state.get("decay_over_speed")) for fold in study.folds for own in fold.estimates]
    if any(decays):
        facts.append(Fact("recommendation.falls_back", {"fits": sum(decays), "n": len(study.folds)}))
    return Recommendation(name, tuple(facts), ties=ties)


def recommend_without(study: Study, fold: Fold, window_ms: float) -> Recommendation:
    """The recommendation for a held-out test, made without it."""
    rest = study.config.training_campaign(study.campaign, fold.held_out)
    return recommend_for(fold.estimates, rest, fold.test.condition, window_ms)


def crps_g(study: Study, approach: str, window_ms: float) -> FloatArray:
    """CRPS of an approach's predictions of the tests, in g, shape (n_tests,)."""
    rated = slice(0, round(window_ms / 1e3 / DT_S), STRIDE)
    scores = []
    for fold in study.folds:
        prediction = fold.estimate(approach)
        draws = prediction.accel_mps2[None] if prediction.draws_mps2 is None else prediction.draws_mps2
        scores.append(Scores.of(fold.test.pulse.accel_mps2[rated], [draws[:, rated]]).crps(np.ones(1)))
    return np.array(scores) / G


def _rated(code: str, study: Study, name: str, window_ms: float) -> Fact:
    overall = {fold.held_out: fold.ratings[name][window_ms].overall for fold in study.folds}
    mean, worst = float(np.mean(list(overall.values()))), min(overall, key=lambda test: overall[test])
    values: dict[str, object] = {
        "mean_rating": mean,
        "grade": grade(mean),
        "worst_rating": overall[worst],
        "worst_test": worst,
        "speed_mps": study.campaign.test(worst).condition.speed_mps,
        "way": "with its speed group" if study.config.leave_out == "speed group" else "alone",
    }
    if name != BASELINE and BASELINE in study.config.approaches:
        raw = {fold.held_out: fold.ratings[BASELINE][window_ms].overall for fold in study.folds}
        harm = {test: round(raw[test], 3) - round(rating, 3) for test, rating in overall.items()}
        values["raw_rating"] = float(np.mean(list(raw.values())))
        values |= {"raw_better_in": [test for test in harm if harm[test] > 0], "raw_better_by": max(harm.values())}
    return Fact(code, values)
