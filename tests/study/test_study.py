"""The study: nothing leaks, nothing is computed twice, and the numbers don't depend on how it is run."""

import hashlib
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.approaches.base import Approach, Prediction
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.registry import APPROACHES, CLASSES
from crashfuse.campaign import Campaign
from crashfuse.errors import Cancelled, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.signals.metrics import Metric, checked_metrics
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.signals.rating import rate_iso18571, rate_windows
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, estimate_at
from crashfuse.study.recommendation import recommend_for
from crashfuse.study.running import run_study
from crashfuse.study.study import Fold, Study
from tests.conftest import cancelled_after, with_pulse

CONFIG = StudyConfig(windows_ms=(20.0, 60.0))
KINDS = {"emulator", "fits", "metric errors", "predictions", "repeatability"}  # of what is kept

pytestmark = pytest.mark.usefixtures("quick_networks")


@pytest.fixture(autouse=True)
def few_draws() -> None:
    """None here: as many are rated as are said to be."""


def bits(prediction: Prediction) -> list[bytes]:
    return [each.tobytes() for each in (prediction.accel_mps2, prediction.draws_mps2) if each is not None]


def test_drawn_pulses_are_rated_as_any_pulse_is(campaign: Campaign) -> None:
    """Of two draws, the test itself rates 1 and a softer pulse what ISO/TS 18571 gives it."""
    test = campaign.tests[1]
    softer = 0.8 * test.pulse.accel_mps2
    prediction = Prediction(test.condition, softer, np.array([test.pulse.accel_mps2, softer]))
    fold = Fold.of(test, [Estimate(**vars(prediction), approach="fused")], [40.0, 60.0])
    for window in (40.0, 60.0):
        expected = rate_windows(test.pulse, Pulse(test.pulse.time_s, softer), [window])[window].overall
        np.testing.assert_allclose(fold.rating_draws("fused", window), [1.0, expected], atol=1e-3)
    lower, upper = fold.rating_interval("fused", 60.0)
    assert expected < lower < upper < 1.0


def test_the_interval_of_ratings_leaves_a_fortieth_out_at_either_end(campaign: Campaign) -> None:
    """Of 100 ever softer draws its ends lie between the third and the fourth, from below and from above."""
    test = campaign.tests[1]
    draws = np.linspace(1.0, 0.6, 100)[:, None] * test.pulse.accel_mps2
    fold = Fold.of(test, [Estimate(test.condition, draws[40], draws, approach="fused")], [60.0])
    lower, upper = fold.rating_interval("fused", 60.0)

    def rating(number: int) -> float:
        return rate_windows(test.pulse, Pulse(test.pulse.time_s, draws[number]), [60.0])[60.0].overall

    assert rating(97) < lower < rating(96) < rating(3) < upper < rating(2)


@pytest.mark.parametrize(("n_draws", "n_rated", "second"), [(100, 100, 1), (101, 51, 2), (400, 100, 4)])
def test_a_hundred_draws_are_rated_evenly_over_all(campaign: Campaign, n_draws: int, n_rated: int, second: int) -> None:
    """Each as it would be alone."""
    test = campaign.tests[1]
    draws = np.linspace(0.5, 1.0, n_draws)[:, None] * test.pulse.accel_mps2
    fold = Fold.of(test, [Estimate(test.condition, draws[0], draws, approach="fused")], [20.0])
    found = fold.rating_draws("fused", 20.0)
    assert found.shape == (n_rated,)
    alone = rate_windows(test.pulse, Pulse(test.pulse.time_s, draws[second]), [20.0])[20.0].overall
    assert found[1] == pytest.approx(alone, abs=1e-3)
    assert fold.estimate("fused").draws_mps2 is draws
    assert fold.with_band == ("fused",)


@pytest.mark.parametrize("name", ["max_crush", "peak"])
def test_crush_and_peak_lie_inside_the_intervals_that_are_told(campaign: Campaign, name: str) -> None:
    """Which may hold the test where its draws do not, and the other way round; without any the draws count."""
    test = campaign.tests[1]
    measured = {own.name: own.value for own in checked_metrics(test.pulse.accel_mps2, test.condition.speed_mps)}
    value, field = measured[name], {"max_crush": "crush", "peak": "peak"}[name]
    assert value is not None

    def inside(draws: FloatArray, lower: float | None, upper: float | None) -> bool:
        interval = Metric(name, value, lower, upper, "mm", drawn=True)
        others = tuple(own for own in checked_metrics(draws[0], test.condition.speed_mps) if own.name != name)
        estimate = Estimate(test.condition, draws[0], draws, approach="fused")
        vars(estimate)["metrics"] = (interval, *others)  # instead of those that it would compute
        return bool(getattr(Fold.of(test, [estimate], [60.0]).coverage("fused"), field))

    around, beside = (np.linspace(*ends, 21)[:, None] * test.pulse.accel_mps2 for ends in ((0.9, 1.1), (0.6, 0.8)))
    assert inside(beside, value - 1, value + 1)
    assert not inside(around, value + 1, value + 2)
    assert inside(around, None, None)
    assert not inside(beside, None, None)


def test_an_approach_without_a_band_has_no_spread(campaign: Campaign) -> None:
    """There is one pulse and one rating; who asks for a spread is told that there is none."""
    test = campaign.tests[1]
    fold = Fold.of(test, [Estimate(test.condition, test.pulse.accel_mps2, approach="cae")], [60.0])
    assert fold.with_band == ()
    with pytest.raises(UsageError, match="cae has no band"):
        fold.rating_draws("cae", 60.0)
    with pytest.raises(UsageError, match="There is no prediction of this test by 'fused'; choose from cae"):
        fold.estimate("fused")
    assert fold.ratings["cae"][60.0].overall == pytest.approx(1.0)


def test_what_folds_say_together_is_their_mean(campaign: Campaign) -> None:
    """Of a test in the middle of its band and one outside."""
    folds = []
    for test, ends in zip(campaign.tests[:2], ((0.5, 1.5), (2.0, 3.0)), strict=True):
        draws = np.linspace(*ends, 101)[:, None] * test.pulse.accel_mps2
        folds.append(Fold.of(test, [Estimate(test.condition, draws[50], draws, approach="fused")], [60.0]))
    study = Study(campaign, CONFIG, tuple(folds))
    np.testing.assert_allclose(study.reliability["fused"], np.full(19, 0.5), atol=0.01)
    assert study.plot("T1") == study.plot("T1", corridors=False) != study.plot("T1", corridors=True)


@pytest.fixture(scope="module")
def finished(campaign: Campaign, quick_networks: None, tmp_path_factory: pytest.TempPathFactory) -> Study:  # noqa: ARG001
    """A study of the small campaign with two tests held out, in one process."""
    return run_study(campaign, CONFIG, held_out=["T2", "T4"], cache=Cache(tmp_path_factory.mktemp("study")), workers=1)


def test_each_held_out_test_has_every_approach_rated_over_every_window(finished: Study) -> None:
    assert [fold.held_out for fold in finished.folds] == ["T2", "T4"]
    for fold in finished.folds:
        assert tuple(fold.ratings) == APPROACHES
        assert all(tuple(ratings) == (20.0, 60.0) for ratings in fold.ratings.values())


def test_the_rating_is_that_of_prediction_against_test(finished: Study) -> None:
    """The figure in the table is ISO/TS 18571 of the two pulses at 10 kHz over the window."""
    fold = finished.fold("T4")
    at = np.arange(600) * 1e-4
    test = finished.campaign.test("T4").pulse
    pair = [np.interp(at, test.time_s, accel) for accel in (test.accel_mps2, fold.estimate("cae").accel_mps2)]
    assert fold.ratings["cae"][60.0] == rate_iso18571(pair[0], pair[1], dt_s=1e-4)
    assert finished.mean_rating("cae", 60.0) == pytest.approx(
        np.mean([f.ratings["cae"][60.0].overall for f in finished.folds])
    )


@pytest.mark.parametrize(
    "approach", [pytest.param(name, marks=[pytest.mark.slow] * each.trains_networks) for name, each in CLASSES.items()]
)
def test_the_held_out_pulse_does_not_reach_its_own_prediction(
    campaign: Campaign, finished: Study, approach: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    pulse = campaign.test("T2").pulse
    changed = with_pulse(campaign, "T2", (1 + 0.5 * np.sin(200 * pulse.time_s)) * pulse.accel_mps2)
    cache = Cache(tmp_path_factory.mktemp("fresh"))
    study = run_study(changed, replace(CONFIG, approaches=(approach,)), held_out=["T2"], cache=cache, workers=1)
    before, after = finished.fold("T2").estimate(approach), study.fold("T2").estimate(approach)
    assert bits(after) == bits(before)
    assert study.fold("T2").ratings[approach][60.0] != finished.fold("T2").ratings[approach][60.0]


@pytest.mark.slow
def test_another_training_pulse_does_reach_the_prediction(campaign: Campaign, finished: Study) -> None:
    """The no-leak test above means something: what may be learnt from is learnt from."""
    changed = with_pulse(campaign, "T3", 0.8 * campaign.test("T3").pulse.accel_mps2).without(["T2"])
    for approach in ("time_domain", "displacement_domain"):
        estimate = estimate_at(changed, campaign.test("T2").condition, approach, CONFIG)
        assert np.abs(estimate.accel_mps2 - finished.fold("T2").estimate(approach).accel_mps2).max() > 1.0


@pytest.mark.slow
def test_leaving_a_speed_group_out_learns_from_other_speeds_only(campaign: Campaign) -> None:
    """T2 at 25 mph is predicted as if T3 at 26 mph did not exist; T4 has no companion, so nothing changes for it."""
    config = StudyConfig(approaches=("displacement_domain",), leave_out="speed group")
    study = run_study(campaign, config, held_out=["T2", "T4"], workers=1)
    for held_out, left_out in (("T2", ["T2", "T3"]), ("T4", ["T4"])):
        alone = estimate_at(campaign.without(left_out), campaign.test(held_out).condition, "displacement_domain")
        assert bits(study.fold(held_out).estimate("displacement_domain")) == bits(alone)


@pytest.mark.slow
def test_workers_do_not_change_the_numbers(campaign: Campaign) -> None:
    config = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(60.0,))
    caches = [Cache(Cache().folder / name) for name in ("one", "two")]
    one = run_study(campaign, config, held_out=["T1", "T2"], cache=caches[0], workers=1)
    two = run_study(campaign, config, held_out=["T1", "T2"], cache=caches[1], workers=2)
    for a, b in zip(one.folds, two.folds, strict=True):
        assert a.ratings == b.ratings
        for x, y in zip(a.estimates, b.estimates, strict=True):
            assert bits(x) == bits(y)


def _count_fits(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    fits: list[str] = []
    original: Callable[..., Approach] = DisplacementDomain.fit

    def counted(self: DisplacementDomain, campaign: Campaign, run: Run) -> Approach:
        fitted = original(self, campaign, run)
        fits.append(campaign.name)
        return fitted

    monkeypatch.setattr(DisplacementDomain, "fit", counted)
    return fits


@pytest.mark.slow
def test_the_cache_is_searched_once_for_each_prediction(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[str] = []
    find = Cache.find

    def noted(self: Cache, kind: str, *rest: object) -> object:
        asked.append(kind)
        return find(self, kind, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(Cache, "find", noted)
    config = StudyConfig(approaches=("cae", "displacement_domain"))
    for _ in range(2):
        run_study(campaign, config, held_out=["T2", "T4"], cache=Cache(tmp_path), workers=1)
    assert asked.count("predictions") == 2 * 4


@pytest.mark.slow
def test_results_of_other_code_stay_unused(campaign: Campaign, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With a change in the code that computes them, every kind of result is computed again beside the older ones."""

    def entries() -> Counter[str]:
        return Counter(path.parent.name for path in tmp_path.rglob("*.bin"))

    config = StudyConfig(approaches=("cae", "lf_tcn", "displacement_domain"))
    run_study(campaign, config, held_out=["T2"], cache=Cache(tmp_path), workers=1)
    before = entries()
    assert set(before) == {*KINDS, "lf_tcn", "code"}
    monkeypatch.setattr(Cache, "digest", lambda *_: "other")
    run_study(campaign, config, held_out=["T2"], cache=Cache(tmp_path), workers=1)
    assert {**entries(), "code": 0} == {**(before + before), "code": 0}


@pytest.mark.slow
def test_a_damaged_cache_is_computed_again(campaign: Campaign, tmp_path: Path) -> None:
    """With a byte flipped in every entry of every kind, the same study gives the same bits and mends the cache."""
    config = StudyConfig(approaches=("displacement_domain",))
    first = run_study(campaign, config, held_out=["T3"], cache=Cache(tmp_path), workers=1)
    entries = {path: path.read_bytes() for kind in KINDS for path in (tmp_path / kind).glob("*.bin")}
    assert {path.parent.name for path in entries} == KINDS
    for path, content in entries.items():
        path.write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:])
    second = run_study(campaign, config, held_out=["T3"], cache=Cache(tmp_path), workers=1)
    a, b = (study.fold("T3").estimate("displacement_domain") for study in (first, second))
    assert bits(a) == bits(b)
    for path in entries:
        checksum, _, payload = path.read_bytes().partition(b"\n")
        name = path.relative_to(tmp_path).as_posix().encode()
        assert hashlib.sha256(name + b"\n" + payload).hexdigest().encode() == checksum


@pytest.mark.slow
def test_two_studies_on_one_cache_learn_once(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the same time, with the same tests left out: who comes second takes what the first has learned."""
    fits = _count_fits(monkeypatch)
    config = StudyConfig(approaches=("displacement_domain",))
    with ThreadPoolExecutor(2) as pool:
        studies = list(pool.map(lambda _: run_study(campaign, config, held_out=["T1", "T2"], workers=1), range(2)))
    assert len(fits) == 2
    for test_id in ("T1", "T2"):
        one, other = (study.fold(test_id).estimate("displacement_domain") for study in studies)
        assert bits(one) == bits(other)


@pytest.mark.slow
def test_a_study_that_was_stopped_goes_on_where_it_was(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    fits = _count_fits(monkeypatch)
    config = StudyConfig(approaches=("displacement_domain",))
    watch = cancelled_after(lambda progress: progress.step == "Held-out predictions" and progress.done == 1)
    with pytest.raises(Cancelled):
        run_study(campaign, config, held_out=["T1", "T2"], watch=watch, workers=1)
    run_study(campaign, config, held_out=["T1", "T2"], workers=1)
    assert len(fits) == 2


@pytest.mark.slow
def test_both_ways_to_leave_out_give_one_study_beside_the_other(campaign: Campaign) -> None:
    config = StudyConfig(approaches=("displacement_domain",), windows_ms=(60.0,))
    both = run_study(campaign, replace(config, leave_out="both"), held_out=["T2"], workers=1)
    assert both.speed_groups is not None
    for found, way in zip((both, both.speed_groups), both.config.split_configs, strict=True):
        alone = run_study(campaign, way, held_out=["T2"], workers=1)
        assert found.mean_rating("displacement_domain", 60.0) == alone.mean_rating("displacement_domain", 60.0)
    assert both.mean_rating("displacement_domain", 60.0) != both.speed_groups.mean_rating("displacement_domain", 60.0)


def test_tests_of_one_speed_group_are_left_out_one_by_one_only(campaign: Campaign) -> None:
    """There is no other group to learn from, and that is no error where both was asked for."""
    alike = replace(campaign, tests=(campaign.tests[0], replace(campaign.tests[0], id="T5")))
    assert run_study(alike, StudyConfig(approaches=("cae",), leave_out="both"), workers=1).speed_groups is None


@pytest.mark.slow
def test_a_recommendation_for_a_test_does_not_know_its_pulse(campaign: Campaign, finished: Study) -> None:
    test = campaign.test("T2")
    changed = with_pulse(campaign, "T2", 0.5 * test.pulse.accel_mps2)
    study = run_study(changed, CONFIG, held_out=["T2"], workers=1)
    pairs = ((finished, campaign), (study, changed))
    first, second = (recommend_for(s.fold("T2").estimates, c.without(["T2"]), test.condition) for s, c in pairs)
    assert first == second
    assert first.expected is not None
