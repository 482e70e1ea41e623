"""What every tab of the Compare page shows: a held-out test and the predictions of it."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import plotly.graph_objects as go

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.crash_test import CrashTest
from crashfuse.reporting.earlier_prediction import EarlierPrediction
from crashfuse.study.config import StudyConfig
from crashfuse.study.recommendation import Recommendation
from crashfuse.study.repeatability import Repeatability
from crashfuse.study.study import Fold, Study
from crashfuse.ui.beside import Shown, choose_curves, leading, without_clicks
from crashfuse.ui.chosen import View
from crashfuse.ui.computation import StudyRequest, advised
from crashfuse.ui.earlier import earlier_of_test


@dataclass(frozen=True, eq=False)
class Comparison:
    """A held-out test, every prediction of it, and how the reader wants to see them.

    Attributes
    ----------
    view : View
        The choices in the sidebar: campaign, held-out test, rated window, units.
    config : StudyConfig
        The settings that were chosen.
    study : Study
        Of this test alone. While networks train, of fewer approaches than the settings ask for.
    fold : Fold
        The predictions of this test and their ratings.
    others : Campaign
        What the predictions learned from: the campaign without this test and what was left out with it.
    advice : Recommendation or None
        Made without this test; None while approaches are still missing.
    key : Hashable
        Equal for equal data, settings and display: the beginning of the key of a cached figure.
    """

    view: View
    config: StudyConfig
    study: Study
    fold: Fold
    others: Campaign
    advice: Recommendation | None
    key: Hashable

    @classmethod
    def of(cls, view: View, request: StudyRequest, study: Study) -> "Comparison":
        """The comparison that the held-out test's study allows."""
        test, config = view.held_out, request.config
        fold, others = study.fold(test.id), config.training_campaign(view.campaign, test.id)
        whole = study.config.approaches == config.approaches
        given = request.key, test.condition, view.display.window_ms
        advice = advised(*given, fold.estimates, others) if whole else None
        return cls(view, config, study, fold, others, advice, (request.key, study.config.approaches, view.display))

    @property
    def test(self) -> CrashTest:
        """The held-out test."""
        return self.view.held_out

    @property
    def window_ms(self) -> float:
        """Length of the rated window."""
        return self.view.display.window_ms

    @property
    def recommended(self) -> str | None:
        """The approach to use, once it is known."""
        return None if self.advice is None else self.advice.approach

    @property
    def predictions(self) -> Mapping[str, Prediction]:
        """By approach."""
        return {estimate.approach: estimate.prediction for estimate in self.fold.estimates}

    @property
    def earlier(self) -> Sequence[EarlierPrediction]:
        """Predictions of the test with other settings that were chosen to be shown beside these."""
        return earlier_of_test(self.view.campaign, self.test.id, self.leading).chosen

    @property
    def leading(self) -> str:
        """The approach whose predictions with other settings stand beside these."""
        return leading(self.predictions, self.recommended)

    def choose_curves(self, offered: Sequence[str] | None = None) -> Shown:
        """Let the user choose the curves of a figure, of those that are offered, and what is shown beside them."""
        known = self.predictions
        return choose_curves(self.view, known, self.recommended, self.test.condition, self.test.id, offered)

    def plot(self, figure: str, shown: Shown, *, corridors: bool = False, notes: Sequence[Note] = ()) -> go.Figure:
        """A figure of the test with the curves that were chosen."""
        drawn = self.study.plot(
            self.test.id, figure, approaches=shown.approaches, also=shown.also, band=shown.band, measured=shown.test,
            corridors=corridors, notes=notes, display=self.view.display,
        )  # fmt: skip
        return without_clicks(drawn)

    @property
    def repeats(self) -> Mapping[float, Repeatability]:
        """What a repeat of the test would rate, by window; empty if it is not known."""
        return self.study.repeatability.get(self.test.id, {})
