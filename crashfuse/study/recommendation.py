"""Recommendation of an approach, for one prediction or a whole campaign, with reasons that an engineer can check.

A recommendation for one test rests on the other tests alone; only that for a campaign uses the results of left-out
tests, of two at least: one alone cannot tell approaches apart. It is decided by a proper score of the whole band
(CRPS), and explained in ratings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

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
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import grade, rate_windows
from crashfuse.study.config import WINDOWS_MS, StudyConfig
from crashfuse.study.estimate import Estimate, find_estimate
from crashfuse.study.expected_rating import ExpectedRating, expected_rating, mean_near
from crashfuse.study.facts import Fact, campaign_facts, departure_fact, distinct, extrapolation_facts, window_facts
from crashfuse.study.outliers import LEAST, Departure, departure
from crashfuse.study.study import Fold, Study
from crashfuse.units import MPH, G, Quantity, Sentence, joined, read_out, speed

_CHANGED = 0.02  # in rating: less is no difference


@dataclass(frozen=True, eq=False)
class Account:
    """What became of the prediction of a left-out test."""

    test: CrashTest
    approach: str
    rating: float  # overall, over [0, window_ms)
    window_ms: float
    expected: ExpectedRating | None
    neighbours: int  # number of other tests at about its speed
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
        way = ", left out with all at about its speed" if self.with_group and self.neighbours else ""
        where = f"{way}, over 0–{self.window_ms:g} ms"
        outcome = f"{CLASSES[self.approach].label} came out {self.rating:.3f} ({grade(self.rating)})."
        if self.expected is not None:
            outcome = self.expected.outcome(self.rating).replace("Expected", "expected", 1)
        v0 = speed(self.test.condition.speed_mps)
        sentence = Sentence("{}, {}{}: {}", self.test.id, v0, where, outcome)
        values = {"test": self.test.id, "approach": self.approach, "rating": self.rating, "window_ms": self.window_ms}
        return Fact("left_out.outcome", sentence, values=values), *self.about_test

    @property
    def sentences(self) -> tuple[str, ...]:
        """The facts in words."""
        return tuple(fact.sentence for fact in self.facts)

    @property
    def about_test(self) -> tuple[Fact, ...]:
        """What the measurements say about the test itself."""
        facts = []
        if self.test.faults:
            faults = joined([fault.text for fault in self.test.faults], "; ")
            facts.append(Fact("test.in_doubt", Sentence("Its record is in doubt: {}.", faults), "Test in doubt"))
        if self.departure is not None:
            facts += [departure_fact(self.departure), Fact("left_out.evidence", self.departure.evidence)]
        else:
            few = f"Other tests at about its speed: {self.neighbours}"
            text = f"{few}; it takes {LEAST} to tell whether a test stands apart."
            facts.append(Fact("left_out.few_neighbours", text, values={"neighbours": self.neighbours}))
        if (without := self.without_neighbours) is not None:
            compared = f"Rated {without:.3f} without its neighbours, {self.rating:.3f} with them"
            misled = ": they mislead here" if without > self.rating + _CHANGED else ""
            facts.append(Fact("left_out.without_neighbours", f"{compared}{misled}.", values={"rating": without}))
        if self.inside is not None:
            text = f"Inside the 95 % band is {100 * self.inside:.0f} % of its a(t) up to TTZV."
            facts.append(Fact("left_out.inside", text, values={"inside": self.inside}))
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
    neighbours = len(campaign.speed_group(test.id)) - 1
    draws = estimate.prediction.draws_mps2
    with_group = config.leave_out == "speed group"
    if not neighbours or with_group:
        without_neighbours = None
    elif without_neighbours is None:
        rest = campaign.without(campaign.speed_group(test.id))
        if (alone := find_estimate(rest, test.condition, approach, config, run.cache)) is not None:
            pulse = Pulse(GRID_S, alone.prediction.accel_mps2)
            without_neighbours = rate_windows(test.pulse, pulse, [window_ms])[float(window_ms)].overall
    apart = None
    if neighbours >= LEAST:
        apart = departure(campaign, test.id, CaeModel().fit(campaign.cae, run), window_ms)
    rating, expected = fold.ratings[approach][window_ms].overall, expected_rating(estimate, others, window_ms)
    inside, group = None if draws is None else Coverage.of(test, draws).accel, (neighbours, apart, without_neighbours)
    return Account(test, approach, rating, window_ms, expected, *group, inside, with_group)


def worst_test(study: Study, window_ms: float | None = None, *, approach: str | None = None) -> Account:
    """Account of the test that an approach, by default the recommended one, predicted worst over the longest window."""
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
    """Facts of a study: of its campaign, the recommendation, and the test that was predicted worst; none twice."""
    return distinct([*campaign_facts(study.campaign), *recommend(study).facts, *worst_test(study).facts])


_CLEARLY = 0.02  # in rating: a handful of tests cannot separate approaches closer than this
_TOLD = 0.005  # in rating: less is not worth a word
_NEAR_MPS = 3 * MPH
_GOOD = 0.80
_FARTHER = (
    "The condition is farther in speed from all tests than any of these was from the others: see the width of the band."
)
SPEED_GROUPS = "recommendation.speed_groups"  # the one fact that rests on other folds than the study's own
_BASIS = "Here tests are left out of this one fit; a study fits anew without each."


@dataclass(frozen=True, slots=True)
class Recommendation:
    """A recommended approach, with reasons."""

    approach: str
    facts: tuple[Fact, ...]  # the recommendation, what to expect of it, its basis, and cautions
    expected: ExpectedRating | None = None  # of that approach, for a single prediction
    undecided: str = ""  # from which approaches the tests cannot tell it, and what prefers one of these

    @property
    def sentences(self) -> tuple[str, ...]:
        """The facts in words."""
        return tuple(fact.sentence for fact in self.facts)

    def __repr__(self) -> str:
        return f"<Recommendation: {self.sentences[0]}>"

    def after(self, rating: float) -> tuple[Fact, ...]:
        """The facts once the test is known: how the expectation came out comes first."""
        if self.expected is None:
            return self.facts
        use = f"Recommended was {CLASSES[self.approach].in_words}{self.undecided}. {self.expected.outcome(rating)}"
        values = {"approach": self.approach, "rating": rating}
        return Fact("recommendation.outcome", use, values=values), *self.facts[1:]


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
    name, best, undecided = equal[0], expected[equal[0]], ""
    if len(equal) > 1:
        means = {w: [mean_near(by_name[other], campaign, best.tests, w) for other in equal] for w in WINDOWS_MS}
        undecided = _undecided(equal, means, [expected[other].lowest for other in equal], len(best.tests))
    facts = [_use(name, f"{undecided}."), Fact("recommendation.expected", best.sentence, values=asdict(best))]
    if best.farther:
        facts.append(Fact("recommendation.farther", _FARTHER))
    if name != BASELINE and BASELINE in expected:
        raw = expected[BASELINE].mean
        worse = " No better is to be expected here." * (best.mean <= raw)
        text = f"The raw CAE model rated {raw:.2f} on the same tests.{worse}"
        facts.append(Fact("recommendation.raw_cae", text, values={"mean_rating": raw}))
    if CLASSES[name].made_of:
        facts.append(Fact("recommendation.mixture", by_name[name].prediction.notes[0]))
    if best.median <= _GOOD:
        likely = "to be expected" if best.upper <= _GOOD else "likely"
        text = f"Less than {grade(_GOOD + 1e-9)} is {likely}: a guide, not a proof."
        facts.append(Fact("recommendation.poor", text))
    facts.append(Fact("recommendation.basis", _BASIS))
    return Recommendation(name, (*facts, *extrapolation_facts(campaign, condition)), best, undecided)


def _use(approach: str, why: str) -> Fact:
    text = Sentence("Use {}{}", CLASSES[approach].in_words, why)
    return Fact("recommendation.use", text, values={"approach": approach})


def _undecided(
    equal: Sequence[str], means: Mapping[float, Sequence[float]], lowest: Sequence[float], n_tests: int
) -> str:
    told = [read_out([CLASSES[other].in_words for other in equal[1:]])]
    for what, ratings in {**{f"0–{w:g} ms": of_all for w, of_all in means.items()}, "the worst test": lowest}.items():
        higher, lower = max(ratings), ratings[0]
        if higher - lower >= _TOLD:
            best = equal[ratings.index(higher)]
            told.append(f"{what} prefers {CLASSES[best].in_words} ({higher:.3f} for {lower:.3f})")
    return f": {n_tests} left-out tests cannot tell it from {'; '.join(told)}"


def _by_the_paper(names: Sequence[str], campaign: Campaign, condition: Condition) -> Recommendation:
    away = min(abs(test.condition.speed_mps - condition.speed_mps) for test in campaign.tests)
    is_beside = AboutTimeDomain.name in names and away <= _NEAR_MPS
    name = AboutTimeDomain.name if is_beside else names[0]
    trusted = "the paper (Sect. 4.3) trusts the time domain beside a test, else the displacement domain"
    reason = Sentence(f": the nearest test is {{}} away, and {trusted}.", speed(away))
    why = "there is only one test" if len(campaign.tests) == 1 else "no test was left out under these settings"
    unknown = Fact("recommendation.expected", f"What rating to expect is not known: {why}.")
    return Recommendation(name, (_use(name, reason), unknown, *extrapolation_facts(campaign, condition)))


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
        rating = study.folds[0].ratings[advice.approach][window_ms].overall
        return replace(advice, facts=advice.after(rating))
    crps = {name: crps_g(study, name, window_ms) for name in by_preference(study.config.approaches)}
    best = min(crps.values(), key=lambda values: float(values.mean()))
    excess = {name: values - best for name, values in crps.items()}
    # the best and all within a standard error of it, the preferred one first
    name, *equal = [name for name, e in excess.items() if e.mean() <= e.std(ddof=1) / np.sqrt(n)]
    undecided = ""
    if equal:
        means = {w: [study.mean_rating(other, w) for other in (name, *equal)] for w in study.config.windows_ms}
        worst = [min(fold.ratings[other][window_ms].overall for fold in study.folds) for other in (name, *equal)]
        undecided = _undecided((name, *equal), means, worst, n)
    shown = {other: Quantity((float(values.mean()),), "g", ".2f") for other, values in crps.items()}
    others = [Sentence("{} {}", CLASSES[other].in_words, value) for other, value in shown.items() if other != name]
    distance = Sentence(
        f"Over 0–{window_ms:g} ms, on {n} left-out tests, its mean distance from what was measured (CRPS, less is "
        "better) is {}.",
        joined([Sentence("{}", shown[name]), *filter(None, [joined(others, ", ")])], "; "),
    )
    facts = [
        _use(name, f" {'away from tested speeds' if grouped else 'for this campaign'}{undecided}."),
        Fact("recommendation.distance", distance, values={"crps_g": {o: float(v.mean()) for o, v in crps.items()}}),
        _rated("recommendation.ratings", study, name, window_ms),
    ]
    if name in study.coverage:
        coverage = study.coverage[name]
        n = len(coverage.tests)
        text = (
            f"95 % model band: {100 * coverage.share('accel'):.0f} % of a(t) up to zero velocity (TTZV) inside, crush "
            f"in {coverage.count('crush')} of {n} left-out tests, peak in {coverage.count('peak')}."
        )
        facts.append(Fact("recommendation.coverage", text, values={"coverage": coverage.counts}))
    if (groups := study.speed_groups) is not None:
        facts.append(_rated(SPEED_GROUPS, groups, name, window_ms))
    decays = [bool(own.state.get("decay_over_speed")) for fold in study.folds for own in fold.estimates]
    if any(decays):
        fits = f"in {sum(decays)} of {len(study.folds)} fits"
        text = f"Away from tested speeds the displacement domain falls back towards the raw CAE model, {fits}."
        facts.append(Fact("recommendation.falls_back", text, values={"fits": sum(decays)}))
    return Recommendation(name, tuple(facts), undecided=undecided)


def recommend_without(study: Study, fold: Fold, window_ms: float) -> Recommendation:
    """The recommendation for a held-out test, made without it."""
    rest = study.config.training_campaign(study.campaign, fold.held_out)
    return recommend_for(fold.estimates, rest, fold.test.condition, window_ms)


def crps_g(study: Study, approach: str, window_ms: float) -> FloatArray:
    """CRPS of an approach's predictions of the tests, in g, shape (n_tests,)."""
    rated = slice(0, round(window_ms / 1e3 / DT_S), STRIDE)
    scores = []
    for fold in study.folds:
        prediction = fold.estimate(approach).prediction
        draws = prediction.accel_mps2[None] if prediction.draws_mps2 is None else prediction.draws_mps2
        scores.append(Scores.of(fold.test.pulse.accel_mps2[rated], [draws[:, rated]]).crps(np.ones(1)))
    return np.array(scores) / G


def _rated(code: str, study: Study, name: str, window_ms: float) -> Fact:
    overall = {fold.held_out: fold.ratings[name][window_ms].overall for fold in study.folds}
    mean, worst = float(np.mean(list(overall.values()))), min(overall, key=lambda test: overall[test])
    v0 = speed(study.campaign.test(worst).condition.speed_mps)
    values: dict[str, object] = {"mean_rating": mean, "worst_rating": overall[worst], "worst_test": worst}
    way = "Without tests of about the same speed: mean" if study.config.leave_out == "speed group" else "Mean"
    rated = Sentence(f"{way} rating {mean:.3f} ({grade(mean)}), worst {overall[worst]:.3f} ({{}}, {{}})", worst, v0)
    if name == BASELINE or BASELINE not in study.config.approaches:
        return Fact(code, joined([rated, "."], ""), values=values)
    raw = {fold.held_out: fold.ratings[BASELINE][window_ms].overall for fold in study.folds}
    harm = {test: round(raw[test], 3) - round(rating, 3) for test, rating in overall.items()}
    below = [test for test in harm if harm[test] > 0]
    most = f"by up to {max(harm.values()):.3f}"
    compared = f"better than this in {', '.join(below)} ({most})" if below else "better in no test"
    text = Sentence(f"{{}}; the raw CAE model {np.mean(list(raw.values())):.3f}, {{}}.", rated, compared)
    return Fact(code, text, values=values)
