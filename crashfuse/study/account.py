"""Account of a left-out test: what was expected of its prediction, what came out, and what sets the test apart."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

from crashfuse.approaches.calibration import Coverage
from crashfuse.approaches.registry import CLASSES
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import one_of, require_a
from crashfuse.execution.cache import Cache
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.signals.rating import grade, rate_windows
from crashfuse.study.config import StudyConfig
from crashfuse.study.departure import LEAST, Departure, departure
from crashfuse.study.estimate import find_estimate
from crashfuse.study.expected_rating import ExpectedRating, expected_rating
from crashfuse.study.recommendation import recommend, recommend_for
from crashfuse.study.study import Fold, Study
from crashfuse.wording import Sentence, joined, speed

_CHANGED = 0.02  # in rating: less is no difference


@dataclass(frozen=True, eq=False)
class Account:
    """What became of the prediction of a left-out test.

    Attributes
    ----------
    approach : str
        The approach whose prediction it is.
    rating : float
        Its overall rating.
    window_ms : float
        The rating is over [0, window_ms).
    expected : ExpectedRating, optional
        What was expected of it before the test was known; None if that was not asked.
    neighbours : int
        Number of other tests at about its speed.
    departure : Departure, optional
        How the test differs from these, if they are enough to tell.
    without_neighbours : float, optional
        The rating of the same approach if these are left out as well, where it is known.
    inside : float, optional
        Share of a(t) up to the time of zero velocity inside the 95 % band, if there is one.
    with_group : bool
        Whether the other tests at about its speed were left out with it.
    """

    test: CrashTest
    approach: str
    rating: float
    window_ms: float
    expected: ExpectedRating | None
    neighbours: int
    departure: Departure | None
    without_neighbours: float | None
    inside: float | None
    with_group: bool

    def __repr__(self) -> str:
        return f"<Account of {self.test.id}: {self.outcome}>"

    @property
    def outcome(self) -> str:
        """A sentence on how the expectation came out."""
        if self.expected is None:
            return f"{CLASSES[self.approach].label} came out {self.rating:.3f} ({grade(self.rating)})."
        return self.expected.outcome(self.rating)

    @property
    def disappoints(self) -> bool:
        """Whether it came out below what was expected."""
        return self.expected is not None and self.expected.is_missed_by(self.rating)

    @property
    def sentences(self) -> tuple[str, ...]:
        """How the expectation came out, and what the measurements say about the test itself."""
        test, few = self.test, "it takes three to tell whether a test stands apart."
        outcome = self.outcome.replace("Expected", "expected", 1)
        way = ", left out with all at about its speed" if self.with_group and self.neighbours else ""
        over = f"{way}, over 0–{self.window_ms:g} ms"
        said: list[str] = [Sentence("{}, {}{}: {}", test.id, speed(test.condition.speed_mps), over, outcome)]
        if test.faults:
            said.append(Sentence("Its record is in doubt: {}.", joined([fault.text for fault in test.faults], "; ")))
        if self.departure is not None:
            said += [self.departure.sentence, self.departure.evidence]
        elif self.neighbours:
            there = "is 1 other test" if self.neighbours == 1 else f"are {self.neighbours} other tests"
            said.append(f"There {there} at about its speed; {few}")
        else:
            said.append(f"There is no other test at about its speed; {few}")
        if self.without_neighbours is not None:
            told = f"It is rated {self.without_neighbours:.3f} without its neighbours and {self.rating:.3f} with them"
            gained = self.without_neighbours > self.rating + _CHANGED
            said.append(f"{told}{': what they teach does not hold for it' if gained else ''}.")
        if self.inside is not None:
            said.append(f"{100 * self.inside:.0f} % of its a(t) up to TTZV lies inside the band that should hold 95 %.")
        return tuple(said)


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
    """Account of an approach's prediction of a left-out test.

    Parameters
    ----------
    campaign : Campaign
        The whole campaign, the test among the others.
    config : StudyConfig
        Of the fold.
    window_ms : float
        The rating is over [0, window_ms).
    approach : str, optional
        By default the one that was recommended for this test before it was known.
    without_neighbours : float, optional
        Its rating if the tests at about its speed are left out as well, if it is known.
    cache : Cache, optional
        Where the CAE model and, if it was ever made, the prediction without the neighbours are found.
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
        without_neighbours = _without_neighbours(campaign, config, fold, approach, window_ms, cache)
    apart = None
    if neighbours >= LEAST:
        apart = departure(campaign, test.id, CaeModel(cache=cache).fit(campaign.cae), window_ms)
    return Account(
        test,
        approach,
        fold.ratings[approach][window_ms].overall,
        window_ms,
        expected_rating(estimate, others, window_ms),
        neighbours,
        apart,
        without_neighbours,
        None if draws is None else Coverage.of(test, draws).accel,
        with_group,
    )


def worst_test(
    study: Study, window_ms: float | None = None, *, approach: str | None = None, cache: Cache | None = None
) -> Account:
    """Account of the test that an approach predicted worst.

    Parameters
    ----------
    window_ms : float, optional
        The rating is over [0, window_ms); by default the longest window of the study.
    approach : str, optional
        By default the one that the study recommends for the campaign.
    cache : Cache, optional
        As for :func:`account`.
    """
    require_a(Study, study, "crashfuse.run_study(campaign)")
    window = max(study.config.windows_ms) if window_ms is None else window_ms
    chosen = recommend(study).approach if approach is None else approach
    one_of("approach of this study", chosen, dict.fromkeys(study.config.approaches))
    known = _worst.setdefault(study, {})  # requested by files, report, and terminal or page
    if (window, chosen) not in known:
        known[window, chosen] = _worst_test(study, window, chosen, cache)
    return known[window, chosen]


_worst: WeakKeyDictionary[Study, dict[tuple[float, str], Account]] = WeakKeyDictionary()


def _worst_test(study: Study, window: float, chosen: str, cache: Cache | None) -> Account:
    fold = min(study.folds, key=lambda fold: fold.ratings[chosen][window].overall)
    groups = () if study.speed_groups is None else study.speed_groups.folds
    group = next((each for each in groups if each.held_out == fold.held_out), None)  # none while a study is running
    known = None if group is None else group.ratings[chosen][window].overall
    config = study.config.split_configs[0]
    return account(study.campaign, config, fold, window, approach=chosen, without_neighbours=known, cache=cache)


def _without_neighbours(
    campaign: Campaign, config: StudyConfig, fold: Fold, approach: str, window_ms: float, cache: Cache
) -> float | None:
    """Rating of the prediction without all tests at about its speed, if it was ever made with these settings."""
    test, rest = fold.test, campaign.without(campaign.speed_group(fold.held_out))
    found = find_estimate(rest, test.condition, approach, config, cache)
    if found is None:
        return None
    pulse = Pulse(GRID_S, found.prediction.accel_mps2)
    return rate_windows(test.pulse, pulse, [window_ms])[float(window_ms)].overall
