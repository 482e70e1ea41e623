"""Directions of columns: the axis of travel is that of the largest change of velocity, unless the user gives it."""

from pathlib import Path

import numpy as np
import pytest

from crashfuse import cli
from crashfuse.importing import Reading, import_source, read_records
from crashfuse.readers.table_headers import Heading
from crashfuse.readers.vocabulary import Travel
from crashfuse.testing.readers import written
from tests.conftest import Capture
from tests.importing.crash_files import german
from tests.importing.crashes import GIVEN, PEAK_MPS2, clock, half_sine_g

TIME_S = clock(0.0, 0.12, 5000)
PULSE = half_sine_g(TIME_S)
SHAKING = 2 * np.sin(2 * np.pi * 300 * TIME_S)


def table(folder: Path, header: str, *columns: np.ndarray) -> Path:
    return written(folder, {"run7.csv": german(TIME_S, *columns, header=f"Time [ms];{header}")}) / "run7.csv"


@pytest.mark.parametrize(
    ("header", "along"),
    [
        ("ax [g];ay [g];az [g]", "y"),
        ("X-Acceleration [g];Y-Acceleration [g];Z-Acceleration [g]", "z"),
        ("Node 12 acc_x [g];Node 12 acc_y [g];Node 12 acc_z [g]", "y"),
        ("10VEHC000000ACXP [g];10VEHC000000ACYP [g];10VEHC000000ACZP [g]", "y"),
        ("ax [g];ay [g];az [g]", "x"),
    ],
)
def test_the_axis_of_a_table_is_found_from_the_motion(tmp_path: Path, header: str, along: str) -> None:
    columns = [PULSE if axis == along else SHAKING for axis in "xyz"]
    source = table(tmp_path, header, *columns)
    (run,) = import_source(source, tmp_path / "out", GIVEN, role="cae")
    assert run.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=0.01)
    assert run.channels == (header.split(";")["xyz".index(along)],)
    careful = [step for step in run.steps if "travel along" in step.lower()]
    assert len(careful) == (along != "x")
    assert all(step.startswith(f"Careful: travel along {along}, by the change of velocity; ") for step in careful)
    given: Travel = "x" if along == "x" else "y" if along == "y" else "z"
    (record,) = read_records(Reading(source, travel=given))
    assert record.proposed == run.channels
    assert f"Travel along {given}, given by the user." in record.steps


def test_a_table_without_x_is_read_along_what_it_has(tmp_path: Path, capsys: Capture) -> None:
    source = table(tmp_path, "Time history ay [g]", PULSE)
    (run,) = import_source(source, tmp_path / "out", GIVEN, role="cae")
    assert any(step.startswith("Careful: travel along y") for step in run.steps)
    assert cli.main(["import", str(source), "--out", str(tmp_path / "no"), "--travel", "-z"]) == cli.WRONG_DATA
    assert "expected time and acceleration" in capsys.readouterr().err


def test_a_dead_sensor_does_not_travel(tmp_path: Path) -> None:
    """A z channel that is stuck at 90 g, or feels gravity, or has an offset: the pulse stays that along x."""
    drift = np.cumsum(np.full(TIME_S.size, 1e-4))
    for number, other in enumerate((np.full(TIME_S.size, 90.0), 5 * SHAKING + 20, 5 * SHAKING + drift, 0 * PULSE)):
        (record,) = read_records(Reading(table(tmp_path / str(number), "ax [g];az [g]", PULSE, other)))
        assert record.proposed == ("ax [g]",)


DUMMIES = (
    "Head X;Kopf;tête conducteur;cabeza;testa;cabeça;hoofdversnelling;huvud;głowa;hlava řidiče;baş ivmesi;голова;頭部;"
    "머리;chest;Becken;genou;HeadAccX;Dummy 1;Occupant X;manichino;乘员胸部"
)
VEHICLES = (
    "Occupant compartment X;occupant safety cell;foot well;Fußraum;Insassenzelle;Headliner;habitacle;pied milieu;客室;"
    "乗員室;先頭車両;车头;Hoofdsteun;Firewall X;Tunnel reinforcement;Kraftstofftank;load floor;Longeron bas;Pos. 3;Z4"
)
CURVES = "RF1;rwall_1;vx;v_x;Contact 3;disp;force;Kraft;Weg;Geschwindigkeit;сила;速度;変位;Rigidwall 1;RWFORC;U1;Weg x"


def test_words_of_many_languages_tell_dummies_from_vehicles_and_quantities() -> None:
    dummies, vehicles, curves = ([Heading(name) for name in names.split(";")] for names in (DUMMIES, VEHICLES, CURVES))
    assert [heading.text for heading in dummies if not heading.names_a_dummy] == []
    assert [heading.text for heading in vehicles if heading.names_a_dummy or heading.why_no_acceleration] == []
    assert [heading.text for heading in curves if not heading.why_no_acceleration] == []
