"""Figures of pulses by name: a test and predictions of it, or predictions alone, and whatever is put beside them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import plotly.graph_objects as go

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError, one_of, printable, several
from crashfuse.reporting.plots.displacement import energy_over_crush, integration_check, over_displacement
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.pulses import motion, overlay
from crashfuse.signals.metrics import Metric
from crashfuse.signals.pulse import Pulse
from crashfuse.study.estimate import Estimate

T = TypeVar("T")

RUN = "cae:"
"""What may stand before the id of a CAE run, and must where a test has the same id."""


class OtherPrediction(Protocol):
    """A prediction at another condition, or with other settings."""

    @property
    def text(self) -> str:
        """In what it differs, in the shortest words: equal for equal ones of a figure."""

    def curve(self, display: Display) -> tuple[str, Estimate]:
        """Its name in a legend, and itself."""


Further = str | OtherPrediction
"""What a figure shows beside its own curves: a test or CAE run by its id, or another prediction."""


@dataclass(frozen=True, eq=False)
class Curves:
    """What a figure of pulses shows.

    Attributes
    ----------
    measured : Pulse or None
        Of the test at the condition, if one is to be shown.
    shown : mapping of str to Estimate or Prediction
        Estimates by approach; then whatever is put beside them, by its name in the legend.
    band : str or None
        The approach whose band is filled; None for the preferred one.
    """

    measured: Pulse | None
    shown: Mapping[str, Estimate | Prediction]
    condition: Condition
    band: str | None = None

    @property
    def predictions(self) -> dict[str, Prediction]:
        """The pulses by their names."""
        return pulses_of(self.shown)

    @property
    def crush(self) -> dict[str, Metric]:
        """Maximum crush of every estimate, with the interval that tables give."""
        own = {name: each.metrics for name, each in self.shown.items() if isinstance(each, Estimate)}
        return {name: metric for name, metrics in own.items() for metric in metrics if metric.name == "max_crush"}

    def draw(self, figure: str, display: Display) -> go.Figure:
        """The figure of this name.

        Raises
        ------
        UsageError
            If there is none.
        """
        return one_of("figure of pulses", figure, PULSES)(self, display)


PULSES: dict[str, Callable[[Curves, Display], go.Figure]] = {
    "motion": lambda own, display: motion(
        own.measured, own.predictions, own.condition.speed_mps, display, filled=own.band
    ),
    "acceleration": lambda own, display: overlay(own.measured, own.predictions, display, filled=own.band),
    "displacement": lambda own, display: over_displacement(
        own.measured, own.predictions, own.condition.speed_mps, display, filled=own.band, crush=own.crush
    ),
    "energy": lambda own, _: energy_over_crush(
        own.measured, own.predictions, own.condition.speed_mps, own.condition.mass_kg, filled=own.band
    ),
    "integration": lambda own, _: integration_check(own.measured, own.predictions, own.condition.speed_mps),
}
"""Acceleration, velocity and displacement over time; acceleration alone, over time and over displacement; the energy
absorbed over crush; a check of the integration over displacement."""


def chosen(known: Mapping[str, T], approaches: Sequence[str] | None, band: str | None = None) -> dict[str, T]:
    """What is known by approach, of those that are asked for, by default all.

    Raises
    ------
    UsageError
        If one of them did not predict, or that whose band is to be filled, shown or not.
    """
    if band is not None:
        one_of("prediction by", band, known)
    names = known if approaches is None else several(approaches)
    return {name: one_of("prediction by", name, known) for name in names}


def beside(campaign: Campaign, also: Sequence[Further], display: Display) -> dict[str, Estimate | Prediction]:
    """Further pulses by their names in the legend.

    Raises
    ------
    UsageError
        If there is no such test or CAE run.
    """
    return dict(_further(campaign, each, display) for each in several(also))


def pulses_of(shown: Mapping[str, Estimate | Prediction]) -> dict[str, Prediction]:
    """What estimates predict; other pulses as they are."""
    return {name: own.prediction if isinstance(own, Estimate) else own for name, own in shown.items()}


def pulse_name(of: str, condition: Condition, display: Display) -> str:
    """Name of a test or CAE run in a legend."""
    run = f"CAE run {of.removeprefix(RUN)}" if of.startswith(RUN) else of
    return f"{run} · {display.speed(condition.speed_mps)}"


def prediction_name(approach: str, condition: Condition, display: Display) -> str:
    """Name of a prediction at another condition in a legend."""
    return f"{LABELS[approach]} at {display.briefly(condition)}"


def _further(campaign: Campaign, each: Further, display: Display) -> tuple[str, Estimate | Prediction]:
    if not isinstance(each, str):
        if not hasattr(each, "curve"):
            raise UsageError(f"Shown beside are ids and predictions, not {printable(repr(each), 60)}.")
        return each.curve(display)
    if each in campaign.test_ids:
        test = campaign.test(each)
        return pulse_name(each, test.condition, display), Prediction(test.condition, test.pulse.accel_mps2)
    run = each.removeprefix(RUN)
    if run not in campaign.cae.ids:
        raise UsageError(
            f"{campaign.name} has no test and no CAE run {run!r}; its tests are {', '.join(campaign.test_ids)}."
        )
    number = campaign.cae.ids.index(run)
    condition = campaign.cae.conditions[number]
    return pulse_name(RUN + run, condition, display), Prediction(
        condition, campaign.cae.accel_mps2[number].astype(float)
    )
