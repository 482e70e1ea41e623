"""NHTSA's ASCII form: conditions, the choice of channels, and what is wrong with a test that is not whole."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.errors import DataError
from crashfuse.files.archive import Limits, zipped
from crashfuse.importing import Choices, settle
from crashfuse.readers.nhtsa import read_nhtsa
from crashfuse.signals.metrics import pulse_metrics
from crashfuse.testing.readers import written
from crashfuse.units import KPH
from tests.conftest import SHARED, needs_shared, not_none
from tests.importing.crashes import SPEED_MPS, clock, half_sine_g
from tests.readers.nhtsa_files import SENSORS, nhtsa_files, samples

CAMRY = SHARED / "real/nhtsa_10146_camry2018"


def test_conditions_and_channels_are_found(tmp_path: Path) -> None:
    (found,) = read_nhtsa(written(tmp_path / "v00005", nhtsa_files()))
    assert found.id == "00005"
    assert found.condition.speed_mps == pytest.approx(SPEED_MPS)
    assert found.condition.front_weight_kg == pytest.approx(1700 * 1500 / 2700)  # moments about the rear axle
    assert found.condition.rear_weight_kg == pytest.approx(1700 * 1200 / 2700)
    assert [channel.name for channel in found.channels] == ["93", "94", "99", "95", "100"]
    assert {channel.unit for channel in found.channels} == {"g"}
    assert {channel.cutoff_hz for channel in found.channels} == {2800.0}
    assert found.proposed == ("93", "94", "99")  # 95 is the engine, 100 failed
    assert found.own_time_zero


def test_a_zip_its_file_and_its_folder_are_one_test(tmp_path: Path) -> None:
    folder = written(tmp_path / "v00005", nhtsa_files())
    packed = zipped({f"download/{name}": content for name, content in nhtsa_files().items()})
    (tmp_path / "v00005.zip").write_bytes(packed)
    (own,) = read_nhtsa(folder)
    for path in (folder / "v00005.EV5", tmp_path / "v00005.zip"):
        (other,) = read_nhtsa(path)
        assert (other.id, other.proposed, other.condition) == (own.id, own.proposed, own.condition)
        np.testing.assert_array_equal(other.channels[0].values, own.channels[0].values)


def test_without_a_centre_of_gravity_the_axles_are_asked_for(tmp_path: Path) -> None:
    (found,) = read_nhtsa(written(tmp_path / "t", nhtsa_files(behind="0")))
    assert (found.condition.mass_kg, found.condition.front_weight_kg) == (1700.0, None)
    assert any("without axle weights" in step for step in found.steps)
    with pytest.raises(DataError, match=r"found the mass alone; .* --front-share"):
        settle(found)
    assert settle(found, Choices(front_share=0.6)).condition.front_weight_kg == pytest.approx(1020.0)


def test_another_kind_of_test_is_pointed_out(tmp_path: Path) -> None:
    (found,) = read_nhtsa(written(tmp_path / "t", nhtsa_files(setup="VTV")))
    named = "vehicle into vehicle (VTV) at 0°"
    assert found.other_setup == named
    careful = f"Careful: not a full-frontal barrier crash, by its own account: {named}."
    assert careful in settle(found).steps
    halved = replace(found, channels=tuple(replace(one, values=0.5 * one.values) for one in found.channels))
    with pytest.raises(DataError, match=r"the file calls it 'vehicle into vehicle \(VTV\) at 0°'"):
        settle(halved)


def test_a_channel_that_ends_early_is_not_proposed(tmp_path: Path) -> None:
    short = clock(end_s=0.067)
    files = nhtsa_files() | {"v00005.093": samples(short, half_sine_g(short)).encode()}
    (found,) = read_nhtsa(written(tmp_path / "t", files))
    assert found.proposed == ("94", "99")
    assert "93" in [channel.name for channel in found.channels]


@pytest.mark.parametrize("comment", ["QUESTIONABLE DELTA-V", "NO VALID DATA AFTER 60 MS", "sensor saturated"])
def test_a_comment_is_heard_as_a_status_is(tmp_path: Path, comment: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SENSORS, 94, (*SENSORS[94][:-1], f"RIGHT REAR SEAT CROSSMEMBER X - {comment}"))
    monkeypatch.setitem(SENSORS, 102, (*SENSORS[101][:-1], "TOTAL BARRIER FORCE"))
    files = nhtsa_files()
    (found,) = read_nhtsa(written(tmp_path / "t", {**files, "v00005.102": files["v00005.101"]}))
    assert found.proposed == ("93", "99")
    told = f"Left out by the file's own account: 94 (RIGHT REAR SEAT CROSSMEMBER X - {comment}"
    assert any(told in step for step in found.steps)
    force = np.loadtxt(tmp_path / "t" / "v00005.101")[:, 1]
    np.testing.assert_array_equal(not_none(found.wall).force_n, force)


@pytest.mark.parametrize("content", [b"0 1\n1 x\n", b""])
def test_a_damaged_channel_that_nobody_proposed_is_left_out(tmp_path: Path, content: bytes) -> None:
    (found,) = read_nhtsa(written(tmp_path / "t", nhtsa_files() | {"v00005.095": content}))
    assert found.proposed == ("93", "94", "99")
    assert "95" not in [channel.name for channel in found.channels]
    assert "Left out as damaged or empty: 95 (TOP OF ENGINE X)." in found.steps
    assert settle(found, Choices(channels=("93", "94"))).channels == ("93", "94")
    with pytest.raises(DataError, match=r"v00005\.095: expected"):
        settle(found, Choices(channels=("95",)))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"v00005.EV5": None}, r"one \.EV5 file, found none"),
        ({"v00006.EV5": nhtsa_files()["v00005.EV5"]}, r"one \.EV5 file, found 2"),
        ({"v00005.EV5": b"----- TEST -----\nV5|x\n"}, "a section VEHICLE, found none"),
        ({f"v00005.{n:03d}": None for n in (93, 94, 95, 99, 100)}, "5 listed, none of them beside it"),
        ({"v00005.093": b"0 1\n1 x\n"}, "time and value on each line"),
        ({"v00005.093": b"0 1\n1\n"}, "time and value on each line"),
        ({"v00005.093": b"0 1\n"}, "2 to 1000000 samples, found 1"),
        ({"v00005.093": b"0 1\n1 nan\n"}, "time and value on each line"),
    ],
)
def test_a_test_that_is_not_whole_is_refused(tmp_path: Path, changed: dict[str, bytes | None], message: str) -> None:
    files = {name: content for name, content in (nhtsa_files() | changed).items() if content is not None}
    with pytest.raises(DataError, match=message):
        read_nhtsa(written(tmp_path / "t", files))


def test_sizes_are_bounded(tmp_path: Path) -> None:
    folder = written(tmp_path / "t", nhtsa_files())
    with pytest.raises(DataError, match=r"at most 0\.00977 MiB a file"):
        read_nhtsa(folder, Limits(member_bytes=10 << 10))


@needs_shared
@pytest.mark.parametrize("channels", [(), ("93",), ("94",), ("99",), ("100",)])
def test_a_real_test_has_its_known_metrics(channels: tuple[str, ...]) -> None:
    """NHTSA 10146, 57.09 km/h and 1719 kg: proposed or chosen, the rear crossmember gives the known numbers."""
    settled = settle(*read_nhtsa(CAMRY), Choices(channels=channels))
    assert settled.condition.speed_mps == pytest.approx(57.09 * KPH)
    assert settled.condition.mass_kg == pytest.approx(1719)
    assert settled.channels == (channels or ("93", "94", "99", "100"))
    assert settled.channel_filter_class == 60
    known = {"peak": (39.5, 47.5), "peak_time": (62.5, 66.5), "delta_v": (65.5, 67.5), "t0": (72.4, 74.3)}
    known |= {"max_crush": (732.5, 751), "sm25": (33.5, 35.5), "olc": (29.2, 30.2), "vpi": (59.7, 61.4)}
    pulse = settled.pulse
    metrics = pulse_metrics(pulse.accel_mps2, settled.condition.speed_mps, dt_s=pulse.dt_s)
    found = {metric.name: metric.value for metric in metrics}
    assert [name for name, (low, high) in known.items() if not low <= not_none(found[name]) <= high] == []
