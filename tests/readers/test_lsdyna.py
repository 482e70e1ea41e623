"""LS-DYNA runs: whatever file, units and direction, the same pulse; damage is told in a sentence, never more."""

import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path

import numpy as np
import pytest

from crashfuse.errors import DataError
from crashfuse.importing import Choices, import_source, settle
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.lsdyna import read_lsdyna
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.testing.readers import written
from crashfuse.units import MS
from tests.conftest import SHARED, needs_shared
from tests.importing.crash_files import sentence
from tests.importing.crashes import CRUSH_M, PEAK_MPS2, SPEED_MPS, STOP_S
from tests.readers.lsdyna_files import MASS_KG, SYSTEMS, Energies, Folders, Layout, Run, chars, lsda

WEIGHTS = Choices(condition=PartialCondition(front_weight_kg=950.0, rear_weight_kg=750.0))
SHORT = Run(end_s=0.02, step_s=1e-3)
RUN = Run(end_s=0.15, step_s=1e-3)
FOLDERS = RUN.folders()
STATES = [name for name in FOLDERS if name.startswith("/nodout/d")]


def saved(folder: Path, **files: bytes) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return written(folder, files)


def only(path: Path) -> Record:
    (record,) = read_lsdyna(path)
    return record


def problem(path: Path) -> str:
    return sentence(lambda: read_lsdyna(path))


def same(one: Record, other: Record) -> bool:
    return [c.name for c in one.channels] == [c.name for c in other.channels] and all(
        np.array_equal(a.time_s, b.time_s) and np.array_equal(a.values, b.values)
        for a, b in zip(one.channels, other.channels, strict=True)
    )


@pytest.mark.parametrize("form", ["binout", "nodout"])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("unit", ["mm/ms²", "mm/s²", "m/s²"])
def test_units_sign_and_speed_are_found_in_either_form(tmp_path: Path, form: str, direction: int, unit: str) -> None:
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


@pytest.mark.parametrize(("system", "unit"), [("ft", "ft/s²"), ("inch", "in/s²"), ("g cm s", "cm/s²")])
def test_a_unit_of_length_that_no_mass_tells_is_asked_for(tmp_path: Path, system: str, unit: str) -> None:
    """At 56 km/h a model moves at 51 ft, 612 inch or 1556 cm a second: neither speed nor mass is guessed."""
    record = only(saved(tmp_path / "run7", nodout=Run(unit=system, step_s=1e-3).nodout()))
    assert (record.condition.speed_mps, record.condition.mass_kg) == (None, None)
    with pytest.raises(DataError, match=rf"unit of length unknown: .* 56.0 km/h if in {unit}.*; give"):
        settle(record, WEIGHTS, role="cae")
    given = replace(WEIGHTS, condition=replace(WEIGHTS.condition, speed_mps=SPEED_MPS))
    with pytest.raises(DataError, match=r"give its unit \(--unit\)"):
        settle(record, given, role="cae")
    pulse = settle(record, replace(given, unit=unit), role="cae").pulse
    assert pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)


@pytest.mark.parametrize("has_energies", [True, False])
@pytest.mark.parametrize("unit", SYSTEMS)
def test_mass_and_force_are_of_one_system_of_units(tmp_path: Path, unit: str, has_energies: bool) -> None:
    """The size of a car tells the unit of mass, by the energy or by the barrier's impulse, and so that of force."""
    folders = Run(unit=unit, step_s=1e-3, has_wall=True).folders()
    kept = {name: of for name, of in folders.items() if has_energies or "glstat" not in name}
    record = only(saved(tmp_path, binout0000=lsda(kept)))
    assert record.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-4)
    assert record.condition.mass_kg == (pytest.approx(MASS_KG, rel=1e-4) if has_energies else None)
    wall = settle(record, WEIGHTS, role="cae").wall
    assert wall is not None
    assert wall.force_n.max() == pytest.approx(MASS_KG * PEAK_MPS2, rel=1e-2)


@pytest.mark.parametrize("form", ["binout", "nodout"])
@pytest.mark.parametrize(("unit", "axis", "direction"), [("mm/ms²", "x", 1), ("mm/s²", "y", -1), ("m/s²", "x", -1)])
def test_a_velocity_that_is_set_after_a_preload_begins_the_crash(
    tmp_path: Path, form: str, unit: str, axis: str, direction: int
) -> None:
    run = Run(unit=unit, axis=axis, direction=direction, step_s=5e-4, rest_s=0.03)
    record = only(saved(tmp_path, **{form: run.binout() if form == "binout" else run.nodout()}))
    settled = settle(record, WEIGHTS, role="cae")
    motion = settled.pulse.kinematics(settled.condition.speed_mps)
    assert record.condition.mass_kg == (pytest.approx(MASS_KG, rel=1e-4) if form == "binout" else None)
    assert settled.time_zero_s == pytest.approx(0.03)
    assert (motion.t0_s, motion.displacement_m.max()) == pytest.approx((STOP_S, CRUSH_M), rel=2e-3)
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)


def test_nodes_that_are_sped_up_are_no_vehicle_unless_the_user_gives_their_travel(tmp_path: Path) -> None:
    """Accelerations that tell of it may be a blow; with the travel given, the crash begins where they are fastest."""
    folders = Run(step_s=5e-4, rest_s=0.03).folders()
    for state in range(52, 61):  # 4 ms
        told = folders[f"/nodout/d{state:06d}"]
        told["x_velocity"] = np.full(4, SPEED_MPS * (state - 52) / 8, "f4")
        told["x_acceleration"] = np.full(4, SPEED_MPS / 4, "f4")
    folder = saved(tmp_path, binout0000=lsda(folders))
    assert "fastest at the start" in problem(folder)
    (record,) = read_lsdyna(folder, "x")
    assert settle(record, WEIGHTS, role="cae").pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)


STATE = b" n o d a l"
WHOLE = Run(step_s=5e-4).nodout().split(STATE)  # two tables a state


@pytest.mark.parametrize(
    "parts",
    [
        [WHOLE[:323], WHOLE[241:]],
        [WHOLE[:323], WHOLE[:1], WHOLE[241:]],  # with its title
        [WHOLE[:322], [WHOLE[322][:-300] + b"\n"], WHOLE[241:]],  # after it was killed in the middle of a state
        [WHOLE[:323], WHOLE[161:201], WHOLE[181:]],  # twice
        [WHOLE[:323], Run(step_s=5.01e-4).nodout().split(STATE)[241:]],  # at other times
    ],
    ids=["states", "title", "killed", "twice", "other times"],
)
def test_of_states_that_a_restart_repeats_the_later_are_read(tmp_path: Path, parts: list[list[bytes]]) -> None:
    """Of a text that goes on at 60 ms after it went to 80, or of a binout that does in one file."""
    record = only(saved(tmp_path / "text", nodout=STATE.join(chain(*parts))))
    motion = settle(record, WEIGHTS, role="cae").pulse.kinematics(SPEED_MPS)
    assert (motion.t0_s, motion.displacement_m.max()) == pytest.approx((STOP_S, CRUSH_M), rel=1e-3)
    assert any("A restart repeats the states from" in step for step in record.steps)
    assert "found another, which begins at 0" in problem(saved(tmp_path / "two", nodout=STATE.join(WHOLE + WHOLE)))


def test_of_states_that_a_binout_repeats_the_later_are_read(tmp_path: Path) -> None:
    once = [FOLDERS[name] for name in STATES]
    other = [{name: 3 * of if "x_" in name else of for name, of in state.items()} for state in once]
    written_twice = enumerate([*once[:60], *other[60:80], *once[60:]], start=1)
    again = {name: of for name, of in FOLDERS.items() if name not in STATES}
    again |= {f"/nodout/d{number:06d}": state for number, state in written_twice}
    whole = only(saved(tmp_path / "b", binout0000=RUN.binout()))
    assert same(only(saved(tmp_path / "a", binout0000=lsda(again))), whole)


def as_bodies(folders: Folders) -> Folders:
    names = {"x_velocity": "global_vx", "x_acceleration": "global_ax"}
    renamed = {path: {names.get(name, name): of for name, of in told.items()} for path, told in folders.items()}
    return {path.replace("nodout", "rbdout"): told for path, told in renamed.items()}


@pytest.mark.parametrize("of", [lambda folders: folders, as_bodies], ids=["nodes", "bodies"])
def test_without_accelerations_the_velocities_tell(tmp_path: Path, of: Callable[[Folders], Folders]) -> None:
    def without(*words: str) -> Path:
        folders = {path: {i: t[i] for i in t if not i.endswith(words)} for path, t in FOLDERS.items()}
        return saved(tmp_path / "-".join(words), binout0000=lsda(of(folders)))

    settled = settle(only(without("acceleration")), WEIGHTS, role="cae")
    assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)
    assert any("no accelerations" in step for step in settled.steps)
    assert "ask the solver" in problem(without("acceleration", "velocity"))


SHORT_FIELDS = Layout(length=4, offset=4, command=2, kind=2)
ALL_AT_ONCE = Layout(order=">", length=4, relative=True, folders_a_table=7)
LAYOUTS = (Layout(order=">"), SHORT_FIELDS, Layout(relative=True), Layout(folders_a_table=1), ALL_AT_ONCE)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_that_the_header_may_declare_is_read_alike(tmp_path: Path, layout: Layout) -> None:
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
    run = Run(nodes={n: ("", scale) for n, scale in enumerate((1.0, 1.01, 0.99, 1.02, 3.0, 0.6), start=1)})
    record = only(saved(tmp_path, binout=run.binout()))
    assert record.proposed == ("1", "2", "3", "4")
    assert any("No title names" in step for step in record.steps)
    named = Run(nodes={7: ("Vehicle C.G.", 1.0), 8: ("B-Pillar left", 1.0), 9: ("Passenger rear seat pelvis", 0.8)})
    assert only(saved(tmp_path / "named", binout=named.binout())).proposed == ("7",)


def test_accelerations_that_miss_the_velocity_are_taken_from_it(tmp_path: Path) -> None:
    """Sampled once in a while, a ringing node's accelerations do not add up to its velocity; the velocity is right."""
    run = Run(nodes={1: ("", 1.0)}, step_s=2e-4, noise_g=300.0)
    record = only(saved(tmp_path, binout=run.binout()))
    assert any("taken from the velocities" in step for step in record.steps)
    motion = settle(record, WEIGHTS, role="cae").pulse.kinematics(SPEED_MPS)
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


def test_a_run_killed_while_writing_is_read_up_to_its_last_whole_state(tmp_path: Path) -> None:
    text = SHORT.nodout()
    whole = only(saved(tmp_path / "whole", nodout=text))
    half = only(saved(tmp_path / "text", nodout=text[: text.rindex(b"x-accl") + 220]))
    assert "The last state is cut short and left out." in half.steps
    assert np.array_equal(half.channels[0].values, whole.channels[0].values[:-1])
    binary = SHORT.binout(Layout(folders_a_table=1)) + SHORT.binout()[200:400]
    assert same(only(saved(tmp_path / "binary", binout=binary)), only(saved(tmp_path / "b", binout=SHORT.binout())))


def test_rigid_bodies_or_text_serve_where_the_binout_has_no_nodes(tmp_path: Path) -> None:
    folders = Run(nodes={12: ("", 1.0)}).folders()
    record = only(saved(tmp_path / "bodies", binout=lsda(as_bodies(folders))))
    assert record.proposed == ("body 12",)
    assert settle(record, WEIGHTS, role="cae").pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
    energies = {path: variables for path, variables in SHORT.folders().items() if "glstat" in path}
    record = only(saved(tmp_path / "text", binout0000=lsda(energies), nodout=SHORT.nodout()))
    assert len(record.channels) == 4
    assert record.condition.mass_kg == pytest.approx(MASS_KG, rel=1e-3)


@pytest.mark.parametrize(
    ("folders", "ids"),
    [
        (["doe/run_1", "doe/run_2"], ["run_1", "run_2"]),
        (["a/solve", "b/solve"], ["a", "b"]),
        (["x/a/1", "x/b/1", "x/b/2"], ["a-1", "b-1", "b-2"]),
        (["deep/down/run_9"], ["run_9"]),
        (["a-b/c", "a/b-c"], []),
    ],
)
def test_runs_are_called_by_what_tells_their_folders_apart(tmp_path: Path, folders: list[str], ids: list[str]) -> None:
    for folder in folders:
        saved(tmp_path / folder, binout=SHORT.binout())
    if not ids:
        assert "found one twice" in problem(tmp_path)
        return
    assert [record.id for record in read_lsdyna(tmp_path)] == ids


def test_of_too_many_nodes_those_with_a_title_are_kept_first(tmp_path: Path) -> None:
    nodes = dict.fromkeys(range(1, 500), ("", 1.0)) | {9999: ("REAR SILL LEFT", 1.0)}
    run = Run(nodes=nodes, end_s=0.005, step_s=1e-3)
    for form, content in (("binout", run.binout()), ("nodout", run.nodout())):
        record = only(saved(tmp_path / form, **{form: content}))
        assert len(record.channels) == 200
        assert record.proposed == ("9999",)
        assert "200 of 500 nodes are kept, titled ones first." in record.steps


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    assert "choose the folder of a run" in problem(saved(tmp_path / "empty"))
    other = lsda({"/matsum/metadata": {"title": chars("x")}})
    assert "DATABASE_HISTORY_NODE" in problem(saved(tmp_path / "a", binout=other))
    assert "x-accl" in problem(saved(tmp_path / "b", nodout=SHORT.nodout().replace(b"x-accl", b"x-temp")))
    slow = Run(nodes={1: ("", 1.0)}, end_s=3.0, step_s=0.1)
    assert "ends at 3000" in problem(saved(tmp_path / "c", nodout=slow.nodout()))


def test_claims_beyond_the_file_cost_nothing(tmp_path: Path) -> None:
    sound = SHORT.binout()
    (table,) = struct.unpack_from("<Q", sound, 8 + 9)
    entry = sound.index(b"x_acceleration", table) + len("x_acceleration")
    damage = {"circle": (len(sound) - 8, table), "huge": (entry + 9, 1 << 60), "moved": (entry + 1, 100)}
    for name, (place, value) in damage.items():
        broken = sound[:place] + struct.pack("<Q", value) + sound[place + 8 :]
        told = "in a circle" if name == "circle" else "x_acceleration"
        assert told in problem(saved(tmp_path / name, binout=broken))


def continued(*cuts: int, torn: bool = False) -> list[bytes]:
    """The run's binout in several files, of which only the first holds metadata; torn in the middle of a state."""
    files = []
    for start, stop in pairwise([0, *cuts, len(STATES)]):
        folders = {name: FOLDERS[name] for name in STATES[start:stop]}
        if torn and start:
            folders = {STATES[start - 1]: _half(STATES[start - 1], after=True)} | folders
        if torn and stop < len(STATES):
            folders[STATES[stop - 1]] = _half(STATES[stop - 1], after=False)
        others = {} if start else {name: content for name, content in FOLDERS.items() if name not in STATES}
        files.append(lsda({**others, **folders}))
    return files


def _half(state: str, *, after: bool) -> dict[str, np.ndarray]:
    """What a state holds before or after the file was full."""
    items, middle = list(FOLDERS[state].items()), list(FOLDERS[state]).index("x_velocity")
    return dict(items[middle:] if after else items[:middle])


@pytest.mark.parametrize("torn", [False, True])
@pytest.mark.parametrize("last", ["binout0000%002", "binout0000_"])
def test_continuations_without_metadata_are_read_whole(tmp_path: Path, torn: bool, last: str) -> None:
    first, second, third = continued(60, 140, torn=torn)
    folder = saved(tmp_path / "split", **{"binout0000": first, "binout0000%001": second, last: third})
    whole = only(saved(tmp_path / "whole", binout0000=RUN.binout()))
    for source in (folder, folder / "binout0000", folder / "binout0000%001"):
        record = only(source)
        assert same(record, whole)
        assert record.channels[0].time_s[-1] == pytest.approx(150 * MS)
        assert "Nodes from 3 of 3 files of binout, joined." in record.steps


def test_a_state_that_was_never_finished_is_left_out(tmp_path: Path) -> None:
    record = only(saved(tmp_path / "alone", binout0000=continued(60, torn=True)[0]))
    assert {channel.time_s.size for channel in record.channels} == {59}
    assert not any("nan" in step for step in record.steps)
    assert record.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-4)


@pytest.mark.parametrize(
    ("there", "missing"), [("binout0000 %002", "%001"), ("%001 %002", ""), ("binout0000 %001 %003", "%002"), ("_", "")]
)
def test_a_family_with_a_missing_member_is_refused(tmp_path: Path, there: str, missing: str) -> None:
    names = [name if name == "binout0000" else f"binout0000{name}" for name in there.split()]
    said = problem(saved(tmp_path, **dict.fromkeys(names, RUN.binout())))
    assert f"expected binout0000{missing} before it, found none; copy all files" in said


def test_a_state_that_lacks_its_nodes_is_refused(tmp_path: Path) -> None:
    time = {"time": FOLDERS[STATES[7]]["time"]}
    fewer = dict.fromkeys(FOLDERS[STATES[7]], np.zeros(3, "f4")) | time
    for name, state, told in (
        ("fewer", fewer, "x_velocity of 4 nodes in each state, found 3 in d000008; copy it again"),
        ("none", time, "expected x_acceleration in each state, found none in d000008"),
    ):
        assert told in problem(saved(tmp_path / name, binout0000=lsda({**FOLDERS, STATES[7]: state})))


def test_two_runs_in_one_folder_are_never_mixed(tmp_path: Path) -> None:
    said = problem(saved(tmp_path / "mixed", binout0000=RUN.binout(), binout0001=Run(direction=-1).binout()))
    assert "nodout of one run in a folder, found the same nodes as in binout0000; keep runs in" in said
    other = Run(direction=-1, end_s=0.15, step_s=1e-3)
    binouts, texts = (RUN.binout(), other.binout()), (RUN.nodout(), other.nodout())
    for names, contents, ids in (
        (("a.binout0000", "b.binout0000"), binouts, ["a", "b"]),
        (("binout_v1", "binout_v2"), binouts, ["v1", "v2"]),
        (("nodout_v1", "nodout_v2.txt"), texts, ["v1", "v2"]),
    ):
        folder = saved(tmp_path / names[0], **dict(zip(names, contents, strict=True)))
        assert [record.id for record in read_lsdyna(folder)] == ids
    twice = {"nodout": RUN.nodout(), "nodout.txt": other.nodout()}
    assert "expected one nodout of a run" in problem(saved(tmp_path / "twice", **twice))
    assert only(tmp_path / "twice" / "nodout.txt").condition.speed_mps is not None


JOBS = ("run12 .binout0000", "Simulation .key.binout0000", "job .nodout", "v1.2 .nodout.txt", "job .nodouthf")


@pytest.mark.parametrize(
    ("run_id", "ending"), [*(job.split() for job in JOBS), ("here", "nodouthf"), ("here", "BINOUT")]
)
def test_names_of_jobs_are_those_of_the_runs(tmp_path: Path, run_id: str, ending: str) -> None:
    name = f"{run_id}{ending}" if ending[0] == "." else ending
    content = RUN.nodout() if "nodout" in name else RUN.binout()
    folder = saved(tmp_path / "here", **{name: content, f"{run_id}.glstat": Energies().glstat(), "d3plot": b"\0"})
    assert FORMATS["lsdyna"].has(Path(name))
    for source in (folder, folder / name):
        record = only(source)
        assert record.id == run_id
        assert record.channels[0].time_s[-1] == pytest.approx(150 * MS)
        assert (record.quality.hourglass_share is None) == ("binout" in name.lower())
    jobs = {f"doe/{number}/job.binout0000": RUN.binout() for number in (1, 2)}
    for path, each in jobs.items():
        saved((tmp_path / path).parent, **{Path(path).name: each})
    assert [record.id for record in read_lsdyna(tmp_path / "doe")] == ["1", "2"]


@pytest.mark.parametrize("form", ["binout", "text"])
def test_nodes_of_nodouthf_are_those_that_are_averaged(tmp_path: Path, form: str) -> None:
    fine = Run(end_s=0.15, step_s=2e-4, nodes={1001: RUN.nodes[1001]}, database="nodouthf")
    texts = {"nodout": RUN.nodout(), "nodouthf": fine.nodout()}
    files = {"binout0000": lsda({**FOLDERS, **fine.folders()})} if form == "binout" else texts
    record = only(saved(tmp_path, **files))
    assert record.proposed == ("1001",)
    sizes = {channel.name: channel.time_s.size for channel in record.channels}
    assert sizes == {"1001": 751, "1002": 151, "2001": 151, "2002": 151}
    assert settle(record, WEIGHTS, role="cae").pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)


def test_nodes_that_end_before_the_energies_are_pointed_out(tmp_path: Path) -> None:
    folders = {**RUN.folders(states=slice(0, 121)), **Energies(time=(0.0, 75.0, 150.0)).glstat_folders()}
    record = only(saved(tmp_path / "a", binout0000=lsda(folders)))
    assert not [step for step in record.steps if "energies at" in step]  # within two steps of the energies
    times = tuple(np.linspace(0, 150, 31).tolist())
    nine = (9.0,) * 31
    many = Energies(nine, nine, nine, nine, nine, times)
    record = only(saved(tmp_path / "b", binout0000=lsda({**folders, **many.glstat_folders()})))
    assert any(step.startswith("Careful: nodes end at 120, energies at 150") for step in record.steps)


@needs_shared
def test_a_run_in_three_files_of_the_solver_s_own_library_is_the_crash(tmp_path: Path) -> None:
    """Written by LSTC's library without metadata in the later files: all 150 ms, and the pulse of NHTSA 10146."""
    choices, real = Choices(condition=PartialCondition(mass_kg=1719.0), front_share=0.56), SHARED / "real"
    (run,) = import_source(real / "formats/lsdyna_split", tmp_path / "run", choices, role="cae")
    (test,) = import_source(real / "nhtsa_10146_camry2018", tmp_path / "test")
    assert {channel.time_s.size for channel in only(real / "formats/lsdyna_split").channels} == {1501}
    of_run, of_test = (each.pulse.kinematics(each.condition.speed_mps) for each in (run, test))
    assert of_run.t0_s == pytest.approx(of_test.t0_s, abs=0.5 * MS)
    assert of_run.displacement_m.max() == pytest.approx(of_test.displacement_m.max(), rel=0.01)
