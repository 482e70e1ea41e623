"""The time domain: it learns the CAE model, then the tests; seeds, cache and cancelling behave."""

import threading
from dataclasses import replace

import numpy as np
import pytest
import torch

from crashfuse.approaches.tcn import TcnConfig
from crashfuse.approaches.time_domain import LfTcn, TimeDomain
from crashfuse.cache import Cache
from crashfuse.campaign import CaeLibrary, Campaign, CrashTest
from crashfuse.errors import Cancelled, NotFittedError, UsageError
from crashfuse.progress import Progress, Watch
from crashfuse.pulse import GRID_S, Condition, FloatArray, Pulse
from crashfuse.units import LB, MPH

SMALL = TcnConfig(channels=12, epochs=1, min_steps=250, tuning_steps=150)


@pytest.fixture(scope="module")
def lf(campaign: Campaign) -> LfTcn:
    """An LF network of the small campaign."""
    return LfTcn(SMALL).fit(campaign)


def _error(predicted: FloatArray, true: FloatArray) -> float:
    """Root mean square difference, relative to the true pulse."""
    return float(np.sqrt(np.mean((predicted - true) ** 2) / np.mean(true**2)))


def test_the_lf_network_learns_the_cae_runs(campaign: Campaign, lf: LfTcn) -> None:
    """Its loss falls to a hundredth, and it gives the CAE pulses back to within 15 % at the tests' conditions."""
    assert lf.losses_[-1, 0] < 0.01 * lf.losses_[0, 0]
    errors = [
        _error(lf.predict(campaign.cae.conditions[i]).accel_mps2, campaign.cae.accel_mps2[i]) for i in range(20, 24)
    ]
    assert max(errors) < 0.15


def test_fine_tuning_moves_the_prediction_to_the_tests(campaign: Campaign, lf: LfTcn) -> None:
    """A test that was trained on is met far better than by the LF network."""
    mf = TimeDomain(SMALL).fit(campaign)
    for test in campaign.tests:
        before = _error(lf.predict(test.condition).accel_mps2, test.pulse.accel_mps2)
        assert _error(mf.predict(test.condition).accel_mps2, test.pulse.accel_mps2) < 0.4 * before


def test_an_infinite_penalty_keeps_the_lf_network(campaign: Campaign, lf: LfTcn) -> None:
    """λ → ∞ leaves no increments: at the same rate, where λ = 0 moves the pulse by far, θ_MF = θ_LF to rounding."""
    condition = campaign.tests[0].condition
    start = lf.predict(condition).accel_mps2
    free, held = (
        TimeDomain(replace(SMALL, penalty=penalty)).fit(campaign).predict(condition).accel_mps2
        for penalty in (0.0, 1e6)
    )
    assert np.abs(held - start).max() < 0.02 * np.abs(free - start).max()


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(campaign: Campaign, lf: LfTcn) -> None:
    """Deterministic on a CPU, whatever the caller's random state."""
    torch.manual_seed(77)
    condition = campaign.tests[0].condition
    again, other = LfTcn(SMALL).fit(campaign), LfTcn(SMALL, seed=1).fit(campaign)
    assert again.predict(condition).accel_mps2.tobytes() == lf.predict(condition).accel_mps2.tobytes()
    assert np.abs(other.predict(condition).accel_mps2 - lf.predict(condition).accel_mps2).max() > 0


def test_the_tests_do_not_reach_the_lf_network(campaign: Campaign, lf: LfTcn) -> None:
    """Training on the CAE runs alone gives the same bits."""
    bare = LfTcn(SMALL).fit(campaign.without(campaign.test_ids))
    condition = campaign.tests[1].condition
    assert bare.predict(condition).accel_mps2.tobytes() == lf.predict(condition).accel_mps2.tobytes()


def test_a_kept_network_is_not_trained_again(campaign: Campaign, lf: LfTcn, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second fit takes network, scaling and learning curve from the cache, to the bit, for both approaches."""
    LfTcn(SMALL, cache=Cache()).fit(campaign)

    def forbidden(*_: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setattr("crashfuse.approaches.time_domain.train", forbidden)
    again = LfTcn(SMALL, cache=Cache()).fit(campaign)
    condition = campaign.tests[0].condition
    assert again.predict(condition).accel_mps2.tobytes() == lf.predict(condition).accel_mps2.tobytes()
    np.testing.assert_array_equal(again.losses_, lf.losses_)
    TimeDomain(SMALL, cache=Cache()).fit(campaign)


def test_another_seed_or_library_is_another_entry(campaign: Campaign) -> None:
    """What is kept is kept by everything that decides it."""
    quick = replace(SMALL, min_steps=2)
    LfTcn(quick, cache=Cache()).fit(campaign)
    LfTcn(quick, seed=1, cache=Cache()).fit(campaign)
    cae = replace(campaign.cae, accel_mps2=1.1 * campaign.cae.accel_mps2)
    LfTcn(quick, cache=Cache()).fit(replace(campaign, cae=cae))
    assert len(list((Cache().folder / "lf_tcn").iterdir())) == 3


@pytest.mark.parametrize("step", ["Training LF TCN", "Fine-tuning on tests"])
def test_a_training_that_is_cancelled_ends_at_its_next_report(campaign: Campaign, step: str) -> None:
    """Cancelled is raised from within either training."""
    cancel = threading.Event()

    def stop(progress: Progress) -> None:
        if progress.step == step and progress.done:
            cancel.set()

    with pytest.raises(Cancelled, match=step):
        TimeDomain(replace(SMALL, epochs=5)).fit(campaign, Watch(stop, cancel))


def test_progress_carries_the_losses(campaign: Campaign) -> None:
    """The learning curve can be drawn while it grows."""
    reports: list[Progress] = []
    TimeDomain(replace(SMALL, min_steps=4)).fit(campaign, Watch(reports.append))
    lf = [report.values for report in reports if report.step == "Training LF TCN" and report.done]
    assert all({"train_loss", "validation_loss"} == set(values) for values in lf)
    assert reports[-1].fraction == 1.0


def test_a_held_out_pulse_does_not_reach_its_prediction(campaign: Campaign) -> None:
    """Whatever the held-out test measured, what is trained without it is the same to the bit."""
    changed = tuple(
        CrashTest(t.id, t.condition, Pulse(GRID_S, 2 * t.pulse.accel_mps2)) if t.id == "T3" else t
        for t in campaign.tests
    )
    quick = replace(SMALL, min_steps=20, tuning_steps=20)
    pulses = [
        TimeDomain(quick).fit(c.without(["T3"])).predict(campaign.test("T3").condition).accel_mps2.tobytes()
        for c in (campaign, replace(campaign, tests=changed))
    ]
    assert pulses[0] == pulses[1]


def test_the_papers_network_takes_a_few_steps(campaign: Campaign) -> None:
    """Table 2 trains and fine-tunes on a small campaign, on a GPU where there is one, and gives 1250 finite samples."""
    paper = replace(TcnConfig.paper(), epochs=1, batch=2, tuning_steps=3, tuning_rate=3e-6)
    cae = campaign.cae
    few = CaeLibrary(cae.ids[:3], cae.conditions[:3], cae.accel_mps2[:3])
    small = replace(campaign, cae=few).without(["T2", "T3", "T4"])
    mf = TimeDomain(paper).fit(small)
    pulse = mf.predict(campaign.tests[2].condition).accel_mps2
    assert pulse.shape == GRID_S.shape
    assert np.isfinite(pulse).all()
    assert mf.state["device"] == ("cuda" if torch.cuda.is_available() else "cpu")
    assert mf.losses_[-1] < mf.losses_[0]


def test_a_condition_beyond_the_library_is_flagged(lf: LfTcn) -> None:
    """The note names the input that lies outside."""
    (note,) = lf.predict(Condition(60 * MPH, 2050 * LB, 1550 * LB)).notes
    assert "speed 60 mph" in note


def test_without_tests_there_is_nothing_to_fine_tune_on(campaign: Campaign) -> None:
    """One sentence says so."""
    with pytest.raises(UsageError, match="learns from tests; this campaign has none"):
        TimeDomain(SMALL).fit(campaign.without(campaign.test_ids))


def test_a_single_cae_run_is_too_few(campaign: Campaign) -> None:
    """One sentence, not an error from within."""
    cae = campaign.cae
    single = CaeLibrary(cae.ids[:1], cae.conditions[:1], cae.accel_mps2[:1])
    with pytest.raises(UsageError, match="needs at least 2"):
        LfTcn(SMALL).fit(replace(campaign, cae=single))


@pytest.mark.parametrize("approach", [LfTcn(SMALL), TimeDomain(SMALL)])
def test_predicting_before_fitting_is_an_error(campaign: Campaign, approach: LfTcn | TimeDomain) -> None:
    """The message says what to call."""
    with pytest.raises(NotFittedError, match=r"call fit\(campaign\) first"):
        approach.predict(campaign.tests[0].condition)
    assert approach.state == {}


def test_standstill_is_predicted_as_nearly_nothing(lf: LfTcn) -> None:
    """A library may start at 0 mph: the output's scale keeps the pulse small there."""
    pulse = lf.predict(Condition(0.0, 2050 * LB, 1550 * LB)).accel_mps2
    assert np.abs(pulse).max() < 20
