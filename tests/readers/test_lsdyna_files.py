"""Which files are a run: families of binout, jobs by name, nodouthf; what is missing is said, nothing is dropped."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from crashfuse.importing import Choices, import_source, settle
from crashfuse.readers.formats import FORMATS
from crashfuse.readers.lsdyna.runs import read_lsdyna
from crashfuse.readers.record import PartialCondition
from crashfuse.units import MS
from tests.conftest import SHARED, needs_shared
from tests.importing.crashes import PEAK_MPS2, SPEED_MPS
from tests.readers.lsdyna_files import Energies, Layout, Run, lsda
from tests.readers.test_lsdyna import WEIGHTS, only, problem, same, saved

RUN = Run(end_s=0.15, step_s=1e-3)
FOLDERS = RUN.folders()
STATES = [name for name in FOLDERS if name.startswith("/nodout/d")]


def continued(*cuts: int, torn: bool = False) -> list[bytes]:
    """The run's binout in several files, of which only the first holds metadata; torn in the middle of a state."""
    bounds = [0, *cuts, len(STATES)]
    files = []
    for number, (start, stop) in enumerate(pairwise(bounds)):
        folders = {name: FOLDERS[name] for name in STATES[start:stop]}
        if torn and start:
            folders = {STATES[start - 1]: _half(STATES[start - 1], after=True)} | folders
        if torn and stop < len(STATES):
            folders[STATES[stop - 1]] = _half(STATES[stop - 1], after=False)
        others = {name: content for name, content in FOLDERS.items() if name not in STATES} if not number else {}
        files.append(lsda({**others, **folders}))
    return files


def _half(state: str, *, after: bool) -> dict[str, np.ndarray]:
    """What a state holds before or after the file was full."""
    items = list(FOLDERS[state].items())
    middle = [name for name, _ in items].index("x_velocity")
    return dict(items[middle:] if after else items[:middle])


@pytest.mark.parametrize("torn", [False, True])
@pytest.mark.parametrize("last", ["binout0000%002", "binout0000_"])
def test_continuations_without_metadata_are_read_whole(tmp_path: Path, torn: bool, last: str) -> None:
    """Three files, the later ones with states alone, the last perhaps of a restart: what one file gives."""
    first, second, third = continued(60, 140, torn=torn)
    folder = saved(tmp_path / "split", **{"binout0000": first, "binout0000%001": second, last: third})
    whole = only(saved(tmp_path / "whole", binout0000=RUN.binout()))
    for source in (folder, folder / "binout0000", folder / "binout0000%001"):
        record = only(source)
        assert same(record, whole)
        assert record.channels[0].time_s[-1] == pytest.approx(150 * MS)
        assert "Nodes from 3 of 3 files of binout, joined." in record.steps


def test_a_state_that_was_never_finished_is_left_out(tmp_path: Path) -> None:
    """The first file of a family alone ends in the middle of a state: the run ends with the state before."""
    first, *_ = continued(60, torn=True)
    record = only(saved(tmp_path / "alone", binout0000=first))
    assert {channel.time_s.size for channel in record.channels} == {59}
    assert not any("nan" in step for step in record.steps)
    assert record.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-4)


@pytest.mark.parametrize(
    ("there", "missing"),
    [
        ("binout0000 %002", "binout0000%001 before it"),
        ("%001 %002", "binout0000 before it"),
        ("binout0000 %001 %003", "binout0000%002 before it"),
        ("_", "binout0000 before it"),
    ],
)
def test_a_family_with_a_missing_member_is_refused(tmp_path: Path, there: str, missing: str) -> None:
    """Whatever would leave a hole in the run, or its nodes without numbers."""
    names = [name if name == "binout0000" else f"binout0000{name}" for name in there.split()]
    said = problem(saved(tmp_path, **dict.fromkeys(names, RUN.binout())))
    assert f"expected {missing}, found none; copy it from the run, too" in said


def test_states_of_nodes_that_nobody_names_are_refused(tmp_path: Path) -> None:
    """A file of another processor cannot lend its numbers."""
    alone = lsda({name: FOLDERS[name] for name in STATES})
    said = problem(saved(tmp_path, binout0000=alone, binout0001=RUN.binout(states=slice(0, 5))))
    assert "the numbers of the nodes of nodout (metadata), found none; copy all files of the run" in said


def test_a_state_that_lacks_its_nodes_is_refused(tmp_path: Path) -> None:
    """Numbers of other nodes than were listed, or none in the middle of the run, are never passed over."""
    fewer = {name: np.zeros(3, "f4") if name != "time" else values for name, values in FOLDERS[STATES[7]].items()}
    said = problem(saved(tmp_path / "fewer", binout0000=lsda({**FOLDERS, STATES[7]: fewer})))
    assert "x_velocity of 4 nodes in each state, found 3 in d000008; copy it again from the run" in said
    none = {"time": FOLDERS[STATES[7]]["time"]}
    said = problem(saved(tmp_path / "none", binout0000=lsda({**FOLDERS, STATES[7]: none})))
    assert "expected x_acceleration in each state, found none in d000008" in said


def test_two_runs_in_one_folder_are_never_mixed(tmp_path: Path) -> None:
    """Numbered like processors they are refused; named by job they are two runs, and so are nodouts."""
    said = problem(saved(tmp_path / "mixed", binout0000=RUN.binout(), binout0001=Run(direction=-1).binout()))
    assert "nodout of one run in a folder, found the same nodes as in binout0000; put each run into" in said
    other = Run(direction=-1, end_s=0.15, step_s=1e-3)
    named = {"a.binout0000": RUN.binout(), "b.binout0000": other.binout()}
    assert [record.id for record in read_lsdyna(saved(tmp_path / "jobs", **named))] == ["a", "b"]
    labelled = {"binout_v1": RUN.binout(), "binout_v2": other.binout()}
    assert [record.id for record in read_lsdyna(saved(tmp_path / "labels", **labelled))] == ["v1", "v2"]
    texts = {"nodout_v1": RUN.nodout(), "nodout_v2.txt": other.nodout()}
    assert [record.id for record in read_lsdyna(saved(tmp_path / "texts", **texts))] == ["v1", "v2"]
    twice = {"nodout": RUN.nodout(), "nodout.txt": other.nodout()}
    assert "expected one nodout of a run" in problem(saved(tmp_path / "twice", **twice))
    assert only(tmp_path / "twice" / "nodout.txt").condition.speed_mps is not None


@pytest.mark.parametrize(
    ("name", "run_id"),
    [
        ("run12.binout0000", "run12"),
        ("Simulation.key.binout0000", "Simulation"),
        ("job.nodout", "job"),
        ("v1.2.nodout.txt", "v1.2"),
        ("job.nodouthf", "job"),
        ("nodouthf", "here"),
        ("BINOUT", "here"),
    ],
)
def test_names_of_jobs_are_those_of_the_runs(tmp_path: Path, name: str, run_id: str) -> None:
    """As LS-DYNA writes them with jobid=, with the energies beside under the same name."""
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
    """A node in both is read where it was written more often; the others keep their own clock."""
    fine = Run(end_s=0.15, step_s=2e-4, nodes={1001: RUN.nodes[1001]}, database="nodouthf")
    if form == "binout":
        folder = saved(tmp_path, binout0000=lsda({**FOLDERS, **fine.folders()}))
    else:
        folder = saved(tmp_path, nodout=RUN.nodout(), nodouthf=fine.nodout())
    record = only(folder)
    assert record.proposed == ("1001",)
    sizes = {channel.name: channel.time_s.size for channel in record.channels}
    assert sizes == {"1001": 751, "1002": 151, "2001": 151, "2002": 151}
    assert settle(record, WEIGHTS, role="cae").pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=2e-3)


def test_nodes_that_end_before_the_energies_are_pointed_out(tmp_path: Path) -> None:
    """The energies go on to 150 ms, the nodes were cut at 120: files are missing."""
    folders = {**RUN.folders(states=slice(0, 121)), **Energies(time=(0.0, 75.0, 150.0)).glstat_folders()}
    record = only(saved(tmp_path / "a", binout0000=lsda(folders)))
    assert not [step for step in record.steps if "energies at" in step]  # within two steps of the energies
    times = tuple(np.linspace(0, 150, 31).tolist())
    nine = (9.0,) * 31
    many = Energies(nine, nine, nine, nine, nine, times)
    record = only(saved(tmp_path / "b", binout0000=lsda({**folders, **many.glstat_folders()})))
    assert "Careful: the nodes end at 120 but the energies at 150; copy all files of the run." in record.steps


def test_a_list_of_states_may_be_as_long_as_it_likes(tmp_path: Path) -> None:
    """A table a state or one for all, and hundreds of variables that nobody asked for: the nodes are what they were."""
    unasked = {f"v{number:03d}": np.ones(1, "f4") for number in range(200)}
    folders = {name: {**content, **unasked} for name, content in FOLDERS.items()}
    whole = only(saved(tmp_path / "whole", binout0000=RUN.binout()))
    for number, tables in enumerate((1, 10_000)):
        content = lsda(folders, Layout(folders_a_table=tables))
        assert same(only(saved(tmp_path / str(number), binout0000=content)), whole)


@needs_shared
def test_a_run_in_three_files_of_the_solver_s_own_library_is_the_crash(tmp_path: Path) -> None:
    """Written by LSTC's library without metadata in the later files: all 150 ms, and the pulse of NHTSA 10146."""
    condition = PartialCondition(mass_kg=1719.0)
    choices = Choices(condition=condition, front_share=0.56)
    real = SHARED / "real"
    (run,) = import_source(real / "formats/lsdyna_split", tmp_path / "run", choices, role="cae")
    (test,) = import_source(real / "nhtsa_10146_camry2018", tmp_path / "test")
    (record,) = read_lsdyna(real / "formats/lsdyna_split")
    assert {channel.time_s.size for channel in record.channels} == {1501}
    of_run, of_test = (each.pulse.kinematics(each.condition.speed_mps) for each in (run, test))
    assert of_run.t0_s == pytest.approx(of_test.t0_s, abs=0.5 * MS)
    assert of_run.displacement_m.max() == pytest.approx(of_test.displacement_m.max(), rel=0.01)
