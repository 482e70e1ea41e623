"""The pre-trained network as an approach: the contract of all, honest bands, and weights that are the shipped ones."""

from pathlib import Path

import numpy as np
import pytest

from crashfuse.approaches.calibration import Coverage
from crashfuse.approaches.pretrained import approach as pretrained
from crashfuse.approaches.pretrained.approach import Pretrained
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import CrashfuseError
from crashfuse.execution.cache import Cache
from crashfuse.synthetic.sample import sample_campaign
from crashfuse.testing import ApproachContract


class TestContract(ApproachContract):
    """It is a part of the fused prediction only, but keeps what every approach promises."""

    approach = Pretrained


@pytest.fixture(scope="module")
def sample() -> Campaign:
    """The sample vehicle, of a family that the network was not trained on."""
    return sample_campaign()


@pytest.fixture(scope="module")
def emulated(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    """Where its CAE emulator is kept."""
    return Cache(tmp_path_factory.mktemp("cache"))


@pytest.mark.slow
def test_three_tests_correct_most_of_the_cae_models_error(sample: Campaign, emulated: Cache) -> None:
    """Learned from three tests over the range of speeds, all others: under half of the error of the raw CAE."""
    known = [sample.test_ids[number] for number in (0, 4, 10)]
    others = [test for test in sample.tests if test.id not in known]
    fitted = Pretrained(cache=emulated).fit(sample.without([test.id for test in others]))
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
    for test in sample.tests[::2]:
        draws = Pretrained(cache=emulated).fit(sample.without([test.id])).predict(test.condition).draws_mps2
        assert draws is not None
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
    numbers = fitted.left_out_groups_.numbers.tolist()
    assert numbers == [0, 1, 2, 3]
    fewer = Pretrained().fit(campaign.without(["T2", "T3"]))
    group = fitted.left_out_groups_.mean_mps2[1]
    alone = fewer.predict(campaign.test("T2").condition).accel_mps2[::10]
    np.testing.assert_allclose(group, alone, atol=1e-3 * np.abs(alone).max())


def test_other_weights_than_the_shipped_ones_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that was cut off or exchanged is told of; no number comes of it."""
    cut = tmp_path / "weights.safetensors"
    cut.write_bytes(pretrained._WEIGHTS.read_bytes()[:-1])
    monkeypatch.setattr(pretrained, "_WEIGHTS", cut)
    pretrained._network.cache_clear()
    with pytest.raises(CrashfuseError, match=r"weights\.safetensors is not the file .* install crashfuse again"):
        pretrained._network()
