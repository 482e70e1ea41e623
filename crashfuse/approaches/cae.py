"""The uncorrected CAE pulse, the baseline that every correction has to beat."""

from typing import Self

from crashfuse.approaches.base import Approach, FittedState, Prediction
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.run import UNKEPT, Run


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

    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> Self:
        """Train the emulator."""
        self.model_ = CaeModel().fit(campaign.cae, run)
        return self

    def learned(self) -> FittedState:
        """An empty state: the emulator trains in a second."""
        self._require("model_")
        return FittedState({}, {})

    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> Self:  # noqa: ARG002
        """Fit again."""
        return self.fit(campaign, run)

    def predict(self, condition: Condition) -> Prediction:
        """Predict the CAE pulse at a condition, with notes on its source."""
        self._require("model_")
        return Prediction(condition, self.model_.pulse(condition).accel_mps2, notes=self.model_.notes(condition))
