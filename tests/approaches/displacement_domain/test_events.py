"""Events of the CAE model's bias: faults of known place and size in the CAE model of a rigid mass."""

import numpy as np
import pytest

from crashfuse.approaches.displacement_domain.dynamics import integrate
from crashfuse.approaches.displacement_domain.events import CaeEvents, cae_events
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.results.fit_explanations import events_frame
from crashfuse.signals.filters import cfc_filter
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse

S = np.arange(0.0, 1.5, 0.001)
SPEEDS = np.linspace(6.0, 16.0, 6)
FORCE = np.interp(S, [0, 0.03, 0.3, 0.6, 1], [0, 1.2e5, 2e5, 3.5e5, 6e5]) * (1 + 0.15 * np.sin(2 * np.pi * S / 0.12))


def crash(at: Condition, missing_n: FloatArray) -> FloatArray:
    """The CFC 60 pulse of a mass that is stopped by this force more than the CAE model has."""
    motion = integrate(-(FORCE + missing_n)[None] / at.mass_kg, S[1], np.zeros((1, 2)), at.speed_mps)
    stop = int(motion.t0_s[0] / DT_S)
    accel = motion.accel_mps2[0]
    accel[stop:] = accel[stop] * np.exp(-np.arange(accel.size - stop) * DT_S / 0.004)
    return cfc_filter(np.pad(accel, (250, 0)), cfc=60, dt_s=DT_S)[250:]


def events(missing_n: FloatArray, slowest: float = 0.0) -> CaeEvents:
    """Events of tests in which this force is missing in the CAE model, from this speed on."""
    tested = [Condition.of_vector([v, 800.0 + 20 * i, 600.0]) for i, v in enumerate(SPEEDS.tolist())]
    runs = tested + [Condition.of_vector([v, 700.0 + 10 * v, 600.0]) for v in np.linspace(4, 17, 20).tolist()]
    pulses = np.array([crash(run, 0 * S) for run in runs], dtype=np.float32)
    measured = [Pulse(GRID_S, crash(at, missing_n * (at.speed_mps >= slowest))) for at in tested]
    tests = [CrashTest(f"T{at.speed_mps:g}", at, pulse) for at, pulse in zip(tested, measured, strict=True)]
    library = CaeLibrary(tuple(map(str, range(len(runs)))), tuple(runs), pulses)
    return cae_events(Campaign("rigid", library, tuple(tests)), 60.0)


def test_a_cae_model_that_equals_the_tests_has_no_event() -> None:
    found = events(0 * S)
    assert not found.events
    assert found.rating_cae == pytest.approx(1, abs=1e-3)
    assert events_frame(found).columns[0] == "rank"


@pytest.mark.parametrize(("start", "stop", "force_kn"), [(0.1, 0.2, 30.0), (0.25, 0.35, -30.0)])
def test_a_constant_force_is_found_to_a_cell_and_a_tenth(start: float, stop: float, force_kn: float) -> None:
    (row,) = events_frame(events(1e3 * force_kn * ((start <= S) & (stop > S)))).to_dict("records")
    assert (row["from_mm"], row["to_mm"]) == pytest.approx((1e3 * start, 1e3 * stop), abs=10)
    assert row["force_kn"] == pytest.approx(force_kn, rel=0.1)
    assert row["lower_kn"] < row["force_kn"] < row["upper_kn"]
    assert row["conditions"] == "all"
    assert row["rating_cae"] == row["rating_but"] < row["rating_alone"] == row["rating_mended"]
    assert row["share"] > 0.7


def test_a_force_that_only_fast_tests_have_is_theirs() -> None:
    first = events(4e4 * ((S >= 0.1) & (S < 0.2)), slowest=11.0).events[0]
    assert (first.conditions, first.tests) == ("fast", ("T12", "T14", "T16"))
    assert (first.from_m, first.to_m, first.force_n) == pytest.approx((0.1, 0.2, 4e4), rel=0.15)
