"""The tangent kernel is the product of gradients by automatic differentiation; its blocks are computed once."""

import itertools
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
import torch
from torch import Tensor

from crashfuse.approaches.threads import single_thread
from crashfuse.approaches.time_domain import tangent_kernel
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.tangent_kernel import KernelBlocks, Tangent
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import UNKEPT
from crashfuse.signals.pulse import FloatArray

N_TIMES = 9

CONFIG = TcnConfig(channels=4, dilations=(1, 2), members=2)
NETWORK = Tcn(CONFIG, torch.Generator().manual_seed(1))
VECTORS = np.random.default_rng(0).normal(size=(4, 3))


@pytest.mark.parametrize(("dilations", "members"), [((1,), 1), ((1, 2), 2), ((1, 2, 4), 1), ((2, 3, 3), 2)])
def test_the_tangent_kernel_is_the_product_of_gradients(dilations: tuple[int, ...], members: int) -> None:
    """By the weights of first and last block and head, mean over members, of conditions and others or themselves."""
    config = TcnConfig(channels=4, dilations=dilations, members=members)
    network = Tcn(config, torch.Generator().manual_seed(1))
    inputs = torch.randn(N_TIMES, 3, config.n_inputs, generator=torch.Generator().manual_seed(5))
    ends = ("head.", "blocks.0.", f"blocks.{len(dilations) - 1}.")
    tuned = [weight for name, weight in network.named_parameters() if name.startswith(ends)]
    outputs = network(inputs).sum(dim=0)

    def gradient(time: int, pulse: int) -> torch.Tensor:
        return torch.cat([g.flatten() for g in torch.autograd.grad(outputs[time, pulse], tuned, retain_graph=True)])

    with single_thread():
        jacobian = torch.stack([torch.stack([gradient(t, i) for t in range(N_TIMES)]) for i in range(3)])
    expected = torch.einsum("itp,jup->itju", jacobian, jacobian).numpy() / members
    for one, two in itertools.product(range(3), repeat=2):
        ours, theirs = (Tangent.of(network, inputs[:, i : i + 1]) for i in (one, two))
        kernel = ours.kernel_with(theirs).mean(dim=0).numpy()
        np.testing.assert_allclose(kernel, expected[one, :, two], rtol=1e-4, atol=1e-5)


def inputs(vectors: FloatArray) -> Tensor:
    """Sequences that differ from condition to condition."""
    time = np.linspace(0, 1, N_TIMES)[:, None, None]
    waves = np.sin(time * np.arange(1, CONFIG.n_inputs + 1) * (1 + vectors @ [0.3, 0.2, 0.1])[:, None])
    return torch.from_numpy(waves.astype(np.float32))


def blocks(cache: Cache = UNKEPT.cache) -> KernelBlocks:
    return KernelBlocks(NETWORK, CONFIG, inputs, "library", cache)


@pytest.fixture
def nothing_is_computed(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    def refuse(*_: object) -> NoReturn:
        raise AssertionError("computed again")

    monkeypatch.setattr(Tangent, "of", refuse)
    return monkeypatch


def test_a_block_does_not_depend_on_what_it_is_computed_with() -> None:
    """Beyond the rounding of products of other sizes: a test predicted in a study and alone is predicted the same."""
    together = blocks().among(VECTORS)
    np.testing.assert_allclose(blocks().among(VECTORS[1:3]), together[1:3, :, 1:3], rtol=1e-6, atol=1e-6)
    for tests in ([2, 0], [2, 1]):
        across = blocks().between(VECTORS[tests], VECTORS[1])[0]
        np.testing.assert_allclose(across, together[tests, :, 1], rtol=1e-6, atol=1e-6)


def test_all_parts_of_a_campaign_share_what_is_kept(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    whole = blocks(Cache(tmp_path)).among(VECTORS)
    request.getfixturevalue("nothing_is_computed")
    np.testing.assert_array_equal(blocks(Cache(tmp_path)).among(VECTORS[[0, 2]]), whole[[0, 2]][:, :, [0, 2]])
    across, own = blocks(Cache(tmp_path)).between(VECTORS[:3], VECTORS[3])
    np.testing.assert_array_equal(across, whole[:3, :, 3])
    np.testing.assert_array_equal(own, whole[3, :, 3])


def test_of_too_many_conditions_the_latest_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.setattr(tangent_kernel, "_MOST", 3)
    own = blocks(Cache(tmp_path))
    own.among(VECTORS[:2])
    latest = own.among(VECTORS[1:])
    request.getfixturevalue("nothing_is_computed")
    np.testing.assert_array_equal(blocks(Cache(tmp_path)).among(VECTORS[1:]), latest)
    with pytest.raises(AssertionError, match="computed again"):
        blocks(Cache(tmp_path)).among(VECTORS[:2])
