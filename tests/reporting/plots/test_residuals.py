"""The figure of residuals shows prediction minus test."""

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.residuals import residuals
from crashfuse.units import G


def test_a_constant_miss_is_a_horizontal_line_with_its_rms(campaign: Campaign) -> None:
    """A prediction that is 2 g off all the time, with a band of 1 g to either side."""
    test = campaign.tests[1]
    accel = test.pulse.accel_mps2 - 2 * G
    draws = accel + np.linspace(-1, 1, 401)[:, None] * G / 0.95
    figure = residuals(test.pulse, {"fused": Prediction(test.condition, accel, draws)}, window_ms=60)
    band, line = figure.data
    assert line.name == "Fused, RMS 2.0 g"
    np.testing.assert_allclose(line.y, -2.0, atol=1e-4)
    assert (band.y.min(), band.y.max()) == pytest.approx((-3.0, -1.0), abs=1e-4)


def test_a_flipped_sign_flips_the_residuals(campaign: Campaign) -> None:
    """As every figure of accelerations."""
    test = campaign.tests[1]
    prediction = Prediction(test.condition, 0.5 * test.pulse.accel_mps2)
    one, other = (residuals(test.pulse, {"cae": prediction}, deceleration=flip).data[0] for flip in (False, True))
    np.testing.assert_array_equal(one.y, -other.y)
