"""A verdict follows from the probability and the confidence, and says why."""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, fields, replace

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtr, ndtri

from crashfuse.approaches.metric_calibration import Distribution
from crashfuse.campaign import Campaign
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.domain import Domain
from crashfuse.certification.forecasts import Forecast
from crashfuse.certification.verdict import Verdict, all_met, judge, with_decided
from crashfuse.condition import Condition
from crashfuse.results.planning import curve_table
from crashfuse.study.config import StudyConfig
from crashfuse.study.expected_rating import RatingDistribution
from crashfuse.study.learning_curve import LearningCurve
from crashfuse.study.one_more_test import sentences, summary
from crashfuse.units import MPH_LB, UnitSystem, said
from tests.conftest import not_none

FREE = 1e9  # degrees of freedom: as good as the normal


def by_seed(
    values: Mapping[str, float | None],
    distributions: Mapping[str, Distribution | None],
    folds: Sequence[Distribution] = (),
    apart_share: float = 0.0,
) -> Forecast:
    """A forecast by one seed, without draws; folds are of the first quantity."""
    unknown = (np.nan,) * len(fields(Distribution))
    rows = [unknown if own is None else astuple(own) for own in distributions.values()]
    by_fold = [[astuple(own), *[unknown] * (len(rows) - 1)] for own in folds] or np.full((2, *np.shape(rows)), np.nan)
    return Forecast(
        names=tuple(distributions),
        accel_mps2=np.zeros((1, 1250)),
        values=np.array([[values[name] for name in distributions]], dtype=np.float64),
        distributions=np.array([rows]),
        ranks=np.empty((1, 0, 0)),
        whole_mps2=np.empty((1, 0, 1250)),
        folds=np.array([by_fold]),
        apart_share=np.array([apart_share]),
    )


def verdict(campaign: Campaign, criterion: Criterion, *, outside: bool = False, tests: tuple[str, ...] = ()) -> Verdict:
    """The verdict on one criterion where 500 ± 10 mm of crush and a rating of 0.90, rarely below 0.82, are forecast."""
    crush, rating = Distribution(500.0, 10.0, FREE), RatingDistribution(-np.log(0.1), 0.3, FREE)
    values = {"max_crush": 498.0, "rating 60": 0.9, "olc": None}
    forecast = by_seed(values, {"max_crush": crush, "rating 60": rating, "olc": None})
    here = campaign.tests[1].condition
    if outside:
        here = Condition.of_vector([3 * here.speed_mps, here.front_weight_kg, here.rear_weight_kg])
    [found] = judge(forecast, here, Criteria((criterion,), 0.95), Domain.of(campaign).exceeded_by(here), tests)
    return found


@pytest.mark.parametrize(("at_most", "word"), [(516.5, "met"), (516.3, "open"), (483.7, "open"), (483.5, "not met")])
def test_the_word_changes_where_probability_crosses_confidence(campaign: Campaign, at_most: float, word: str) -> None:
    """1.645 standard deviations from the limit on either side."""
    assert verdict(campaign, Criterion("crush", "max_crush", at_most=at_most)).word == word


def test_what_rests_on_the_peak_is_outside_where_no_test_shows_it(campaign: Campaign) -> None:
    """What is integrated over the crash is judged as ever."""
    names = ("peak", "rating 60", "max_crush", "sm25")
    distributions: dict[str, Distribution | None] = dict.fromkeys(names, Distribution(1.0, 0.1, FREE))
    forecast = by_seed(dict.fromkeys(names, 1.0), distributions)
    limits = [Criterion(n, n.split()[0], at_most=2.0, window_ms=60 * ("rating" in n) or None) for n in names]
    verdicts = judge(forecast, campaign.tests[1].condition, Criteria(tuple(limits), 0.95), unshown=("Faster.",))
    assert [verdict.word for verdict in verdicts] == ["outside", "outside", "met", "met"]
    assert verdicts[0].reason == "Faster."


@pytest.mark.parametrize(("off", "word"), [(0.0, "met"), (0.02, "met"), (0.05, "open")])
def test_the_error_by_the_seed_counts_against_a_verdict(campaign: Campaign, off: float, word: str) -> None:
    """Four seeds scatter as eight would of which four had the usual spread; two standard errors count."""
    limit, parts, centres = Criterion("crush", "max_crush", at_most=500.0), [], []
    for chance in (0.975 - off, 0.975, 0.975, 0.975 + off * 0.4):
        centre = 500.0 - 10 * float(ndtri(chance))
        centres.append(centre)
        parts.append(by_seed({"max_crush": centre}, {"max_crush": Distribution(centre, 10.0, FREE)}))
    [found] = judge(Forecast.mean(parts), campaign.tests[1].condition, Criteria((limit,), 0.95))
    chances = np.array(found.chances)
    usual = 0.5 * chances.mean() * (1 - chances.mean())
    assert found.probability == pytest.approx(chances.mean())
    assert found.error == pytest.approx(np.sqrt((4 * usual**2 + 3 * chances.var(ddof=1)) / 7 / 4))
    assert found.word == word
    mean, lower = not_none(found.value), not_none(found.lower)
    below = [np.mean([ndtr((x - centre) / 10) for centre in centres]) for x in (mean, lower)]
    assert below == pytest.approx([0.5, 0.025], abs=1e-6)


def test_where_tests_fold_in_two_ways_the_probability_weighs_both(campaign: Campaign) -> None:
    """Crush of 500 mm in seven of ten draws, 540 mm in three; kept in the cache and found again."""
    ways = [Distribution(crush, 1.0, FREE) for crush in (500.0, 540.0)]
    forecast = by_seed({"max_crush": 505.0}, {"max_crush": Distribution(512.0, 20.0, FREE)}, ways, 0.3)
    limit = Criterion("crush", "max_crush", at_most=520.0)
    for own in (forecast, Forecast.restored(forecast.entry)):
        [found] = judge(own, campaign.tests[1].condition, Criteria((limit,), 0.95), ())
        assert found.folds == pytest.approx((1.0, 0.0))
        assert found.probability == pytest.approx(0.7)
        assert found.word == "open"


@pytest.mark.parametrize(
    ("limits", "outside", "word", "probability", "told"),
    [
        ({"at_most": 516.42}, False, "open", 0.9497, "met with probability 0.9497 only"),  # not 0.950
        ({"at_least": 490.0, "at_most": 510.0}, False, "open", 0.6827, "at least 490 mm and at most 510 mm"),
        ({"at_most": 900.0}, True, "outside", 1.0, "above the fastest test"),
    ],
)
def test_the_probability_that_a_verdict_rests_on_is_told(
    campaign: Campaign, limits: dict[str, float], outside: bool, word: str, probability: float, told: str
) -> None:
    """Never shown to reach a confidence that it does not; of lying between two limits; outside, it decides nothing."""
    found = verdict(campaign, Criterion("crush", "max_crush", **limits), outside=outside)
    assert (found.word, found.decided) == (word, False)
    assert found.probability == pytest.approx(probability, abs=5e-5)
    assert told in found.reason


@pytest.mark.parametrize(("second", "inside"), [(0.08, "least"), (0.0, "most"), (0.04, "between")])
def test_the_probability_that_all_are_met_is_between_bounds(campaign: Campaign, second: float, inside: str) -> None:
    """Risks of 5 and 2 % that never come together add up; that comes together, the larger one is all; else between."""
    chance = np.linspace(0, 1, 10_000, endpoint=False)
    missed = [(chance < 0.05), (chance >= second) & (chance < second + 0.02)]
    found = verdict(campaign, Criterion("crush", "max_crush", at_most=510.0))
    met = [replace(found, probability=1 - float(own.mean()), drawn=~own) for own in missed]
    low, probability, high, _ = all_met(met)
    assert (low, high) == pytest.approx((0.93, 0.95))
    both = 1 - float((missed[0] | missed[1]).mean())
    assert probability == pytest.approx(both, abs=1e-4)
    ends = {"least": low, "most": high}
    assert both == pytest.approx(ends[inside]) if inside in ends else low < both < high
    assert all_met([met[0], replace(met[1], drawn=met[1].drawn[:0])]).probability == pytest.approx(low), "no draws"
    few = all_met([replace(own, drawn=own.drawn[5000:5020]) for own in met]).probability
    assert few == pytest.approx(min((20 + 20 * 0.95 * 0.98) / 40, high)), "few draws say little"
    assert all_met([replace(found, probability=0.2)] * 3)[:3] == (0.0, 0.0, 0.2)


def test_the_reason_gives_value_interval_limit_and_probability(campaign: Campaign) -> None:
    """As a sentence, in the metric's unit."""
    found = verdict(campaign, Criterion("crush", "max_crush", at_most=510.0))
    assert found.reason == (
        "We expect 498.0 mm (95 % of tests: 480.4 to 519.6 mm); at most 510 mm is met with probability 0.841 only."
    )
    assert (found.value, found.lower, found.upper) == pytest.approx((498.0, 480.4, 519.6), abs=0.01)
    found = verdict(campaign, found.criterion, tests=("T2",))  # what that measured is known: it is on another test
    assert found.word == "open"
    assert found.reason.endswith("at most 510 mm is met by another test with probability 0.841 only.")


def test_an_interval_with_an_open_end_tells_the_other() -> None:
    """As tables of metrics do, in the reader's units; without any end it is a dash."""
    change = Criterion("change", "delta_v", at_most=64.0)
    assert change.compared(61.0, None, 64.75).startswith("We expect 61.00 km/h (95 % of tests: ≤ 64.75 km/h)")
    assert said(change.interval(58.2, None), MPH_LB) == "≥ 36.16 mph"
    assert str(change.interval(None, None)) == "–"
    told = Criterion("crush", "max_crush", at_most=300.0).compared(None, 200.0, 260.0)  # the pulse does not stop
    assert told == "95 % of tests: 200.0 to 260.0 mm, no single value expected (record too short); at most 300 mm"


@pytest.mark.parametrize(
    ("metric", "limit", "said"),
    [
        ("rating", 0.805, "0.805"),
        ("rating", 0.8, "0.80"),
        ("max_crush", 600.45, "600.45 mm"),
        ("esw", 12000.0, "12000 g"),
    ],
)
def test_a_limit_stands_with_all_its_digits(metric: str, limit: float, said: str) -> None:
    """A rating of 0.805 is not one of 0.81."""
    assert Criterion("own", metric, at_most=limit).limits == f"at most {said}"


def test_round_values_keep_their_digits() -> None:
    """A value of 30 g stands as exactly as one of 26.52 g; a limit as it was declared."""
    peak = Criterion("peak", "peak", at_most=40.0)
    assert peak.compared(30.0, 26.52, 36.754).startswith("We expect 30.00 g (95 % of tests: 26.52 to 36.75 g)")
    assert peak.limits == "at most 40 g"
    assert said(peak.shown(120.0), UnitSystem(acceleration="m/s²")) == "1177 m/s²"


def test_a_rating_is_at_most_one(campaign: Campaign) -> None:
    """Its interval ends below."""
    found = verdict(campaign, Criterion("rating", "rating", at_least=0.7, window_ms=60.0))
    assert (found.lower, found.upper) == pytest.approx((0.820, 0.944), abs=1e-3)
    assert found.word == "met"
    assert found.reason.startswith("We expect 0.900 (95 % of tests: 0.820 to 0.944); at least 0.70")


@pytest.mark.parametrize("value", [None, 12.0])
def test_a_record_too_short_leaves_it_open(campaign: Campaign, value: float | None) -> None:
    """For the value itself, or for that of many draws."""
    forecast, olc = by_seed({"olc": value}, {"olc": None}), Criterion("OLC", "olc", at_most=20.0)
    [found] = judge(forecast, campaign.tests[1].condition, Criteria((olc,)))
    assert (found.word, found.value, found.probability) == ("open", value, None)
    assert "OLC" in found.reason


@pytest.mark.parametrize(
    ("at_most", "measured", "word"),
    [(520.0, 515.0, "met"), (520.0, 525.0, "open"), (480.0, 470.0, "open"), (480.0, 485.0, "not met")],
)
def test_a_test_that_was_run_there_stands_beside_the_verdict_and_may_reopen_it(
    campaign: Campaign, at_most: float, measured: float, word: str
) -> None:
    """A verdict that the measured test contradicts is open; the reason names test and value, the probability stays."""
    alone = verdict(campaign, Criterion("crush", "max_crush", at_most=at_most))
    found = alone.beside_tests({"T5": measured, "T6": None})
    assert found.word == word
    assert found.probability == alone.probability
    does = "meets" if measured <= at_most else "misses"
    ran = f"Test T5 was run there: it measured {measured:.1f} mm, which {does} the limit."
    assert found.reason == f"{alone.reason} {ran}"
    assert found.run == {"T5": measured, "T6": None}


CRUSH, PEAK = Criterion("crush", "max_crush", at_most=500.0), Criterion("peak", "peak", at_least=30.0)
RATING = Criterion("rating", "rating", at_least=0.8, window_ms=60.0)
SURE, UNSURE = Distribution(400.0, 10.0, 9.0), Distribution(495.0, 10.0, 9.0)


@pytest.fixture
def curve(campaign: Campaign) -> LearningCurve:
    """Two numbers of tests, two held-out tests each; with more tests the crush is better known."""
    row = {"chosen": "", "choice": "even", "approach": "fused", "window_ms": 60.0, "overall": 0.9, "inside": 0.9}
    rows = [{**row, "n_tests": n, "held_out": f"T{i}", "half_width_g": 2.0} for n in (2, 3) for i in (1, 2)]
    peak = Distribution(20.0, 1.0, 9.0)
    crushes = (UNSURE, None, SURE, UNSURE)
    forecasts = tuple({"max_crush": own, "peak": peak} for own in crushes)
    config = StudyConfig(approaches=("fused",), windows_ms=(60.0,))
    return LearningCurve(campaign, config, 0, pd.DataFrame(rows), forecasts, 1.0)


def test_a_verdict_counts_as_decided_by_its_probability(curve: LearningCurve) -> None:
    """The peak is missed for certain; the crush is decided once; what is not known is not decided."""
    found = with_decided(curve, Criteria((CRUSH, PEAK, RATING)))
    assert found.table["decided"].tolist() == [0.5, 0.5, 1.0, 0.5]
    assert summary(found)["decided"].tolist() == [0.5, 0.75]
    assert curve_table(found).texts()["Decided (%)"].tolist() == ["50", "75"]
    assert "It decides 75 % of the verdicts on metrics." in sentences(found)[0]


def test_ratings_alone_decide_nothing(curve: LearningCurve) -> None:
    """The column is empty then, and no sentence tells of it."""
    found = with_decided(curve, Criteria((RATING,)))
    assert np.isnan(found.table["decided"]).all()
    assert "decides" not in " ".join(sentences(found))
    assert "decided" not in curve.table
