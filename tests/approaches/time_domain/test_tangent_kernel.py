"""The tangent kernel, taken by factors, is the product of gradients by automatic differentiation."""

import copy

import numpy as np
import pytest
import torch

from crashfuse.approaches.time_domain import tangent_kernel
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.tangent_kernel import Tangent, TangentKernel

N_TIMES = 9


@pytest.mark.parametrize("dilations", [(1,), (1, 2), (1, 2, 4)])
@pytest.mark.parametrize("members", [1, 2])
def test_the_tangent_kernel_is_the_product_of_gradients(dilations: tuple[int, ...], members: int) -> None:
    """By the weights of first and last block and head, mean over members, between conditions and others or themselves.

    The sequence is shorter than the last block looks back.
    """
    config = TcnConfig(channels=4, dilations=dilations, members=members)
    network = Tcn(config, torch.Generator().manual_seed(1))
    inputs = torch.randn(N_TIMES, 3, config.n_inputs, generator=torch.Generator().manual_seed(5))
    tuned = [
        weight
        for name, weight in network.named_parameters()
        if name.startswith(("head.", "blocks.0.", f"blocks.{len(dilations) - 1}."))
    ]

    def gradient(time: int, pulse: int) -> torch.Tensor:
        gradients = torch.autograd.grad(network(inputs)[:, time, pulse].sum(), tuned)
        return torch.cat([g.flatten() for g in gradients])

    jacobian = torch.stack([torch.stack([gradient(t, i) for t in range(N_TIMES)]) for i in range(3)])
    expected = torch.einsum("itp,jup->itju", jacobian, jacobian).numpy() / members
    kernel = TangentKernel(network, config, inputs)
    np.testing.assert_allclose(kernel.between(inputs, inputs), expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(kernel.between(inputs, inputs[:, 1:2]), expected[:, :, 1:2], rtol=1e-4, atol=1e-5)


def _some(seed: int) -> tuple[Tcn, TcnConfig, torch.Tensor]:
    config = TcnConfig(channels=4, dilations=(1, 2), members=2)
    inputs = torch.randn(N_TIMES, 4, config.n_inputs, generator=torch.Generator().manual_seed(seed))
    return Tcn(config, torch.Generator().manual_seed(seed)), config, inputs


def test_a_pair_has_the_same_bits_whatever_it_was_computed_with(monkeypatch: pytest.MonkeyPatch) -> None:
    """Alone, in a larger set, in either order, twice in a set, and with nothing known from before."""
    network, config, inputs = _some(2)
    whole = TangentKernel(network, config, inputs[:, :2]).between(inputs, inputs)
    monkeypatch.setattr(TangentKernel, "_pairs", {})
    fresh = TangentKernel(network, config, inputs)
    np.testing.assert_array_equal(fresh.between(inputs[:, 3:], inputs[:, :2]), whole[3:, :, :2])
    np.testing.assert_array_equal(fresh.between(inputs[:, :2], inputs[:, 3:]), whole[:2, :, 3:])
    twice = fresh.between(inputs[:, [1, 1, 0]], inputs[:, [1]])
    np.testing.assert_array_equal(twice, whole[[1, 1, 0]][:, :, [1]])


def test_pairs_of_the_same_networks_are_not_computed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """By any kernel of the same weights; other weights are another matter, and the oldest pairs give way."""
    monkeypatch.setattr(TangentKernel, "_pairs", {})
    network, config, inputs = _some(3)
    TangentKernel(network, config, inputs).between(inputs, inputs)
    assert len(TangentKernel._pairs) == 10
    with monkeypatch.context() as patch:
        patch.setattr(Tangent, "of", None)
        TangentKernel(copy.deepcopy(network), config, inputs).between(inputs[:, 1:], inputs)
        with pytest.raises(TypeError):
            TangentKernel(_some(4)[0], config, inputs).between(inputs, inputs)
    monkeypatch.setattr(tangent_kernel, "_MOST_PAIRS", 12)
    TangentKernel(_some(4)[0], config, inputs).between(inputs, inputs)
    assert len(TangentKernel._pairs) == 12
