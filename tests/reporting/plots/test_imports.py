"""The figure of an import shows what was recorded and what comes of it, on one clock and in one unit."""

from dataclasses import replace

import numpy as np
import pytest

from crashfuse.importing import settle
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.plots.imports import imported_pulse
from tests.importing.crashes import CONDITION, PEAK_MPS2, channel, record


def test_the_recording_lies_under_its_pulse() -> None:
    """A file that counts braking positive in m/s² and starts late: both curves have their trough at one place."""
    raw = replace(channel(scale=-9.80665, unit="m/s²"), time_s=channel().time_s + 0.3)
    source = replace(record(raw, condition=CONDITION), own_time_zero="")
    found = settle(source)
    recorded, pulse = imported_pulse([raw], found, Display(unit="m/s²")).data
    assert recorded.y.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    assert pulse.y.min() == pytest.approx(-PEAK_MPS2, rel=0.01)
    assert recorded.x[recorded.y.argmin()] == pytest.approx(pulse.x[pulse.y.argmin()], abs=0.5)
    flipped, _ = imported_pulse([raw], found, Display(unit="m/s²", deceleration=True)).data
    assert flipped.y.max() == pytest.approx(PEAK_MPS2, rel=1e-3)


def test_what_cannot_be_settled_is_drawn_as_it_is() -> None:
    """The file's own time, its own numbers, and no more curves than can be told apart."""
    channels = [channel(str(number), scale=2.0) for number in range(12)]
    figure = imported_pulse(channels, None)
    assert len(figure.data) == 8
    assert figure.data[0].x[0] == pytest.approx(1000 * channels[0].time_s[0])
    assert np.abs(figure.data[0].y).max() == pytest.approx(2 * np.abs(channel().values).max(), rel=1e-3)
    assert figure.layout.yaxis.title.text == "As in the file"
