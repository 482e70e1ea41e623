"""The low-fidelity (LF) networks: an emulator of the CAE model over time, trained without tests (Eq. 5)."""

from collections.abc import Sequence
from typing import Self

import numpy as np
import torch

from crashfuse.approaches.base import Approach, Device, FittedState, Prediction, Settings
from crashfuse.approaches.time_domain.config import AboutLfTcn, TcnConfig
from crashfuse.approaches.time_domain.network import Scaling, Tcn
from crashfuse.approaches.time_domain.training import Checkpoint, load_weights, mean_outputs, train, weights_of
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.execution.cache import Code, Entry
from crashfuse.execution.run import UNKEPT, Run
from crashfuse.signals.pulse import FloatArray

_KIND = "lf_tcn"
_MOST_POINTS = 200  # most points of a learning curve shown


class TcnApproach(Approach):
    """Common base of the LF TCN and the time domain."""

    network_: Tcn
    scaling_: Scaling
    _library: CaeLibrary

    def __init__(self, config: TcnConfig | None = None, *, seed: int = 0, device: Device = "auto") -> None:
        self.config = TcnConfig.fast() if config is None else config
        self.seed, self._wanted = seed, device

    @classmethod
    def create(cls, settings: Settings) -> Self:
        """Create it with Table 2 under the paper's preset, else with the small networks."""
        config = TcnConfig.paper() if settings.preset == "paper" else None
        return cls(config, seed=settings.seed, device=settings.device)

    @property
    def device(self) -> str:
        """Device it trains on, ``cpu`` or ``cuda``: their results differ in the last bits."""
        there_is_cuda = torch.cuda.is_available()
        if self._wanted == "cuda" and not there_is_cuda:
            raise UsageError("This torch can use no CUDA device; choose auto or cpu.")
        return "cuda" if there_is_cuda and self._wanted != "cpu" else "cpu"

    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition: the mean of the members."""
        self._require("network_")
        vector, scaling = condition.vector[None], self.scaling_
        accel = scaling.pulses(mean_outputs(self.network_, scaling.inputs(vector)), vector)[0]
        return Prediction(condition, accel, notes=self._library.extrapolation(condition))


class LfTcn(AboutLfTcn, TcnApproach):
    """The LF networks as an approach; the cache keeps them, and checkpoints of an unfinished training."""

    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> Self:
        """Train on the CAE runs of the campaign, or load networks from the cache."""
        cae, config = campaign.cae.for_networks, self.config
        if len(cae) < 2:
            raise UsageError("The LF TCN needs at least 2 CAE runs: it checks itself on some.")
        settings = {"config": config.lf_settings, "seed": self.seed, "device": self.device}
        key = {"cae": cae.fingerprint, **settings, "code": Code(__name__)}

        def compute() -> tuple[Approach, Entry]:
            vectors, accel = self._begin(cae)
            checkpoint = Checkpoint(run, {**key, "training": _KIND})
            self.network_, self.losses_ = train(vectors, accel, self.scaling_, self.seed, self.device, checkpoint)
            return self, self.learned().arrays

        run.get_or_compute(_KIND, key, compute, lambda entry: self.restore(campaign, FittedState({}, entry)))
        return self

    def _begin(self, cae: CaeLibrary) -> tuple[FloatArray, FloatArray]:
        most = self.config.max_runs or len(cae)
        rows = slice(None) if len(cae) <= most else np.linspace(0, len(cae) - 1, most).astype(int)
        vectors, accel = cae.vectors[rows], cae.accel_mps2[rows]
        self._library, self.scaling_ = cae, Scaling.of(vectors, accel, self.config)
        return vectors, accel

    def learned(self) -> FittedState:
        """Weights and learning curves."""
        self._require("network_")
        return FittedState({}, {**weights_of(self.network_), "losses": self.losses_})

    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> Self:  # noqa: ARG002
        """Restore weights; the scaling is computed from the library."""
        self._begin(campaign.cae.for_networks)
        weights = dict(learned.arrays)
        self.losses_ = weights.pop("losses")
        self.network_ = Tcn(self.config, torch.Generator()).to(self.device).eval()
        load_weights(self.network_, weights)
        return self

    @property
    def state(self) -> dict[str, object]:
        """Number of members, weights and epochs, losses (mean of the members), device."""
        if not hasattr(self, "network_"):
            return {}
        columns = ("train_loss", "validation_loss")
        return {
            "members": self.network_.members,
            "weights": self.network_.size,
            "epochs": self.losses_.shape[1],
            **dict(zip(columns, self.losses_[:, -1].mean(axis=0).tolist(), strict=True)),
            "device": self.device,
            "learning_curve": thinned(self.losses_.mean(axis=0), columns),
        }


def thinned(curve: FloatArray, columns: Sequence[str]) -> dict[str, list[float]]:
    """A learning curve of at most 200 epochs, as plain JSON values by column."""
    chosen = np.unique(np.linspace(0, len(curve) - 1, min(len(curve), _MOST_POINTS)).astype(int))
    values = {name: [float(f"{value:.4g}") for value in curve[chosen, i]] for i, name in enumerate(columns)}
    return {"epoch": (chosen + 1).tolist(), **values}
