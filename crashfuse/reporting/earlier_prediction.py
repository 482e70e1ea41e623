"""A prediction of a held-out test with other settings than those of the study whose figures show it."""

from dataclasses import dataclass

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.display import Display
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate

LEFT_OUT = {"test": "left out alone", "speed group": "all at its speed left out"}
"""What was left out with a test, in few words."""


@dataclass(frozen=True, eq=False)
class EarlierPrediction:
    """What an approach estimated of a held-out test with some settings, to be put beside those with others.

    Attributes
    ----------
    config : StudyConfig
        Its settings.
    shown : StudyConfig
        Those of the figure that it is put into: its name says in what the first differ from them.
    """

    estimate: Estimate
    config: StudyConfig
    shown: StudyConfig

    @property
    def text(self) -> str:
        """In what its settings differ, in words."""
        return otherwise(self.config, self.shown)

    def curve(self, _: Display) -> tuple[str, Estimate]:
        """Its name in a legend, and itself."""
        return earlier_name(self.estimate.approach, self.config, self.shown), self.estimate


def earlier_name(approach: str, config: StudyConfig, shown: StudyConfig) -> str:
    """Name of a prediction with other settings in a legend."""
    return f"{LABELS[approach]}, {otherwise(config, shown)}"


def otherwise(config: StudyConfig, shown: StudyConfig) -> str:
    """In what some settings differ from others, in words: ``paper settings, seed 1, left out alone``."""
    said = {
        f"{config.preset} settings": config.preset != shown.preset,
        f"seed {config.seed}": config.seed != shown.seed,
        LEFT_OUT[config.leave_out]: config.leave_out != shown.leave_out,
    }
    return ", ".join(words for words, differs in said.items() if differs)
