"""The learning curve: a part sees nothing of the others, and all but one is what a study computes."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import Cancelled, DataError, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.learning_curve import LearningCurve, Subset, is_curve_cached, learning_curve, measure, subsets
from crashfuse.study.running import run_study
from crashfuse.units import MPH
from tests.conftest import cancelled_after, with_pulse

CONFIG = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(40.0, 60.0))
COLUMNS = ["n_tests", "chosen", "choice", "held_out", "approach", "window_ms", "overall", "inside", "half_width_g"]


def with_tests(campaign: Campaign, n: int) -> Campaign:
    """The campaign with n tests at speeds of their own, in no order."""
    speeds = np.random.default_rng(3).permutation(np.linspace(10.0, 40.0, n))
    pulse = campaign.tests[0].pulse
    tests = tuple(
        CrashTest(f"T{i:02d}", Condition.of_vector([v * MPH, 900.0, 650.0]), pulse) for i, v in enumerate(speeds)
    )
    return replace(campaign, tests=tests)


@pytest.mark.parametrize("n", [2, 3, 4, 5, 7, 11, 13, 31, 34])
def test_every_test_is_left_out_by_an_even_choice_of_every_size(campaign: Campaign, n: int) -> None:
    """So means over the tests compare the same tests at every size; all but one is leaving each out in turn."""
    own = with_tests(campaign, n)
    parts = [part for part in subsets(own, 2, 0) if part.choice == "even"]
    sizes = {len(part.chosen) for part in parts}
    assert sizes >= {1, n - 1}
    for size in sizes:
        held_out = [
            test for part in parts if len(part.chosen) == size for test in own.test_ids if test not in part.chosen
        ]
        assert set(held_out) == set(own.test_ids)
    alone = [
        tuple(test for test in own.test_ids if test not in part.chosen) for part in parts if len(part.chosen) == n - 1
    ]
    assert sorted(alone) == sorted((test_id,) for test_id in own.test_ids)


def test_the_sizes_are_small_steps_first_up_to_all_but_one(campaign: Campaign) -> None:
    """1, 2, 3, 4, then every second, then wider."""
    sizes = [len(part.chosen) for part in subsets(with_tests(campaign, 12), 0, 0)]
    assert sorted(set(sizes)) == [1, 2, 3, 4, 6, 8, 10, 11]


def test_even_choices_are_even_over_speed(campaign: Campaign) -> None:
    """In the order of speed, neighbours of an even choice are as far apart as n / size, to a place."""
    own = with_tests(campaign, 13)
    order = sorted(own.test_ids, key=lambda test_id: own.test(test_id).condition.speed_mps)
    for part in subsets(own, 0, 0):
        places = sorted(order.index(test_id) for test_id in part.chosen)
        assert all(abs(b - a - 13 / len(places)) < 1 for a, b in pairwise(places))


def test_random_choices_are_those_of_the_seed(campaign: Campaign) -> None:
    """Equal seeds choose equally, others otherwise; where even choices are all there are, nothing is drawn."""
    own = with_tests(campaign, 9)

    def drawn(seed: int) -> list[Subset]:
        return [part for part in subsets(own, 3, seed) if part.choice == "random"]

    assert drawn(1) == drawn(1) != drawn(2)
    assert {len(part.chosen) for part in drawn(1)} == {1, 2, 3, 4, 6}
    assert all(len(set(part.chosen)) == len(part.chosen) for part in drawn(1))
    assert not [part for part in subsets(with_tests(campaign, 3), 3, 0) if part.choice == "random"]


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("curve"))


@pytest.fixture(scope="module")
def curve(campaign: Campaign, cache: Cache) -> LearningCurve:
    return learning_curve(campaign, CONFIG, repeats=1, cache=cache, workers=1)


@pytest.mark.slow
def test_each_part_predicts_all_other_tests_with_every_approach_over_every_window(curve: LearningCurve) -> None:
    table = curve.table
    assert list(table) == [*COLUMNS, "basis"]
    for (chosen, _, n_tests), part in table.groupby(["chosen", "choice", "n_tests"]):
        ids = chosen.split()
        assert len(ids) == n_tests
        assert set(part["held_out"]) == set(curve.campaign.test_ids) - set(ids)
        assert len(part) == (4 - n_tests) * len(CONFIG.approaches) * len(CONFIG.windows_ms)
    assert sorted(table["n_tests"].unique()) == [1, 2, 3]


@pytest.mark.slow
def test_a_row_is_the_prediction_of_a_fit_to_its_part(curve: LearningCurve) -> None:
    campaign = curve.campaign
    row = next(row for row in curve.table.itertuples() if row.n_tests == 2 and row.approach == "displacement_domain")
    training = campaign.without([test_id for test_id in campaign.test_ids if test_id not in row.chosen.split()])
    test = campaign.test(row.held_out)
    estimate = Fit.of(training, row.approach, CONFIG).estimate(test.condition)
    expected = measure(estimate, test, row.window_ms)
    assert {name: getattr(row, name) for name in expected} == pytest.approx(expected)
    assert estimate.draws_mps2 is not None
    draws = estimate.draws_mps2[:, : round(row.window_ms / 0.08)]
    lower, upper = np.quantile(draws, [0.025, 0.975], axis=0)
    measured = test.pulse.accel_mps2[: draws.shape[1]]
    assert row.inside == pytest.approx(np.mean((lower <= measured) & (measured <= upper)), abs=2 / draws.shape[1])
    assert row.half_width_g == pytest.approx(np.mean(upper - lower) / 2 / 9.80665, rel=1e-4)


@pytest.mark.slow
def test_the_raw_cae_model_has_no_band_and_needs_no_test(curve: LearningCurve) -> None:
    cae = curve.table[curve.table["approach"] == "cae"]
    assert cae[["inside", "half_width_g"]].isna().all(axis=None)
    assert (cae.groupby(["held_out", "window_ms"])["overall"].nunique() == 1).all()


@pytest.mark.slow
def test_all_but_one_is_what_a_study_rates(curve: LearningCurve, cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    """The largest parts leave each test out, and their predictions are the study's: nothing is fitted for it again."""
    monkeypatch.setattr(Fit, "of", None)
    study = run_study(curve.campaign, CONFIG, cache=cache, workers=1)
    found = curve.table[curve.table["n_tests"] == 3].set_index(["held_out", "approach", "window_ms"])["overall"]
    for fold in study.folds:
        for name, ratings in fold.ratings.items():
            for window, rating in ratings.items():
                assert found[fold.held_out, name, window] == pytest.approx(rating.overall)


@pytest.mark.slow
def test_a_held_out_pulse_reaches_no_prediction_without_it(campaign: Campaign, curve: LearningCurve) -> None:
    """Another pulse of T2: parts without T2 predict the others as before to the bit, those with T2 do not."""
    softer = with_pulse(campaign, "T2", 0.7 * campaign.test("T2").pulse.accel_mps2)
    before, after = curve.table, learning_curve(softer, CONFIG, repeats=1, workers=1).table
    learned = (before["approach"] == "displacement_domain") & (before["held_out"] != "T2")
    saw_it = before["chosen"].str.split().map(lambda ids: "T2" in ids)
    assert before[learned & ~saw_it].equals(after[learned & ~saw_it])
    assert (before.loc[learned & saw_it, "overall"] != after.loc[learned & saw_it, "overall"]).all()


@pytest.mark.slow
def test_what_was_computed_is_not_computed_again(
    curve: LearningCurve, cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second time all rows come from the cache, equal to the digit; other settings do not find them."""
    assert is_curve_cached(curve.campaign, CONFIG, repeats=1)
    assert not is_curve_cached(curve.campaign, replace(CONFIG, windows_ms=(50.0,)), repeats=1)
    monkeypatch.setattr(Fit, "of", None)
    assert learning_curve(curve.campaign, CONFIG, repeats=1, cache=cache, workers=1).table.equals(curve.table)


@pytest.mark.slow
def test_workers_do_not_change_the_numbers(curve: LearningCurve) -> None:
    assert learning_curve(curve.campaign, CONFIG, repeats=1, workers=2).table.equals(curve.table)


@pytest.mark.slow
def test_the_ratings_by_test_are_means_over_the_even_choices(curve: LearningCurve) -> None:
    by_test = curve.by_test("displacement_domain")
    assert by_test.index.tolist() == list(curve.campaign.test_ids)
    assert by_test.columns.tolist() == [1, 2, 3]
    own = curve.table.query("approach == 'displacement_domain' and window_ms == 60 and choice == 'even'")
    assert by_test.loc["T3", 1] == pytest.approx(own.query("held_out == 'T3' and n_tests == 1")["overall"].mean())
    assert by_test.notna().all(axis=None)
    assert (curve.over(40.0).by_test("displacement_domain") != by_test).all(axis=None)


def test_it_can_be_stopped(campaign: Campaign) -> None:
    watch = cancelled_after(lambda p: p.step == "Predictions from fewer tests" and p.done > 0)
    with pytest.raises(Cancelled):
        learning_curve(campaign, replace(CONFIG, approaches=("cae",)), watch=watch, workers=1)


def test_what_makes_it_impossible_is_a_sentence(campaign: Campaign) -> None:
    with pytest.raises(UsageError, match="at least 2 tests"):
        learning_curve(campaign.without(["T1", "T2", "T3"]), CONFIG)
    with pytest.raises(UsageError, match="or more, not -1"):
        learning_curve(campaign, CONFIG, repeats=-1)
    short = replace(campaign, tests=tuple(replace(test, recorded_s=0.05) for test in campaign.tests))
    with pytest.raises(DataError, match="0–60 ms"):
        learning_curve(short, CONFIG)
