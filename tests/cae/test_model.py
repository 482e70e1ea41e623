"""The CAE model over time and displacement: what was run, else what is emulated."""

import numpy as np
import pytest

from crashfuse.cae.emulator import Emulator
from crashfuse.cae.model import CaeModel, LoadingCurve
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache
from crashfuse.signals.loading import loading_phase
from crashfuse.signals.pulse import GRID_S, FloatArray

OMEGA = 30.0


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
    """Where there is a run at the very condition it is taken as it is, and named."""
    model = CaeModel().fit(campaign.cae)
    condition = campaign.tests[0].condition
    run = campaign.cae.paired_run(condition)
    assert run is not None
    np.testing.assert_array_equal(model.pulse(condition).accel_mps2, campaign.cae.accel_mps2[run])
    assert model.pulse(condition).source == f"run {campaign.cae.ids[run]}"
    assert model.notes(condition)[0] == f"CAE pulse: paired run {campaign.cae.ids[run]}."


def test_without_a_paired_run_the_emulator_is_taken(campaign: Campaign) -> None:
    """At any other condition the pulse is the emulator's, and the notes say so."""
    model = CaeModel().fit(campaign.cae)
    condition = Condition.of_vector([12.0, 930.0, 690.0])
    np.testing.assert_array_equal(model.pulse(condition).accel_mps2, model.emulator_.predict(condition))
    assert model.notes(condition)[0] == "CAE pulse: from the emulator."


def test_conditions_outside_the_library_are_flagged(campaign: Campaign) -> None:
    """They are predicted all the same."""
    model = CaeModel().fit(campaign.cae)
    outside = Condition.of_vector([12.0, 1100.0, 690.0])
    assert any(note.startswith("Extrapolation: front weight") for note in model.notes(outside))
    assert np.isfinite(model.pulse(outside).accel_mps2).all()


def test_the_emulator_is_trained_once(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second model finds it in the cache and gives the same to the bit."""
    condition = Condition.of_vector([12.0, 930.0, 690.0])
    first = CaeModel(cache=Cache()).fit(campaign.cae).pulse(condition)
    monkeypatch.setattr(Emulator, "fit", lambda *_: pytest.fail("trained again"))
    np.testing.assert_array_equal(
        CaeModel(cache=Cache()).fit(campaign.cae).pulse(condition).accel_mps2, first.accel_mps2
    )


def test_within_its_crush_the_curve_is_the_pulse_itself(campaign: Campaign) -> None:
    """Up to the CAE vehicle's crush G_a(s) is its own acceleration over displacement."""
    curve = CaeModel().fit(campaign.cae).loading_curve(campaign.tests[1].condition)
    np.testing.assert_allclose(curve.accel_at(curve.own.displacement_m), curve.own.accel_mps2, atol=1e-9)


def test_beyond_its_crush_the_curve_goes_on_as_faster_runs_do() -> None:
    """On a linear spring every faster crash continues a = -ω² s; a flat line would be wrong by half."""
    model = CaeModel().fit(springs())
    curve = model.loading_curve(Condition.of_vector([7.0, 950.0, 700.0]))
    crush = 7.0 / OMEGA
    s = np.linspace(crush, 2 * crush, 100)
    np.testing.assert_allclose(curve.accel_at(s), -(OMEGA**2) * s, rtol=0.02)


def test_beyond_the_fastest_run_the_curve_is_level() -> None:
    """There is nothing to go by."""
    curve = CaeModel().fit(springs()).loading_curve(Condition.of_vector([16.0, 950.0, 700.0]))
    level = curve.accel_at(np.array([1.0, 2.0]))
    assert level[0] == level[1] == pytest.approx(-16.0 * OMEGA, rel=0.01)


@pytest.mark.parametrize("share", [0.0, 0.25])
def test_the_curve_has_no_jump_where_one_pulse_takes_over_from_another(share: float) -> None:
    """A slower pulse with another level hands over smoothly."""
    slow, fast = loading_phase(np.full(1250, -100.0), 8.0), loading_phase(np.full(1250, -180.0), 14.0)
    s = np.linspace(0.0, 0.6, 6001)
    curve = LoadingCurve(slow, (fast,)).accel_at(s, share)
    assert np.abs(np.diff(curve)).max() < 0.5
    assert curve[-1] == pytest.approx(-180.0, abs=1.0)


def test_curve_and_stop_together_give_the_pulse() -> None:
    """Along the CAE vehicle's own path, G_a(s) followed to a quarter of the speed plus its stop is its acceleration."""
    own = loading_phase(-300.0 * np.sin(np.pi * GRID_S / 0.07), 12.0)
    curve = LoadingCurve(own, (loading_phase(np.full(1250, -250.0), 15.0),))
    together = curve.accel_at(own.displacement_m, 0.25) + curve.stopping_accel(own.speed_share, 0.25)
    np.testing.assert_allclose(together, own.accel_mps2, atol=0.5)
    assert (curve.stopping_accel(np.array([0.3, 0.9]), 0.25) == 0).all()
