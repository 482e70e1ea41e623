"""Certification of a campaign: verdicts from all tests, and a record in which no test speaks for itself."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.certification.certify import Answer, Certification, Variant, certify_matrix, without_each_test
from crashfuse.certification.criteria import Criteria, Criterion, Tolerances, varied
from crashfuse.certification.domain import Domain
from crashfuse.certification.earlier import parse_earlier
from crashfuse.certification.forecasts import Plan, Query, spreads, training
from crashfuse.certification.matrix import Matrix
from crashfuse.certification.track_record import TrackRecord
from crashfuse.certification.verdict import Verdict, Word, all_met
from crashfuse.condition import Condition
from crashfuse.errors import DataError, UsageError
from crashfuse.execution.run import Run
from crashfuse.execution.workers import Local
from crashfuse.results.certification import certification_json, certification_record, certification_result
from crashfuse.results.certification_facts import facts, spot_check
from crashfuse.results.certification_tables import certification_table, planned, track_record_table
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.signals.sensor_faults import SensorFault
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate, estimate_at
from crashfuse.study.facts import campaign_facts
from crashfuse.units import KPH, MPH, G

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("one_cache")]

CONFIG, CAE = StudyConfig(approaches=("displacement_domain",)), StudyConfig(approaches=("cae",))
CRUSH, PEAK = Criterion("crush", "max_crush", at_most=430.0), Criterion("peak", "peak", at_most=25.0)
RATING = Criterion("rating", "rating", at_least=0.6, window_ms=60.0)
CRITERIA = Criteria((CRUSH, PEAK, RATING))


def matrix(campaign: Campaign, *speeds_mph: float) -> Matrix:
    """Conditions at these speeds with the weights of the second test."""
    here = campaign.tests[1].condition
    conditions = tuple(replace(here, speed_mps=v * MPH) for v in speeds_mph)
    return Matrix(tuple(f"M{v:g}" for v in speeds_mph), conditions)


def certified(campaign: Campaign, criteria: Criteria = CRITERIA) -> Certification:
    """Verdicts at 20, 30 and 70 mph."""
    return certify_matrix(campaign, criteria, matrix(campaign, 20.0, 30.0, 70.0), CONFIG)


def run_already(certification: Certification) -> dict[str, str]:
    """What is told of the tests at conditions that were run."""
    return {own.id: own.why for own in planned(certification) if own.word == "was run"}


def estimates(campaign: Campaign, verdict: Verdict) -> list[Estimate]:
    """The prediction there by each seed that the verdict is averaged over."""
    seeds = [replace(CONFIG, seed=seed) for seed in range(2)]
    return [estimate_at(campaign, verdict.condition, "displacement_domain", seed) for seed in seeds]


def test_a_spot_check_is_a_criterion_on_the_rating_of_one_planned_test(campaign: Campaign) -> None:
    """Each has the probability of a rating criterion; one drawn at random the mean, as simulated draws come out."""
    found = certified(campaign)
    of_rating = {i: row[2].probability for i, row in found.rows.items() if row[2].word != "outside"}
    assert found.spot_checks == of_rating
    assert list(of_rating) == ["M20", "M30"]
    without = certified(campaign, Criteria((CRUSH, PEAK)))
    good = certified(campaign, Criteria((CRUSH, PEAK, replace(RATING, at_least=0.8))))
    assert without.spot_checks == good.spot_checks
    assert all(good.spot_checks[i] < p for i, p in of_rating.items() if p)
    assert without.judged[0] == good.judged[0][:2]
    told, met = spot_check(good), [all_met(good.rows[i]).probability for i in good.spot_checks]
    rng = np.random.default_rng(0)
    drawn = rng.integers(2, size=100_000)
    chances = np.array([[*good.spot_checks.values()], met])[:, drawn]
    shares = (rng.random(chances.shape) < chances).mean(axis=1)
    assert [told["rates"], told["meets"]] == pytest.approx(shares, abs=0.005)
    assert (told["tests"], told["least"]) == (2, min(good.spot_checks.values()))
    assert certification_record(good)["spot_check"] == told
    table = certification_table(good).groupby("id")["spot_check"].first()
    assert table.dropna().to_dict() == good.spot_checks
    there = certify_matrix(campaign, CRITERIA, Matrix(("T",), (campaign.tests[2].condition,)), CAE)
    assert (there.spot_checks, spot_check(there)) == ({}, {})


def test_tolerances_scatter_what_a_planned_test_shows(campaign: Campaign) -> None:
    """Each is a normal: of a pulse whose metrics are known as formulas, and in the probability by simulation."""

    def half_sine(at: Condition) -> FloatArray:
        """A vehicle on a spring: peak v0 w, crush v0 / w, w the root of stiffness over mass."""
        w = np.sqrt(5e5 / at.mass_kg)
        return np.asarray(-at.speed_mps * w * np.sin(w * GRID_S) * (w * GRID_S < np.pi))

    at = Condition.of_vector([12.0, 900.0, 700.0])
    told = spreads(half_sine, at, Tolerances(0.5, 0.02, 0.01), campaign.occupant)
    peak, by_weight = np.sqrt(5e5 / 1600) * 12.0, 0.02 * np.array([900, 700]) / 1600 / 2
    parts = [0.5 * KPH / 12.0, *by_weight]
    assert told["peak"] == pytest.approx(peak / G * np.hypot.reduce([*parts, 0.01]), rel=0.01)
    of_speed = spreads(half_sine, at, Tolerances(0.5), campaign.occupant)
    assert of_speed["max_crush"] == pytest.approx(1e3 * 0.5 * KPH / np.sqrt(5e5 / 1600), rel=0.01)
    none = spreads(half_sine, at, Tolerances(), campaign.occupant)
    assert {none[name] for name in ("peak", "max_crush", "mean")} == {0.0}

    criteria = Criteria((CRUSH, PEAK, RATING), tolerances=Tolerances(1.0, 0.02, 0.02))
    plain, asked = (certify_matrix(campaign, own, matrix(campaign, 20.0), CAE) for own in (CRITERIA, criteria))
    emulator = CaeModel().fit(campaign.cae).emulator_
    here, rng = plain.matrix.conditions[0], np.random.default_rng(0)
    for number, limit in enumerate((CRUSH, PEAK)):
        (before, after) = (own.judged[0][number] for own in (plain, asked))
        sd = spreads(emulator.predict, here, criteria.tolerances or Tolerances(), campaign.occupant)[limit.metric]
        forecast = Plan.of(campaign, CRITERIA, plain.matrix, replace(CAE, windows_ms=(60.0,)), Run.of(campaign))
        (known,) = forecast.forecasts.averaged(forecast.cells, "").values()
        centre, scale, freedom, *_ = known.distributions[0, known.names.index(limit.metric)]
        drawn = centre + scale * rng.standard_t(freedom, 200_000) + sd * rng.standard_normal(200_000)
        assert after.probability == pytest.approx((drawn <= limit.at_most).mean(), abs=0.005)
        assert after.upper - after.lower > before.upper - before.lower  # type: ignore[operator]
    assert asked.judged[0][2] == plain.judged[0][2]  # a rating has no tolerance
    assert parse_earlier(certification_json(asked)).criteria.tolerances == criteria.tolerances
    assert "1 km/h, 2 % of each weight" in certification_result(asked).sentences["verdicts"][-1]
    assert "No tolerance" in certification_result(plain).sentences["verdicts"][-1]
    assert asked.record.decided == plain.record.decided


def test_values_and_intervals_are_those_of_the_prediction(campaign: Campaign) -> None:
    """A verdict rests on the numbers that predict shows at the same condition, averaged over seeds."""
    found = certified(campaign)
    assert [cell for cell, _ in found.cells] == [name for name in ("M20", "M30", "M70") for _ in range(3)]
    for verdict in found.verdicts[0][:2]:
        metrics = (m for estimate in estimates(campaign, verdict) for m in estimate.metrics)
        said = [(m.value, m.lower, m.upper) for m in metrics if m.name == verdict.criterion.metric]
        by_seed, shown = np.array(said, float), np.array([verdict.value, verdict.lower, verdict.upper], float)
        assert ((by_seed.min(axis=0) <= shown) & (shown <= by_seed.max(axis=0))).all()
        assert verdict.drawn.mean() == pytest.approx(verdict.probability, abs=1 / verdict.drawn.size)
    assert {own.word for own in found.verdicts[2]} == {"outside"}
    for each in (found, found.matrix, found.criteria, found.record, found.verdicts[0][0]):
        assert len(repr(each)) < 200, each


def test_the_record_is_what_each_left_out_test_showed(campaign: Campaign) -> None:
    """Measured metrics of the test, ratings of the prediction against it; both ways of leaving out."""
    found = certified(campaign)
    record = found.record
    ways = {(trial.held_out, trial.left_out) for trial in record.trials}
    assert ways == {(test, way) for test in campaign.test_ids for way in ("test", "speed group")}
    whole = []
    for trial in record.trials:
        test, criterion = campaign.test(trial.held_out), trial.verdict.criterion
        if criterion.metric == "rating":
            held_out = campaign.speed_group(test.id) if trial.left_out == "speed group" else [test.id]
            paired = campaign.cae.paired_ids(campaign.test(own).condition for own in held_out)
            others = replace(campaign.without(held_out), cae=campaign.cae.without(paired))
            said = estimates(others, trial.verdict)
            rated = [rate_windows(test.pulse, Pulse(GRID_S, own.accel_mps2), [60.0])[60.0].overall for own in said]
            assert len(paired) == len(held_out)
            assert trial.measured == pytest.approx(np.mean(rated))
            assert trial.cae_probability is None
            bands = [band for own in said if (band := own.whole_band()) is not None]
            if bands and (trial.left_out == "test" or len(held_out) > 1):
                band = np.mean(bands, axis=0)
                is_inside = (band[0] <= test.pulse.accel_mps2) & (test.pulse.accel_mps2 <= band[1])
                whole.append((trial.left_out, bool(is_inside[GRID_S < 0.06].all())))
        else:
            measured = metric_values(test.pulse.accel_mps2, test.condition.speed_mps)[criterion.metric]
            assert trial.measured == pytest.approx(float(measured))
            assert trial.cae_probability is not None
    assert len(record.counted) == 3 * (4 + 2)  # the tests at 25 and 26 mph are the only group of more than one
    assert sorted(record.whole) == sorted(whole)
    assert {way: n for way, (_, n) in record.whole_pulses.items()} == {"test": 4, "speed group": 2}
    (told,) = [own.values for own in facts(found) if own.code == "record.whole"]
    assert (told["test"], told["narrow"]) == (record.whole_pulses["test"], False)


def tuned_to(campaign: Campaign, *tests: str) -> Campaign:
    """The campaign whose CAE model was tuned to these tests, and to no other."""
    return replace(campaign, tests=tuple(replace(test, cae_tuned=test.id in tests) for test in campaign.tests))


def test_a_test_that_the_cae_model_was_tuned_to_teaches_and_supports_nothing(campaign: Campaign) -> None:
    """Predictions are the same; its trials stand apart, its row is not counted, and its domain is not checked."""
    before, found = certified(campaign), certified(tuned_to(campaign, "T2"))
    record = found.record
    assert {trial.held_out for trial in record.trials} == {"T1", "T3", "T4"}
    assert {trial.held_out for trial in record.tuned} == {"T2"}
    key = [(trial.held_out, trial.left_out) for trial in before.record.trials]
    of = {(t.held_out, t.left_out, t.verdict.criterion.name): t for t in (*record.trials, *record.tuned)}
    assert len(of) == len(key)
    for trial in before.record.trials:
        same = of[trial.held_out, trial.left_out, trial.verdict.criterion.name]
        assert same.verdict.chances == trial.verdict.chances
    assert [v.chances for _, v in found.cells] == [v.chances for _, v in before.cells]
    assert (before.domain.n_tests, found.domain.n_tests) == (4, 3)
    assert {verdict.word for _, verdict in found.cells} == {"outside"}  # three tests check nothing
    assert found.record.waived(CRITERIA)[0] == 3
    assert len(record.whole) < len(before.record.whole)
    table, unsaid = track_record_table(found), track_record_table(before)["tuned"]
    assert (set(table[table["tuned"]]["held_out"]), unsaid.isna().all()) == ({"T2"}, True)
    assert not table[table["tuned"]]["counted"].any()
    told = certification_record(found)
    assert told["cae_tuned"] == {"T1": False, "T2": True, "T3": False, "T4": False}
    assert told["track_record"]["tuned"]["tests"]["n"] <= 1  # type: ignore[index]


@pytest.mark.parametrize(("tuned", "unknown"), [((), 4), (("T1", "T4"), 0), (("T1", "T2", "T3", "T4"), 0)])
def test_what_the_cae_model_has_seen_is_said(campaign: Campaign, tuned: tuple[str, ...], unknown: int) -> None:
    """That it is not said, too; with every test tuned to there is no record, and nothing is decided."""
    found = certified(tuned_to(campaign, *tuned) if tuned else campaign)
    (told,) = [fact for fact in facts(found) if fact.code == "tests.cae_tuned"]
    assert (told.values["tuned"], len(told.values["unknown"])) == (list(tuned), unknown)  # type: ignore[arg-type]
    assert (told in campaign_facts(found.campaign)) is False or tuned
    if len(tuned) == 4:
        assert not found.record.trials
        assert [fact.code for fact in facts(found)].count("record.none") == 1
        assert not any(verdict.decided for _, verdict in found.cells)


def test_a_test_that_was_tuned_to_still_stands_at_its_condition(campaign: Campaign) -> None:
    """It was run there, and what it measured is told, however it was used."""
    here = campaign.tests[1].condition
    at = Matrix(("M",), (here,))
    found = certify_matrix(tuned_to(campaign, "T2"), CRITERIA, at, CAE)
    assert found.run == {"M": ("T2",)}
    assert found.rows["M"][0].run["T2"] is not None


def test_a_held_out_test_has_no_say_in_its_own_verdict(campaign: Campaign) -> None:
    """With another pulse, and another CAE run, it gets the same verdict to the bit; that of the others changes."""
    test, cae = campaign.test("T3"), campaign.cae
    tests = tuple(replace(t, pulse=Pulse(GRID_S, 1.3 * t.pulse.accel_mps2)) if t is test else t for t in campaign.tests)
    accel = cae.accel_mps2.copy()
    accel[cae.paired_run(test.condition)] *= 1.2
    other = replace(campaign, tests=tests, cae=replace(cae, accel_mps2=accel))
    before, after = certified(campaign).record, certified(other).record
    for one, two in zip(before.trials, after.trials, strict=True):
        if one.held_out == "T3" or (one.held_out == "T2" and one.left_out == "speed group"):
            assert one.verdict == two.verdict
            np.testing.assert_array_equal(one.verdict.drawn, two.verdict.drawn)
            assert one.cae_probability == two.cae_probability
        else:
            assert one.verdict.probability != two.verdict.probability


def test_nobody_can_choose_the_seed(campaign: Campaign) -> None:
    """Whatever the seed of the config, verdicts are the same to the bit; what the first seed alone would say is not."""
    few = replace(campaign, tests=campaign.tests[:2])
    found, other = (certify_matrix(few, CRITERIA, matrix(few, 20.0), replace(CONFIG, seed=seed)) for seed in (0, 5))
    assert (found.verdicts, found.record.trials) == (other.verdicts, other.record.trials)
    assert len({*found.verdicts[0][0].chances}) > 1


@pytest.mark.parametrize("all_have_runs", [False, True])
def test_left_out_tests_have_a_cae_run_where_all_planned_ones_do(campaign: Campaign, *, all_have_runs: bool) -> None:
    """Else the record is made without, and that with these runs stands beside it."""
    planned = Matrix(("P",), (campaign.tests[1].condition,)) if all_have_runs else matrix(campaign, 20.0)
    found = certify_matrix(campaign, CRITERIA, planned, CAE)
    assert (found.record_with_runs is None) == all_have_runs
    told: Any = certification_record(found)["track_record"]
    assert ("with_paired_runs" in told) != all_have_runs
    assert all_have_runs or "record.with_runs" in {fact.code for fact in facts(found)}
    if found.record_with_runs is not None:
        assert told["with_paired_runs"]["decided"]["n"] == found.record_with_runs.decided[0]
        pairs = zip(found.record.trials, found.record_with_runs.trials, strict=True)
        assert any(one.verdict.probability != other.verdict.probability for one, other in pairs)


def test_other_limits_take_no_new_prediction(
    campaign: Campaign, fitting_is_an_error: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forecasts are kept; only the window of a rating is part of them."""
    certified(campaign)
    fitting_is_an_error()
    monkeypatch.setattr("crashfuse.certification.forecasts.Forecast.of", None)
    other = Criteria((replace(CRUSH, at_most=500.0), replace(PEAK, at_most=20.0), replace(RATING, at_least=0.9)), 0.8)
    assert certified(campaign, other).criteria == other


def test_a_confidence_that_the_record_does_not_support_leaves_every_verdict_open(campaign: Campaign) -> None:
    """Four tests cannot support 0.999; the reason says what would."""
    found = certified(campaign, replace(CRITERIA, declared=0.999))
    inside = [own for row in found.verdicts[:2] for own in row]
    assert {own.word for own in inside} == {"open"}
    sure = [own for own in inside if own.probability is not None and not 0.001 < own.probability < 0.999]
    assert sure
    assert all("enough for a confidence of" in own.reason and "not of 0.999" in own.reason for own in sure)


def test_a_limit_that_no_test_comes_near_is_named(campaign: Campaign) -> None:
    """The verdict stays, and says that the record tells nothing about it."""
    far = Criterion("far", "max_crush", at_most=3000.0)
    verdict = certified(campaign, Criteria((CRUSH, PEAK, RATING, far), 0.8)).verdicts[0][3]
    assert verdict.word == "met"
    assert "No hidden test came near this limit" in verdict.reason


@pytest.mark.parametrize("n", [1, 2, 3])
def test_three_tests_or_fewer_give_no_verdict(campaign: Campaign, n: int) -> None:
    """Every condition is outside, with the numbers of the prediction."""
    few = replace(campaign, tests=campaign.tests[:n])
    found = certify_matrix(few, Criteria((CRUSH,)), matrix(campaign, 20.0), CAE)
    [[verdict]] = found.verdicts
    assert verdict.word == "outside"
    assert "too few to check verdicts" in verdict.reason
    assert verdict.probability is not None
    assert {trial.held_out for trial in found.record.trials} == (set(few.test_ids) if n > 1 else set())


def test_a_metric_that_no_pulse_is_long_enough_for_leaves_the_others_judged(campaign: Campaign) -> None:
    """An occupant who flies 1 m meets no restraint in 100 ms: OLC is open, and said to be so, beside a crush."""
    campaign = replace(campaign, occupant=replace(campaign.occupant, olc_free_flight_mm=1000.0))
    both = Criteria((Criterion("slow", "olc", at_most=10.0), Criterion("wide", "max_crush", at_most=5000.0)), 0.8)
    found = certify_matrix(campaign, both, matrix(campaign, 20.0), CAE)
    [[slow, wide]] = found.verdicts
    assert (slow.word, slow.probability, wide.word) == ("open", None, "met")
    assert "too early to tell the OLC" in slow.reason
    assert (found.waived, found.run_first) == ({}, None)
    assert found.answers == {"M20": "cannot say"}


def test_the_settings_are_those_that_were_used(campaign: Campaign) -> None:
    """Tests are left out both ways, and ratings are over the windows of the criteria, 60 ms if these have none."""
    twenty = replace(RATING, window_ms=20.0)
    for items, windows in (((CRUSH, twenty), (20.0,)), ((CRUSH,), (60.0,))):
        config = certify_matrix(campaign, Criteria(items), matrix(campaign, 20.0), CAE).config
        assert (config.windows_ms, config.leave_out) == (windows, "both")


def test_what_cannot_be_judged_is_refused(campaign: Campaign) -> None:
    """No test, or a window longer than a record."""
    with pytest.raises(UsageError, match="this campaign has none"):
        certify_matrix(replace(campaign, tests=()), CRITERIA, matrix(campaign, 20.0), CONFIG)
    short = replace(campaign, tests=(replace(campaign.tests[0], recorded_s=0.05), *campaign.tests[1:]))
    with pytest.raises(DataError, match="a record over 0–60 ms, found 50 ms"):
        certify_matrix(short, CRITERIA, matrix(campaign, 20.0), CONFIG)


def test_two_processes_find_as_one_does(campaign: Campaign, monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    """The same verdicts to the bit."""
    few = replace(campaign, tests=campaign.tests[:2])
    asked = matrix(campaign, *np.linspace(16.0, 34.0, 5).tolist())
    found = []
    for n in (1, 2):
        monkeypatch.setenv("CRASHFUSE_CACHE", f"{tmp_path}/{n}")
        found.append(certify_matrix(few, CRITERIA, asked, CONFIG, Run(workers=Local(n))))
    assert found[0].verdicts == found[1].verdicts
    assert found[0].record.trials == found[1].record.trials


def test_a_condition_that_was_run_is_said_to_be_that_test(campaign: Campaign) -> None:
    """By speed and weights as tables are rounded; with what it measured, and the rating that it got when left out."""
    test = campaign.tests[1]
    rounded = replace(test.condition, speed_mps=1.001 * test.condition.speed_mps)
    apart = replace(test.condition, speed_mps=1.003 * test.condition.speed_mps)
    found = certify_matrix(campaign, CRITERIA, Matrix(("P1", "P2", "P3"), (test.condition, rounded, apart)), CAE)
    assert found.run == {"P1": (test.id,), "P2": (test.id,)}
    crush, _, rating = found.verdicts[0]
    measured = metric_values(test.pulse.accel_mps2, test.condition.speed_mps)
    assert crush.run[test.id] == pytest.approx(measured["max_crush"])
    trials = {(one.held_out, one.left_out, one.verdict.criterion): one for one in found.record.trials}
    assert rating.run == {test.id: trials[test.id, "test", RATING].measured}
    assert (found.answers["P1"], found.answers["P2"]) == ("was run", "was run")
    assert [*run_already(found).values()] == [f"{test.id} missed peak deceleration"] * 2
    assert certification_table(found)["test"].tolist() == [test.id] * 6 + [""] * 3
    assert certification_record(found)["run"]["P1"][test.id]["crush"] == crush.run[test.id]  # type: ignore[index]


def test_a_test_that_was_made_for_a_condition_counts_as_run_there_though_a_little_off(campaign: Campaign) -> None:
    """Up to 1 km/h and 2 % of each weight; of two conditions the nearer one is meant. Nobody hits them to 0.2 %."""
    test = campaign.tests[1]
    near, far, other = (
        replace(test.condition, speed_mps=test.condition.speed_mps + off * KPH) for off in (0.9, -0.95, 1.1)
    )
    loose, tight = (Criteria((Criterion("crush", "max_crush", at_most=most),), 0.5) for most in (1e4, 1e-4))
    for criteria in (loose, tight):
        found = certify_matrix(campaign, criteria, Matrix(("P1", "P2", "P3"), (near, far, other)), CAE)
        assert found.run == {"P1": (test.id,)}
        assert not {"P1"} & {*found.waived}
    assert run_already(found)["P1"] == f"{test.id} missed crush"
    failed = replace(test, faults=(SensorFault("spike", 0.03, 0.03, 60 * G, 2.0),))
    tests = tuple(failed if one.id == test.id else one for one in campaign.tests)
    doubtful = replace(found, campaign=replace(campaign, tests=tests))
    assert "spike of 60.0 g at 30.0 ms" in run_already(doubtful)["P1"]
    ran = f"Test {test.id} was run for it, at {test.condition}: it measured "
    assert ran in found.verdicts[0][0].reason
    assert certify_matrix(campaign, loose, Matrix(("P3",), (other,)), CAE).run == {}


CRUSH_500, PEAK_30 = Criterion("crush", "max_crush", at_most=500.0), Criterion("peak", "peak", at_most=30.0)
Said = tuple[Word, float | None]


def answer(campaign: Campaign, crush: Said, peak: Said, *tests: str) -> Answer:
    """The answer at a condition with these verdicts, where these tests were run; the confidence is 0.95."""
    here = campaign.tests[0].condition
    row = tuple(
        Verdict(here, criterion, 1.0, 0.9, 1.1, probability, word, "", dict.fromkeys(tests, 1.0))
        for criterion, (word, probability) in ((CRUSH_500, crush), (PEAK_30, peak))
    )
    criteria, domain = Criteria((CRUSH_500, PEAK_30)), Domain.of(campaign)
    config, record = StudyConfig(approaches=("fused",)), TrackRecord(())
    made = Certification(campaign, criteria, Matrix(("M",), (here,)), config, domain, (row,), (row,), record, {})
    return made.answers["M"]


@pytest.mark.parametrize(
    ("crush", "peak", "said"),
    [
        (("met", 0.99), ("met", 0.98), "skip"),
        (("met", 0.96), ("met", 0.96), "run"),  # both at once: 0.92 at least
        (("not met", 0.01), ("met", 0.99), "would miss"),
        (("not met", 0.01), ("open", 0.5), "would miss"),  # takes another design, whatever is open
        (("outside", 0.9), ("not met", 0.01), "would miss"),
        (("open", 0.5), ("met", 0.99), "run"),
        (("open", None), ("open", 0.5), "run"),
        (("open", None), ("met", 0.99), "cannot say"),
        (("outside", 0.9), ("outside", 0.9), "cannot say"),
    ],
)
def test_the_verdicts_of_a_condition_make_one_answer(campaign: Campaign, crush: Said, peak: Said, said: Answer) -> None:
    """A test need not be run only where all criteria are met at once with the confidence."""
    assert answer(campaign, crush, peak) == said


@pytest.mark.parametrize("word", ["met", "not met", "open", "outside"])
def test_a_condition_that_was_run_has_no_other_answer(campaign: Campaign, word: Word) -> None:
    """Whatever the verdict on another test there."""
    assert answer(campaign, (word, 0.99), (word, 0.99), "T1") == "was run"


def test_variants_are_what_the_same_certification_says_if_asked_otherwise(campaign: Campaign) -> None:
    """Limits 5 % stricter and looser and two confidences each time."""
    two = Criteria((Criterion("mean", "mean", at_least=8.0, at_most=16.0), RATING), 0.8)
    found, others = certified(campaign, two), varied(two)
    assert others["limits 5 % stricter"].items[0] == Criterion("mean", "mean", at_least=8.4, at_most=0.95 * 16)
    assert others["limits 5 % looser"].items[1].at_least == pytest.approx(0.57)
    assert [own.confidence for own in others.values()] == [0.9, 0.99, 0.8, 0.8]
    assert [*found.variants] == [Variant.of(name, found, certified(campaign, own)) for name, own in others.items()]
    assert any(own.changed for own in found.variants)


def test_each_test_is_left_out_if_asked_for(campaign: Campaign) -> None:
    """As if each had been asked for alone."""
    asked = CRITERIA, matrix(campaign, 20.0, 30.0), CAE
    found = certify_matrix(campaign, *asked)
    first, *others = without_each_test(found, Run()).variants[len(found.variants) :]
    assert [(own.name, own.left_out) for own in others] == [(f"without {i}", i) for i in campaign.test_ids[1:]]
    assert first == Variant.of("without T1", found, certify_matrix(found.without("T1"), *asked))
    assert first.left_out == "T1"


@pytest.mark.parametrize("approach", ["cae", "displacement_domain", "time_domain", "fused"])
def test_a_fit_without_a_test_serves_its_cae_run_and_what_if(campaign: Campaign, approach: str) -> None:
    """Equal keys are one fit; with its run, the CAE pulse is known where a test is predicted, and no test's changes."""
    config, planned = StudyConfig(approaches=(approach,)), matrix(campaign, 20.0)
    plan, key = Plan.of(campaign, CRITERIA, planned, config, Run()), config.create(approach).fit_key
    for asked in plan.with_runs:
        without, known = (
            training(plan.forecasts.campaign, asked._replace(runs=runs)) for runs in ("dropped", "paired")
        )
        assert key(without) == key(known)
        assert without.cae.paired_run(asked.condition) is None is not known.cae.paired_run(asked.condition)
    what_if = Plan.of(plan.without("T4"), CRITERIA, planned, config, Run())
    assert key(training(what_if.forecasts.campaign, what_if.cells[0])) == key(plan.without("T4"))
    twins = replace(campaign, tests=(*campaign.tests, replace(campaign.tests[0], id="T0")))
    assert not training(twins, Query(("T0",), approach, twins.tests[0].condition, "paired")).cae.paired_only
