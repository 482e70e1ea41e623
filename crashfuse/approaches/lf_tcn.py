"""The TCN before it has seen a test: an emulator of the CAE model in time (LF TCN, Eq. 5)."""

from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch

from crashfuse.approaches.base import Approach, Prediction
from crashfuse.approaches.tcn import Tcn, TcnConfig
from crashfuse.approaches.training import Scaling, predict, train
from crashfuse.cache import Cache
from crashfuse.campaign import CaeLibrary, Campaign
from crashfuse.errors import UsageError
from crashfuse.progress import SILENT, Watch
from crashfuse.pulse import Condition, FloatArray

_KIND = "lf_tcn"


class TcnApproach(Approach):
    """What both approaches share: hyperparameters, and a prediction once there are networks."""

    networks_: tuple[Tcn, ...]
    scaling_: Scaling
    _library: CaeLibrary

    def __init__(
        self, config: TcnConfig | None = None, *, seed: int = 0, device: str = "auto", cache: Cache | None = None
    ) -> None:
        self.config = TcnConfig.fast() if config is None else config
        self.seed = seed
        self.device = device
        self.cache = cache

    @property
    def _device(self) -> torch.device:
        if self.device != "auto":
            return torch.device(self.device)
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")

    @property
    def hardware(self) -> str:
        """The kind of device it trains on: its numbers differ in the last bits."""
        return self._device.type

    def predict(self, condition: Condition) -> Prediction:
        """Predict the pulse at a condition: the mean of the networks.

        Raises
        ------
        NotFittedError
            If called before ``fit``.
        """
        self._require("networks_")
        accel = predict(self.networks_, self.scaling_, condition.vector[None], self.config)[0]
        return Prediction(condition, accel, notes=self._library.extrapolation(condition))


class LfTcn(TcnApproach):
    """The networks before they have seen a test: an emulator of the CAE model in time (Eq. 5).

    Parameters
    ----------
    config : TcnConfig, optional
        Default: :meth:`TcnConfig.fast`.
    seed : int
    device : str
        ``"auto"`` takes CUDA if there is any, else the CPU.
    cache : Cache, optional
        Where each trained network is kept, by fingerprint of the CAE runs, settings of the training and seed.

    Attributes
    ----------
    networks_ : tuple of Tcn
        The members, each with a seed of its own made from the one that was asked for.
    scaling_ : Scaling
    losses_ : ndarray, shape (n_members, n_epochs, 2)
        Training and validation loss after each epoch.
    """

    name = "lf_tcn"
    label = "LF TCN"

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Train on the CAE runs of the campaign, or take networks from the cache; tests are not looked at.

        Raises
        ------
        UsageError
            If there are fewer than two runs.
        Cancelled
            If the watch was told to stop.
        """
        cae, config = campaign.cae, self.config
        if len(cae) < 2:
            raise UsageError("The LF TCN learns from CAE runs and checks itself on others; it needs at least 2.")
        self._library = cae
        self.scaling_ = Scaling.of(cae.vectors, cae.accel_mps2, config)
        members = [self._member(number, watch) for number in range(config.members)]
        self.networks_ = tuple(network for network, _ in members)
        self.losses_ = np.array([losses for _, losses in members])
        return self

    def _member(self, number: int, watch: Watch) -> tuple[Tcn, FloatArray]:
        cae = self._library
        seed = int(np.random.SeedSequence([self.seed, number]).generate_state(1)[0])  # torch looks at 32 bits only
        key = {
            "cae": cae.fingerprint,
            "config": self.config.lf_settings,
            "seed": seed,
            "device": self._device.type,
        }
        entry = self.cache.get(_KIND, key) if self.cache else None
        if entry is not None:
            return _network(entry, self.config).to(self._device), entry["losses"]
        step = "Training LF TCN" + (f" {number + 1} of {self.config.members}" if self.config.members > 1 else "")
        network, losses = train(
            cae.vectors, cae.accel_mps2, self.scaling_, self.config, seed, self._device, watch, step
        )
        if self.cache:
            weights = {f"weight {name}": weight.cpu().numpy() for name, weight in network.state_dict().items()}
            self.cache.put(_KIND, key, {**weights, "losses": losses})
        return network, losses

    @property
    def state(self) -> dict[str, object]:
        """Number of members, weights and epochs, final losses (mean of the members), device."""
        if not hasattr(self, "networks_"):
            return {}
        train_loss, validation_loss = self.losses_[:, -1].mean(axis=0).tolist()
        return {
            "members": len(self.networks_),
            "weights": sum(weight.numel() for weight in self.networks_[0].parameters()),
            "epochs": self.losses_.shape[1],
            "train_loss": train_loss,
            "validation_loss": validation_loss,
            "device": self._device.type,
        }


def _network(entry: dict[str, npt.NDArray[Any]], config: TcnConfig) -> Tcn:
    network = Tcn(config, torch.Generator())
    kept = {k.removeprefix("weight "): torch.from_numpy(v) for k, v in entry.items() if k.startswith("weight ")}
    network.load_state_dict(kept)
    return network
