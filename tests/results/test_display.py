"""One choice of units for everything that a reader is shown."""

import numpy as np

from crashfuse.condition import Condition
from crashfuse.results.display import Display
from crashfuse.signals.metrics import Metric
from crashfuse.units import KPH, KPH_KG, LB, MPH

METRIC, USUAL = Display(system=KPH_KG, unit="m/s²"), Display()


def test_numbers_are_in_the_chosen_units() -> None:
    """Arrays for figures, single numbers for fields, metrics: a change of velocity is a speed like any other."""
    np.testing.assert_allclose(METRIC.speeds(np.array([56 * KPH])), [56.0], rtol=1e-15)
    np.testing.assert_allclose(USUAL.speeds(np.array([35 * MPH])), [35.0], rtol=1e-15)
    np.testing.assert_allclose([METRIC.weights(950.0), USUAL.weights(2100 * LB)], [950.0, 2100.0], rtol=1e-15)
    delta_v = Metric("delta_v", 66.0, 64.0, None, "km/h")
    assert METRIC.metric(delta_v) == delta_v
    shown = USUAL.metric(delta_v)
    assert (shown.unit, shown.upper) == ("mph", None)
    np.testing.assert_allclose(shown.value or 0.0, 66 * KPH / MPH, rtol=1e-12)


def test_labels_have_the_chosen_units() -> None:
    assert METRIC.title("Impact speed", "mph") == "Impact speed (km/h)"
    assert USUAL.title("Velocity", "km/h") == "Velocity (mph)"
    assert METRIC.title("OLC, slack (65 mm), CFC 60", "g") == "OLC, slack (65 mm), CFC 60 (m/s²)"
    assert METRIC.condition(Condition.of_vector([56 * KPH, 950.0, 700.0])) == "56.0 km/h, front 950 kg, rear 700 kg"
