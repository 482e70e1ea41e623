"""The CAE model over time and displacement: what was run, else what is emulated from other runs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from sklearn.gaussian_process.kernels import Matern

from crashfuse.cae.model import CaeModel, Emulator, LoadingCurve
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.condition import Condition
from crashfuse.execution.run import Run
from crashfuse.signals.loading_phase import loading_phase
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray
from crashfuse.signals.rating import rate_iso18571
from crashfuse.units import MPH
from tests.conftest import SHARED, needs_shared, not_none

WORLDS = SHARED / "worlds"
ELSEWHERE = [pytest.param(world, marks=[needs_shared, pytest.mark.slow]) for world in ("alpha", "beta")]

OMEGA = 30.0


def pulse(condition: Condition) -> FloatArray:
    """A half sine that stops the vehicle, longer the heavier it is, then a rebound."""
    duration = 0.08 * condition.mass_kg / 1700
    peak = 1.1 * condition.speed_mps * np.pi / (2 * duration)
    return np.where(duration > GRID_S, -peak * np.sin(np.pi * GRID_S / duration), 0.0)


def half_sines(n: int, lowest_mps: float = 0.0) -> CaeLibrary:
    spread = np.random.default_rng(3).uniform([lowest_mps, 880.0, 620.0], [16.0, 1000.0, 800.0], (n, 3))
    conditions = tuple(Condition.of_vector(row) for row in spread)
    accel = np.array([pulse(condition) for condition in conditions], dtype=np.float32)
    return CaeLibrary(tuple(f"C{i}" for i in range(n)), conditions, accel)


def part(cae: CaeLibrary, chosen: FloatArray) -> CaeLibrary:
    ids, conditions = zip(*((cae.ids[i], cae.conditions[i]) for i in chosen.tolist()), strict=True)
    return CaeLibrary(ids, conditions, cae.accel_mps2[chosen])


@pytest.mark.parametrize("name", ["half sines", *ELSEWHERE])
def test_held_out_runs_rate_at_least_097(name: str) -> None:
    """Over 0–60 ms, runs from 5 mph on that were left out of the training."""
    cae = half_sines(80) if name == "half sines" else load_campaign(WORLDS / name).cae
    order = np.random.default_rng(0).permutation(len(cae))
    held_out = [i for i in order.tolist() if cae.conditions[i].speed_mps > 5 * MPH][:25]
    emulator = Emulator().fit(part(cae, np.setdiff1d(order, held_out)))
    window = GRID_S < 0.06
    runs = [(cae.accel_mps2[i][window].astype(float), cae.conditions[i]) for i in held_out]
    assert np.mean([rate_iso18571(run, emulator.predict(at)[window], dt_s=DT_S).overall for run, at in runs]) >= 0.97


def test_a_run_of_the_library_comes_back() -> None:
    """Where pulses are smooth in the condition, the emulator passes through the runs it was trained on."""
    cae = half_sines(60)
    emulator = Emulator().fit(cae)
    predicted = np.array([emulator.predict(condition) for condition in cae.conditions[:5]])
    assert np.abs(predicted - cae.accel_mps2[:5]).max() < 0.02 * np.abs(cae.accel_mps2).max()


def test_speeds_near_zero_break_nothing() -> None:
    """A library may start at 0 mph, where pulses vanish."""
    cae = half_sines(40)
    conditions = (*cae.conditions, Condition.of_vector([0.0, 950.0, 700.0]))
    cae = CaeLibrary((*cae.ids, "zero"), conditions, np.vstack([cae.accel_mps2, np.zeros((1, 1250), np.float32)]))
    emulator = Emulator().fit(cae)
    for speed in (0.0, 1e-3, 0.5, 10.0):
        assert np.isfinite(emulator.predict(Condition.of_vector([speed, 950.0, 700.0]))).all()


def test_beyond_the_fastest_run_the_change_of_velocity_grows_with_the_speed() -> None:
    """A crash a tenth faster than the library brakes a tenth harder; it does not fall back to a mean pulse."""
    emulator = Emulator().fit(half_sines(60))
    top = float(emulator.speed_range_[1])
    border, beyond = (emulator.predict(Condition.of_vector([factor * top, 950.0, 700.0])) for factor in (1.0, 1.1))
    np.testing.assert_allclose(beyond, 1.1 * border)


def test_noise_of_the_runs_is_not_interpolated() -> None:
    """Runs that scatter about a smooth model (folding that bifurcates) are averaged: closer to it than they are."""
    cae = half_sines(80, lowest_mps=8.0)
    scatter = 20 * np.random.default_rng(1).standard_normal((80, 1)) * np.sin(2 * np.pi * GRID_S / 0.03)
    emulator = Emulator().fit(CaeLibrary(cae.ids, cae.conditions, (cae.accel_mps2 + scatter).astype(np.float32)))
    error = np.array([emulator.predict(c) - pulse(c) for c in cae.conditions])
    assert np.sqrt(np.mean(error**2)) < 0.5 * np.sqrt(np.mean(scatter**2))


def test_no_other_length_scales_are_more_probable() -> None:
    """By the densities of scikit-learn's Matérn kernel with the noise that was found, each length alone 10 % off."""
    cae = half_sines(60, lowest_mps=2.0)
    found = Emulator().fit(cae)
    per_speed = cae.accel_mps2 / cae.vectors[:, :1]
    left = np.linalg.svd(per_speed - per_speed.mean(axis=0), full_matrices=False)[0]
    scores = left[:, : len(found.modes_)] * np.sqrt(len(cae))

    def log_posterior(lengths: FloatArray) -> float:
        total = -0.5 * float(np.sum(np.log(lengths / [0.5, 3.0, 3.0]) ** 2))
        for score, noise in zip(scores.T, found.noise_, strict=True):
            shape = Matern(lengths, nu=2.5)(found.inputs_) + noise * np.eye(len(cae))
            variance = score @ np.linalg.solve(shape, score) / len(cae)
            total += multivariate_normal(cov=variance * shape, allow_singular=True).logpdf(score)
        return total

    best = log_posterior(found.length_scales_)
    for off in (0.9, 1.1):
        for axis in range(3):
            assert log_posterior(found.length_scales_ * np.where(np.arange(3) == axis, off, 1.0)) < best


def test_its_errors_are_as_large_as_those_on_runs_it_has_not_seen() -> None:
    """Drawn errors have the root mean square of true ones on new runs, to a factor of two, at noisy pulses."""
    cae = half_sines(120, lowest_mps=4.0)
    noisy = cae.accel_mps2 * (1 + 0.1 * np.random.default_rng(0).standard_normal((120, 1)).astype(np.float32))
    cae = CaeLibrary(cae.ids, cae.conditions, noisy)
    new = np.arange(0, 120, 6)
    emulator = Emulator().fit(part(cae, np.setdiff1d(np.arange(120), new)))
    rng = np.random.default_rng(1)
    true = [cae.accel_mps2[i] - emulator.predict(cae.conditions[i]) for i in new]
    drawn = [emulator.errors(cae.conditions[i], 50, rng) for i in new]
    assert 0.5 < np.sqrt(np.mean(np.square(drawn)) / np.mean(np.square(true))) < 2.0
    assert np.abs(np.mean(drawn)) < 0.1 * np.std(drawn)


def spring_pulse(speed_mps: float) -> FloatArray:
    """A vehicle on a linear spring, a = -ω² s at every speed, that leaves the barrier as fast as it came."""
    return np.where(np.pi > OMEGA * GRID_S, -speed_mps * OMEGA * np.sin(OMEGA * GRID_S), 0.0)


def springs() -> CaeLibrary:
    """Runs of that vehicle up to 16 m/s."""
    spread = np.random.default_rng(0).uniform([1.0, 880.0, 620.0], [16.0, 1000.0, 800.0], (40, 3))
    conditions = tuple(Condition.of_vector(row) for row in [*spread.tolist(), [16.0, 950.0, 700.0]])
    accel = np.array([spring_pulse(condition.speed_mps) for condition in conditions], np.float32)
    return CaeLibrary(tuple(f"C{i}" for i in range(41)), conditions, accel)


def test_a_paired_run_beats_the_emulator(campaign: Campaign) -> None:
    model, condition = CaeModel().fit(campaign.cae), campaign.tests[0].condition
    run = not_none(campaign.cae.paired_run(condition))
    np.testing.assert_array_equal(model.pulse(condition).accel_mps2, campaign.cae.accel_mps2[run])
    assert model.notes(condition)[0] == f"CAE pulse: paired run {campaign.cae.ids[run]}."
    alone = Condition.of_vector([12.0, 930.0, 690.0])
    np.testing.assert_array_equal(model.pulse(alone).accel_mps2, model.emulator_.predict(alone))
    assert model.notes(alone)[0] == "CAE pulse: from the emulator."
    own = frozenset({campaign.cae.ids[run]})  # known where it is, and nothing learned from it
    known, others = (CaeModel().fit(cae) for cae in (replace(campaign.cae, paired_only=own), campaign.cae.without(own)))
    sources = f"run {campaign.cae.ids[run]}", "emulator"
    assert (known.pulse(condition).source, others.pulse(condition).source) == sources
    np.testing.assert_array_equal(known.emulator_.predict(condition), others.emulator_.predict(condition))


def test_the_emulator_is_trained_once(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    condition = Condition.of_vector([12.0, 930.0, 690.0])
    first = CaeModel().fit(campaign.cae, Run()).pulse(condition)
    monkeypatch.setattr(Emulator, "fit", lambda *_: pytest.fail("trained again"))
    np.testing.assert_array_equal(CaeModel().fit(campaign.cae, Run()).pulse(condition).accel_mps2, first.accel_mps2)


def test_beyond_its_crush_the_curve_goes_on_as_faster_runs_do() -> None:
    """On a linear spring every faster crash continues a = -ω² s; a flat line would be wrong by half."""
    curve = CaeModel().fit(springs()).loading_curve(Condition.of_vector([7.0, 950.0, 700.0]))
    crush = 7.0 / OMEGA
    s = np.linspace(crush, 2 * crush, 100)
    np.testing.assert_allclose(curve.accel_at(s), -(OMEGA**2) * s, rtol=0.02)


@pytest.mark.parametrize("share", [0.0, 0.25])
def test_the_curve_has_no_jump_where_one_pulse_takes_over_from_another(share: float) -> None:
    slow, fast = loading_phase(np.full(1250, -100.0), 8.0), loading_phase(np.full(1250, -180.0), 14.0)
    curve = LoadingCurve(slow, (fast,)).accel_at(np.linspace(0.0, 0.6, 6001), share)
    assert np.abs(np.diff(curve)).max() < 0.5
    assert curve[-1] == pytest.approx(-180.0, abs=1.0)


def test_curve_and_stop_together_give_the_pulse() -> None:
    """Along the CAE vehicle's own path, G_a(s) followed to a quarter of the speed plus its stop is its acceleration."""
    own = loading_phase(-300.0 * np.sin(np.pi * GRID_S / 0.07), 12.0)
    curve = LoadingCurve(own, (loading_phase(np.full(1250, -250.0), 15.0),))
    together = curve.accel_at(own.displacement_m, 0.25) + curve.stopping_accel(own.speed_share, 0.25)
    np.testing.assert_allclose(together, own.accel_mps2, atol=0.5)
    assert (curve.stopping_accel(np.array([0.3, 0.9]), 0.25) == 0).all()
