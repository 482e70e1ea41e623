"""The time-domain approach: a TCN trained on the CAE runs (LF TCN) and fine-tuned on the tests (MF TCN, Sect. 3.1)."""

from dataclasses import asdict
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch

from crashfuse.approaches.base import Approach, Prediction
from crashfuse.approaches.tcn import Tcn, TcnConfig
from crashfuse.approaches.training import Scaling, fine_tune, predict, train
from crashfuse.cache import Cache
from crashfuse.campaign import CaeLibrary, Campaign
from crashfuse.errors import NotFittedError, UsageError
from crashfuse.progress import SILENT, Watch
from crashfuse.pulse import Condition, FloatArray

_KIND = "lf_tcn"


class _TcnApproach(Approach):
    """What both networks share: hyperparameters, and a prediction once there is a network."""

    network_: Tcn
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
        """Predict the pulse at a condition.

        Raises
        ------
        NotFittedError
            If called before ``fit``.
        """
        if not hasattr(self, "network_"):
            raise NotFittedError(f"The approach {self.name} has not been fitted; call fit(campaign) first.")
        accel = predict(self.network_, self.scaling_, condition.vector[None], self.config)[0]
        return Prediction(condition, accel, notes=self._library.extrapolation(condition))


class LfTcn(_TcnApproach):
    """The network before it has seen a test: an emulator of the CAE model in time (Eq. 5).

    Parameters
    ----------
    config : TcnConfig, optional
        Default: :meth:`TcnConfig.fast`.
    seed : int
    device : str
        ``"auto"`` takes CUDA if there is any, else the CPU.
    cache : Cache, optional
        Where the trained network is kept, by fingerprint of the CAE runs, config and seed.

    Attributes
    ----------
    network_ : Tcn
    scaling_ : Scaling
    losses_ : ndarray, shape (n_epochs, 2)
        Training and validation loss after each epoch.
    """

    name = "lf_tcn"
    label = "LF TCN"

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Train on the CAE runs of the campaign, or take the network from the cache; tests are not looked at.

        Raises
        ------
        UsageError
            If there are fewer than two runs.
        Cancelled
            If the watch was told to stop.
        """
        if len(campaign.cae) < 2:
            raise UsageError("The LF TCN learns from CAE runs and checks itself on others; it needs at least 2.")
        self._library = campaign.cae
        key = {"cae": campaign.cae.fingerprint, "config": self.config, "seed": self.seed, "device": self._device.type}
        entry = self.cache.get(_KIND, key) if self.cache else None
        if entry is None:
            self.network_, self.scaling_, self.losses_ = train(
                campaign.cae.vectors, campaign.cae.accel_mps2, self.config, self.seed, self._device, watch
            )
            if self.cache:
                self.cache.put(_KIND, key, self._as_arrays())
        else:
            self._from_arrays(entry)
        return self

    @property
    def state(self) -> dict[str, object]:
        """Number of weights, epochs, final losses, device."""
        if not hasattr(self, "network_"):
            return {}
        return {
            "weights": sum(weight.numel() for weight in self.network_.parameters()),
            "epochs": len(self.losses_),
            "train_loss": float(self.losses_[-1, 0]),
            "validation_loss": float(self.losses_[-1, 1]),
            "device": self._device.type,
        }

    def _as_arrays(self) -> dict[str, npt.ArrayLike]:
        weights = {f"weight {name}": weight.cpu().numpy() for name, weight in self.network_.state_dict().items()}
        return {**weights, **{f"scaling {k}": v for k, v in asdict(self.scaling_).items()}, "losses": self.losses_}

    def _from_arrays(self, entry: dict[str, npt.NDArray[Any]]) -> None:
        def scaling(name: str) -> tuple[float, ...]:
            return tuple(np.atleast_1d(entry[f"scaling {name}"]).tolist())

        self.losses_ = entry["losses"]
        self.scaling_ = Scaling(
            scaling("centre"), scaling("spread"), scaling("lowest"), scaling("highest"), *scaling("accel_mps2")
        )
        self.network_ = Tcn(self.config, torch.Generator()).to(self._device)
        kept = {k.removeprefix("weight "): torch.from_numpy(v) for k, v in entry.items() if k.startswith("weight ")}
        self.network_.load_state_dict(kept)


class TimeDomain(_TcnApproach):
    """The MF TCN: the LF network with increments learned from the tests (Eq. 6). Parameters as :class:`LfTcn`.

    Attributes
    ----------
    lf_ : LfTcn
    network_ : Tcn
    scaling_ : Scaling
        The LF network's own.
    losses_ : ndarray, shape (n_steps,)
        Loss on the tests before each step.
    """

    name = "time_domain"
    label = "Time domain"

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Fine-tune the LF network, which is trained before if the cache does not have it, on the campaign's tests.

        Raises
        ------
        UsageError
            If the campaign has no test.
        Cancelled
            If the watch was told to stop.
        """
        if not campaign.tests:
            raise UsageError("The time domain learns from tests; this campaign has none.")
        self.lf_ = LfTcn(self.config, seed=self.seed, device=self.device, cache=self.cache).fit(campaign, watch)
        self._library = campaign.cae
        vectors = np.array([test.condition.vector for test in campaign.tests])
        accel: FloatArray = np.array([test.pulse.accel_mps2 for test in campaign.tests])
        self.scaling_ = self.lf_.scaling_
        self.network_, self.losses_ = fine_tune(self.lf_.network_, self.scaling_, vectors, accel, self.config, watch)
        return self

    @property
    def state(self) -> dict[str, object]:
        """What the LF training found, and the loss on the tests before and after fine-tuning."""
        if not hasattr(self, "network_"):
            return {}
        return {
            **self.lf_.state,
            "tuning_steps": len(self.losses_),
            "loss_on_tests_before": float(self.losses_[0]),
            "loss_on_tests_after": float(self.losses_[-1]),
            "penalty": self.config.penalty,
        }
