"""The barrier as a second witness: wrong masses, gains, time zeros and triggers are found, sound tests left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import WALLS, load_campaign
from crashfuse.campaign_folder.writer import write_campaign
from crashfuse.errors import DataError
from crashfuse.importing import Settled, import_source, settle
from crashfuse.readers.lsdyna import read_lsdyna
from crashfuse.readers.nhtsa import read_nhtsa
from crashfuse.readers.radioss import read_binary, read_radioss
from crashfuse.results.result_tables import wall_table
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray
from crashfuse.signals.wall import BEGIN_S, Wall, Witness
from crashfuse.testing.readers import written
from tests.conftest import SHARED, needs_shared, not_none
from tests.importing.crashes import SPEED_MPS, half_sine_g
from tests.readers.lsdyna_files import Run
from tests.readers.nhtsa_files import nhtsa_files
from tests.readers.radioss_files import RadiossRun
from tests.readers.test_lsdyna import WEIGHTS

MASS_KG = 1700.0
TIME_S = BEGIN_S + DT_S * np.arange(1900)


def pulse(late_s: float = 0.0) -> FloatArray:
    return np.asarray(half_sine_g(GRID_S - late_s) * 9.80665)


def wall(late_s: float = 0.0, lead_s: float = 0.0) -> Wall:
    """What the barrier felt of it; what is ahead of the cell feels it earlier."""
    return Wall(TIME_S, -MASS_KG * half_sine_g(TIME_S - late_s + lead_s) * 9.80665)


@pytest.mark.parametrize("lead_s", [0.0, 4e-3])
@pytest.mark.parametrize(
    ("mass", "gain", "late_s", "sensor_s", "told"),
    [
        (1.0, 1.0, 0.0, 0.0, []),
        (1.03, 0.98, 0.0, 0.0, []),
        (1.1, 1.0, 0.0, 0.0, ["weights"]),
        (0.9, 1.0, 0.0, 0.0, ["weights"]),
        (0.5, 1.0, 0.0, 0.0, ["a sum among them): 0."]),
        (1e-3, 1.0, 0.0, 0.0, ["a sum among them): 0.001 times"]),
        (1 / 2.2046, 1.0, 0.0, 0.0, ["check its weights"]),
        (1.0, 0.8, 0.0, 0.0, ["sensor, which reads 0.8"]),
        (1.0, 1.0, 10e-3, 0.0, ["time zero"]),
        (1.0, 1.0, 0.0, 12e-3, ["trigger"]),
    ],
)
def test_what_is_wrong_is_found_and_nothing_else(
    mass: float, gain: float, late_s: float, sensor_s: float, told: list[str], lead_s: float
) -> None:
    """Ten per cent of mass, a gain of 0.8, ten milliseconds of time zero, a sensor triggered late."""
    witness = wall(late_s, min(lead_s, 3e-3)).beside(gain * pulse(late_s + sensor_s))
    findings = witness.findings(mass * MASS_KG, SPEED_MPS)
    assert len(findings) == len(told)
    assert all(words in finding for words, finding in zip(told, findings, strict=True))


def test_it_is_kept_with_its_test_and_told_by_the_check(campaign: Campaign, tmp_path: Path) -> None:
    test = campaign.tests[0]
    force = np.interp(TIME_S, GRID_S, -1.2 * test.condition.mass_kg * test.pulse.accel_mps2, left=0.0, right=0.0)
    tests = (replace(test, wall=Wall(TIME_S, force)), *campaign.tests[1:])
    write_campaign(replace(campaign, tests=tests), tmp_path / "c")
    again = load_campaign(tmp_path / "c")
    assert any(test.id in warning and "1.20 times mass" in warning for warning in again.warnings)
    assert wall_table(again).texts()["Ratio"].tolist() == ["1.200"]
    assert len(again.plot("wall").data) == 2
    impulse = replace(tests[0], wall=Wall(TIME_S, np.cumsum(force)))
    write_campaign(replace(campaign, tests=(impulse, *campaign.tests[1:])), tmp_path / "d")
    with pytest.raises(DataError, match=f"{WALLS['tests']}, {test.id}.*as an impulse is"):
        load_campaign(tmp_path / "d")


def witness_of(settled: Settled) -> Witness:
    """What the barrier says of an imported pulse."""
    return not_none(settled.wall).beside(np.interp(GRID_S, settled.pulse.time_s, settled.pulse.accel_mps2))


def test_forces_and_impulses_of_rigid_walls_are_read_in_either_solver(tmp_path: Path) -> None:
    """``rwforc`` of LS-DYNA as it is, the impulses of Radioss differentiated: both witness the mass and the pulse."""
    (dyna,) = read_lsdyna(written(tmp_path / "d", {"binout0000": Run(has_wall=True).binout()}))
    (radioss,) = read_radioss(written(tmp_path / "r", {"hc1T01": RadiossRun().binary()}))
    for record in (dyna, radioss):
        witness = witness_of(settle(record, WEIGHTS, role="cae"))
        assert witness.share(MASS_KG) == pytest.approx(1.0, abs=0.02)
        assert witness.findings(MASS_KG, SPEED_MPS) == []


def test_load_cells_of_nhtsa_are_read_at_import(tmp_path: Path) -> None:
    (settled,) = import_source(written(tmp_path / "v", nhtsa_files()), tmp_path / "c", fmt="nhtsa")
    assert witness_of(settled).share(MASS_KG) == pytest.approx(1.0, abs=0.03)
    assert (tmp_path / "c" / WALLS["tests"]).is_file()
    another = {name: text.replace(b"|101|LC", b"|102|LC") for name, text in nhtsa_files().items()}  # its file lacks
    assert read_nhtsa(written(tmp_path / "w", another))[0].wall is None


@needs_shared
def test_impulses_of_the_solver_are_the_change_of_its_momentum() -> None:
    path = SHARED / "real" / "formats" / "radioss" / "BOX1BLT01"
    history = read_binary(path.read_bytes(), path.name)
    change, impulse = (values - values[0] for values in (history.model["X-MOMENTUM"], history.walls["X"]))
    np.testing.assert_allclose(-impulse, change, atol=2e-3 * np.abs(change).max())
