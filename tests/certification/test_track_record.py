"""The record of left-out verdicts: counted once, bounded exactly, and asked for what it supports."""

import pytest
from scipy.stats import binom

from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.track_record import (
    LeftOut,
    Support,
    TrackRecord,
    Trial,
    counted_wrong,
    largest_share,
    share_bounds,
    wrong_shares,
)
from crashfuse.certification.verdict import Verdict, Word
from crashfuse.condition import Condition

CRUSH = Criterion("crush", "max_crush", at_most=500.0)
PEAK = Criterion("peak", "peak", at_most=30.0)
SIX = [Criterion(of, of, at_most=500.0) for of in ("max_crush", "static_crush", "peak", "mean", "olc", "vpi")]
HERE = Condition.of_vector([10.0, 1000.0, 700.0])


def trial(
    word: Word,
    measured: float,
    probability: float | None = 0.5,
    *,
    held_out: str = "T1",
    left_out: LeftOut = "test",
    criterion: Criterion = CRUSH,
    cae: float | None = 0.5,
    interval: tuple[float | None, float | None] = (480.0, 520.0),
) -> Trial:
    """A left-out test with a verdict, at most 500 mm of crush the limit."""
    verdict = Verdict(HERE, criterion, 500.0, *interval, probability, word, "")
    return Trial(held_out, left_out, verdict, measured, cae)


@pytest.mark.parametrize(("word", "wrong"), [("met", [501.0]), ("not met", [499.0]), ("open", []), ("outside", [])])
def test_a_verdict_is_wrong_if_the_test_contradicts_it(word: Word, wrong: list[float]) -> None:
    """Met and not met are, each on its own side; an open one says nothing that a test could contradict."""
    assert [measured for measured in (499.0, 501.0) if trial(word, measured).wrong] == wrong


def test_a_group_of_one_test_counts_once() -> None:
    """Left out alone and with its speed group are then the same; with another verdict both count."""
    alone, group = trial("met", 450.0), trial("met", 450.0, left_out="speed group")
    assert TrackRecord((alone, group)).decided == (1, 0)
    other = trial("met", 450.0, 0.97, left_out="speed group")
    assert TrackRecord((alone, other)).decided == (2, 0)


def test_verdicts_are_counted_by_word_with_the_wrong_ones_and_by_test() -> None:
    """Over all criteria; open ones bound nothing, and a test is wrong once any verdict on it is."""
    trials = (
        trial("met", 450.0, held_out="A"),
        trial("met", 550.0, held_out="B"),
        trial("met", 20.0, held_out="B", criterion=PEAK),
        trial("not met", 450.0, held_out="C"),
        trial("open", 450.0, held_out="D"),
        trial("outside", 450.0, held_out="E", criterion=PEAK),
    )
    record = TrackRecord(trials)
    assert record.counts() == {"met": (3, 1), "not met": (1, 1), "open": (1, 0), "outside": (1, 0)}
    assert record.decided == (4, 2)
    assert [own.held_out for own in record.of(PEAK)] == ["B", "E"]
    assert record.bounds() == {"verdicts": (2, 4), "tests": (2, 3)}
    assert record.bounds(PEAK) == {"verdicts": (0, 1), "tests": (0, 1)}


def test_a_left_out_test_need_not_have_been_run_if_every_criterion_was_met() -> None:
    """A and B are, however often; B misses one all the same. C is open, D lacks a metric, E met at .97 each."""

    def both(test: str, peak_g: float, p: float, way: LeftOut = "test") -> list[Trial]:
        limits = ((CRUSH, 450.0), (PEAK, peak_g))
        return [trial("met", shown, p, held_out=test, left_out=way, criterion=limit) for limit, shown in limits]

    record = TrackRecord(
        (
            *both("A", 20.0, 0.98),
            *both("A", 20.0, 0.98, "speed group"),
            *both("B", 31.0, 0.98),
            *both("B", 31.0, 0.99, "speed group"),
            trial("met", 450.0, 0.98, held_out="C"),
            trial("open", 31.0, held_out="C", criterion=PEAK),
            trial("met", 450.0, 0.98, held_out="D"),
            *both("E", 20.0, 0.97),
        )
    )
    assert record.waived(Criteria((CRUSH, PEAK), 0.95)) == (5, 2, 1)
    assert record.waived(Criteria((CRUSH, PEAK), 0.94)) == (5, 3, 1)
    assert TrackRecord(()).waived(Criteria((CRUSH,))) == (0, 0, 0)
    assert record.saved(Criteria((CRUSH, PEAK), 0.95))["B"] == {"test": True, "speed group": True}


def test_no_record_supports_much_confidence_in_a_metric_that_is_often_wrong() -> None:
    """On random vehicles a tenth of the decided verdicts on restitution were wrong, however good a record looks."""
    slow = Criterion("slow", "restitution", at_most=0.2)
    record = TrackRecord(tuple(trial("met", 0.1, held_out=f"T{i}", criterion=slow) for i in range(99)))
    support = record.support(slow)
    assert support.confidence == 0.85
    assert support.shortfall(0.85) is None
    assert "0.85" in (support.shortfall(0.95) or "")


def test_the_brier_score_is_the_mean_squared_error_of_probabilities() -> None:
    """Beside that of the raw CAE, over those trials inside the domain that have both."""
    record = TrackRecord(
        (
            trial("met", 450.0, 0.9, held_out="A", cae=0.6),
            trial("open", 550.0, 0.4, held_out="B", cae=0.7),
            trial("open", 550.0, 0.4, held_out="C", cae=None),
            trial("outside", 550.0, 1.0, held_out="D", cae=1.0),
        )
    )
    assert record.brier == pytest.approx(((0.01 + 0.16) / 2, (0.16 + 0.49) / 2))
    assert TrackRecord(()).brier is None


def test_probabilities_in_a_bin_are_compared_with_the_share_that_met() -> None:
    """Ten of probability 0.8, seven met: the mean lies within the exact bounds; with one met it does not."""
    for met, holds in ((7, True), (1, False)):
        trials = [trial("open", 450.0 if i < met else 550.0, 0.8, held_out=f"T{i}") for i in range(10)]
        [found] = TrackRecord(tuple(trials)).reliability
        assert (found.low, found.high, found.n, found.met) == (0.75, 0.95, 10, met / 10)
        assert (found.lower, found.upper) == share_bounds(met, 10)
        assert found.holds is holds
    ends = TrackRecord((trial("met", 450.0, 1.0), trial("not met", 550.0, 0.0, held_out="B")))
    assert [(own.low, own.high, own.met) for own in ends.reliability] == [(0.0, 0.05, 0.0), (0.95, 1.0, 1.0)]


def test_a_criterion_counts_on_others_only_if_a_test_came_near_their_limits() -> None:
    """Trivial criteria prove nothing for others; their own verdicts they may count."""
    near = [trial("met", 495.0, held_out=f"N{i}") for i in range(5)]
    far = [trial("met", 5.0, held_out=f"F{i}", criterion=PEAK, interval=(4.0, 6.0)) for i in range(7)]
    record = TrackRecord((*near, *far))
    assert record.decided == (12, 0)
    assert record.support(CRUSH) == Support(5, 0, 5, 0, near=True)
    assert record.support(PEAK) == Support(12, 0, 7, 0, near=False)


def test_a_criterion_under_a_second_name_supports_nothing_more() -> None:
    """Nor do two limits on one metric: one verdict a left-out test counts, a wrong one first."""
    first = tuple(trial("met", 495.0, held_out=f"T{i}") for i in range(6))
    again = Criterion("again", "max_crush", at_most=498.0)
    second = tuple(trial("met", 495.0, held_out=f"T{i}", criterion=again) for i in range(6))
    record = TrackRecord((*first, *second))
    assert record.decided == (12, 0)
    others = tuple(trial("met", 495.0, 0.99, held_out=f"T{i}", left_out="speed group") for i in range(7))
    assert (record.near_limit.decided, TrackRecord((*first, *others)).near_limit.decided) == ((6, 0), (7, 0))
    assert record.support(CRUSH) == Support(6, 0, 6, 0, near=True)
    strict = Criterion("strict", "max_crush", at_most=490.0)
    wrong = trial("met", 495.0, held_out="T0", criterion=strict)
    assert TrackRecord((*first, wrong)).support(CRUSH) == Support(6, 1, 6, 0, near=True)


def test_intervals_that_held_what_was_measured_are_counted_once_a_metric() -> None:
    """Both ends count; an end beyond the record holds anything, and two limits on one metric share an interval."""
    again = Criterion("window", "max_crush", at_least=100.0)
    record = TrackRecord(
        (
            *(trial("met", measured, held_out=f"T{measured}") for measured in (479.0, 480.0, 520.0, 521.0)),
            trial("met", 480.0, held_out="T480.0", criterion=again),
            trial("met", 900.0, held_out="A", interval=(480.0, None)),
            trial("outside", 900.0, held_out="B"),
            trial("open", 900.0, None, held_out="C", interval=(None, None)),
        )
    )
    assert (record.intervals, record.intervals_outside) == ((3, 5), (0, 1))


def test_near_means_within_one_width_of_the_interval() -> None:
    """Of the limit; where one end is not known it is as far from the value as the other, and never just anywhere."""
    assert trial("met", 461.0).near
    assert not trial("met", 459.0).near
    assert trial("met", 461.0, interval=(480.0, None)).near
    assert not trial("met", 459.0, interval=(480.0, None)).near
    assert not trial("open", 499.0, interval=(None, None)).near


def test_a_test_that_is_left_out_both_ways_supports_no_more_than_once() -> None:
    """Its metrics vary together, alone as with its speed group: whatever is right in it, others have to be."""
    ways: list[tuple[LeftOut, float]] = [("test", 0.9), ("speed group", 0.8)]
    own = [trial("met", 495.0, p, left_out=way, criterion=each) for each in SIX for way, p in ways]
    assert TrackRecord(tuple(own)).support(SIX[0]).decided == 5
    assert TrackRecord(tuple(own[:2])).support(SIX[0]).decided == 2
    other = trial("met", 495.0, held_out="T2", criterion=SIX[0])
    assert TrackRecord((*own, other)).support(SIX[0]).decided == 6


def test_a_wrong_verdict_is_among_the_five_that_count_of_a_test() -> None:
    """Whichever metric it is on: right ones, and open ones after them, do not crowd it out."""
    for missed in SIX:
        verdicts = [trial("met", 505.0 if one is missed else 495.0, criterion=one) for one in SIX]
        support = TrackRecord((*(trial("open", 495.0, criterion=one) for one in SIX), *verdicts)).support(missed)
        assert (support.decided, support.wrong) == (5, 1)
    opened = [trial("open" if one in SIX[:5] else "met", 495.0, criterion=one) for one in SIX]
    assert TrackRecord(tuple(opened)).support(SIX[0]).decided == 1


def test_what_a_test_missed_is_one_miss_among_its_own() -> None:
    """Those of its own metric are one a test; in all it counts each time that somebody would have been misled."""
    ways: list[tuple[LeftOut, float]] = [("test", 0.9), ("speed group", 0.8), ("planned", 0.95)]
    wrong = [trial("met", 505.0, p, left_out=way) for way, p in ways]
    right = [trial("met", 495.0, held_out=f"T{i}") for i in range(2, 10)]
    record = TrackRecord((*wrong[:2], *right), since=tuple(wrong[2:]))
    assert record.support(CRUSH) == Support(11, 3, 9, 1, near=True, before=1, wrong_before=1)


def test_a_test_that_was_only_planned_can_come_near_a_limit() -> None:
    """It says as much of the limit as one that was left out."""
    planned = trial("met", 495.0, left_out="planned", held_out="T3")
    far = trial("met", 5.0)
    assert not TrackRecord((far,)).support(CRUSH).near
    assert TrackRecord((far,), since=(planned,)).support(CRUSH).near


@pytest.mark.parametrize(("count", "n"), [(0, 11), (1, 11), (5, 20), (11, 11)])
def test_bounds_of_a_share_are_exact(count: int, n: int) -> None:
    """At the bounds, what was seen or something more extreme has just the probability of the tail."""
    lower, upper = share_bounds(count, n)
    if count:
        assert binom.sf(count - 1, n, lower) == pytest.approx(0.025)
    if count < n:
        assert binom.cdf(count, n, upper) == pytest.approx(0.025)
        assert binom.cdf(count, n, largest_share(count, n)) == pytest.approx(0.05)
    assert (lower == 0) == (count == 0)
    assert (upper == 1) == (count == n)


def test_bounds_by_verdict_test_and_vehicle_have_their_closed_forms() -> None:
    """One of 118 on five vehicles is at most 4.0 % by answer and 66 % by vehicle; with none wrong, 1 − 0.05^(1/n)."""
    wrong, vehicles = [i == 7 for i in range(118)], [i % 5 for i in range(118)]
    shares = wrong_shares(wrong, tests=range(118), vehicles=vehicles)
    assert shares == {"verdicts": (1, 118), "tests": (1, 118), "vehicles": (1, 5)}
    assert [shares[unit].at_most for unit in ("verdicts", "vehicles")] == pytest.approx([0.0396, 0.6574], abs=5e-5)
    none = wrong_shares([False] * 118, vehicles=vehicles)
    expected = [1 - 0.05 ** (1 / n) for n in (118, 5)]
    assert [share.at_most for share in none.values()] == pytest.approx(expected, abs=5e-5)
    assert wrong_shares([], tests=[])["tests"].at_most is None


@pytest.mark.parametrize(("decided", "wrong", "supports"), [(9, 0, True), (8, 0, False), (29, 1, True), (28, 1, False)])
def test_a_record_supports_the_confidence_that_it_makes_likely(decided: int, wrong: int, supports: bool) -> None:
    """Jeffreys' mean of the share of right verdicts reaches 0.95 with nine of nine, or 28 of 29."""
    support = Support(decided, wrong, decided, wrong, near=True)
    assert support.confidence == pytest.approx(1 - (wrong + 0.5) / (decided + 1))
    said = support.shortfall(0.95)
    assert (said is None) is supports
    if said is not None:
        needed = 9 if wrong == 0 else 29
        assert f"takes {needed} with {f'at most {wrong}' if wrong else 'none'} wrong" in said
    said = Support(47, 0, 47, 0, near=True).shortfall(0.99)  # 0.9896 is not shown as 0.99
    assert said is not None
    assert 0.989 <= float(said.partition("enough for a confidence of ")[2].partition(", not of")[0]) < 0.99


def test_few_verdicts_of_its_own_are_told_though_those_on_other_criteria_suffice() -> None:
    """Two right ones do not support 0.95, though with fifty on other criteria they do; nine do, alone."""
    expected = (2, 0, "2 hidden tests, none"), (0, 0, "Not checked on any"), (30, 3, "3 wrong"), (9, 0, None)
    for decided, wrong, told in expected:
        said = Support(200, wrong, own_decided=decided, own_wrong=wrong, near=True).reservation(0.95)
        assert (told is None) is (said is None)
        assert (told or "") in (said or "")
        assert said is None or said.endswith(f"200 verdicts, {counted_wrong(wrong)}: enough for a confidence of 0.95.")
    assert "enough" not in (Support(5, 0, 2, 0, near=False).reservation(0.95) or "enough")


@pytest.mark.parametrize(
    ("wrong", "n", "refuted"), [(1, 2, False), (2, 8, False), (2, 7, True), (3, 12, True), (0, 9, False)]
)
def test_right_verdicts_on_others_do_not_make_up_for_its_own_wrong_ones(wrong: int, n: int, refuted: bool) -> None:
    """Two of seven are too many for 0.95, as fewer than one in twenty of such records would have as many."""
    support = Support(500, wrong, n, wrong, near=True)
    assert bool(binom.sf(wrong - 1, n, 0.05) < 0.05) is refuted
    said = support.shortfall(0.95)
    assert (said is not None) is refuted
    if said is not None:
        assert said.startswith(f"{wrong} of {n} verdicts on this metric, one a test, were wrong: too many for a")
    before = Support(500, wrong, 0, 0, near=True, before=n, wrong_before=wrong).shortfall(0.95)
    assert (before is not None) is refuted
