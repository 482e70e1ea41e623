"""A prediction with other settings than those of the figure that shows it."""

from dataclasses import dataclass

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.plots.display import Display
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate

LEFT_OUT = {"test": "left out alone", "speed group": "all at its speed left out"}
"""What was left out with a test, in few words."""
WITH_GROUP = "left out with its speed group"


@dataclass(frozen=True, eq=False)
class EarlierPrediction:
    """What an approach estimated with some settings, to be put beside those with others."""

    estimate: Estimate
    config: StudyConfig
    shown: StudyConfig  # of the figure that it is put into: its name says in what its own differ from them

    @property
    def text(self) -> str:
        """In what its settings differ, in words."""
        return otherwise(self.config, self.shown)

    def curve(self, _: Display | None = None) -> tuple[str, Estimate]:
        """Its name in a legend, and itself."""
        return earlier_name(self.estimate.approach, self.config, self.shown), self.estimate


def how_left_out(way: str) -> str:
    """How a test was left out: alone, or with its speed group."""
    return LEFT_OUT["test"] if way == "test" else WITH_GROUP


def earlier_name(approach: str, config: StudyConfig, shown: StudyConfig) -> str:
    """Name of a prediction with other settings in a legend: ``Fused, seed 1``."""
    return ", ".join(filter(None, [LABELS[approach], otherwise(config, shown)]))


def otherwise(config: StudyConfig, shown: StudyConfig) -> str:
    """In what some settings differ from others, in words: ``paper settings, seed 1, left out alone``."""
    left_out = LEFT_OUT.get(config.leave_out, config.leave_out)
    words = {"preset": f"{config.preset} settings", "seed": f"seed {config.seed}", "leave_out": left_out}
    return ", ".join(text for name, text in words.items() if getattr(config, name) != getattr(shown, name))
