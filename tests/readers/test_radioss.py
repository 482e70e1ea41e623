"""Time histories of Radioss: a vehicle's pulse, speed and energies are read; anything else is told in a sentence."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse.errors import DataError
from crashfuse.importing import Choices, format_of, settle
from crashfuse.readers.radioss import read_radioss
from crashfuse.run_quality import RunQuality
from tests.conftest import SHARED, needs_shared
from tests.importing.crashes import CRUSH_M, PEAK_MPS2, SPEED_MPS, STOP_S
from tests.readers.radioss_files import END_MS, time_history
from tests.readers.test_lsdyna import WEIGHTS

FILES = SHARED / "real" / "formats" / "radioss"


def saved(folder: Path, content: bytes) -> Path:
    """Write it as the solver would."""
    (folder / "hc1T01").write_bytes(content)
    return folder / "hc1T01"


@pytest.mark.parametrize("layout", [3040, 4021])
@pytest.mark.parametrize("codes", [(1, 4, 7), (4, 7), (4,)])
def test_the_pulse_of_what_lies_behind_the_crush_is_read(tmp_path: Path, codes: tuple[int, ...], layout: int) -> None:
    """Of two nodes the one that rebounds less, in the direction of travel, from its velocity if need be."""
    path = saved(tmp_path, time_history(codes, layout))
    assert format_of(path) == "radioss"
    (record,) = read_radioss(path)
    assert (record.id, record.proposed, len(record.channels)) == ("hc1", ("758",), 2)
    assert record.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-6)
    assert record.condition.mass_kg == pytest.approx(1700)
    settled = settle(record, WEIGHTS, role="cae")
    assert (settled.unit, settled.deceleration_sign) == ("mm/ms²", "positive")
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)
    motion = settled.pulse.kinematics(settled.condition.speed_mps)
    assert motion.t0_s == pytest.approx(STOP_S, abs=1e-4)
    assert motion.displacement_m.max() == pytest.approx(CRUSH_M, rel=2e-3)


def test_quality_is_that_of_the_global_histories(tmp_path: Path) -> None:
    """All energy less the work from outside: 80 - 90 + 1 + 2 + 4 + 3 = 0; and 4 of 80; and 1.25 %."""
    (record,) = read_radioss(saved(tmp_path, time_history()))
    quality = record.quality
    assert quality.energy_change == pytest.approx(0.0, abs=1e-6)
    assert quality.hourglass_share == pytest.approx(0.05)
    assert quality.added_mass_share == pytest.approx(0.0125)


@pytest.mark.parametrize(
    ("damage", "found"),
    [
        (lambda _: b"", "one that was cut short"),
        (lambda _: b"x" * 5000, "one that was cut short, or another kind"),
        (lambda content: content[:200], "cut short"),
        (lambda content: content[:1200], "found "),
        (lambda content: content[:-40_000] + b"\1" * 20_000, "states that are not alike"),
        (lambda content: content[:8] + b"\xff" * 80 + content[88:184] + b"\x7f" * 24 + content[208:], "makes no sense"),
    ],
)
def test_a_damaged_file_is_told(tmp_path: Path, damage: object, found: str) -> None:
    """In one sentence, whatever is wrong with it."""
    with pytest.raises(DataError) as caught:
        read_radioss(saved(tmp_path, damage(time_history())))  # type: ignore[operator]
    assert "\n" not in str(caught.value)
    assert found in str(caught.value)


def test_a_run_that_was_stopped_is_read_to_its_last_whole_state(tmp_path: Path) -> None:
    """Half a state at the end is left out."""
    whole = time_history()
    (record,) = read_radioss(saved(tmp_path, whole[:-30]))
    assert record.channels[0].time_s.size == round(END_MS / 0.1) - 1


def test_nodes_without_velocity_are_asked_for(tmp_path: Path) -> None:
    """Displacement alone is no pulse."""
    with pytest.raises(DataError, match=r"the velocity of nodes along x \(VX\), found none; ask the solver"):
        read_radioss(saved(tmp_path, time_history((1, 2))))


@needs_shared
def test_a_vehicle_of_openradioss_is_read_as_its_converter_reads_it() -> None:
    """A vehicle front: the pulse of the occupant cell, and quality as from the CSV of the solver's own converter."""
    (record,) = read_radioss(FILES / "veh_pickup" / "hc1T01")
    table = pd.read_csv(FILES / "veh_pickup" / "hc1T01.csv")
    table.columns = [name.strip() for name in table.columns]
    assert record.proposed == ("758",)
    np.testing.assert_allclose(record.channels[1].time_s, table["time"] * 1e-3, rtol=1e-6, atol=1e-9)
    velocity = table.filter(regex="^mains +758").to_numpy()[:, 2]
    settled = settle(record, Choices(front_share=0.55), role="cae")
    motion = settled.pulse.kinematics(settled.condition.speed_mps)
    assert record.condition.speed_mps == pytest.approx(abs(velocity[0]), rel=1e-6)
    crossing = table["time"][int(np.argmax(velocity >= 0))]
    assert motion.t0_s * 1e3 == pytest.approx(crossing, abs=0.3)
    energy = table[["INTERNAL ENERGY", "KINETIC ENERGY", "ROTATION ENERGY", "CONTACT ENERGY", "HOURGLASS ENERGY"]]
    change = energy.sum(axis=1) - table["EXTERNAL WORK"] - energy.iloc[0].sum()
    expected = RunQuality(
        change[change.abs().idxmax()] / energy.iloc[0].sum(), 0.0, table["PERCENTAGE ADDED MASS"].max() / 100
    )
    assert record.quality.energy_change == pytest.approx(expected.energy_change, rel=1e-3)
    assert record.quality.hourglass_share == expected.hourglass_share
    assert record.quality.added_mass_share == pytest.approx(expected.added_mass_share, rel=1e-6)


@needs_shared
@pytest.mark.parametrize("name", ["ACCELEROT01", "BOX1BLT01"])
def test_runs_without_a_vehicle_are_read_and_fairly_refused(name: str) -> None:
    """A tensile specimen and a box: their nodes are read, and what a vehicle has is asked for."""
    (record,) = read_radioss(FILES / name)
    assert record.channels
    with pytest.raises(DataError, match="the weights on both axles"):
        settle(record, role="cae")
