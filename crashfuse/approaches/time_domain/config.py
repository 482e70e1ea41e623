"""Hyperparameters of the time domain, and what its approaches say of themselves: known without PyTorch."""

from dataclasses import asdict, dataclass, replace
from typing import Literal, Self

from crashfuse.approaches.base import Approach

_AFTER_LF = ("tuning", "tuning_steps", "tuning_rate", "penalty", "n_draws")


@dataclass(frozen=True, slots=True)
class TcnConfig:
    """Network, LF training (Eq. 5) and fine-tuning (Eq. 6), as by :meth:`fast` or :meth:`paper`.

    Waves are sines and cosines, as inputs beside the paper's four, of time and of the typical displacement (travel) and
    velocity of CAE runs at this speed at that time. Without travel waves, neither of these is an input.
    """

    channels: int = 48
    kernel: int = 3
    dilations: tuple[int, ...] = (1, 2, 4, 8)  # of one residual block each
    dropout: float = 0.0
    stride: int = 20  # samples of the study grid from step to step; a cubic spline interpolates back
    time_waves: int = 2
    travel_waves: int = 10
    velocity_waves: int = 1
    scale_floor: float = 0.3  # an output of 1 is an acceleration that grows with v0, from this share of the highest
    batch: int = 16  # pulses a step
    epochs: int = 2
    min_steps: int = 340  # a small library has more epochs
    max_runs: int = 3000  # to learn from, taken evenly from the library; 0 for all
    learning_rate: float = 4e-3
    annealing_epochs: int = 0  # half period of the rate's cosine; 0: a warm-up and one cosine over the whole training
    members: int = 4  # LF networks from different seeds; their mean is the prediction
    tuning: Literal["posterior", "gradient"] = "posterior"  # in closed form with a band, or by Adam without
    n_draws: int = 200  # posterior: whole pulses drawn for the band
    tuning_steps: int = 1000  # Adam
    tuning_rate: float = 3e-4
    penalty: float = 1e-3  # λ of λ‖θ_HF‖², which keeps θ_MF near θ_LF

    @classmethod
    def fast(cls) -> Self:
        """LF training takes about 3 s per member on one core."""
        return cls()

    @classmethod
    def paper(cls) -> Self:
        """Table 2 as published, 1000 epochs; one residual block, so one dilation, 1. For a GPU."""
        network = cls(channels=600, kernel=20, dilations=(1,), dropout=0.05, stride=1, scale_floor=1.0, members=1)
        inputs = replace(network, time_waves=0, travel_waves=0, velocity_waves=0)
        length = replace(inputs, batch=32, epochs=1000, min_steps=0, max_runs=0)
        return replace(length, learning_rate=3e-4, annealing_epochs=100, tuning="gradient")

    @property
    def lf_settings(self) -> dict[str, object]:
        """The settings that the LF training depends on."""
        return {name: value for name, value in asdict(self).items() if name not in _AFTER_LF}

    @property
    def n_inputs(self) -> int:
        """Number of inputs: time, v0, two weights, typical displacement and velocity, the waves."""
        motion = 2 + 2 * self.travel_waves + 2 * self.velocity_waves if self.travel_waves else 0
        return 4 + 2 * self.time_waves + motion


class AboutLfTcn(Approach):
    """What is shown of the LF TCN."""

    name = "lf_tcn"
    label = "LF TCN"
    in_words = "the LF TCN"
    description = (
        "the low-fidelity (LF) networks: temporal convolutional networks (TCN) trained on the CAE runs alone (Eq. 5)."
    )
    colour, dash = "#C871A1", "dot"
    preference = 40
    learns_from_tests = False
    trains_networks = True


class AboutTimeDomain(Approach):
    """What is shown of the time domain."""

    name = "time_domain"
    label = "Time domain"
    in_words = "the time domain"
    description = (
        "the multi-fidelity (MF) networks: those of the LF TCN with increments of their weights learned from the "
        "tests (Eq. 6); under the fast preset in closed form, with a band."
    )
    colour, dark_colour = "#0072B2", "#2E93D6"
    preference = 30
    trains_networks = True
