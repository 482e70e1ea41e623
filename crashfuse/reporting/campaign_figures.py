"""Figures of a campaign by name: its tests, their conditions, the CAE runs, and what the CAE model gets wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Unpack

import plotly.graph_objects as go

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.displacement_domain.approach import measured_bias
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError, one_of, several
from crashfuse.execution.cache import Cache
from crashfuse.reporting.figures import Further, beside, pulses_of
from crashfuse.reporting.plots.conditions import condition_space
from crashfuse.reporting.plots.displacement import bias_by_speed
from crashfuse.reporting.plots.display import Display, DisplayOptions
from crashfuse.reporting.plots.pulses import library_band, measured_pulses


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a figure of a campaign shows."""

    campaign: Campaign
    tests: Sequence[CrashTest]
    held_out: str | None
    cfc: float | None
    also: Sequence[Further]
    display: Display

    @property
    def further(self) -> dict[str, Prediction]:
        """Further pulses by their names in the legend."""
        return pulses_of(beside(self.campaign, self.also, self.display))


def campaign_figure(
    campaign: Campaign,
    figure: str,
    *,
    tests: Sequence[str],
    held_out: str | None,
    cfc: float | None,
    also: Sequence[Further],
    **options: Unpack[DisplayOptions],
) -> go.Figure:
    """A figure of a campaign, see :meth:`Campaign.plot`."""
    draw = one_of("figure of a campaign", figure, FIGURES)
    if cfc is not None and figure != "tests":
        raise UsageError("A filter is for the figure tests.")
    if also and figure not in ("tests", "cae"):
        raise UsageError("Further curves are for the figures tests and cae.")
    if held_out is not None:
        campaign.test(held_out)
    some = [campaign.test(test) for test in several(tests) or campaign.test_ids]
    return draw(_Shown(campaign, some, held_out, cfc, also, Display.of(campaign.units, **options)))


def _tests(own: _Shown) -> go.Figure:
    return measured_pulses(
        own.tests,
        among=own.campaign.tests,
        highlight=own.held_out,
        cfc=own.cfc,
        display=own.display,
        further=own.further,
    )


def _bias(own: _Shown) -> go.Figure:
    model = CaeModel(cache=Cache()).fit(own.campaign.cae)
    biases = [measured_bias(test, model) for test in own.tests]
    return bias_by_speed(own.tests, biases, among=own.campaign.tests, highlight=own.held_out, display=own.display)


FIGURES: dict[str, Callable[[_Shown], go.Figure]] = {
    "tests": _tests,
    "conditions": lambda own: condition_space(own.campaign.cae, own.tests, held_out=own.held_out, display=own.display),
    "cae": lambda own: library_band(own.campaign.cae, own.tests, display=own.display, further=own.further),
    "bias": _bias,
}
"""Pulses of the tests; conditions of tests and CAE runs; pulses of the CAE runs; tests minus CAE over displacement."""
