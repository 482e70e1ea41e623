"""LS-DYNA runs: whatever file, units and direction, the same pulse; damage is told in a sentence, never more."""

import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import DataError
from crashfuse.files.archive import zipped
from crashfuse.importing import Choices, import_source, settle
from crashfuse.readers.lsdyna.runs import read_lsdyna
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.units import LB
from tests.conftest import content_of
from tests.importing.crashes import CRUSH_M, PEAK_MPS2, SPEED_MPS, STOP_S
from tests.readers.lsdyna_files import MASS_KG, SYSTEMS, Layout, Run, chars, lsda

WEIGHTS = Choices(condition=PartialCondition(front_weight_kg=950.0, rear_weight_kg=750.0))
SHORT = Run(end_s=0.02, step_s=1e-3)


def saved(folder: Path, **files: bytes) -> Path:
    """Write files and return their folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def only(path: Path) -> Record:
    """The one record there."""
    (record,) = read_lsdyna(path)
    return record


def problem(path: Path) -> str:
    """What is said to be wrong with it, in one sentence."""
    with pytest.raises(DataError) as caught:
        read_lsdyna(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def same(one: Record, other: Record) -> bool:
    """Whether two records have the same channels, numbers and all."""
    return [c.name for c in one.channels] == [c.name for c in other.channels] and all(
        np.array_equal(a.time_s, b.time_s) and np.array_equal(a.values, b.values)
        for a, b in zip(one.channels, other.channels, strict=True)
    )


@pytest.mark.parametrize("form", ["binout", "nodout"])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("unit", ["mm/ms²", "mm/s²", "m/s²"])
def test_units_sign_and_speed_are_found_in_either_form(tmp_path: Path, form: str, direction: int, unit: str) -> None:
    """In any consistent system, driving to either side, binary or not: speed and pulse are those of the closed form."""
    run = Run(unit=unit, direction=direction)
    record = only(saved(tmp_path / "run7", **{form: run.binout() if form == "binout" else run.nodout()}))
    assert record.id == "run7"
    assert record.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-4)
    assert record.condition.mass_kg == (pytest.approx(MASS_KG, rel=1e-4) if form == "binout" else None)
    assert record.proposed == ("1001", "1002")
    settled = settle(record, WEIGHTS, role="cae")
    assert (settled.unit, settled.deceleration_sign) == (unit, "negative" if direction == 1 else "positive")
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    motion = settled.pulse.kinematics(settled.condition.speed_mps)
    assert motion.t0_s == pytest.approx(STOP_S, abs=5e-5)
    assert motion.displacement_m.max() == pytest.approx(CRUSH_M, rel=1e-3)


@pytest.mark.parametrize("in_a_metre", [39.37, 100.0])
def test_a_model_in_inch_or_cm_is_not_taken_for_one_in_mm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_a_metre: float
) -> None:
    """At 56 km/h it moves at 612 inch or 1556 cm a second, far too slow for mm: neither speed nor mass is guessed."""
    monkeypatch.setitem(SYSTEMS, "other", (in_a_metre, 1.0, 1e-3))
    record = only(saved(tmp_path / "run7", binout=Run(unit="other").binout()))
    assert (record.condition.speed_mps, record.condition.mass_kg) == (None, None)
    with pytest.raises(DataError, match=r"found a unit of length unknown: .* too fast for m and too slow for mm; give"):
        settle(record, WEIGHTS, role="cae")
    with pytest.raises(DataError, match=r"give its unit \(--unit\), or convert it"):
        settle(record, replace(WEIGHTS, condition=replace(WEIGHTS.condition, speed_mps=SPEED_MPS)), role="cae")


def test_a_slow_run_in_mm_is_taken_once_its_speed_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bumper test at 2 m/s in mm and s: with the speed its unit is found."""
    monkeypatch.setitem(SYSTEMS, "slow", (1e3 * 2 / SPEED_MPS, 1.0, 1e-3))
    record = only(saved(tmp_path, binout=Run(unit="slow").binout()))
    assert record.condition.speed_mps is None
    settled = settle(record, replace(WEIGHTS, condition=replace(WEIGHTS.condition, speed_mps=2.0)), role="cae")
    assert settled.unit == "mm/s²"
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2 * 2 / SPEED_MPS, rel=1e-3)


@pytest.mark.parametrize(
    "layout",
    [
        Layout(order=">"),
        Layout(length=4, offset=4, command=2, kind=2),
        Layout(relative=True),
        Layout(folders_a_table=1),
        Layout(order=">", length=4, relative=True, folders_a_table=7),
    ],
)
def test_every_layout_that_the_header_may_declare_is_read_alike(tmp_path: Path, layout: Layout) -> None:
    """Byte order, widths, relative folders and a symbol table a state make no difference."""
    plain = only(saved(tmp_path / "a", binout=SHORT.binout()))
    assert same(plain, only(saved(tmp_path / "b", binout=SHORT.binout(layout))))


def test_shards_and_restarts_merge_into_the_run(tmp_path: Path) -> None:
    """Nodes of two processors and a restart that wrote three states again give what one file gives."""
    run = Run(end_s=0.03)
    whole = only(saved(tmp_path / "whole", binout=run.binout()))
    shards = {
        "binout0000": run.binout(numbers=[1001, 2001], states=slice(0, 200)),
        "binout0000%001": run.binout(numbers=[1001, 2001], states=slice(197, None)),
        "binout0001": run.binout(numbers=[1002, 2002]),
        "binout0002": lsda({"/rcforc/metadata": {"ids": np.array([1], "i4")}}),
    }
    folder = saved(tmp_path / "shards", **shards)
    for source in (folder, folder / "binout0001"):
        merged = only(source)
        assert merged.id == "shards"
        assert merged.proposed == whole.proposed
        assert "Nodes from 3 of 4 files of binout, joined." in merged.steps
        by_name = {channel.name: channel for channel in merged.channels}
        for channel in whole.channels:
            assert np.array_equal(by_name[channel.name].time_s, channel.time_s)
            assert np.array_equal(by_name[channel.name].values, channel.values)


def test_where_no_title_says_so_nodes_that_travel_alike_are_proposed(tmp_path: Path) -> None:
    """Of six nodes without a title, the one in the crush and the one on the wall are left out."""
    scales = {1: 1.0, 2: 1.01, 3: 0.99, 4: 1.02, 5: 3.0, 6: 0.6}
    run = Run(nodes={number: ("", scale) for number, scale in scales.items()})
    record = only(saved(tmp_path, binout=run.binout()))
    assert record.proposed == ("1", "2", "3", "4")
    assert any("No titles say" in step for step in record.steps)
    named = Run(nodes={7: ("Vehicle C.G.", 1.0), 8: ("B-Pillar left", 1.0), 9: ("Passenger rear seat pelvis", 0.8)})
    assert only(saved(tmp_path / "named", binout=named.binout())).proposed == ("7",)


def test_accelerations_that_miss_the_velocity_are_taken_from_it(tmp_path: Path) -> None:
    """Sampled once in a while, a ringing node's accelerations do not add up to its velocity; the velocity is right."""
    run = Run(nodes={1: ("", 1.0)}, step_s=2e-4, noise_g=300.0)
    record = only(saved(tmp_path, binout=run.binout()))
    assert any("taken from the velocities" in step for step in record.steps)
    settled = settle(record, WEIGHTS, role="cae")
    motion = settled.pulse.kinematics(settled.condition.speed_mps)
    assert motion.displacement_m.max() == pytest.approx(CRUSH_M, rel=1e-3)


def test_ascii_numbers_may_touch_and_lose_their_e(tmp_path: Path) -> None:
    """Negative numbers leave no blank, and Fortran writes D or, before three digits, nothing."""
    plain = SHORT.nodout()
    touching = plain.replace(b"  0.0000E+00  0.0000E+00 -1.0000E+00", b"  0.0000E+00 -1.2000-103-1.2000E-10")
    assert touching.count(b"-1.2000-103-") > 50
    record, tight = only(saved(tmp_path / "a", nodout=plain)), only(saved(tmp_path / "b", nodout=touching))
    assert tight.channels[0].values[0] == -1.2e-103
    assert np.array_equal(tight.channels[0].values[1:], record.channels[0].values[1:])
    assert same(record, only(saved(tmp_path / "c", nodout=SHORT.nodout(exponent="D"))))


def test_a_negative_first_column_may_touch_the_node(tmp_path: Path) -> None:
    """A run that drives to -x: its displacement leaves no blank behind the node's number."""
    plain = SHORT.nodout()
    touching = re.sub(rb"(?m)^( +\d+) +(?=0\.0000E)", rb"\1-", plain)
    assert touching.count(b"1001-") > 10
    assert same(only(saved(tmp_path / "a", nodout=plain)), only(saved(tmp_path / "b", nodout=touching)))


def test_a_run_killed_while_writing_is_read_up_to_its_last_whole_state(tmp_path: Path) -> None:
    """What a killed solver leaves is a shorter run: half a row of text, data that no symbol table lists."""
    whole = only(saved(tmp_path / "whole", nodout=SHORT.nodout()))
    text = SHORT.nodout()
    last = text.rindex(b"x-accl")
    half = only(saved(tmp_path / "text", nodout=text[: last + 220]))
    assert "Its last state is incomplete and left out." in half.steps
    assert np.array_equal(half.channels[0].values, whole.channels[0].values[:-1])
    binary = SHORT.binout(Layout(folders_a_table=1)) + SHORT.binout()[200:400]
    assert same(only(saved(tmp_path / "binary", binout=binary)), only(saved(tmp_path / "b", binout=SHORT.binout())))


def test_rigid_bodies_serve_where_there_are_no_nodes(tmp_path: Path) -> None:
    """The rigid body of rbdout is the pulse if nodout is missing."""
    folders = {}
    for path, variables in Run(nodes={12: ("", 1.0)}).folders().items():
        names = {"x_velocity": "global_vx", "x_acceleration": "global_ax"}
        folders[path.replace("nodout", "rbdout")] = {names.get(name, name): v for name, v in variables.items()}
    record = only(saved(tmp_path, binout=lsda(folders)))
    assert record.proposed == ("body 12",)
    assert settle(record, WEIGHTS, role="cae").pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)


def test_ascii_nodout_serves_where_the_binout_has_no_nodes(tmp_path: Path) -> None:
    """A binout with energies alone gives the mass, the text beside it the pulse."""
    energies = {path: variables for path, variables in SHORT.folders().items() if "glstat" in path}
    record = only(saved(tmp_path, binout0000=lsda(energies), nodout=SHORT.nodout()))
    assert len(record.channels) == 4
    assert record.condition.mass_kg == pytest.approx(MASS_KG, rel=1e-3)


@pytest.mark.slow
def test_a_folder_of_runs_becomes_a_library_with_conditions_from_a_table(tmp_path: Path) -> None:
    """One folder a run, in a folder or a zip, and a table with the weights: a campaign's CAE library."""
    ids = [f"run_{number}" for number in range(10)]
    run = Run(end_s=0.12, step_s=2e-4)
    for run_id in ids:
        saved(tmp_path / "doe" / run_id, binout0000=run.binout(), messag=b"normal termination")
    binouts = {name: content for name, content in content_of(tmp_path / "doe").items() if "binout" in name}
    (tmp_path / "doe.zip").write_bytes(zipped(binouts))
    table = tmp_path / "cae.csv"
    rows = "".join(f"{run_id},{2000 + number},1500\n" for number, run_id in enumerate(ids))
    table.write_text("id,front_weight_lb,rear_weight_lb\n" + rows)
    assert [record.id for record in read_lsdyna(tmp_path / "doe")] == ids
    import_source(tmp_path / "doe.zip", tmp_path / "campaign", role="cae", conditions=table)
    import_source(
        saved(tmp_path / "test", nodout=run.nodout()), tmp_path / "campaign", WEIGHTS, role="tests", record_id="T1"
    )
    campaign = load_campaign(tmp_path / "campaign")
    assert list(campaign.cae.ids) == ids
    assert [round(c.front_weight_kg / LB) for c in campaign.cae.conditions] == list(range(2000, 2010))
    assert campaign.cae.conditions[0].speed_mps == pytest.approx(SPEED_MPS, rel=1e-4)
    assert campaign.tests[0].pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)


@pytest.mark.parametrize(
    ("folders", "ids"),
    [
        (["doe/run_1", "doe/run_2"], ["run_1", "run_2"]),
        (["a/solve", "b/solve"], ["a", "b"]),
        (["x/a/1", "x/b/1", "x/b/2"], ["a-1", "b-1", "b-2"]),
        (["deep/down/run_9"], ["run_9"]),
    ],
)
def test_runs_are_called_by_what_tells_their_folders_apart(tmp_path: Path, folders: list[str], ids: list[str]) -> None:
    """Folders that all runs share are no part of their ids."""
    for folder in folders:
        saved(tmp_path / folder, binout=SHORT.binout())
    assert [record.id for record in read_lsdyna(tmp_path)] == ids


def test_two_runs_of_one_name_are_refused(tmp_path: Path) -> None:
    """A run is never silently mixed with another."""
    for folder in ("a-b/c", "a/b-c"):
        saved(tmp_path / folder, binout=SHORT.binout())
    assert "the same twice" in problem(tmp_path)


def test_of_too_many_nodes_those_with_a_title_are_kept_first(tmp_path: Path) -> None:
    """Of 500 nodes 200 stay, the titled one among them, wherever it stands; in text as in binary."""
    nodes = dict.fromkeys(range(1, 500), ("", 1.0)) | {9999: ("REAR SILL LEFT", 1.0)}
    run = Run(nodes=nodes, end_s=0.005, step_s=1e-3)
    for form, content in (("binout", run.binout()), ("nodout", run.nodout())):
        record = only(saved(tmp_path / form, **{form: content}))
        assert len(record.channels) == 200
        assert record.proposed == ("9999",)
        assert "200 of 500 nodes are kept, those with a title first." in record.steps


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    """No run, no nodes, no accelerations: each says what to do."""
    assert "choose the folder of a run" in problem(saved(tmp_path / "empty"))
    other = lsda({"/matsum/metadata": {"title": chars("x")}})
    assert "DATABASE_HISTORY_NODE" in problem(saved(tmp_path / "a", binout=other))
    turned = SHORT.nodout().replace(b"x-accl", b"x-temp")
    assert "x-accl" in problem(saved(tmp_path / "b", nodout=turned))
    slow = Run(nodes={1: ("", 1.0)}, end_s=3.0, step_s=0.1)
    assert "ends at 3000" in problem(saved(tmp_path / "c", nodout=slow.nodout()))


@pytest.mark.parametrize("cut", [0, 5, 8, 20, 30, 400, -9, -40])
def test_a_binout_cut_short_is_refused_in_a_sentence(tmp_path: Path, cut: int) -> None:
    """Wherever it ends, it is said to be no sound binout."""
    assert "expected a sound binout file" in problem(saved(tmp_path, binout=SHORT.binout()[:cut]))


def test_claims_beyond_the_file_cost_nothing(tmp_path: Path) -> None:
    """Tables in a circle, a variable of 2^60 numbers and one that lies elsewhere are refused at once."""
    sound = SHORT.binout()
    link = 8 + 9
    (table,) = struct.unpack_from("<Q", sound, link)
    circle = bytearray(sound)
    circle[-8:] = struct.pack("<Q", table)
    assert "in a circle" in problem(saved(tmp_path / "circle", binout=bytes(circle)))
    entry = sound.index(b"x_acceleration", table) + len("x_acceleration")
    huge = bytearray(sound)
    huge[entry + 9 : entry + 17] = struct.pack("<Q", 1 << 60)
    assert "x_acceleration" in problem(saved(tmp_path / "huge", binout=bytes(huge)))
    moved = bytearray(sound)
    moved[entry + 1 : entry + 9] = struct.pack("<Q", 100)
    assert "x_acceleration" in problem(saved(tmp_path / "moved", binout=bytes(moved)))
