"""Kinds of files that laboratories and solvers were reported to write: read rightly, asked about, or refused."""

import numpy as np
import pytest

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import DataError
from crashfuse.importing import Choices, Reading, Settled, read_records, settle
from crashfuse.readers.record import PartialCondition
from crashfuse.signals.pulse import GRID_S
from crashfuse.units import KPH, MS, G
from tests.conftest import SHARED, needs_shared

SPEED_MPS, MASS_KG = 14.2, 1560.0
WEIGHTS = Choices(condition=PartialCondition(front_weight_kg=905.0, rear_weight_kg=655.0))
GIVEN = Choices(condition=PartialCondition(51.12 * KPH, None, 905.0, 655.0))


def settled(name: str, choices: Choices = WEIGHTS, role: Role = "tests") -> Settled:
    (record,) = read_records(Reading(SHARED / "real/formats" / name))
    return settle(record, choices, role=role)


@needs_shared
@pytest.mark.parametrize(
    ("name", "role", "channels", "told"),
    [
        ("isomme_side_member/S1", "tests", ["11SIMELERE00ACXP"], "at the rear"),
        ("isomme_filter_letters/Q1", "tests", ["11TUNN000000ACXP"], "11TUNN000000ACXQ (filtered below CFC 60)"),
        ("isomme_filter_letters/V1", "tests", ["11TUNN000000ACXP"], "11TUNN000000ACXV (film analysis)"),
        ("nhtsa_comment/questionable_delta_v", "tests", ["1"], "QUESTIONABLE DELTA-V"),
        ("barrier_sum/LWsum", "tests", ["11TUNN000000ACXP"], "4 load cells"),
        ("lsdyna_barrier_units/g_mm_ms", "cae", ["1"], "all rigid walls"),
        ("lsdyna_preload/run", "cae", ["1"], "rest until 50"),
        ("lsdyna_restart/run", "cae", ["1"], "repeats the states from 60 on"),
        ("lsdyna_no_acceleration/run", "cae", ["1"], "no accelerations"),
    ],
)
def test_the_crash_is_found(name: str, role: Role, channels: list[str], told: str) -> None:
    found = settled(name, role=role)
    motion = found.pulse.kinematics(found.condition.speed_mps)
    assert [*found.channels] == channels
    assert any(told in step for step in found.steps)
    assert not any(step.startswith("Careful") for step in found.steps)
    assert found.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-3)
    assert motion.t0_s / MS == pytest.approx(55.0, abs=0.15)
    assert motion.displacement_m.max() / MS == pytest.approx(500, abs=1)
    assert found.pulse.accel_mps2.min() / G == pytest.approx(-47.7, abs=0.1)
    if found.wall is not None:
        assert found.wall.force_n.max() == pytest.approx(729e3, rel=2e-3)
        witness = found.wall.beside(np.interp(GRID_S, found.pulse.time_s, found.pulse.accel_mps2))
        assert witness.findings(MASS_KG, SPEED_MPS) == []


@needs_shared
@pytest.mark.parametrize(
    ("name", "choices", "role", "told"),
    [
        ("nhtsa_comment/failed_at_50ms", WEIGHTS, "tests", "expected a sound channel of 99001, .*FAILED AT 50 MS"),
        ("lsdyna_feet/run", WEIGHTS, "cae", r"unit of length unknown: .* 51.1 km/h if in ft/s²; .*\n.*\(--unit\)"),
        ("tdms_groups/two_tests.tdms", GIVEN, "tests", "Test_041/.*Test_042/.*choose one"),
    ],
)
def test_what_no_file_tells_is_asked(name: str, choices: Choices, role: Role, told: str) -> None:
    with pytest.raises(DataError, match=told):
        settled(name, choices, role)
