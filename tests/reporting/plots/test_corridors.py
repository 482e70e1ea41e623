"""The corridors drawn are those of ISO/TS 18571."""

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.canvas import new_figure
from crashfuse.reporting.plots.corridors import add_corridors
from crashfuse.reporting.plots.display import Display
from crashfuse.signals.pulse import GRID_S
from crashfuse.units import G


def test_they_are_5_and_50_percent_of_the_largest_acceleration_wide(campaign: Campaign) -> None:
    """To either side of the test, over the rated window only."""
    pulse = campaign.tests[1].pulse
    outer, inner = add_corridors(new_figure(400), pulse, Display(window_ms=40.0)).data
    largest = np.abs(pulse.accel_mps2[GRID_S < 0.04]).max() / G
    for corridor, share in ((outer, 0.5), (inner, 0.05)):
        n = len(corridor.x) // 2
        lower, upper = corridor.y[:n], corridor.y[: n - 1 : -1]
        np.testing.assert_allclose(upper - lower, 2 * share * largest, rtol=1e-4)
        np.testing.assert_allclose((upper + lower) / 2, pulse.accel_mps2[GRID_S < 0.04] / G, atol=1e-4)
        assert corridor.x.max() == pytest.approx(39.92)
