"""The displacement domain from campaign to prediction, on vehicles whose truth is known."""

import json
from dataclasses import replace

import numpy as np
import pytest

from crashfuse.approaches.calibration import Coverage
from crashfuse.approaches.displacement_domain.approach import DisplacementConfig, DisplacementDomain, measured_bias
from crashfuse.approaches.displacement_domain.dynamics import integrate
from crashfuse.approaches.displacement_domain.rebound import follow_unloading
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import NotFittedError
from crashfuse.execution.cache import NoCache
from crashfuse.execution.progress import SILENT, Progress, Watch
from crashfuse.execution.run import Run
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse, kinematics
from crashfuse.signals.rating import rate_windows
from tests.conftest import not_none

FEW = DisplacementConfig(n_draws=60)
SPEEDS = (5.0, 7.5, 10.0, 11.0, 13.0, 15.5)
S = np.linspace(0, 2, 2001)


def crash(force: FloatArray, speed_mps: float) -> FloatArray:
    """The pulse of a vehicle that brakes with ``force`` over displacement S and lets go within 5 ms."""
    motion = integrate(force[None], S[1], np.zeros((1, 2)), speed_mps)
    never = np.full(1250, -1.0)
    return np.asarray(follow_unloading(motion.accel_mps2, speed_mps, never, loading_phase(never, speed_mps))[0])


def cae_force() -> FloatArray:
    """The CAE model's braking over displacement, in m/s²."""
    return np.asarray(-120 * (1 - np.exp(-S / 0.04)) - 150 * S - 20 * np.sin(S / 0.05))


def bias() -> FloatArray:
    return np.asarray(-70 * np.exp(-(((S - 0.15) / 0.08) ** 2)) + 60 * np.exp(-(((S - 0.4) / 0.1) ** 2)))


def made_up(extra: FloatArray, speeds: tuple[float, ...] = SPEEDS) -> Campaign:
    """Tests at these speeds, each with a paired CAE run, of a vehicle whose bias is ``extra`` (one, or one a test)."""
    conditions = [Condition.of_vector([v, 950.0 + 5 * i, 700.0 + 3 * i]) for i, v in enumerate(speeds)]
    cae = np.array([crash(cae_force(), c.speed_mps) for c in conditions], np.float32)
    tests = tuple(
        CrashTest(f"T{i + 1}", c, Pulse(GRID_S, crash(cae_force() + own, c.speed_mps)))
        for i, (c, own) in enumerate(zip(conditions, np.broadcast_to(extra, (len(speeds), S.size)), strict=True))
    )
    return Campaign("Made up", CaeLibrary(tuple(f"C{i}" for i in range(len(speeds))), tuple(conditions), cae), tests)


@pytest.mark.slow
def test_a_perfect_cae_model_is_left_as_it_is() -> None:
    campaign = made_up(0 * S)
    pulses = [Pulse(GRID_S, accel.astype(float)) for accel in campaign.cae.accel_mps2]
    campaign = replace(
        campaign, tests=tuple(replace(t, pulse=pulse) for t, pulse in zip(campaign.tests, pulses, strict=True))
    )
    held_out = campaign.tests[2]
    prediction = DisplacementDomain(FEW).fit(campaign.without([held_out.id])).predict(held_out.condition)
    loading = loading_phase(held_out.pulse.accel_mps2, held_out.condition.speed_mps).t0_s > GRID_S
    error = (prediction.accel_mps2 - held_out.pulse.accel_mps2)[loading]
    assert np.abs(error).max() < 0.02 * np.abs(held_out.pulse.accel_mps2).max()


@pytest.mark.parametrize("held_out", ["T3", "T6"])
def test_a_known_bias_is_recovered(held_out: str) -> None:
    """A vehicle with a bias over displacement is predicted at a held-out speed, where the CAE model is poor."""
    campaign = made_up(bias())
    test = campaign.test(held_out)
    prediction = DisplacementDomain(FEW).fit(campaign.without([held_out])).predict(test.condition)
    run = not_none(campaign.cae.paired_run(test.condition))
    cae = Pulse(GRID_S, campaign.cae.accel_mps2[run].astype(float))
    corrected = rate_windows(test.pulse, Pulse(GRID_S, prediction.accel_mps2), [60.0])[60.0].overall
    assert corrected > 0.95
    assert corrected > rate_windows(test.pulse, cae, [60.0])[60.0].overall + 0.1


def test_a_bias_that_turns_from_speed_to_speed_is_not_carried_over() -> None:
    """Beyond its tests the prediction is nearly the CAE pulse, and its band holds vehicles with either bias."""
    speeds, turns = (6.0, 6.0, 9.0, 9.0, 12.0, 12.0, 15.0, 15.0), np.repeat([1, -1, 1, -1], 2)
    domain = DisplacementDomain(FEW).fit(made_up(np.multiply.outer(turns, 0.7 * bias()), speeds))
    beside, beyond = (domain.predict(Condition.of_vector([v, 970.0, 712.0])) for v in (15.0, 17.0))
    assert ["of its correction" in " ".join(one.notes) for one in (beside, beyond)] == [False, True]
    cae, band = domain.model_.pulse(beyond.condition).accel_mps2[:500], beyond.band()
    assert band is not None
    for sign in (1, -1):
        pulse = crash(cae_force() + sign * 0.7 * bias(), 17.0)[:500]
        assert np.abs(beyond.accel_mps2[:500] - cae).mean() < 0.1 * np.abs(pulse - cae).mean()
        assert ((band[0][:500] <= pulse) & (pulse <= band[1][:500])).mean() > 0.85


@pytest.mark.slow
def test_the_band_covers_velocity_and_crush() -> None:
    """Where tests differ as the model says, the 95 % band holds v(t) and crush of left-out tests so often."""
    rng = np.random.default_rng(4)
    distance = np.abs(np.subtract.outer(S[::20], S[::20])) / 0.08
    covariance = 15**2 * (1 + np.sqrt(5) * distance + 5 / 3 * distance**2) * np.exp(-np.sqrt(5) * distance)
    own = rng.multivariate_normal(np.zeros(101), covariance, size=len(SPEEDS), method="eigh")
    campaign = made_up(bias() + np.array([np.interp(S, S[::20], function) for function in own]))
    inside_v, inside_crush = [], []
    for test in campaign.tests:
        speed = test.condition.speed_mps
        domain = DisplacementDomain(DisplacementConfig(n_draws=200)).fit(campaign.without([test.id]))
        prediction = domain.predict(test.condition)
        drawn, truth = (kinematics(np.asarray(a), speed, DT_S) for a in (prediction.draws_mps2, test.pulse.accel_mps2))
        low, high = np.quantile(drawn.velocity_mps, [0.025, 0.975], axis=0)
        loading = slice(1, int(float(truth.t0_s) / DT_S))
        inside_v.append(np.mean(((low <= truth.velocity_mps) & (truth.velocity_mps <= high))[loading]))
        low, high = np.quantile(drawn.displacement_m.max(axis=1), [0.025, 0.975])
        inside_crush.append(low <= truth.displacement_m.max() <= high)
    assert np.mean(inside_v) > 0.85
    assert sum(inside_crush) >= len(SPEEDS) - 1


@pytest.mark.slow
def test_one_test_is_a_fallback_that_is_said() -> None:
    first, second, *_ = (campaign := made_up(bias())).tests
    prediction = DisplacementDomain(FEW).fit(replace(campaign, tests=(first,))).predict(second.condition)
    assert any("Only one test" in note for note in prediction.notes)
    assert np.isfinite(prediction.accel_mps2).all()


def test_vehicles_that_never_stop_within_the_record_are_predicted() -> None:
    """A CAE model and a car so soft that 100 ms are not enough: every sample has a finite value all the same."""
    conditions = [Condition.of_vector([v, 950.0, 700.0 + 5 * v]) for v in (12.0, 14.0, 16.0)]
    cae = np.array([np.full(1250, -5 * c.speed_mps) for c in conditions], np.float32)
    tests = [CrashTest(f"T{i}", c, Pulse(GRID_S, np.full(1250, -6 * c.speed_mps))) for i, c in enumerate(conditions)]
    campaign = Campaign("Soft", CaeLibrary(("A", "B", "C"), tuple(conditions), cae), tuple(tests))
    prediction = DisplacementDomain(FEW).fit(campaign.without(["T1"])).predict(conditions[1])
    assert np.isfinite(np.asarray(prediction.draws_mps2, dtype=float)).all()
    np.testing.assert_allclose(prediction.accel_mps2[200:1000], -6 * 14.0, rtol=0.1)


@pytest.mark.slow
def test_the_paper_preset_runs_and_tells_how_its_fit_went() -> None:
    """Table 4: 75 points for each projection of each test, 10 restarts; here with fewer, to be quick."""
    assert DisplacementConfig.paper() == DisplacementConfig(bias="table 4", projected_points=75, restarts=10)
    campaign = made_up(bias())
    config = replace(DisplacementConfig.paper(), n_draws=20, projected_points=8, restarts=1)
    model = DisplacementDomain(config).fit(campaign.without(["T3"]))
    assert np.asarray(model.predict(campaign.test("T3").condition).draws_mps2).shape == (20, 1250)
    assert json.loads(json.dumps(model.state))["points"] == 5 * 2 * 8
    assert "dead" in model.state


@pytest.mark.parametrize(("extra", "is_shared"), [(bias(), True), (0.0 * S, False)])
def test_seeds_share_what_none_of_them_changes(extra: FloatArray, is_shared: bool) -> None:
    """In one task a second seed learns, to the bit, what it learns alone; a fit that was retried is of its seed."""
    campaign, task = made_up(extra), Run(NoCache(), memory={})
    first, second = (DisplacementDomain(FEW, seed=seed).fit(campaign, task) for seed in (0, 1))
    alone = DisplacementDomain(FEW, seed=1).fit(campaign)
    assert (second.points_ is first.points_) == is_shared
    for name, array in alone.learned().arrays.items():
        np.testing.assert_array_equal(second.learned().arrays[name], array)
    at = campaign.tests[0].condition
    np.testing.assert_array_equal(second.predict(at).draws_mps2, alone.predict(at).draws_mps2)


@pytest.mark.slow
def test_progress_is_reported_and_the_seed_decides_the_draws(campaign: Campaign) -> None:
    seen: list[Progress] = []
    model = DisplacementDomain(FEW).fit(campaign, Run(watch=Watch(seen.append)))
    assert list(dict.fromkeys(p.step for p in seen)) == ["CAE emulator", "Bias model", "Check of the band"]
    check, state = model.state["band_check"], model.state
    assert isinstance(check, dict)
    assert check["left_out_tests"] == len(campaign.tests)
    assert dict(state["spread_factors"]).keys() == dict(state["hyperparameters"]).keys()  # type: ignore[call-overload]
    other, condition = DisplacementDomain(FEW, seed=1).restore(campaign, model.learned()), campaign.tests[0].condition
    drawn = [np.asarray(fit.predict(condition).draws_mps2) for fit in (model, other)]
    assert np.abs(drawn[0] - drawn[1]).max() > 1


def test_the_parts_of_the_bias_foresee_a_test_that_was_left_out(campaign: Campaign) -> None:
    held_out = campaign.tests[1]
    domain = DisplacementDomain().fit(campaign.without([held_out.id]))
    grid = np.linspace(0, 0.4, 41)
    *parts, total = domain.bias_parts(held_out.condition, grid)
    np.testing.assert_allclose(sum(part.mean_mps2 for part in parts), total.mean_mps2, atol=1e-6)
    bias = measured_bias(held_out, domain.model_)
    inside = (bias.displacement_m > 0.05) & (bias.displacement_m < 0.3)
    expected = np.interp(bias.displacement_m, grid, total.mean_mps2)
    assert np.sqrt(np.mean((bias.bias_mps2 - expected)[inside] ** 2)) < 0.5 * np.abs(bias.bias_mps2[inside]).max()
    with pytest.raises(NotFittedError):
        DisplacementDomain().bias_parts(held_out.condition, grid)


@pytest.mark.slow
def test_the_emulators_own_error_is_in_the_band() -> None:
    """Tests with paired runs say nothing of it, so where no run was made the band is wider by it."""
    campaign = made_up(bias())
    domain = DisplacementDomain(FEW).fit(campaign)
    between = replace(campaign.tests[2].condition, speed_mps=10.4)
    assert campaign.cae.paired_run(between) is None

    def width() -> float:
        return float(np.asarray(domain.predict(between).draws_mps2)[:, :400].std(axis=0).mean())

    with_error = width()
    domain.model_.emulator_.residuals_ = 0 * domain.model_.emulator_.residuals_
    assert with_error > 1.02 * width()


@pytest.mark.slow
def test_the_band_after_the_stop_holds_tests_that_rebound_in_their_own_way() -> None:
    """Tests that let go otherwise than the CAE model, each in its own way, lie inside when left out."""
    rng = np.random.default_rng(5)
    campaign = made_up(bias())
    tests = []
    for test in campaign.tests:
        accel = test.pulse.accel_mps2.copy()
        after = np.maximum(GRID_S - float(test.pulse.kinematics(test.condition.speed_mps).t0_s), 0.0)
        accel += (after > 0) * (40 + 15 * rng.normal()) * np.sin(np.pi * np.minimum(after / 0.02, 1.0))
        tests.append(replace(test, pulse=Pulse(GRID_S, accel)))
    campaign = replace(campaign, tests=tuple(tests))
    inside = []
    for test in campaign.tests[1:5]:
        prediction = DisplacementDomain(FEW).fit(campaign.without([test.id])).predict(test.condition)
        inside.append(Coverage.of(test, np.asarray(prediction.draws_mps2)).rebound)
        after = test.pulse.kinematics(test.condition.speed_mps).t0_s < GRID_S
        assert np.abs((prediction.accel_mps2 - test.pulse.accel_mps2)[after]).max() < 60
    assert np.mean(inside) > 0.85


@pytest.mark.slow
def test_of_many_tests_as_many_are_learned_from_as_an_exact_posterior_bears(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is what the thinned campaign teaches, tests left out included, and the prediction says so."""
    monkeypatch.setattr("crashfuse.approaches.base.MOST_TESTS", 3)
    monkeypatch.setattr("crashfuse.approaches.calibration.MOST_TESTS", 3)
    thinned, condition = campaign.evenly_over_speed(3), campaign.tests[1].condition
    domain, expected = DisplacementDomain().fit(campaign), DisplacementDomain().fit(thinned)
    one, other = domain.predict(condition), expected.predict(condition)
    np.testing.assert_array_equal(one.accel_mps2, other.accel_mps2)
    assert "Of 4 tests 3 were learned from, evenly over speed." in one.notes
    assert list(domain.left_out(campaign)) == list(thinned.test_ids)


@pytest.mark.slow
def test_a_left_out_group_says_nothing_of_its_tests() -> None:
    """Tests at one speed are predicted from the others alone, whatever they measured; a lone test as in left_out_."""
    campaign = made_up(bias(), (6.0, 10.0, 10.3, 15.5))
    group, others = [1, 2], [0, 3]
    domain = DisplacementDomain(FEW).fit(campaign)
    np.testing.assert_array_equal(domain.left_out_groups_.numbers, range(4))
    np.testing.assert_array_equal(domain.left_out_groups_.mean_mps2[others], domain.left_out_.mean_mps2[others])
    np.testing.assert_array_equal(domain.left_out_groups_.draws_mps2[others], domain.left_out_.draws_mps2[others])
    pulses = [Pulse(GRID_S, (1 + 0.3 * (i in group)) * t.pulse.accel_mps2) for i, t in enumerate(campaign.tests)]
    stiffer = (replace(test, pulse=pulse) for test, pulse in zip(campaign.tests, pulses, strict=True))
    changed = replace(campaign, tests=tuple(stiffer))
    again = DisplacementDomain(FEW).restore(changed, domain.learned())  # with the hyperparameters of the others
    again._calibrate(changed, {}, SILENT)
    expected = domain.left_out_groups_.mean_mps2[group]
    np.testing.assert_allclose(again.left_out_groups_.mean_mps2[group], expected, atol=1e-6 * np.abs(expected).max())
    assert np.abs(again.left_out_.mean_mps2[group] - domain.left_out_.mean_mps2[group]).max() > 1.0
