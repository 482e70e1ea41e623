"""Humps of a pulse are found where they were put, and matched with those of another."""

import numpy as np
import pytest

from crashfuse.signals.humps import counterparts, humps
from crashfuse.signals.pulse import FloatArray

N = 600


def bumps(*centres: float, height: float = 200.0) -> FloatArray:
    """Braking in Gaussian humps of 4 ms at these times in ms, at 10 kHz."""
    time_ms = np.arange(N)[:, None] / 10
    curve: FloatArray = -height * np.exp(-0.5 * ((time_ms - np.array(centres)) / 4) ** 2).sum(axis=1)
    return curve


def test_peaks_are_where_the_humps_are_and_valleys_half_way_between() -> None:
    """Together they fill the curve, whatever its sign."""
    for curve in (bumps(15, 35), -bumps(15, 35)):
        first, second = humps(curve)
        assert (first.begin, first.peak, second.peak, second.end) == (0, 150, 350, N)
        assert first.end == second.begin == pytest.approx(250, abs=1)


def test_a_ripple_is_no_hump_and_a_rise_has_none() -> None:
    """What rises less than a tenth of the largest value above its valleys does not count."""
    ripple = bumps(15) + bumps(40, height=15.0)
    assert [hump.peak for hump in humps(ripple)] == [150]
    assert humps(np.linspace(0.0, -1.0, N)) == ()


def test_each_hump_finds_the_same_one_moved() -> None:
    """2 ms early, at its time, 3 ms late; and one of the three is missing."""
    found = counterparts(bumps(12, 30, 48), bumps(10, 30, 51))
    assert [found[number].peak for number in range(3)] == pytest.approx([100, 300, 510], abs=1)
    assert set(counterparts(bumps(12, 30, 48), bumps(12, 30))) == {0, 1}


def test_flat_curves_have_no_humps_to_match() -> None:
    """Neither a reference nor a comparison of zeros."""
    assert counterparts(bumps(12), np.zeros(N)) == {}
    assert humps(np.zeros(N)) == ()
