"""The uncorrected CAE pulse, the baseline that every correction has to beat."""

from typing import Self

from crashfuse.approaches.base import Approach, FittedState, Prediction, Settings
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import SILENT, Watch


class Cae(Approach):
    """The CAE model as it is: the paired run if there is one, else the emulator."""

    name = "cae"
    label = "CAE"
    in_words = "the raw CAE model"
    description = (
        "the run at the condition, else an emulator of the library (principal modes, a Gaussian process on each); the "
        "baseline."
    )
    colour, dark_colour, dash = "#7F7F7F", "#9A9FA6", "dash"
    preference = 50
    learns_from_tests = False

    def __init__(self, *, cache: Cache | None = None) -> None:
        self.cache = cache

    @classmethod
    def create(cls, settings: Settings) -> Self:
        """Create it with the cache."""
        return cls(cache=settings.cache)

    def fit(self, campaign: Campaign, watch: Watch = SILENT) -> Self:
        """Train the emulator."""
        self.model_ = CaeModel(cache=self.cache).fit(campaign.cae, watch)
        return self

    def learned(self) -> FittedState:
        """An empty state: the emulator trains in a second."""
        self._require("model_")
        return FittedState({}, {})

    def restore(self, campaign: Campaign, learned: FittedState) -> Self:  # noqa: ARG002 - there is nothing in it
        """Fit again."""
        return self.fit(campaign)

    def predict(self, condition: Condition) -> Prediction:
        """Predict the CAE pulse at a condition, with notes on its source."""
        self._require("model_")
        return Prediction(condition, self.model_.pulse(condition).accel_mps2, notes=self.model_.notes(condition))
