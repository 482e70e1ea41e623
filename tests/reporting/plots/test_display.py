"""What a reader has chosen for all figures decides scale and title."""

import pytest

from crashfuse.reporting.plots.display import Display, Unit


@pytest.mark.parametrize(
    ("unit", "deceleration", "shown", "title"),
    [
        ("g", False, -2.0, "Acceleration (g)"),
        ("g", True, 2.0, "Deceleration (g)"),
        ("m/s²", False, -19.6133, "Acceleration (m/s²)"),
        ("m/s²", True, 19.6133, "Deceleration (m/s²)"),
    ],
)
def test_braking_at_2_g_is_shown_in_the_unit_and_with_the_sign_of_the_axis(
    unit: Unit, deceleration: bool, shown: float, title: str
) -> None:
    """Data are signed m/s²; only what is shown turns."""
    display = Display(unit=unit, deceleration=deceleration)
    assert -19.6133 * display.accel_scale == pytest.approx(shown)
    assert display.accel_title == title
