"""The pre-trained network reads what it may; as an approach it has honest bands, and the weights that were shipped."""

from pathlib import Path

import numpy as np
import pytest
import torch

from crashfuse.approaches import pretrained
from crashfuse.approaches.calibration import STRIDE, Coverage
from crashfuse.approaches.pretrained import N_TIMES, Forecast, Pretrained, PretrainedNetwork, _integral, _motion
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import CrashfuseError
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import GRID_S, motion
from crashfuse.synthetic.sample import sample_campaign
from crashfuse.testing import ApproachContract, small_campaign
from tests.conftest import not_none

CAMPAIGN = small_campaign()


def _arrays(*order: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    tests = [CAMPAIGN.tests[number] for number in order]
    paired = [CAMPAIGN.cae.paired_run(test.condition) for test in tests]
    measured = np.array([test.pulse.accel_mps2[::STRIDE] for test in tests])
    cae = np.array([CAMPAIGN.cae.accel_mps2[run][::STRIDE] for run in paired if run is not None])
    vectors = np.array([test.condition.vector for test in tests])
    measured_, cae_, vectors_ = (torch.tensor(own, dtype=torch.float64)[None] for own in (measured, cae, vectors))
    return measured_, cae_, vectors_


def _network() -> PretrainedNetwork:
    torch.manual_seed(3)
    network = PretrainedNetwork(width=16, heads=2, layers=1).double().eval()
    for weight in network.parameters():  # those of the heads are near zero before training
        torch.nn.init.normal_(weight, std=0.3)
    return network


def _forecast(arrays: tuple[torch.Tensor, ...], *known: bool) -> Forecast:
    with torch.inference_mode():
        forecast = _network()(*arrays, torch.tensor(known)[None])
    assert isinstance(forecast, Forecast)
    return forecast


def test_the_motion_is_that_of_the_pulse() -> None:
    """Velocity and displacement of the steps' samples by Eqs. 11 and 13, as elsewhere in the program."""
    measured, _, vectors = _arrays(0, 3)
    speeds = vectors[..., :1]
    velocity = (speeds + _integral(measured)).numpy()[0]
    displacement = _integral(speeds + _integral(measured)).numpy()[0]
    for number, speed in enumerate(speeds[0, :, 0].tolist()):
        own = motion(measured[0, number].numpy()[None], speed, GRID_S[STRIDE])
        np.testing.assert_allclose(velocity[number], own[0][0], atol=1e-9)
        np.testing.assert_allclose(displacement[number], own[1][0], atol=1e-9)
    by_step = _motion(measured, speeds)[0, 0, :, 5:10].flatten().numpy()
    np.testing.assert_allclose(by_step, velocity[0] / speeds[0, 0].numpy(), atol=1e-9)


def test_a_pulse_that_is_not_known_changes_no_forecast() -> None:
    measured, cae, vectors = _arrays(0, 1, 2, 3)
    known = (True, True, False, False)
    before = _forecast((measured, cae, vectors), *known)
    spoilt = measured.clone()
    spoilt[0, 2:] = 1000 * torch.randn(2, N_TIMES, dtype=torch.float64)
    after = _forecast((spoilt, cae, vectors), *known)
    for one, other in zip(before, after, strict=True):
        torch.testing.assert_close(one[0, 2:], other[0, 2:], rtol=0, atol=0)


def test_what_is_predicted_together_is_what_is_predicted_alone() -> None:
    """Pulses that are not known do not see each other, and the order of the known ones does not matter."""
    together = _forecast(_arrays(0, 1, 2, 3), True, True, False, False)
    alone = _forecast(_arrays(1, 0, 3), True, True, False)
    for one, other in zip(together, alone, strict=True):
        torch.testing.assert_close(one[0, 3], other[0, 2], rtol=1e-9, atol=1e-9)


def test_a_parked_vehicle_has_a_finite_forecast() -> None:
    measured, cae, vectors = _arrays(0, 1)
    vectors[0, 1, 0], cae[0, 1] = 0.0, 0.0
    assert all(bool(torch.isfinite(part).all()) for part in _forecast((measured, cae, vectors), True, False))


def test_tests_that_were_read_once_say_what_they_say_together() -> None:
    """A pulse beside tests that were read before has the forecast that all of them have at once."""
    measured, cae, vectors = _arrays(0, 1, 2)
    network = _network()
    with torch.inference_mode():
        told = network.read(measured[:, :2], cae[:, :2], vectors[:, :2])
        beside = network.predict(told, cae[:, 2:], vectors[:, 2:])
    for one, other in zip(_forecast((measured, cae, vectors), True, True, False), beside, strict=True):
        torch.testing.assert_close(one[:, 2:], other, rtol=1e-9, atol=1e-9)


class TestContract(ApproachContract):
    """It is a part of the fused prediction only, but keeps what every approach promises."""

    approach = Pretrained


@pytest.fixture(scope="module")
def sample() -> Campaign:
    """The sample vehicle, of a family that the network was not trained on."""
    return sample_campaign()


@pytest.fixture(scope="module")
def emulated(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


@pytest.mark.slow
def test_three_tests_correct_most_of_the_cae_models_error(sample: Campaign, emulated: Cache) -> None:
    """Learned from three tests over the range of speeds, all others: under half of the error of the raw CAE."""
    known = [sample.test_ids[number] for number in (0, 4, 10)]
    others = [test for test in sample.tests if test.id not in known]
    fitted = Pretrained().fit(sample.without([test.id for test in others]), Run(emulated))
    errors = np.array([_errors(fitted, test) for test in others])
    assert errors[:, 0].mean() < 0.5 * errors[:, 1].mean()


def _errors(fitted: Pretrained, test: CrashTest) -> tuple[float, float]:
    """Mean error over the rated 60 ms, and the raw CAE's, m/s²."""
    predicted, cae = fitted.predict(test.condition).accel_mps2, fitted.model_.pulse(test.condition).accel_mps2
    measured = test.pulse.accel_mps2
    return tuple(float(np.abs(own - measured)[:750].mean()) for own in (predicted, cae))  # type: ignore[return-value]


@pytest.mark.slow
def test_its_band_holds_tests_that_it_was_not_shown(sample: Campaign, emulated: Cache) -> None:
    """On average over the tests left out in turn, 90 % of a(t) up to zero velocity at least, and most peaks."""
    covered = []
    for test in sample.tests[::3]:
        draws = not_none(Pretrained().fit(sample.without([test.id]), Run(emulated)).predict(test.condition).draws_mps2)
        covered.append(Coverage.of(test, draws))
    assert np.mean([own.accel for own in covered]) > 0.9
    assert sum(own.peak for own in covered) >= len(covered) - 1


def test_with_two_tests_the_band_is_wider_than_the_network_says(campaign: Campaign) -> None:
    """Too few to check it: it is widened by what left-out tests would otherwise have to tell."""
    fitted = Pretrained().fit(campaign.without(["T1", "T2"]))
    assert fitted.calibration_.tests == ()
    assert fitted.calibration_.widening > 1
    assert fitted.left_out_.numbers.size == 0


def test_a_test_is_predicted_from_other_speeds_without_its_group(campaign: Campaign) -> None:
    """T2 and T3 are at one speed: left out together, neither is told of the other."""
    fitted = Pretrained().fit(campaign)
    assert fitted.left_out_groups_.numbers.tolist() == [0, 1, 2, 3]
    fewer = Pretrained().fit(campaign.without(["T2", "T3"]))
    group = fitted.left_out_groups_.mean_mps2[1]
    alone = fewer.predict(campaign.test("T2").condition).accel_mps2[::10]
    np.testing.assert_allclose(group, alone, atol=1e-3 * np.abs(alone).max())


def test_other_weights_than_the_shipped_ones_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cut = tmp_path / "weights.safetensors"
    cut.write_bytes(pretrained._WEIGHTS.read_bytes()[:-1])
    monkeypatch.setattr(pretrained, "_WEIGHTS", cut)
    pretrained._network.cache_clear()
    with pytest.raises(CrashfuseError, match=r"weights\.safetensors is not the file .* install crashfuse again"):
        pretrained._network(None)
