"""Figure of an import: the resulting pulse over the recorded channels."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from crashfuse.importing.settle import Settled
from crashfuse.readers.record import RecordedChannel
from crashfuse.readers.unit_spelling import ACCELERATION_UNITS
from crashfuse.reporting.plots.canvas import add_line, new_figure
from crashfuse.reporting.plots.curves import TEST, curve_line
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.plots.palette import COLOURS
from crashfuse.units import MS

_FROM_S, _TO_S = -0.02, 0.15
_MOST_CHANNELS, _MOST_POINTS = 8, 4000


def imported_pulse(
    channels: Sequence[RecordedChannel], settled: Settled | None, display: Display = DEFAULT
) -> go.Figure:
    """Draw a record's resulting pulse over its channels as recorded, at most eight, contact at 0.

    As long as the record can't be settled, draw its channels alone, in the file's own time and unit.
    """
    figure = new_figure(height=420)
    scale = display.accel_scale
    factor, zero_s = 1.0, 0.0
    if settled is not None:
        factor = ACCELERATION_UNITS[settled.unit] * (1 if settled.deceleration_sign == "negative" else -1) * scale
        zero_s = settled.time_zero_s
    for number, channel in enumerate(channels[:_MOST_CHANNELS]):
        time = channel.time_s - zero_s
        shown = np.flatnonzero((time >= _FROM_S) & (time <= _TO_S)) if settled is not None else np.arange(time.size)
        shown = shown[:: -(-shown.size // _MOST_POINTS) or 1]
        add_line(
            figure, time[shown] / MS, channel.values[shown] * factor, line={"color": COLOURS["cae"], "width": 1},
            opacity=0.6, name="As recorded", legendgroup="recorded", showlegend=number == 0, hoverinfo="skip",
        )  # fmt: skip
    if settled is None:
        figure.update_xaxes(autorange=True, range=None, title="Time in the file (ms)")
        figure.update_yaxes(title="As in the file")
        return figure
    pulse = settled.pulse
    inside = (pulse.time_s >= _FROM_S) & (pulse.time_s <= _TO_S)
    add_line(
        figure, pulse.time_s[inside] / MS, pulse.accel_mps2[inside] * scale, line=curve_line(TEST),
        name=settled.id,
    )  # fmt: skip
    figure.update_xaxes(range=[_FROM_S / MS, _TO_S / MS])
    figure.update_yaxes(title=display.accel_title)
    return figure
