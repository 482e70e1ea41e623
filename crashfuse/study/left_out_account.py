"""Account of a left-out test: what was expected of its prediction, what came out, and what sets the test apart."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

from crashfuse.approaches.calibration import Coverage
from crashfuse.approaches.registry import CLASSES
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import one_of, require_a, require_number
from crashfuse.execution.cache import Cache
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import grade, rate_windows
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import find_estimate
from crashfuse.study.expected_rating import ExpectedRating, expected_rating
from crashfuse.study.facts import Fact, campaign_facts, departure_fact, distinct, window_facts
from crashfuse.study.outliers import LEAST, Departure, departure
from crashfuse.study.recommendation import recommend, recommend_for
from crashfuse.study.study import Fold, Study
from crashfuse.wording import Sentence, joined, speed

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
    cache: Cache | None = None,
) -> Account:
    """Account of an approach's prediction of a left-out test, by default the approach recommended without its pulse.

    The rating ``without_neighbours`` is by default looked up in the cache.
    """
    cache, test = cache or Cache(), fold.test
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
        if (alone := find_estimate(rest, test.condition, approach, config, cache)) is not None:
            pulse = Pulse(GRID_S, alone.prediction.accel_mps2)
            without_neighbours = rate_windows(test.pulse, pulse, [window_ms])[float(window_ms)].overall
    apart = None
    if neighbours >= LEAST:
        apart = departure(campaign, test.id, CaeModel(cache=cache).fit(campaign.cae), window_ms)
    rating, expected = fold.ratings[approach][window_ms].overall, expected_rating(estimate, others, window_ms)
    inside, group = None if draws is None else Coverage.of(test, draws).accel, (neighbours, apart, without_neighbours)
    return Account(test, approach, rating, window_ms, expected, *group, inside, with_group)


def worst_test(
    study: Study, window_ms: float | None = None, *, approach: str | None = None, cache: Cache | None = None
) -> Account:
    """Account of the test that an approach, by default the recommended one, predicted worst over the longest window.

    The cache holds the CAE model and, if it was ever made, the prediction without the neighbours.
    """
    require_a(Study, study, "crashfuse.run_study(campaign)")
    window = max(study.config.windows_ms) if window_ms is None else window_ms
    require_number("window_ms", window)
    approach = recommend(study).approach if approach is None else approach
    one_of("approach of this study", approach, dict.fromkeys(study.config.approaches))
    known = _worst.setdefault(study, {})  # requested by files, report, and terminal or page
    if (window, approach) not in known:
        fold = min(study.folds, key=lambda fold: fold.ratings[approach][window].overall)
        groups = () if study.speed_groups is None else study.speed_groups.folds
        # there is none while a study is running
        apart = next(
            (group.ratings[approach][window].overall for group in groups if group.held_out == fold.held_out), None
        )
        config = study.config.split_configs[0]
        known[window, approach] = account(
            study.campaign, config, fold, window, approach=approach, without_neighbours=apart, cache=cache
        )
    return known[window, approach]


_worst: WeakKeyDictionary[Study, dict[tuple[float, str], Account]] = WeakKeyDictionary()


def study_facts(study: Study) -> tuple[Fact, ...]:
    """Facts of a study: of its campaign, the recommendation, and the test that was predicted worst; none twice."""
    return distinct([*campaign_facts(study.campaign), *recommend(study).facts, *worst_test(study).facts])
