"""What every tab of the Predict page shows: the predictions at a condition."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from functools import cached_property

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.reporting.predicted import PredictedPulse
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.history import PastResult, keep
from crashfuse.study.recommendation import Recommendation
from crashfuse.ui.chosen import View
from crashfuse.ui.computation import FitRequest, Fitted, advised, answers
from crashfuse.ui.other_seeds import predicted
from crashfuse.ui.pins import pinned


@dataclass(frozen=True, eq=False)
class Answer:
    """The prediction of every approach at a condition, and how the reader wants to see it.

    Attributes
    ----------
    view : View
        The choices in the sidebar: campaign, rated window, units.
    request : FitRequest
        What was asked for: all tests of the campaign, and the settings that were chosen.
    fitted : Fitted
        The approaches, ready to predict any condition. While networks train, fewer than the settings ask for.
    condition : Condition
        What is predicted.
    estimates : list of Estimate
        One for each approach.
    """

    view: View
    request: FitRequest
    fitted: Fitted
    condition: Condition
    estimates: list[Estimate]

    @classmethod
    def of(cls, view: View, request: FitRequest, fitted: Fitted, condition: Condition) -> "Answer":
        """The answer of fitted approaches at a condition."""
        return cls(view, request, fitted, condition, answers(request.key, condition, fitted))

    @property
    def whole(self) -> bool:
        """True once every approach is known."""
        return len(self.fitted.fits) == len(self.config.approaches)

    @cached_property
    def advice(self) -> Recommendation | None:
        """Which of them to use; None while approaches are still missing."""
        if not self.whole:
            return None
        window_ms = self.view.display.window_ms
        return advised(self.request.key, self.condition, window_ms, self.estimates, self.campaign)

    @property
    def campaign(self) -> Campaign:
        """What the predictions learned from."""
        return self.view.campaign

    @property
    def config(self) -> StudyConfig:
        """The settings that were chosen."""
        return self.request.config

    @property
    def recommended(self) -> str | None:
        """The approach to use, once it is known."""
        return None if self.advice is None else self.advice.approach

    @property
    def predictions(self) -> Mapping[str, Prediction]:
        """By approach."""
        return {estimate.approach: estimate.prediction for estimate in self.estimates}

    @property
    def prediction(self) -> PredictedPulse:
        """All of them, as the library has it."""
        return PredictedPulse(self.campaign, tuple(self.estimates), self.config)

    @cached_property
    def beside(self) -> list[PredictedPulse]:
        """What is to be seen beside it: predictions here by other seeds and presets, and those at pinned conditions."""
        others = [condition for text, condition in pinned().items() if text != self.condition.text]
        at_pins = (tuple(answers(self.request.key, condition, self.fitted)) for condition in others)
        same = predicted(self.campaign, self.condition) if self.whole else []
        return [*same, *(PredictedPulse(self.campaign, own, self.config) for own in at_pins)]

    def remember(self) -> None:
        """Keep a record of it among the results of this machine."""
        keep(PastResult.of_prediction(self.campaign, self.estimates, self.config))

    @property
    def key(self) -> Hashable:
        """Equal for equal data, settings, condition and display: the beginning of the key of a cached figure."""
        return self.request.key, self.fitted.approaches, self.condition, self.view.display
