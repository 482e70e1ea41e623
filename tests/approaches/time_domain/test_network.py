"""The network: the paper's size, causality, and that both ways to convolve are one."""

import pytest
import torch

from crashfuse.approaches.time_domain import network as tcn
from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Tcn


def _weights(config: TcnConfig) -> int:
    return Tcn(config, torch.Generator()).size


def test_the_papers_network_has_its_size() -> None:
    """Table 2: 600 channels, kernel 20, one block make 7.25 million weights."""
    paper = TcnConfig.paper()
    assert _weights(paper) == pytest.approx(7.25e6, rel=1e-3)
    assert len(Tcn(paper, torch.Generator()).blocks) == 1
    assert paper.n_inputs == 4


def test_the_papers_training_is_table_2() -> None:
    """Adam at 3e-4, cosine annealing over 100 epochs, 1000 epochs, dropout 0.05, every one of 1250 samples."""
    paper = TcnConfig.paper()
    assert (paper.learning_rate, paper.annealing_epochs, paper.epochs, paper.dropout) == (3e-4, 100, 1000, 0.05)
    assert paper.stride == 1


@pytest.mark.parametrize("config", [TcnConfig.fast(), TcnConfig(kernel=20, dilations=(1,), channels=6, members=2)])
def test_what_comes_later_changes_nothing_before(config: TcnConfig) -> None:
    """Causality: an input at step 30 moves no output before 30, and some from there on."""
    network = Tcn(config, torch.Generator().manual_seed(1)).double()
    inputs = torch.randn(60, 2, config.n_inputs, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    changed = inputs.clone()
    changed[30] += 1.0
    difference = (network(changed) - network(inputs)).abs().amax(dim=(0, 2))
    assert difference[:30].max() == 0
    assert difference[30] > 0


def test_a_convolution_is_the_sum_of_eq_4() -> None:
    """Σ l(i) F(p − d i), written out for one channel, kernel 3 and dilation 2."""
    convolution = tcn.CausalConv(1, 1, 1, 3, 2, torch.Generator().manual_seed(0))
    inputs = torch.randn(1, 12, 1, 1, generator=torch.Generator().manual_seed(1))
    taps = convolution.weight.flatten().tolist()  # the last tap is the present
    past = [0.0] * 4 + inputs.flatten().tolist()
    expected = [sum(taps[2 - i] * past[4 + p - 2 * i] for i in range(3)) + convolution.bias.item() for p in range(12)]
    torch.testing.assert_close(convolution(inputs).flatten(), torch.tensor(expected))


@pytest.mark.parametrize(("kernel", "dilation"), [(1, 1), (3, 2), (4, 5)])
def test_the_derivatives_are_those_of_the_sum(kernel: int, dilation: int) -> None:
    """By input, weights and biases, as small steps say, also for taps that reach back beyond the sequence."""
    convolution = tcn.CausalConv(2, 3, 2, kernel, dilation, torch.Generator().manual_seed(0)).double()
    inputs = torch.randn(2, 9, 2, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)).requires_grad_()

    def convolved(inputs: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
        outputs: torch.Tensor = tcn._TapByTap.apply(inputs, weight, bias, convolution.lags)  # type: ignore[no-untyped-call]
        return outputs

    assert torch.autograd.gradcheck(convolved, (inputs, convolution.weight, convolution.bias))


def test_many_taps_are_convolved_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    convolution = tcn.CausalConv(2, 3, 4, 10, 2, torch.Generator().manual_seed(0)).double()
    inputs = torch.randn(2, 30, 2, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    by_library = convolution(inputs)
    monkeypatch.setattr(tcn, "_MOST_TAPS", 10)
    torch.testing.assert_close(convolution(inputs), by_library)


def test_dropout_silences_whole_channels_in_training_only() -> None:
    network = Tcn(TcnConfig(dropout=0.5), torch.Generator().manual_seed(0))
    inputs = torch.ones(5, 3, TcnConfig().n_inputs)
    assert not torch.equal(network(inputs), network(inputs))
    network.eval()
    assert torch.equal(network(inputs), network(inputs))


def test_members_know_nothing_of_each_other() -> None:
    config = TcnConfig(channels=6, dilations=(1, 2), members=3)
    generator = torch.Generator().manual_seed(0)
    alone = [Tcn(config, generator, members=1).double() for _ in range(3)]
    inputs = torch.randn(20, 4, config.n_inputs, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(Tcn.joined(alone, config)(inputs), torch.cat([single(inputs) for single in alone]))


def test_members_may_be_fed_each_with_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    config = TcnConfig(channels=6, dilations=(1, 2), members=2)
    network = Tcn(config, torch.Generator().manual_seed(0)).double()
    inputs = torch.randn(2, 20, 3, config.n_inputs, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    both = network(inputs)
    torch.testing.assert_close(both[0], network(inputs[0])[0])
    torch.testing.assert_close(both[1], network(inputs[1])[1])
    monkeypatch.setattr(tcn, "_MOST_TAPS", 0)
    torch.testing.assert_close(network(inputs), both)
