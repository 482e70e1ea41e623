"""Tuning of the pre-trained network: its loss, and what it changes."""

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal

from crashfuse.approaches.calibration import STRIDE
from crashfuse.approaches.pretrained import FACTORS, N_TIMES, Forecast, PretrainedNetwork, shipped_network
from crashfuse.approaches.pretrained_tuning import Vehicle, _surprise, losses, tuned
from crashfuse.signals.pulse import FloatArray
from crashfuse.testing import small_campaign


def test_the_surprise_is_that_of_a_normal_distribution() -> None:
    """By SciPy, up to the constant, per sample."""
    rng = np.random.default_rng(0)
    off, deviation, factors = rng.normal(size=N_TIMES), rng.normal(size=N_TIMES), rng.normal(size=(N_TIMES, FACTORS))
    covariance = factors @ factors.T + np.diag(np.exp(2 * deviation))
    expected = -multivariate_normal(cov=covariance).logpdf(off) - 0.5 * N_TIMES * np.log(2 * np.pi)
    none = torch.zeros(N_TIMES)
    forecast = Forecast(none, none, torch.from_numpy(deviation), torch.from_numpy(factors))
    assert _surprise(torch.from_numpy(off), forecast).item() == pytest.approx(expected / N_TIMES)


def _vehicle(stiffer: float) -> Vehicle:
    tests = small_campaign().tests
    measured = np.array([test.pulse.accel_mps2[::STRIDE] for test in tests])
    return Vehicle(measured, measured / stiffer, np.array([test.condition.vector for test in tests]))


@pytest.mark.slow
def test_the_tuned_network_knows_how_cae_models_of_its_vehicles_err(monkeypatch: pytest.MonkeyPatch) -> None:
    """A vehicle that it was not tuned to, whose CAE model is too soft as theirs are, is predicted better; no other."""
    monkeypatch.setattr("crashfuse.approaches.pretrained_tuning._STEPS", 30)
    state = torch.get_rng_state()
    weights = tuned([_vehicle(1.3), _vehicle(1.4)], seed=1)
    assert torch.equal(torch.get_rng_state(), state)
    network = shipped_network()
    assert {name: weight.shape for name, weight in weights.items()}.items() <= {
        name: tuple(weight.shape) for name, weight in network.named_parameters()
    }.items()
    assert 0 < sum(weight.size for weight in weights.values()) < 30_000
    before = _error(network, _vehicle(1.35))
    network.load_state_dict(
        {**network.state_dict(), **{name: torch.from_numpy(w).float() for name, w in weights.items()}}
    )
    assert _error(network, _vehicle(1.35)) < 0.9 * before


def _error(network: PretrainedNetwork, vehicle: Vehicle) -> float:
    arrays: list[FloatArray] = [*vehicle]
    known = torch.tensor([[False, True, False, False]])
    with torch.inference_mode():
        return losses(network, [torch.tensor(rows, dtype=torch.float32)[None] for rows in arrays], known).mean.item()
