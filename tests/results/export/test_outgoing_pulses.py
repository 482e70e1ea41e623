"""The pulse that goes on to an occupant model is the predicted one, and says that it was predicted."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.readers.isomme import read_isomme
from crashfuse.results.export.outgoing_pulses import PulseExport, PulseFormat, outgoing
from crashfuse.results.export.solver_curves import UNIT_SYSTEMS, SolverCurve
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray
from crashfuse.study.estimate import Estimate
from crashfuse.testing.readers import written
from crashfuse.units import KPH_KG
from tests.conftest import OTHER_READERS, needs_other_readers

SPEED_MPS, T0_S, N_DRAWS = 15.0, 0.06, 40
CONDITION = Condition.of_vector([SPEED_MPS, 950.0, 700.5])
PULSE = np.where(GRID_S <= T0_S, -SPEED_MPS / T0_S, 0.0)
SHIFTS = np.linspace(-30, 30, N_DRAWS)
ANY = SolverCurve("m-s-kg")


@pytest.fixture
def estimates() -> list[Estimate]:
    """Two approaches, one with draws: a constant deceleration that stops the vehicle at t0, and parallels of it."""
    note = "Extrapolation: the front weight 2237 lb lies outside the CAE runs' 1922–2185 lb."
    return [
        Estimate(CONDITION, PULSE * 1.1, approach="cae", seconds=0.1),
        Estimate(CONDITION, PULSE, PULSE + SHIFTS[:, None], (note,), approach="fused", seconds=0.2),
    ]


Write = Callable[..., Path]


@pytest.fixture
def write(campaign: Campaign, estimates: list[Estimate], tmp_path: Path) -> Write:
    """Writes an export of them, from the campaign changed like this; returns the folder."""

    def folder(export: PulseExport, **changes: Any) -> Path:
        for name, files in export.files(replace(campaign, **changes), estimates).items():
            written(tmp_path / name, files)
        return tmp_path

    return folder


def columns(path: Path) -> FloatArray:
    """The points of an include: lines of two numbers in columns of 20."""
    lines = path.read_text(encoding="ascii").splitlines()
    start = max(number for number, line in enumerate(lines) if line.startswith(("$#", "#  "))) + 1
    numbers = [line for line in lines[start:] if line != "*END"]
    assert {len(line) for line in numbers} == {40}
    return np.array([(float(line[:20]), float(line[20:])) for line in numbers])


def asked_of(reader: str, program: str, *paths: Path) -> Any:
    """What a program of others, in a process of its own, prints as JSON; ``paths`` are its arguments."""
    env = {**os.environ, "PYTHONPATH": str(OTHER_READERS)}
    code = f"import json, sys\n{reader}\nprint(json.dumps({program}))"
    command = [sys.executable, "-W", "ignore", "-c", code, *map(str, paths)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(
    ("system", "time", "accel"), [("mm-ms-kg", 1e3, 1e-3), ("mm-s-t", 1.0, 1e3), ("m-s-kg", 1.0, 1.0)]
)
def test_a_curve_is_in_the_units_of_the_model(system: str, time: float, accel: float) -> None:
    """Time in ms or s; 1 m/s² is 0.001 mm/ms² or 1000 mm/s²; two zeros follow the pulse, half a step on and on."""
    points = SolverCurve(system).points(PULSE)
    np.testing.assert_allclose(points[:-2, 0], GRID_S * time, rtol=1e-12)
    np.testing.assert_allclose(points[:-2, 1], PULSE * accel, rtol=1e-12)
    np.testing.assert_array_equal(points[-2:, 1], 0.0)
    assert set(UNIT_SYSTEMS) == {"mm-ms-kg", "mm-s-t", "m-s-kg"}
    braking = SolverCurve(system, deceleration_sign="positive", scale=1 / 9.80665).points(PULSE)
    assert braking[0, 1] == pytest.approx(SPEED_MPS / T0_S / 9.80665 * accel)


@pytest.mark.parametrize("start_s", [0.0, 0.01, 0.00997, 0.00003, 1.0])
def test_a_curve_that_starts_later_is_zero_until_then_in_even_steps(start_s: float) -> None:
    """From time zero, or within a step of it: LS-DYNA samples curves anew in even steps, as many as LCINT says."""
    points = SolverCurve("m-s-kg", start_s=start_s).points(PULSE)
    np.testing.assert_allclose(np.diff(points[:, 0]), DT_S, rtol=1e-6)
    assert 0 <= points[0, 0] < DT_S
    contact = np.flatnonzero(points[:, 1])[0]
    assert points[contact, 0] == pytest.approx(start_s, abs=1e-12)
    np.testing.assert_array_equal(points[contact : contact + PULSE.size, 1], PULSE)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"unit_system": "in-s-lb"}, "choose from mm-ms-kg, mm-s-t, m-s-kg"),
        ({"start_s": -0.01}, "not at -10 ms"),
        ({"start_s": float("nan")}, "a number, not nan"),
        ({"scale": -1.0}, "the sign is set apart"),
        ({"scale": float("inf")}, "a number, not inf"),
        ({"number": 0}, "between 1 and 99999999"),
        ({"formats": ("csv",)}, "format of pulses 'csv'"),
        ({"formats": ("lsdyna",)}, "unit system"),
        ({"location": "VEHC"}, "12 digits and capitals"),
        ({"location": "10VEHC000000ACXD"}, "12 digits and capitals"),
        ({"draws": -1}, "0 or more"),
    ],
)
def test_a_curve_or_an_export_that_makes_no_sense_is_refused(wrong: dict[str, Any], sentence: str) -> None:
    is_export = {*wrong} & {"formats", "location", "draws"}
    with pytest.raises(UsageError, match=sentence):
        PulseExport(**wrong) if is_export else SolverCurve(**{"unit_system": "m-s-kg", **wrong})


def test_whole_draws_go_out_and_no_edges_of_the_band(estimates: list[Estimate]) -> None:
    """Each draw bears its number; all differ by a shift alone, so do these, in their order; the seed decides which."""
    cae, expected, representative, *drawn = outgoing(estimates, 5, seed=3)
    assert [p.which for p in (cae, expected, representative)] == ["expected", "expected", "representative"]
    assert (cae.name, expected.name) == ("cae_33.554mph_expected", "fused_33.554mph_expected")
    numbers = [int(pulse.which.removeprefix("draw_")) for pulse in drawn]
    assert len(set(numbers)) == 5
    shifts = np.array([pulse.accel_mps2 - PULSE for pulse in (representative, *drawn)])
    np.testing.assert_allclose(np.ptp(shifts, axis=1), 0.0, atol=1e-9)
    np.testing.assert_array_equal(np.argsort(shifts[1:, 0]), np.argsort([SHIFTS[n - 1] for n in numbers]))
    assert [pulse.which for pulse in outgoing(estimates, 5, 4)][3:] != [pulse.which for pulse in drawn]


def test_the_corridor_of_a_sled_is_that_of_whole_pulses(estimates: list[Estimate], write: Write) -> None:
    """A test for each edge, of one channel up to 60 ms; nine of ten draws, all parallel, lie between both."""
    folder = write(PulseExport(("isomme", "lsdyna"), curve=ANY))
    tests = [read_isomme(folder / f"isomme/fused_33.554mph_corridor_{edge}") for edge in ("lower", "upper")]
    (lower,), (upper,) = (test.channels for test in tests)
    assert "Fused, lower edge of the corridor, 33.554 mph" in " ".join(lower.comments)
    drawn = PULSE[:750] + SHIFTS[:, None]
    assert ((lower.values <= drawn) & (drawn <= upper.values)).all(axis=1).sum() == 0.9 * N_DRAWS
    assert len(list((folder / "lsdyna").iterdir())) == len(estimates) + 1


def test_more_draws_than_there_are_is_one_sentence(estimates: list[Estimate]) -> None:
    with pytest.raises(UsageError, match="fused has 40 draws"):
        list(outgoing(estimates, 41, 0))
    with pytest.raises(UsageError, match="no draws of cae"):
        list(outgoing(estimates[:1], 1, 0))


@pytest.mark.parametrize(("kind", "suffix"), [("lsdyna", "k"), ("radioss", "inc")])
def test_an_include_holds_one_curve_in_columns_of_twenty(
    estimates: list[Estimate], write: Write, kind: PulseFormat, suffix: str
) -> None:
    """Each has an id of its own, so that all fit into one model; the numbers are exact to 12 digits."""
    curve = SolverCurve("mm-s-t", start_s=0.01, number=4711)
    folder = write(PulseExport((kind,), draws=2, curve=curve)) / kind
    assert len(list(folder.iterdir())) == 2 + 1 + 2
    for place, pulse in enumerate(outgoing(estimates, 2, 0)):
        path = folder / f"{pulse.name}.{suffix}"
        np.testing.assert_allclose(columns(path), curve.points(pulse.accel_mps2), rtol=1e-12, atol=1e-12)
        assert max(map(len, path.read_text(encoding="ascii").splitlines())) <= 80
        ids = {"lsdyna": f"\n{4711 + place:>10}         0", "radioss": f"\n/FUNCT/{4711 + place}\n"}
        assert ids[kind] in path.read_text(encoding="ascii")


def test_curves_of_other_speeds_have_other_names_and_say_the_speed_as_it_was_typed(estimates: list[Estimate]) -> None:
    """56 and 64 km/h, in km/h; all else in kg."""
    names, titles = [], []
    for speed_kph in (56, 64):
        there = Condition.of(speed_kph=speed_kph, front_weight_kg=950, rear_weight_kg=700)
        own = replace(estimates[0], condition=there)
        [pulse] = outgoing([own], 0, 0)
        names.append(pulse.name)
        titles.append(pulse.title)
        assert f"Condition: {speed_kph} km/h, front 950 kg, rear 700 kg." in pulse.comments_in(KPH_KG)
    assert names == ["cae_56kph_expected", "cae_64kph_expected"]
    assert titles == ["CAE, expected pulse, 56 km/h", "CAE, expected pulse, 64 km/h"]


def test_the_includes_say_what_they_hold(campaign: Campaign, write: Write) -> None:
    """Origin, condition, notes, units, sign; a line break in a name writes no keyword."""
    curve = SolverCurve("mm-ms-kg", deceleration_sign="positive", start_s=0.02, scale=1.5)
    export = PulseExport(("lsdyna", "radioss"), curve=curve)
    folder = write(export, name="Tiny\n*INCLUDE\n/etc/passwd ü", channel_filter_class=60.0)
    for path, mark in (
        (folder / "lsdyna/fused_33.554mph_expected.k", "$ "),
        (folder / "radioss/fused_33.554mph_expected.inc", "# "),
    ):
        lines = path.read_text(encoding="ascii").splitlines()
        comments = " ".join(line.removeprefix(mark) for line in lines if line.startswith(mark))
        for said in (
            "not measured: Fused, expected pulse, 33.554 mph.",
            "Condition: 33.554 mph",
            "Extrapolation: the front weight 2237 lb",
            "filtered with CFC 60",
            "Units mm-ms-kg: time in ms, acceleration in mm/ms^2. Braking is positive. Contact is at 20 ms;",
            "scaled by 1.5",
            campaign.fingerprint,
        ):
            assert said in comments
        keywords = [line for line in lines if line.startswith(("*", "/"))]
        assert keywords in (["*KEYWORD", "*DEFINE_CURVE_TITLE", "*END"], ["/FUNCT/2"])


def test_what_happens_at_the_end_of_the_record_is_said() -> None:
    """A vehicle that has not stopped, or is still accelerated, matters to a model that runs for longer."""
    stopped = 1.05 * PULSE
    said = []
    for pulse in (PULSE / 2, np.where(GRID_S > 0.09, 20.0, stopped), stopped):
        (one,) = outgoing([Estimate(CONDITION, pulse, approach="cae", seconds=0.1)], 0, 0)
        said.append(" ".join(one.comments_in(KPH_KG)))
    assert "ends at 100 ms, while the vehicle still moves forward at 16.8 mph" in said[0]
    assert "ends at 100 ms with 2.0 g left" in said[1]
    assert "ends at" not in said[2]


def test_iso_mme_holds_acceleration_velocity_and_displacement_at_a_chosen_location(write: Write) -> None:
    """A test for each pulse, so that channel codes are those that a program looks for; CFC in code and header."""
    folder = write(PulseExport(draws=3, location="10BPILLERE00"), channel_filter_class=60.0) / "isomme"
    assert len(list(folder.iterdir())) == 2 + 1 + 3 + 2
    channels = {channel.code: channel for channel in read_isomme(folder / "fused_33.554mph_expected").channels}
    assert {code: channel.unit for code, channel in channels.items()} == {
        "10BPILLERE00ACXD": "m/(s*s)",
        "10BPILLERE00VEXD": "m/s",
        "10BPILLERE00DVXD": "m",
    }
    for channel in channels.values():
        assert (channel.start_s, channel.interval_s, channel.values.size) == (0.0, DT_S, 1250)
    np.testing.assert_array_equal(channels["10BPILLERE00ACXD"].values, PULSE)
    velocity, displacement = channels["10BPILLERE00VEXD"].values, channels["10BPILLERE00DVXD"].values
    assert velocity[0] == SPEED_MPS
    assert velocity[GRID_S > T0_S + 1e-4] == pytest.approx(0.0, abs=0.02)
    assert displacement.max() == pytest.approx(SPEED_MPS * T0_S / 2, rel=1e-3)
    header = (folder / "fused_33.554mph_expected/Channel/fused_33.554mph_expected.002").read_text(encoding="latin-1")
    assert "Channel frequency class     :60\n" in header


def test_the_iso_mme_files_say_that_nothing_was_measured(campaign: Campaign, write: Write) -> None:
    """Header and channels name crashfuse, campaign, fingerprint, approach and notes; speed in m/s, masses in kg."""
    folder = write(PulseExport(), name="Tiny\nDate of the test :2024-01-01")
    test = read_isomme(folder / "isomme/fused_33.554mph_expected")
    comments = [value for name, value in test.descriptors if name == "Comments"]
    assert test.descriptor("Subtype of the test") == "Prediction, no vehicle was crashed"
    assert test.descriptor("Date of the test") == ""
    assert campaign.fingerprint in "".join(comments)
    numbers = "Velocity", "Mass", ".Front weight", ".Rear weight"
    assert [test.descriptor(f"{name} test object 1") for name in numbers] == ["15", "1650.5", "950", "700.5"]
    for channel in test.channels:
        assert channel.source == "simulation"
        assert channel.code[-1] == "S", "records taken as they are"
        assert "not measured: Fused, expected pulse" in " ".join(channel.comments)
        assert "Extrapolation: the front weight 2237 lb" in " ".join(channel.comments)


@needs_other_readers
@pytest.mark.slow
def test_pydyna_reads_the_ls_dyna_include(estimates: list[Estimate], write: Write) -> None:
    """The keyword reader of LS-DYNA's vendor finds one curve, its id and LCINT, and every point."""
    curve = SolverCurve("mm-ms-kg", start_s=0.005, number=77)
    path = write(PulseExport(("lsdyna",), curve=curve)) / "lsdyna"
    reader = "from ansys.dyna.core import Deck\ndeck = Deck()\ndeck.loads(open(sys.argv[1]).read())"
    program = "[(k.get_title(), k.lcid, k.lcint, k.sfa, k.sfo, k.curves.values.tolist()) for k in deck.keywords]"
    ((keyword, number, lcint, sfa, sfo, points),) = asked_of(reader, program, path / "fused_33.554mph_expected.k")
    assert keyword == "*DEFINE_CURVE_TITLE"
    assert (number, lcint, sfa, sfo) == (78, len(points), 1.0, 1.0), "the second of two curves for one model"
    pulse = next(iter(outgoing(estimates[1:], 0, 0)))
    np.testing.assert_allclose(points, curve.points(pulse.accel_mps2), rtol=1e-12, atol=1e-15)


@needs_other_readers
@pytest.mark.slow
def test_pyisomme_reads_the_iso_mme_test(write: Write) -> None:
    """Codes, units, filter class, time and every sample of all three channels."""
    name = "fused_33.554mph_expected"
    path = write(PulseExport(), channel_filter_class=60.0) / "isomme" / name / f"{name}.mme"
    reader = "import pyisomme\nread = pyisomme.Isomme().read(sys.argv[1])"
    program = (
        "[(c.code, str(c.unit), c.get_info('Channel frequency class'), c.data.index.tolist(),"
        " c.data.iloc[:, 0].tolist()) for c in read.channels]"
    )
    channels = {code: more for code, *more in asked_of(reader, program, path)}
    assert set(channels) == {"10VEHC000000ACXD", "10VEHC000000VEXD", "10VEHC000000DVXD"}
    assert [channels[f"10VEHC000000{name}XD"][0] for name in ("AC", "VE", "DV")] == ["m / s2", "m / s", "m"]
    for _, cfc, time_s, values in channels.values():
        assert float(cfc) == 60
        np.testing.assert_allclose(time_s, GRID_S, atol=1e-9)
        assert len(values) == 1250
    np.testing.assert_array_equal(channels["10VEHC000000ACXD"][3], PULSE)
