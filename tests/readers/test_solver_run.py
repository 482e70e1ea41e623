"""The axis of travel: found from how nodes set out, given by the user, and refused where nothing travels."""

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse import cli
from crashfuse.cae_library import RunQuality
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import DataError
from crashfuse.importing import Choices, import_source, settle
from crashfuse.readers.lsdyna import read_lsdyna
from crashfuse.readers.record import PartialCondition
from crashfuse.readers.solver_run import History, axis_of_travel, departure, quality_by_histories
from crashfuse.readers.vocabulary import TRAVELS, Travel
from crashfuse.signals.pulse import FloatArray
from crashfuse.testing.readers import written
from tests.conftest import SHARED, Capture, needs_shared
from tests.importing.crash_files import isomme
from tests.importing.crashes import CRUSH_M, PEAK_MPS2, SPEED_MPS, STOP_S
from tests.readers.lsdyna_files import Energies, Run, lsda
from tests.readers.test_lsdyna import WEIGHTS, only, saved

SPEED = replace(WEIGHTS, condition=replace(WEIGHTS.condition, speed_mps=SPEED_MPS))


@pytest.mark.parametrize("form", ["binout", "nodout"])
@pytest.mark.parametrize("travel", TRAVELS)
def test_a_vehicle_may_drive_along_any_axis(tmp_path: Path, form: str, travel: Travel) -> None:
    run = Run(end_s=0.15, step_s=5e-4, axis=travel[-1], direction=-1 if travel.startswith("-") else 1)
    folder = saved(tmp_path, **{form: run.binout() if form == "binout" else run.nodout()})
    for given, told in ((None, "as the nodes set out"), (travel, "given by the user")):
        (record,) = read_lsdyna(folder, given)
        assert any(step.startswith(f"Travel along {travel}, {told}") for step in record.steps)
        settled = settle(record, WEIGHTS, role="cae")
        motion = settled.pulse.kinematics(settled.condition.speed_mps)
        assert settled.condition.speed_mps == pytest.approx(SPEED_MPS, rel=1e-4)
        assert settled.pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)
        assert motion.t0_s == pytest.approx(STOP_S, abs=1e-4)
        assert motion.displacement_m.max() == pytest.approx(CRUSH_M, rel=1e-3)
    against = travel[1:] if travel.startswith("-") else f"-{travel}"
    with pytest.raises(DataError, match=rf"set out along {against}, found along {travel}"):
        read_lsdyna(folder, against)  # type: ignore[arg-type]
    across: Travel = "y" if travel[-1] == "x" else "x"
    with pytest.raises(DataError, match=rf"move along {across}, as given, found at most"):
        read_lsdyna(folder, across)


def set_out(
    start: np.ndarray,
    speeds: tuple[float, float],
    fastest: np.ndarray,
    travel: Travel | None = None,
    unit: str = "m/s²",
) -> tuple[float | None, str]:
    """Speed of a node that sets out and is fastest like this, and the sentence on its direction."""
    node = History("1", "", np.arange(2.0), np.zeros(2), np.array(speeds))
    units = (1.0, unit or None, "Unit of length unknown.")
    speed, _, sentence = departure([node], units, (start, fastest), travel, "run")
    return speed, sentence


def test_the_axis_is_that_of_most_motion_whatever_single_nodes_do() -> None:
    """Wheels turn as fast as the vehicle drives, a barrier's nodes rest, one node flies off, one is not a number."""
    angle = np.linspace(0, 2 * np.pi, 40)
    wheels = 15 * np.array([0 * angle, 1 + np.cos(angle), np.sin(angle)])
    body, barrier = np.array([[0.0], [15.0], [0.0]]) * np.ones(20), np.zeros((3, 500))
    odd = np.array([[99.0, np.nan], [0.0, np.nan], [0.0, np.inf]])
    start = np.concatenate([wheels, body, barrier, odd], axis=1)
    assert axis_of_travel(start) == 1
    assert axis_of_travel(start, "-z") == 2
    speed, sentence = set_out(start, (15.0, 15.0), np.array([99.0, 30.0, 15.0]))
    assert (speed, sentence.split(",")[0]) == (15.0, "Travel along y")


def test_a_vehicle_that_drives_aslant_is_refused_until_the_user_chooses() -> None:
    """Along an axis that is 20° off, the pulse would be 6 % too small."""
    start = 15.0 * np.array([[np.cos(np.radians(20))], [np.sin(np.radians(20))], [0.0]]) * np.ones(9)
    fastest = np.abs(start).max(axis=1)
    with pytest.raises(DataError, match=r"travels along one axis, found x 14\.1, y 5"):
        set_out(start, (14.1, 14.1), fastest)
    speed, sentence = set_out(start, (14.1, 14.1), fastest, "x")
    assert speed == 14.1
    assert sentence.startswith("Careful: travel along x")


@pytest.mark.parametrize(
    ("speeds", "unit"),
    [((0.0, 0.0), "m/s²"), ((0.0, 4.9), "m/s²"), ((0.5, 0.5), "m/s²"), ((2.0, 15.0), "m/s²"), ((0.0, 400.0), "")],
    ids=["still", "pushed", "creeping", "accelerated", "pushed, in inch"],
)
def test_nodes_that_are_not_fastest_when_they_set_out_are_no_vehicle(speeds: tuple[float, float], unit: str) -> None:
    start, fastest = np.array([[0.0], [speeds[0]], [0.0]]), np.array([0.0, speeds[1], 0.0])
    with pytest.raises(DataError, match=rf"at most x 0, y {speeds[1]:.3g}, z 0 .*--travel, --speed-kph"):
        set_out(start, speeds, fastest, unit=unit)


def test_a_vehicle_that_is_struck_at_rest_needs_its_speed(tmp_path: Path) -> None:
    """In the frame of the vehicle a barrier comes along −x: with axis and speed it is the same crash."""

    class Struck(Run):
        def columns(self, scale: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            time, velocity, accel = super().columns(scale, seed)
            return time, velocity - velocity[0], accel

    folder = saved(tmp_path, binout0000=Struck(end_s=0.15, step_s=5e-4).binout())
    with pytest.raises(DataError, match="fastest at the start"):
        read_lsdyna(folder)
    (record,) = read_lsdyna(folder, "x")
    with pytest.raises(DataError, match=r"the impact speed of .*, found nodes at rest along x at the start; give"):
        settle(record, WEIGHTS, role="cae")
    assert settle(record, SPEED, role="cae").pulse.accel_mps2.min() == pytest.approx(-PEAK_MPS2, rel=1e-3)


def test_the_command_line_takes_a_direction_as_written(tmp_path: Path, capsys: Capture) -> None:
    run = Run(end_s=0.15, step_s=5e-4, axis="y", direction=-1)
    source, out = saved(tmp_path / "run7", binout0000=run.binout()), tmp_path / "campaign"
    options = ["--as", "cae", "--front-weight-kg", "950", "--rear-weight-kg", "750", "--out", str(out)]
    assert cli.main(["import", str(source), *options, "--travel", "-y"]) == cli.DONE
    assert "  Travel along -y, given by the user." in capsys.readouterr().out.splitlines()
    assert cli.main(["import", str(source), *options, "--travel=y", "--id", "again"]) == cli.WRONG_DATA
    assert "check the direction (--travel -y)" in capsys.readouterr().err
    mme = written(tmp_path / "mme", isomme("M1"))
    assert cli.main(["import", str(mme), "--out", str(out), "--travel", "x"]) == cli.WRONG_USAGE
    assert "remove --travel" in capsys.readouterr().err


@needs_shared
def test_a_battery_pouch_is_no_vehicle(tmp_path: Path) -> None:
    pouch = SHARED / "real/formats/lsdyna_no_travel"
    for choices in (WEIGHTS, Choices(condition=PartialCondition(15.0, None, 950.0, 750.0))):
        with pytest.raises(DataError, match=r"fastest at the start, found x 0, y 0, z 0 m/s at"):
            import_source(pouch, tmp_path / "out", choices, role="cae")
    given: tuple[tuple[Travel, str], ...] = (("-x", r"at most x 0, y 4\.9, z 0 m/s"), ("y", r"38\.6 km/h .* 60 ms"))
    for travel, found in given:
        with pytest.raises(DataError, match=found):
            import_source(pouch, tmp_path / "out", SPEED, role="cae", travel=travel)
    assert not (tmp_path / "out").exists()


RUN = Run(end_s=0.12, step_s=5e-4)
TOLD = Energies()
QUALITY = RunQuality(-0.04, 0.05, 0.025)
"""By hand: 97 - 1 of 100 in between, 4 of 80, 2.5 %."""


def binout(*energies: dict[str, dict[str, np.ndarray]]) -> bytes:
    folders = {name: content for name, content in RUN.folders().items() if "glstat" not in name}
    for more in energies:
        folders |= more
    return lsda(folders)


@pytest.mark.parametrize("form", ["in the binout", "as text", "as text beside a nodout"])
def test_quality_is_that_of_glstat_in_any_form(tmp_path: Path, form: str) -> None:
    files = {
        "in the binout": {"binout0000": binout(TOLD.glstat_folders())},
        "as text": {"binout0000": binout(), "glstat": TOLD.glstat()},
        "as text beside a nodout": {"nodout": RUN.nodout(), "glstat.txt": TOLD.glstat()},
    }[form]
    record = only(saved(tmp_path / "run7", **files))
    found = record.quality
    assert astuple(found) == pytest.approx(astuple(QUALITY))
    assert any(step.startswith("Run quality: energy change −4 %") for step in record.steps)
    assert settle(record, WEIGHTS, role="cae").quality == found
    assert settle(record, WEIGHTS, role="tests").quality == RunQuality()


@pytest.mark.parametrize("form", ["in the binout", "as text"])
def test_parts_are_summed_where_the_whole_is_not_told(tmp_path: Path, form: str) -> None:
    without = replace(TOLD, hourglass=None, added_percent=None)
    files = {
        "in the binout": {"binout0000": binout(without.glstat_folders(), TOLD.matsum_folders())},
        "as text": {"binout0000": binout(), "glstat": without.glstat(), "matsum": TOLD.matsum()},
    }[form]
    found = only(saved(tmp_path / "run7", **files)).quality
    assert astuple(found)[:2] == pytest.approx((-0.04, 0.05))
    assert found.added_mass_share is None


def test_energies_that_a_run_lacks_are_not_recorded(tmp_path: Path) -> None:
    """LS-DYNA writes zeros for hourglass energy it does not compute; a killed run's last state has no total energy."""
    zeros, whole = replace(TOLD, hourglass=(0.0, 0.0, 0.0)), TOLD.glstat()
    record = only(saved(tmp_path / "zeros", binout0000=binout(zeros.glstat_folders(), zeros.matsum_folders())))
    assert record.quality.hourglass_share is None
    assert any("hourglass energy not recorded" in step for step in record.steps)
    killed = saved(tmp_path / "killed", binout0000=binout(), glstat=whole[: whole.rindex(b" total energy...")])
    assert only(killed).quality.energy_change == pytest.approx(-0.04)


def test_energies_alone_are_no_run(tmp_path: Path) -> None:
    saved(tmp_path / "doe" / "a", binout0000=binout(TOLD.glstat_folders()))
    saved(tmp_path / "doe" / "b", glstat=TOLD.glstat())
    assert [record.id for record in read_lsdyna(tmp_path / "doe")] == ["a"]
    with pytest.raises(DataError, match="expected binout or nodout of LS-DYNA, found none"):
        read_lsdyna(tmp_path / "doe" / "b")


def test_a_damaged_glstat_is_told(tmp_path: Path) -> None:
    damaged = TOLD.glstat().replace(b"8.00000E+01", b"8.00-00E+01")
    with pytest.raises(DataError, match=r"glstat: expected numbers, found '8.00-00E\+01'; copy it again"):
        read_lsdyna(saved(tmp_path / "run7", binout0000=binout(), glstat=damaged))


@pytest.mark.parametrize(
    ("histories", "quality"),
    [
        ({}, RunQuality()),
        ({"total": np.array([0.0, 1.0]), "work": np.zeros(2)}, RunQuality()),
        ({"total": np.array([1.0, np.nan]), "work": np.zeros(2)}, RunQuality()),
        ({"total": np.array([1.0, 1.2]), "work": np.array([0.5, 0.7])}, RunQuality(0.0)),
        ({"total": np.array([1.0, 9.0]), "work": np.zeros(2)}, RunQuality(1.0)),
        ({"internal": np.zeros(2), "hourglass": np.zeros(2)}, RunQuality()),
        ({"internal": np.array([0.0, 2.0]), "hourglass": np.array([0.0, -1e-9])}, RunQuality(hourglass_share=0.0)),
        ({"added_mass_percent": np.array([10.0, 300.0])}, RunQuality(added_mass_share=1.0)),
    ],
)
def test_quality_follows_from_the_histories(histories: dict[str, FloatArray], quality: RunQuality) -> None:
    """What can't be computed is not recorded; what lies beyond the whole counts as all of it."""
    assert astuple(quality_by_histories(**histories)) == pytest.approx(astuple(quality))


def test_quality_comes_into_the_campaign_with_the_run(tmp_path: Path, campaign_folder: Path) -> None:
    source = saved(tmp_path / "run7", binout0000=binout(TOLD.glstat_folders()))
    import_source(source, campaign_folder, WEIGHTS, role="cae")
    import_source(source, campaign_folder, WEIGHTS, role="tests")
    campaign = load_campaign(campaign_folder)
    assert campaign.cae.quality[-1].energy_change == pytest.approx(QUALITY.energy_change)
    assert campaign.cae.quality[0] == RunQuality()
    assert "energy_change" not in (campaign_folder / "tests.csv").read_text()
