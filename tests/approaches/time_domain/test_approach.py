"""The time domain: it learns what the tests show, its band holds, its pulses stop the vehicle."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from crashfuse.approaches.calibration import Coverage
from crashfuse.approaches.time_domain.approach import TimeDomain
from crashfuse.approaches.time_domain.band import stopping_notes
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.lf_tcn import LfTcn
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.errors import Cancelled
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import UNKEPT, Run
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics
from tests.conftest import cancelled_after, not_none, with_pulse

pytestmark = pytest.mark.slow

SMALL = TcnConfig(channels=12, epochs=1, min_steps=150, members=2)
BY_ADAM = replace(SMALL, tuning="gradient", members=1, tuning_steps=150, tuning_rate=3e-3)


@pytest.fixture(scope="module")
def lf(campaign: Campaign) -> LfTcn:
    return LfTcn(SMALL).fit(campaign)


@pytest.fixture(scope="module")
def mf(campaign: Campaign) -> TimeDomain:
    """Fine-tuned on all tests but T3 (26 mph; T2 is at 25)."""
    return TimeDomain(SMALL).fit(campaign.without(["T3"]))


def relative_error(predicted: FloatArray, true: FloatArray) -> float:
    return float(np.sqrt(np.mean((predicted - true) ** 2) / np.mean(true**2)))


def test_a_test_with_a_neighbour_is_met_far_better_than_by_the_lf(
    campaign: Campaign, lf: LfTcn, mf: TimeDomain
) -> None:
    """The held-out test lies 1 mph from one that was learned from: half the error at most."""
    test = campaign.test("T3")
    before = relative_error(lf.predict(test.condition).accel_mps2, test.pulse.accel_mps2)
    assert relative_error(mf.predict(test.condition).accel_mps2, test.pulse.accel_mps2) < 0.5 * before


def test_held_out_tests_lie_within_the_band(campaign: Campaign, tmp_path: Path) -> None:
    """Each test left out in turn: acceleration and velocity nine tenths of the time, crush and peak always."""
    fits = [TimeDomain(SMALL).fit(campaign.without([test.id]), Run(Cache(tmp_path))) for test in campaign.tests]
    pairs = zip(campaign.tests, fits, strict=True)
    found = [Coverage.of(test, not_none(fit.predict(test.condition).draws_mps2)) for test, fit in pairs]
    assert np.mean([own.accel for own in found]) > 0.9
    assert np.mean([own.velocity for own in found]) > 0.9
    assert all(own.crush and own.peak for own in found)


def test_predicted_pulses_end_as_the_tests_did(campaign: Campaign, mf: TimeDomain) -> None:
    """All tests bounce back with a tenth of their speed; so does what is predicted, to a few hundredths of v0."""
    for test in campaign.tests:
        pulse = mf.predict(test.condition).accel_mps2
        end = kinematics(pulse, test.condition.speed_mps, DT_S).velocity_mps[-1] / test.condition.speed_mps
        assert end == pytest.approx(-0.1, abs=0.04)
    assert 0 <= float(str(mf.state["left_out_delta_v_misfit"])) < 0.05


def test_a_pulse_that_does_not_stop_the_vehicle_is_noted(campaign: Campaign) -> None:
    condition = campaign.tests[0].condition
    pulse = campaign.tests[0].pulse.accel_mps2
    assert stopping_notes(condition, pulse, pulse) == ()
    (note,) = stopping_notes(condition, 0.8 * pulse, pulse)
    assert "does not stop the vehicle within 100 ms" in note
    assert "12.0% of the impact speed is left" in note  # 1 - 0.8 * 1.1
    assert stopping_notes(condition, 0.8 * pulse, 0.8 * pulse) == ()


def test_tests_alone_at_their_speed_are_left_out_once(mf: TimeDomain) -> None:
    """T1, T2 and T4 are at 15, 25 and 35 mph: without their speed group is without themselves."""
    assert mf.left_out_groups_.numbers.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(mf.left_out_groups_.mean_mps2, mf.left_out_.mean_mps2)


def test_a_test_without_its_speed_group_is_predicted_from_the_others(campaign: Campaign) -> None:
    """T2 and T3 are at 25 and 26 mph: what T3 measured does not change what is predicted of T2 without both."""
    approach = TimeDomain(replace(SMALL, min_steps=60))
    changed = with_pulse(campaign, "T3", 1.5 * campaign.test("T3").pulse.accel_mps2)
    assert campaign.speed_group("T2") == ("T2", "T3")
    both = [approach.fit(each).left_out_groups_ for each in (campaign, changed)]
    ours = [left.mean_mps2[left.numbers == 1][0] for left in (*both, approach.left_out_)]
    apart = [np.abs(own - ours[0]).max() for own in ours[1:]]
    assert apart[0] < 0.3 * apart[1]  # the penalty, chosen from all tests, may differ


def test_the_band_is_wider_far_from_tests_at_a_single_speed(campaign: Campaign) -> None:
    """They cannot tell how wide it has to be there: half as wide again as the check says, and not beside them."""
    single = TimeDomain(replace(SMALL, min_steps=60)).fit(campaign.without(["T1", "T3", "T4"]))
    assert single.left_out_groups_.numbers.size == 0
    assert single.calibration_.further(0.0) == 1.5
    assert single.calibration_.further(1.0) == 1.0


def test_adam_moves_predictions_to_the_tests_and_an_infinite_penalty_keeps_those_of_the_lf(campaign: Campaign) -> None:
    """At the same rate, where λ = 0 moves the pulses by far, λ → ∞ leaves θ_MF = θ_LF to rounding."""
    lf, free, held = (
        approach.fit(campaign, Run())
        for approach in (LfTcn(BY_ADAM), *(TimeDomain(replace(BY_ADAM, penalty=penalty)) for penalty in (0.0, 1e6)))
    )
    for test in campaign.tests:
        before, after, kept = (fit.predict(test.condition).accel_mps2 for fit in (lf, free, held))
        measured = test.pulse.accel_mps2
        assert relative_error(after, measured) < 0.4 * relative_error(before, measured)
        assert np.abs(kept - before).max() < 0.02 * np.abs(after - before).max()


@pytest.mark.parametrize(
    ("step", "config"),
    [("Training LF TCN", SMALL), ("Strength of the fine-tuning", SMALL), ("Fine-tuning on tests", BY_ADAM)],
)
def test_a_training_that_is_cancelled_ends_at_its_next_report(campaign: Campaign, step: str, config: TcnConfig) -> None:
    watch = cancelled_after(lambda progress: progress.step == step and progress.done > 0)
    with pytest.raises(Cancelled, match=step):
        TimeDomain(replace(config, epochs=5, min_steps=0)).fit(campaign, replace(UNKEPT, watch=watch))


def test_the_papers_network_takes_a_few_steps(campaign: Campaign) -> None:
    """Table 2 trains and fine-tunes on a small campaign, on a GPU where there is one, and gives 1250 finite samples."""
    paper = replace(TcnConfig.paper(), channels=60, epochs=1, batch=2, tuning_steps=3, tuning_rate=3e-5)
    cae = campaign.cae
    few = CaeLibrary(cae.ids[:3], cae.conditions[:3], cae.accel_mps2[:3])
    mf = TimeDomain(paper).fit(replace(campaign, cae=few).without(["T2", "T3", "T4"]))
    pulse = mf.predict(campaign.tests[2].condition).accel_mps2
    assert pulse.shape == GRID_S.shape
    assert np.isfinite(pulse).all()
    assert mf.state["device"] == ("cuda" if torch.cuda.is_available() else "cpu")
    assert mf.losses_[0, -1] < mf.losses_[0, 0]
    assert mf.predict(campaign.tests[2].condition).draws_mps2 is None
