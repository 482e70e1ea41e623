"""A fold rates what was predicted, and what was drawn, against the test."""

import numpy as np
import pytest

from crashfuse.approaches.base import Prediction
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError
from crashfuse.signals.pulse import Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.estimate import Estimate
from crashfuse.study.fold import Fold


def test_drawn_pulses_are_rated_as_any_pulse_is(campaign: Campaign) -> None:
    """Of two draws, the test itself rates 1 and a softer pulse what ISO/TS 18571 gives it."""
    test = campaign.tests[1]
    softer = 0.8 * test.pulse.accel_mps2
    prediction = Prediction(test.condition, softer, np.array([test.pulse.accel_mps2, softer]))
    fold = Fold.of(test, [Estimate("fused", prediction, {}, 0.0)], [40.0, 60.0])
    for window in (40.0, 60.0):
        expected = rate_windows(test.pulse, Pulse(test.pulse.time_s, softer), [window])[window].overall
        np.testing.assert_allclose(fold.rating_draws("fused", window), [1.0, expected], atol=1e-3)
    lower, upper = fold.rating_interval("fused", 60.0)
    assert expected < lower < upper < 1.0


def test_an_approach_without_a_band_has_no_spread(campaign: Campaign) -> None:
    """There is one pulse and one rating; who asks for a spread is told that there is none."""
    test = campaign.tests[1]
    fold = Fold.of(test, [Estimate("cae", Prediction(test.condition, test.pulse.accel_mps2), {}, 0.0)], [60.0])
    assert fold.with_band == ()
    with pytest.raises(UsageError, match="cae has no band"):
        fold.rating_draws("cae", 60.0)
    assert fold.ratings["cae"][60.0].overall == pytest.approx(1.0)
