"""Recommendations follow from left-out tests, and say so."""

import gc
import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.execution import cache
from crashfuse.execution.cache import Cache
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, store_estimate
from crashfuse.study.expected_rating import expected_rating, mean_near
from crashfuse.study.recommendation import SPEED_GROUPS, Recommendation, account, recommend, recommend_for, worst_test
from crashfuse.study.study import Fold, Study
from crashfuse.units import MPH, G
from tests.conftest import not_none


def estimate(approach: str, campaign: Campaign, test: CrashTest, scale: float, spread: float = 0.0) -> Estimate:
    """An approach that is always off by a factor, with a band of a relative width."""
    accel = scale * test.pulse.accel_mps2
    draws = None if spread == 0 else accel * (1 + spread * np.linspace(-1, 1, 41)[:, None])
    left_out: dict[str, FloatArray] = {other.id: scale * other.pulse.accel_mps2 for other in campaign.tests}
    notes = ("Made of 60 % time domain, 40 % raw CAE.",) if approach == "fused" else ()
    return Estimate(test.condition, accel, draws, notes, approach=approach, left_out_mps2=left_out)


def study(campaign: Campaign, scales: dict[str, float]) -> Study:
    """A study in which each approach is off by its factor in every test."""
    config = StudyConfig(approaches=tuple(scales))
    folds = []
    for number, test in enumerate(campaign.tests):
        off = {name: scale + 0.001 * number for name, scale in scales.items()}
        own = [estimate(name, campaign, test, off[name], 0.0 if name == "cae" else 0.05) for name in scales]
        folds.append(Fold.of(test, own, config.windows_ms))
    return Study(campaign, config, tuple(folds))


@pytest.mark.parametrize(
    ("scales", "chosen"),
    [
        ({"cae": 0.5, "time_domain": 0.99, "displacement_domain": 0.8}, "time_domain"),
        ({"cae": 0.5, "time_domain": 1.0, "displacement_domain": 1.0, "fused": 0.999}, "fused"),
        ({"cae": 0.9, "displacement_domain": 0.4}, "cae"),
        ({"cae": 0.5, "lf_tcn": 0.9}, "lf_tcn"),
    ],
)
def test_what_predicted_near_tests_best_is_advised(campaign: Campaign, scales: dict[str, float], chosen: str) -> None:
    """A hundredth of the rating is no difference: then the mixture is, with its reason. None need learn from tests."""
    rest, test = campaign.without(["T2"]), campaign.test("T2")
    found = recommend_for([estimate(name, rest, test, s) for name, s in scales.items()], rest, test.condition)
    assert found.approach == chosen
    assert found.expected is not None
    assert ("Made of 60 % time domain, 40 % raw CAE." in found.sentences) == (chosen == "fused")


def test_a_campaign_gets_the_approach_with_the_least_crps(campaign: Campaign) -> None:
    """Nearly right with a narrow band is nearer to what was measured than any other."""
    found = recommend(study(campaign, {"cae": 0.6, "time_domain": 0.8, "displacement_domain": 0.97}))
    assert found.approach == "displacement_domain"


def test_harm_against_the_raw_model_is_named_with_its_test(campaign: Campaign) -> None:
    """Whoever recommends must say where it was worse."""
    spoiled = study(campaign, {"cae": 0.9, "displacement_domain": 0.97})
    first = campaign.tests[0]
    pair = [estimate("cae", campaign, first, 0.99), estimate("displacement_domain", campaign, first, 0.7, 0.05)]
    bad = Fold.of(first, pair, spoiled.config.windows_ms)
    text = " ".join(recommend(replace(spoiled, folds=(bad, *spoiled.folds[1:]))).sentences)
    shown = [round(bad.ratings[name][60.0].overall, 3) for name in ("cae", "displacement_domain")]
    harm = shown[0] - shown[1]
    assert f"In T1 the raw model is better, by up to {harm:.3f}." in text


def test_a_correction_that_ceases_away_from_tests_is_named(campaign: Campaign) -> None:
    """With the number of fits in which it does; where it carries over to all speeds, nothing is."""
    whole = study(campaign, {"displacement_domain": 0.97})
    first, *others = whole.folds
    less = replace(first, estimates=(replace(first.estimates[0], state={"decay_over_speed": 0.5}),))
    last = [recommend(replace(whole, folds=(fold, *others))).sentences[-1] for fold in (first, less)]
    assert ["In 1 of 4 fits the displacement domain falls back" in sentence for sentence in last] == [False, True]


def test_of_a_single_test_no_rating_is_expected(campaign: Campaign) -> None:
    """Nothing was left out, so nothing is known: the paper's advice decides, and a mixture is not taken."""
    single, other = campaign.without(["T1", "T2", "T3"]), campaign.test("T1")
    estimates = [estimate(name, single, other, 0.9, 0.05) for name in ("fused", "displacement_domain", "time_domain")]
    found = recommend_for(estimates, single, other.condition)
    assert (found.approach, found.expected) == ("displacement_domain", None)
    assert recommend_for(estimates, single, single.tests[0].condition).approach == "time_domain"
    two = campaign.without(["T2", "T3"])  # each of which tells about the other
    assert recommend_for([estimate("fused", two, other, 0.9, 0.05)], two, other.condition).expected is not None


def off_by(approach: str, test: CrashTest, offset_g: float) -> Estimate:
    """A pulse without a band that is everywhere this far from the test, so its CRPS is just that."""
    return Estimate(test.condition, test.pulse.accel_mps2 + offset_g * G, approach=approach)


def values(found: Recommendation, code: str) -> Mapping[str, object]:
    """What the fact of this code rests on."""
    return {fact.code: fact.values for fact in found.facts}[code]


def offsets_study(campaign: Campaign, offsets_g: dict[str, list[float]]) -> Study:
    """A study in which each approach is off by known amounts, one a test."""
    config = StudyConfig(approaches=tuple(offsets_g))
    rows = [[off_by(name, test, own[i]) for name, own in offsets_g.items()] for i, test in enumerate(campaign.tests)]
    folds = [Fold.of(test, row, config.windows_ms) for test, row in zip(campaign.tests, rows, strict=True)]
    return Study(campaign, config, tuple(folds))


@pytest.mark.parametrize(("n", "excess_g", "tied"), [(4, 0.56, True), (4, 0.6, False), (2, 0.9, True), (2, 1.1, False)])
def test_what_lies_within_a_standard_error_of_the_best_is_equal_to_it(
    campaign: Campaign, n: int, excess_g: float, tied: bool
) -> None:
    """Of tests 1 g above and below a mean excess, it is √(4/3)/√4 = 0.577 g of four, √2/√2 = 1 g of two."""
    worse = [4 + excess_g + side for side in (-1.0, 1.0, -1.0, 1.0)]
    of_all = offsets_study(campaign, {"time_domain": [4.0] * 4, "displacement_domain": worse})
    found = recommend(replace(of_all, folds=of_all.folds[:n]))
    assert found.approach == ("displacement_domain" if tied else "time_domain")
    crps_g = {"time_domain": pytest.approx(4.0), "displacement_domain": pytest.approx(4 + excess_g)}
    assert values(found, "recommendation.distance")["crps_g"] == crps_g
    assert (found.ties.get("equal") == ["the time domain"]) == tied


def test_the_end_of_the_longest_window_counts(campaign: Campaign) -> None:
    """An error of 6 g from 50 to 60 ms alone is in 12 of the 75 samples that are judged: 0.96 g on average."""
    study = offsets_study(campaign, {"time_domain": [0.5] * 4, "displacement_domain": [6.0] * 4})
    folds = []
    for fold in study.folds:
        late = fold.estimates[1]
        accel = np.where((late.time_s >= 0.05) & (late.time_s < 0.06), late.accel_mps2, late.accel_mps2 - 6 * G)
        folds.append(replace(fold, estimates=(fold.estimates[0], replace(late, accel_mps2=accel))))
    found = recommend(replace(study, folds=tuple(folds)))
    crps_g = {"time_domain": pytest.approx(0.5), "displacement_domain": pytest.approx(0.96)}
    assert values(found, "recommendation.distance")["crps_g"] == crps_g


def test_of_a_single_left_out_test_it_is_what_was_recommended_without_it(campaign: Campaign) -> None:
    """One test cannot tell approaches apart: hindsight recommends nothing, and how it came out is told."""
    both = study(campaign, {"time_domain": 0.99, "displacement_domain": 0.8})
    fold = both.folds[0]
    before = recommend_for(fold.estimates, both.config.training_campaign(campaign, fold.held_out), fold.test.condition)
    found = recommend(replace(both, folds=(fold,)))
    assert before.expected is not None
    rated = fold.ratings["time_domain"][60.0].overall
    assert (found.approach, found.expected) == ("time_domain", before.expected)
    assert before.expected.outcome(rated) in found.sentences[0]
    told = values(found, "recommendation.outcome")
    assert (told["approach"], told["rating"]) == ("time_domain", rated)
    assert found.facts[1:] == before.facts[1:]


def test_among_equals_there_is_an_order_of_preference(campaign: Campaign) -> None:
    """The mixture, the displacement domain, the time domain, the network alone, the raw model."""
    order = ["fused", "displacement_domain", "time_domain", "lf_tcn", "cae"]
    for first in range(len(order) - 1):
        names = order[first:]
        assert recommend(offsets_study(campaign, {name: [2.0] * 4 for name in reversed(names)})).approach == names[0]


def scaled_to(rating: float, campaign: Campaign, test: CrashTest, measure: str = "mean") -> float:
    """The factor on the tests' own pulses that is expected to rate this much at the condition of a test."""

    def excess(scale: float) -> float:
        found = not_none(expected_rating(estimate("displacement_domain", campaign, test, scale), campaign))
        return float(getattr(found, measure)) - rating

    return float(brentq(excess, 0.5, 0.99, xtol=1e-6))


def test_the_headline_says_which_window_prefers_what_cannot_be_told_apart(campaign: Campaign) -> None:
    """Of two that rate alike over 60 ms one is right until 40 ms; of one that is clearly better nothing is said."""
    rest, test = campaign.without(["T2"]), campaign.test("T2")

    def late(scale: float) -> Estimate:
        factors = np.where(GRID_S < 0.04, 1.0, scale)
        left_out = {other.id: factors * other.pulse.accel_mps2 for other in rest.tests}
        return replace(estimate("time_domain", rest, test, 1.0), left_out_mps2=left_out)

    def excess(scale: float) -> float:
        return mean_near(late(scale), rest, rest.test_ids, 60.0) - 0.85

    early_right = late(float(brentq(excess, 0.1, 0.99, xtol=1e-6)))
    both = [early_right, estimate("displacement_domain", rest, test, scaled_to(0.85, rest, test))]
    found = recommend_for(both, rest, test.condition)
    assert found.approach == "displacement_domain"
    for headline in (found.sentences[0], found.after(0.85)[0].sentence):
        assert "the displacement domain. On 3 left-out tests the time domain did as well. " in headline
        assert re.search(r"Ahead of it was the time domain over 0–20 ms \(1\.000, not 0\.\d{3}\)", headline)
    assert not recommend_for([early_right, estimate("displacement_domain", rest, test, 0.5)], rest, test.condition).ties


@pytest.mark.parametrize(
    ("other", "ahead", "chosen"),
    [
        ("time_domain", -0.019, "displacement_domain"),
        ("time_domain", -0.021, "time_domain"),
        ("cae", -0.01, "displacement_domain"),
        ("cae", 0.01, "displacement_domain"),
    ],
)
def test_two_hundredths_of_the_rating_are_a_difference(
    campaign: Campaign, other: str, ahead: float, chosen: str
) -> None:
    """Less is none, and then the preferred one is taken; that it beats the raw model no more is said where so."""
    rest, test = campaign.without(["T2"]), campaign.test("T2")
    ratings = {other: 0.85, "displacement_domain": 0.85 + ahead}
    both = [estimate(name, rest, test, scaled_to(rating, rest, test)) for name, rating in ratings.items()]
    found = recommend_for(both, rest, test.condition)
    assert found.approach == chosen
    assert not_none(found.expected).mean == pytest.approx(0.85 if chosen == other else 0.85 + ahead, abs=1e-3)
    raw = [fact for fact in found.facts if fact.code == "recommendation.raw_cae"]
    assert [fact.values for fact in raw] == [{"mean_rating": pytest.approx(0.85, abs=1e-3)}] * (other == "cae")
    assert ["recommendation.no_better" in {fact.code for fact in found.facts}] * len(raw) == [ahead < 0] * len(raw)


@pytest.mark.parametrize(("away_mph", "approach"), [(2.9, "time_domain"), (3.1, "displacement_domain")])
def test_the_papers_advice_turns_at_3_mph(campaign: Campaign, away_mph: float, approach: str) -> None:
    """Faster than the fastest test by a little less, and by a little more (Sect. 4.3); no test was left out."""
    last, names = campaign.tests[-1], ("time_domain", "displacement_domain")
    condition = replace(last.condition, speed_mps=(35 + away_mph) * MPH)
    both = [replace(estimate(name, campaign, last, 1.0), left_out_mps2={}) for name in names]
    found = recommend_for(both, campaign, condition)
    assert (found.approach, found.expected) == (approach, None)
    assert f"{away_mph:.1f} mph away" in found.sentences[2]


def test_the_recommendation_of_a_study_is_computed_once(campaign: Campaign) -> None:
    """Files, report and terminal all ask for it; another study is judged anew, and one that is gone is forgotten."""
    one, other = study(campaign, {"cae": 0.5, "fused": 0.9}), study(campaign, {"cae": 0.9, "fused": 0.5})
    assert recommend(one) is recommend(one)
    assert recommend(other) != recommend(one)
    gc.collect()  # those of other tests
    before = len(cache._remembered)
    del one, other
    gc.collect()
    assert len(cache._remembered) == before - 2


@pytest.mark.parametrize(
    ("rating", "measure", "likely"),
    [(0.79, "upper", ["to be expected"]), (0.81, "upper", ["likely"]), (0.81, "median", [])],
)
def test_less_than_good_is_said_to_be_likely_where_it_is(
    campaign: Campaign, rating: float, measure: str, likely: list[str]
) -> None:
    """By the median of what a test may rate; to be expected by the upper end of it."""
    rest, test = campaign.without(["T2"]), campaign.test("T2")
    one = estimate("displacement_domain", rest, test, scaled_to(rating, rest, test, measure))
    said = " ".join(recommend_for([one], rest, test.condition).sentences)
    assert re.findall("A rating below Good is ([a-z ]+)", said) == likely


@pytest.mark.parametrize(("speed_mph", "warned"), [(30.0, False), (60.0, True)])
def test_farther_than_tests_from_each_other_the_band_tells(campaign: Campaign, speed_mph: float, warned: bool) -> None:
    """Tests at 15 to 35 mph lie within 10 mph of another."""
    test = replace(campaign.tests[0], condition=replace(campaign.tests[0].condition, speed_mps=speed_mph * MPH))
    found = recommend_for([estimate("displacement_domain", campaign, test, 0.9)], campaign, test.condition)
    assert ("recommendation.farther" in {fact.code for fact in found.facts}) == warned


def test_each_view_of_a_study_has_sentences_of_its_own_rows(campaign: Campaign) -> None:
    """Tests left out alone, and with their speed groups: every rating in words is a cell of that view's tables."""
    worse = [4.56 + side for side in (-1.0, 1.0, -1.0, 1.0)]  # not to be told from the other
    alone, groups = (
        offsets_study(campaign, {"time_domain": [4 * n] * 4, "displacement_domain": [n * x for x in worse]})
        for n in (1.0, 1.3)
    )
    groups = replace(groups, config=replace(groups.config, leave_out="speed group"))
    both = replace(alone, config=replace(alone.config, leave_out="both"), speed_groups=groups)
    for view in (both, groups):
        scores = view.scores
        means = scores.groupby(["approach", "window_ms"])["overall"].mean()
        found = {fact.code: re.findall(r"\b[01]\.\d{2,}\b", fact.sentence) for fact in recommend(view).facts}
        for code in ("recommendation.use", "recommendation.ratings"):
            assert found[code]
            assert {*found[code]} <= {f"{rating:.3f}" for rating in [*scores["overall"], *means]}
    mean = values(recommend(both), SPEED_GROUPS)["mean_rating"]
    assert mean == pytest.approx(groups.mean_rating("displacement_domain", 60.0))


CONFIG = StudyConfig(approaches=("cae", "displacement_domain"))


def fold(campaign: Campaign, test_id: str, own: float, of_others: float) -> Fold:
    """A fold in which the displacement domain is off by a factor in its test, by another in those it left out."""
    test, rest = campaign.test(test_id), campaign.without([test_id])
    better = estimate("displacement_domain", rest, test, own, 0.1)
    left_out = {other.id: of_others * other.pulse.accel_mps2 for other in rest.tests}
    raw = estimate("cae", rest, test, 0.5)
    return Fold.of(test, (raw, replace(better, left_out_mps2=left_out)), CONFIG.windows_ms)


def test_a_test_far_below_its_expectation_is_told_with_its_range_and_its_rating(campaign: Campaign) -> None:
    """Others are predicted to 1 %, this one is half of what was measured; over which window is said."""
    found = account(campaign, CONFIG, fold(campaign, "T3", 0.5, 0.99))
    assert found.approach == "displacement_domain"
    assert found.disappoints
    assert found.expected is not None
    assert found.expected.surprise(found.rating) == "far below what we expected"
    assert (found.neighbours, found.departure) == (("T2",), None)
    assert account(campaign, CONFIG, fold(campaign, "T3", 0.5, 0.99), 20.0).window_ms == 20.0


def test_a_test_that_comes_out_like_the_others_is_as_expected(campaign: Campaign) -> None:
    found = account(campaign, CONFIG, fold(campaign, "T3", 0.93, 0.93))
    assert not found.disappoints
    assert found.inside == 1.0


def test_the_worst_test_of_each_view_is_told_as_it_was_left_out_there(campaign: Campaign) -> None:
    """Alone T3, with its rating without T2, at its speed; of speed groups T2, by the approach asked for."""
    alone = [fold(campaign, test, 0.6 if test == "T3" else 0.97, 0.97) for test in campaign.test_ids]
    apart = [fold(campaign, test, 0.7 if test == "T2" else 0.8, 0.97) for test in campaign.test_ids]
    groups = Study(campaign, replace(CONFIG, leave_out="speed group"), tuple(apart))
    study = Study(campaign, replace(CONFIG, leave_out="both"), tuple(alone), speed_groups=groups)
    found = worst_test(study)
    assert found.test.id == "T3"
    assert found.without_neighbours == groups.fold("T3").ratings["displacement_domain"][60.0].overall
    assert worst_test(study) is found
    found = worst_test(groups, approach="displacement_domain")
    assert found.rating == groups.fold("T2").ratings["displacement_domain"][60.0].overall
    assert (found.test.id, found.with_group, found.without_neighbours) == ("T2", True, None)
    assert worst_test(groups, approach="cae").rating < found.rating


def test_a_prediction_without_the_neighbours_that_was_made_before_is_found(campaign: Campaign) -> None:
    """A study has left T3 out with T2; a comparison of T3 alone rates that prediction."""
    test = campaign.test("T3")
    rest = campaign.without(campaign.speed_group("T3"))
    assert account(campaign, CONFIG, fold(campaign, "T3", 0.6, 0.97)).without_neighbours is None
    own = estimate("displacement_domain", rest, test, 1.0)
    errors = {name: np.zeros(0) for name in METRIC_LABELS}
    perfect = replace(own, accel_mps2=test.pulse.accel_mps2, draws_mps2=None, metric_errors=errors)
    store_estimate(perfect, rest, CONFIG, Cache())
    assert account(campaign, CONFIG, fold(campaign, "T3", 0.6, 0.97)).without_neighbours == pytest.approx(1.0)


def test_ranges_and_grades_agree_with_what_is_displayed(campaign: Campaign) -> None:
    """0.94 is Good, as Excellent is above it; a surprise is judged by the digits of the range."""
    found = not_none(expected_rating(estimate("displacement_domain", campaign, campaign.test("T3"), 1.0), campaign))
    told = replace(found, lower=0.8849, upper=0.9404, least=0.7, most=0.98)
    assert told.range == "0.88 to 0.94"
    assert told.grades == "Good"
    assert told.outcome(0.8801) == "Rated 0.880 (Good), as expected: 0.88 to 0.94 (80 %)."
    assert told.outcome(0.8004).startswith("Rated 0.800 (Good), below what we expected: ")  # the grade of its rating
    assert told.outcome(0.878).startswith("Rated 0.878 (Good), below what we expected: ")  # not what 0.88 begins with
    assert told.surprise(0.75) == "below what we expected"
    assert told.surprise(0.96) == "above what we expected"
    assert told.surprise(0.59) == "far below what we expected"
    assert replace(told, upper=0.951).grades == "Good to Excellent"
