"""A saved model predicts as on the day it was saved; a file that is not one is refused, and nothing in it runs."""

import json
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save, save_file

from crashfuse import cli
from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import DataError, NotFittedError, UsageError
from crashfuse.files.tensors import checksum
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.saved_models import load_model, save_model
from crashfuse.units import LB, MPH
from crashfuse.version import versions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("quick_networks")]

NEW = Condition.of_vector([22 * MPH, 2060 * LB, 1520 * LB])


@pytest.fixture(scope="module")
def fits(
    campaign: Campaign,
    quick_networks: None,  # noqa: ARG001
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Fit]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CRASHFUSE_CACHE", str(tmp_path_factory.mktemp("cache")))
        return {name: Fit.of(campaign, name) for name in APPROACHES}


@pytest.fixture
def saved(campaign: Campaign, fits: dict[str, Fit], tmp_path: Path) -> Path:
    path = tmp_path / "models" / "time_domain.safetensors"
    save_model(fits["time_domain"], campaign, path)
    return path


@pytest.mark.parametrize("name", APPROACHES)
def test_a_saved_model_predicts_the_same_bits_without_learning_again(
    name: str, campaign: Campaign, fits: dict[str, Fit], tmp_path: Path, fitting_is_an_error: Callable[[], None]
) -> None:
    path = tmp_path / f"{name}.safetensors"
    save_model(fits[name], campaign, path)
    fitting_is_an_error()
    loaded = load_model(path, campaign)
    one, other = fits[name].estimate(NEW), loaded.estimate(NEW)
    assert loaded.config == StudyConfig()
    assert other.accel_mps2.tobytes() == one.accel_mps2.tobytes()
    assert other.notes == one.notes
    assert (other.draws_mps2 is None) == (one.draws_mps2 is None)
    if one.draws_mps2 is not None and other.draws_mps2 is not None:
        assert other.draws_mps2.tobytes() == one.draws_mps2.tobytes()
    assert json.dumps(other.state) == json.dumps(one.state)


def test_the_papers_models_can_be_kept_too(
    campaign: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fitting_is_an_error: Callable[[], None]
) -> None:
    from crashfuse.approaches.displacement_domain.approach import DisplacementConfig

    quick = replace(DisplacementConfig.paper(), restarts=0, projected_points=15)
    monkeypatch.setattr(DisplacementConfig, "paper", lambda: quick)
    config = StudyConfig(preset="paper", seed=3)
    fit = Fit.of(campaign, "displacement_domain", config)
    save_model(fit, campaign, tmp_path / "model")
    fitting_is_an_error()
    loaded = load_model(tmp_path / "model", campaign)
    assert loaded.config == config
    one, other = fit.estimate(NEW), loaded.estimate(NEW)
    assert other.accel_mps2.tobytes() == one.accel_mps2.tobytes()


def test_other_data_is_refused(campaign: Campaign, saved: Path) -> None:
    with pytest.raises(DataError, match=r"a model of the data in Tiny .* found one of Tiny .* take the campaign"):
        load_model(saved, campaign.without(["T1"]))


def test_a_fit_is_not_saved_as_one_of_other_data(campaign: Campaign, fits: dict[str, Fit], tmp_path: Path) -> None:
    """It would be taken for one that has not seen the test that is missing there."""
    with pytest.raises(UsageError, match="learned from other data"):
        save_model(fits["displacement_domain"], campaign.without(["T1"]), tmp_path / "other.safetensors")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["crashfuse", "numpy", "torch", "Python"])
def test_another_version_is_refused(
    campaign: Campaign, saved: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Numbers must not change silently with the code around them."""
    monkeypatch.setattr("crashfuse.study.saved_models.versions", lambda: {**versions(), name: "99.0"})
    with pytest.raises(DataError, match=rf"a model made with {name} 99\.0, found .*{name} .*; train it again"):
        load_model(saved, campaign)


def test_a_model_under_the_name_of_another_is_refused(campaign: Campaign, saved: Path) -> None:
    other = saved.rename(saved.with_name("fused.safetensors"))
    with pytest.raises(DataError, match="a model of fused, found one of time_domain"):
        load_model(other, campaign)
    assert load_model(other.rename(saved.with_name("mine.safetensors")), campaign).approach.name == "time_domain"


@pytest.mark.parametrize("keep", [0, 1, 7, 100, 5000, -1])
def test_a_file_that_was_cut_off_is_refused(campaign: Campaign, saved: Path, keep: int) -> None:
    saved.write_bytes(saved.read_bytes()[:keep])
    with pytest.raises(DataError, match=r"time_domain\.safetensors: expected a model .*, found .*cut off"):
        load_model(saved, campaign)


def test_a_flipped_byte_is_noticed_wherever_it_is(campaign: Campaign, saved: Path) -> None:
    content = saved.read_bytes()
    for place in np.linspace(0, len(content) - 1, 60).astype(int):
        damaged = bytearray(content)
        damaged[place] ^= 4
        saved.write_bytes(damaged)
        with pytest.raises(DataError, match="train it again"):
            load_model(saved, campaign)


def test_arrays_that_do_not_fit_are_refused_although_the_checksum_is_right(campaign: Campaign, saved: Path) -> None:
    import safetensors

    with safetensors.safe_open(saved, framework="numpy") as file:
        text = file.metadata()["crashfuse"]
    arrays = load_file(saved)
    for forged, record in (
        ({k: v for k, v in arrays.items() if k != "lf/head.weight"}, text),
        ({**arrays, "lf/head.weight": arrays["lf/head.weight"][:, :, :3]}, text),
        (arrays, text.replace('"approach": "time_domain"', '"approach": "os"')),
        (arrays, text.replace('"preset": "fast"', '"preset": "slow"')),
        (arrays, text.replace('"channels": 8', '"channels": 800000')),
        (arrays, text.replace('"seed": 0', '"seed": []')),
        (arrays, text.replace('"learned": {', '"learned": {"x": 1}, "y": {')),
    ):
        save_file(forged, saved, {"crashfuse": record, "sha256": checksum(record, forged)})
        with pytest.raises(DataError, match="expected a model as crashfuse saved it, found"):
            load_model(saved, campaign)


def test_a_pickle_is_not_opened(campaign: Campaign, tmp_path: Path) -> None:
    """What would run code when it is unpickled is refused unread."""

    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return exec, (f"open({str(tmp_path / 'ran')!r}, 'w')",)

    path = tmp_path / "time_domain.safetensors"
    path.write_bytes(pickle.dumps(Evil()))
    with pytest.raises(DataError, match="another kind of file"):
        load_model(path, campaign)
    assert not (tmp_path / "ran").exists()


def test_an_unfitted_approach_cannot_be_saved(campaign: Campaign, tmp_path: Path) -> None:
    for name in APPROACHES:
        unfitted = Fit(StudyConfig().create(name), StudyConfig(), 0.0, {}, {}, campaign)
        with pytest.raises(NotFittedError):
            save_model(unfitted, campaign, tmp_path / "model")
    assert not list(tmp_path.iterdir())


def test_a_model_of_one_process_is_read_by_another(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Trained by a call of the command line and used by another: the same numbers as without the model."""
    monkeypatch.chdir(tmp_path)
    condition = ["--speed-mph", "22", "--front-weight-lb", "2060", "--rear-weight-lb", "1520"]
    chosen = ["--approach", "cae", "displacement_domain"]
    predict = ["predict", str(campaign_on_disk), *condition, "--out"]
    assert cli.main([*predict, str(tmp_path / "trained"), *chosen]) == cli.DONE
    train = [sys.executable, "-m", "crashfuse", "train", str(campaign_on_disk), "--out", "models", *chosen]
    environment = {**os.environ, "CRASHFUSE_CACHE": str(tmp_path / "another")}
    subprocess.run(train, check=True, env=environment, capture_output=True)
    assert cli.main([*predict, str(tmp_path / "saved"), "--models", "models"]) == cli.DONE
    names = {path.name for path in (tmp_path / "models").iterdir()}
    assert names == {"cae.safetensors", "displacement_domain.safetensors"}
    for name in ("pulses.csv", "metrics.csv"):
        assert (tmp_path / "saved" / name).read_bytes() == (tmp_path / "trained" / name).read_bytes()


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "null", "[]", '{"crashfuse": []}', '{"crashfuse": NaN, "fingerprint": 1}']
)
def test_a_header_that_means_harm_is_a_sentence(campaign: Campaign, tmp_path: Path, text: str) -> None:
    path = tmp_path / "m.safetensors"
    path.write_bytes(save({}, {"crashfuse": text, "sha256": checksum(text, {})}))
    with pytest.raises(DataError, match=r"m\.safetensors: expected a model"):
        load_model(path, campaign)


@pytest.mark.parametrize("kind", ["F8_E4M3", "F8_E5M2", "BF16", "X9"])
def test_numbers_that_numpy_lacks_are_a_sentence(campaign: Campaign, tmp_path: Path, kind: str) -> None:
    header = json.dumps({"a": {"dtype": kind, "shape": [2], "data_offsets": [0, 2 * (1 + (kind == "BF16"))]}}).encode()
    path = tmp_path / "m.safetensors"
    path.write_bytes(len(header).to_bytes(8, "little") + header + bytes(2 * (1 + (kind == "BF16"))))
    with pytest.raises(DataError, match=r"m\.safetensors: expected a model as crashfuse saved it"):
        load_model(path, campaign)
