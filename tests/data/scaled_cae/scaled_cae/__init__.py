"""The CAE pulse times one factor: the one that fits the tests best."""

from typing import Self

import numpy as np

from crashfuse.approaches.base import Approach, FittedState, Prediction
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.execution.run import UNKEPT, Run


class ScaledCae(Approach):
    """One factor on the CAE pulse, by least squares over all tests."""

    name = "scaled_cae"
    label = "Scaled CAE"
    in_words = "the scaled CAE model"
    description = "the CAE pulse times the one factor that fits the tests best, by least squares."
    colour = "#8C6D1F"
    preference = 45

    def fit(self, campaign: Campaign, run: Run = UNKEPT) -> Self:
        """Find the factor."""
        if not campaign.tests:
            raise UsageError(f"The approach {self.name} learns from tests; this campaign has none.")
        self.model_ = CaeModel().fit(campaign.cae, run)
        cae = np.array([self.model_.pulse(test.condition).accel_mps2 for test in campaign.tests])
        measured = np.array([test.pulse.accel_mps2 for test in campaign.tests])
        self.factor_ = float((cae * measured).sum() / (cae**2).sum())
        return self

    def predict(self, condition: Condition) -> Prediction:
        """Scale the CAE pulse at a condition."""
        self._require("factor_")
        notes = self.model_.notes(condition)
        return Prediction(condition, self.factor_ * self.model_.pulse(condition).accel_mps2, notes=notes)

    def learned(self) -> FittedState:
        """The factor."""
        self._require("factor_")
        return FittedState({"factor": self.factor_}, {})

    def restore(self, campaign: Campaign, learned: FittedState, run: Run = UNKEPT) -> Self:
        """Take up the factor that was found before."""
        self.model_ = CaeModel().fit(campaign.cae, run)
        self.factor_ = learned.values["factor"]
        return self
