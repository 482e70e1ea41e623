"""The command line: what it prints, what it writes, how it ends."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from io import BytesIO, StringIO, TextIOWrapper
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse import cli
from crashfuse.approaches.registry import APPROACHES
from crashfuse.campaign import Campaign
from crashfuse.results.files import RESULT_FILES
from crashfuse.signals.pulse import GRID_S
from crashfuse.testing import small_campaign
from crashfuse.version import __version__
from tests.cli.conftest import Shell, run
from tests.conftest import write_campaign


def at_condition(speed_mph: float, front_weight_lb: float, rear_weight_lb: float) -> list[str]:
    """The options of a condition."""
    values = {"speed-mph": speed_mph, "front-weight-lb": front_weight_lb, "rear-weight-lb": rear_weight_lb}
    return [part for name, value in values.items() for part in (f"--{name}", str(value))]


pytestmark = pytest.mark.usefixtures("quick_networks", "one_cache")


@pytest.mark.slow
def test_a_study_writes_six_files_and_what_made_their_numbers(campaign_on_disk: Path, tmp_path: Path) -> None:
    """No temporary file stays; versions, settings and fingerprint are recorded, and the report needs no network."""
    out = tmp_path / "study"
    assert run("study", campaign_on_disk, "--out", out, "--held-out", "T2", "T4", "--workers", 1) == cli.DONE
    names = {path.name for path in out.iterdir()}
    assert names == set(RESULT_FILES["study"]) - {"speed_groups.csv"}
    assert names == {"scores.csv", "pulses.csv", "metrics.csv", "cae_events.csv", "study.json", "report.html"}
    record = json.loads((out / "study.json").read_text())
    assert (record["crashfuse"], record["finished"], record["seed"]) == (__version__, True, 0)
    assert record["config"]["preset"] == "fast"
    assert re.fullmatch("[0-9a-f]{64}", record["fingerprint"])
    assert set(record["packages"]) >= {"numpy", "torch", "scikit-learn"}
    assert all(fit["seconds"] >= 0 for fit in record["fits"])
    assert {fit["approach"] for fit in record["fits"]} == set(APPROACHES)
    report = (out / "report.html").read_text()
    assert not re.search(r"<(script|link|img)[^>]+(src|href)\s*=\s*[\"']?https?:", report)
    assert all(part in report for part in (record["fingerprint"], "Test T2: 25.0 mph", "Maximum dynamic crush (mm)"))


@pytest.mark.slow
def test_resuming_takes_the_settings_that_were_noted(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    """A study that was begun goes on without its options being repeated."""
    out = tmp_path / "out"
    command = ["study", campaign_on_disk, "--out", out, "--workers", 1]
    options = ["--held-out", "T1", "--approach", "cae", "--windows-ms", 30, "--seed", 3, "--device", "cpu"]
    assert run(*command, *options) == cli.DONE
    record = json.loads((out / "study.json").read_text())
    assert record["config"]["device"] == "cpu"
    (out / "study.json").write_text(json.dumps(record | {"finished": False}))
    (out / "scores.csv").unlink()
    assert run(*command, "--resume") == cli.DONE
    assert pd.read_csv(out / "scores.csv")["window_ms"].tolist() == [30.0]
    assert "was begun with other settings: seed" in shell.wrong_usage(*command, "--resume", "--seed", 4)
    nothing = ["study", campaign_on_disk, "--out", tmp_path / "none", "--resume"]
    assert "no study to resume" in shell.wrong_usage(*nothing)


@pytest.mark.slow
def test_a_killed_study_resumes_to_the_same_files(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed in mid-study, it leaves no table; resumed, it keeps what was finished and ends with the same bytes."""
    study = ["study", str(campaign_on_disk), "--workers", "1", "--approach", "cae", "displacement_domain"]
    study += ["--held-out", "T1", "T2"]
    assert run(*study, "--out", tmp_path / "undisturbed") == cli.DONE
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path / "cache"))
    command = [sys.executable, "-m", "crashfuse", *study, "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and len(list((tmp_path / "cache").glob("predictions/*.bin"))) < 2:
            time.sleep(0.001)
        process.kill()
    kept = {path: path.stat().st_ino for path in (tmp_path / "cache" / "predictions").glob("*.bin")}
    assert 2 <= len(kept) < 4
    assert not (tmp_path / "out" / "scores.csv").exists()
    assert run("study", campaign_on_disk, "--out", tmp_path / "out", "--resume") == cli.DONE
    assert all(path.stat().st_ino == file for path, file in kept.items())
    for name in ("scores.csv", "pulses.csv", "metrics.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "undisturbed" / name).read_bytes()


def test_bad_data_end_with_1_and_leave_nothing(campaign_folder: Path, tmp_path: Path, shell: Shell) -> None:
    """Every problem is a line on standard error; the output folder is not even made."""
    (campaign_folder / "tests" / "T1.csv").unlink()
    (campaign_folder / "campaign.toml").write_text("name = ")
    *problems, last = shell.wrong_data("study", campaign_folder, "--out", tmp_path / "out").splitlines()
    assert (len(problems), last) == (2, "2 problems found.")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["study", "--held-out", "T9"],
        ["predict", *at_condition(0, 2000, 1500)],
        ["learning-curve", "--cost-per-test", "-5"],
        *([command, "--device", "cuda"] for command in ("study", "train")),
        *([command, "--approach", "magic"] for command in ("study", "learning-curve")),
        *([command, "--windows-ms", "400"] for command in ("study", "learning-curve")),
    ],
)
def test_wrong_usage_ends_with_2_and_leaves_nothing(
    campaign_on_disk: Path, tmp_path: Path, arguments: list[str], shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asked for what does not exist: one sentence, before anything is computed."""
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    command, *options = arguments
    said = shell.wrong_usage(command, campaign_on_disk, "--out", tmp_path / "out", *options)
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("out", "sentence"),
    [
        ("{tmp}/file", "file; name another folder for --out."),
        ("{tmp}/file/results", "file; name another folder for --out."),
        ("{campaign}", "where no results belong; name another for --out."),
        ("{campaign}/results", "where no results belong; name another for --out."),
        ("{tmp}/other", "where no results belong; name another for --out."),
        ("{tmp}/sweep", "sweep holds a sweep (sweep.csv); name another folder for the "),
        ("", "one of the arguments is empty; was a variable not set?"),
    ],
)
@pytest.mark.parametrize("command", [["study"], ["predict", *at_condition(30, 2100, 1500)]])
def test_a_folder_that_results_do_not_belong_in_is_one_sentence(
    campaign_on_disk: Path, tmp_path: Path, command: list[str], out: str, sentence: str, shell: Shell
) -> None:
    """A file, the campaign, another campaign, results of another kind, nothing: said before anything is computed."""
    (tmp_path / "file").write_text("")
    for folder, table in (("other", "tests.csv"), ("sweep", "sweep.csv")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / table).write_text("")

    def stamps() -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for place in (tmp_path, campaign_on_disk) for path in place.rglob("*")}

    before = stamps()
    place = out.format(tmp=tmp_path, campaign=campaign_on_disk)
    (line,) = shell.wrong_usage(command[0], campaign_on_disk, *command[1:], "--out", place).strip().splitlines()
    assert sentence in line
    assert stamps() == before


def test_a_folder_that_may_not_be_written_is_one_sentence(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    """Asked beforehand; and what the system refuses later is a sentence too."""
    command = ["train", campaign_on_disk, "--approach", "cae", "--out", tmp_path / "out"]
    with monkeypatch.context() as patch:
        patch.setattr("os.access", lambda *_: False)
        said = shell.wrong_usage(*command)
    assert f"Nothing can be written to {tmp_path}; name another folder for --out." in said

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "model")

    monkeypatch.setattr("crashfuse.study.saved_models.write_atomically", full)
    assert "crashfuse: model cannot be read or written: no space left on device.\n" in shell.wrong_data(*command)


@pytest.mark.slow
def test_what_older_results_of_the_same_kind_had_more_does_not_stay(campaign_on_disk: Path, tmp_path: Path) -> None:
    """Speed groups that are not asked for again; a stranger's file stays."""
    study = tmp_path / "study"
    command = ["study", campaign_on_disk, "--out", study, "--approach", "cae", "--workers", 1]
    assert run(*command) == cli.DONE
    (study / "notes.txt").write_text("")
    assert (study / "speed_groups.csv").is_file()
    assert run(*command, "--leave-out", "test") == cli.DONE
    names = {"notes.txt", "scores.csv", "pulses.csv", "metrics.csv", "study.json", "report.html"}
    assert {path.name for path in study.iterdir()} == names


def test_a_name_that_the_terminal_cannot_show_is_no_traceback(
    campaign_folder: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell, tmp_path: Path
) -> None:
    """Letters that its encoding lacks are escaped; a folder whose name is not UTF-8 has to be renamed."""
    (campaign_folder / "campaign.toml").write_text('name = "\u540d\u524d"', encoding="utf-8")
    with TextIOWrapper(BytesIO(), encoding="ascii") as screen, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", screen)
        assert run("check", campaign_folder) == cli.DONE
        assert screen.buffer.getvalue().startswith(b"\\u540d\\u524d: 4 tests, 24 CAE runs.")
    no_utf_8 = campaign_folder.rename(tmp_path / os.fsdecode(b"b\xff"))
    assert "is not UTF-8; rename the file or folder." in shell.wrong_usage("check", no_utf_8)


def test_memory_that_runs_out_is_a_sentence(
    campaign_on_disk: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    """Not a traceback; other errors of the program stay what they are."""

    def fail(*_: object) -> None:
        raise RuntimeError("another")

    monkeypatch.setattr("crashfuse.campaign_folder.load.read_lenient", lambda *_, **__: np.zeros(1 << 50))
    assert shell.wrong_data("check", campaign_on_disk).startswith("crashfuse: Memory ran out. Close other programs")
    monkeypatch.setattr("crashfuse.campaign_folder.load.read_lenient", lambda *_, **__: fail())
    with pytest.raises(RuntimeError, match="another"):
        run("check", campaign_on_disk)


@pytest.mark.skipif(sys.platform == "win32", reason="pipes end in another way there")
@pytest.mark.slow
def test_a_reader_that_has_seen_enough_is_no_error(campaign_on_disk: Path) -> None:
    """As with `crashfuse check … | head -0`: nothing is said of it."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "crashfuse", "check", str(campaign_on_disk)]
    ended = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (cli.CUT_OFF, b"")


@pytest.mark.slow
def test_predict_writes_pulses_metrics_and_report(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    """Of the study's form, with no held-out test; an extrapolation is said aloud."""
    out, two = tmp_path / "out", ["--approach", "cae", "displacement_domain"]
    command = ["predict", campaign_on_disk, "--out", out, *at_condition(30, 2400, 1500), *two]
    printed = shell.prints(*command)
    files = {"pulses.csv", "pulses.parquet", "metrics.csv", "report.html", "prediction.json", "isomme"}
    assert {path.name for path in out.iterdir()} == files
    pulses = pd.read_csv(out / "pulses.csv")
    binary = pd.read_parquet(out / "pulses.parquet").astype({"approach": str, "held_out": str})
    pair = (table.drop(columns="held_out") for table in (binary, pulses))
    pd.testing.assert_frame_equal(*pair, rtol=1e-5, check_dtype=False)
    assert len(pulses) == 2 * GRID_S.size
    assert pulses["held_out"].isna().all()
    kinds = ("expected", "representative", "corridor_lower", "corridor_upper")
    stems = {"cae_30mph_expected", *(f"displacement_domain_30mph_{kind}" for kind in kinds)}
    assert {path.stem for path in out.rglob("*.mme")} == stems
    record = json.loads((out / "prediction.json").read_text())
    assert record["condition"]["speed_mps"] == pytest.approx(30 * 0.44704)
    for text in (record["extrapolation"][0], printed, (out / "report.html").read_text()):
        assert "Extrapolation: front weight 2400 lb" in text
    listed = "pulses.csv, pulses.parquet, metrics.csv, report.html, isomme/, prediction.json"
    assert printed.endswith(f"Written to {out}: {listed}\n")
    assert "Method and settings" in (out / "report.html").read_text()
    assert run(*command, "--report", "short") == cli.DONE
    assert "Method and settings" not in (out / "report.html").read_text()


def test_predict_takes_factors_that_tests_have_alone(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    """The factor is in the record; one that no test has is refused with what there is."""
    command = ["predict", campaign_on_disk, *at_condition(30, 2100, 1500), "--approach", "cae"]
    assert run(*command, "--out", tmp_path / "a", "--factor", "drive=FWD") == cli.DONE
    record = json.loads((tmp_path / "a" / "prediction.json").read_text())
    assert record["condition"]["factors"] == [["drive", "FWD"]]
    for wrong in ("drive=AWD", "engine=V6", "drive"):
        said = shell.wrong_usage(*command, "--out", tmp_path / "b", "--factor", wrong)
        assert f"No test has the factor '{wrong}'; the tests have: drive=FWD." in said
    assert not (tmp_path / "b").exists()


def test_rate_prints_pairs_of_a_table_as_csv_and_fails_if_one_lacks(campaign_folder: Path, shell: Shell) -> None:
    """Each pair over each window, with standard, rate and filter class beside it; the others with a note."""
    pairs = campaign_folder / "tests" / "pairs.csv"
    pairs.write_text("reference,comparison\nT1.csv,T2.csv\nT1.csv,T3.csv\n")
    table = pd.read_csv(StringIO(shell.prints("rate", "--pairs", pairs, "--windows-ms", 40, 60, "--csv")))
    assert table["comparison"].tolist() == ["T2.csv", "T2.csv", "T3.csv", "T3.csv"]
    assert table["window_ms"].tolist() == [40.0, 60.0, 40.0, 60.0]
    assert set(table["basis"]) == {"ISO/TS 18571:2024, 10 kHz, filtered as supplied"}
    pairs.write_text("reference,comparison\nT1.csv,T2.csv\nT1.csv,T9.csv\n")
    assert run("rate", "--pairs", pairs, "--windows-ms", 60) == cli.WRONG_DATA
    out, err = shell.capsys.readouterr()
    assert "0–60 ms" in out
    assert "Not rated: T9.csv: " in out
    assert "1 rated, 1 not; each says why." in err


def test_rate_takes_a_channel_of_each_file(tmp_path: Path, shell: Shell) -> None:
    """Of one file with two channels; the comparison's is named otherwise."""
    path, time_ms = tmp_path / "two.csv", np.arange(0.0, 100.0, 0.1)
    pulse = -30 * np.sin(np.pi * time_ms / 100)
    pd.DataFrame({"time_ms": time_ms, "left [g]": pulse, "right [g]": 0.8 * pulse}).to_csv(path, index=False)
    asked = ["rate", path, path, "--windows-ms", 60, "--csv", "--channel", "left [g]"]
    right = ["--comparison-channel", "right [g]"]
    same, other = (pd.read_csv(StringIO(shell.prints(*asked, *own)))["overall"][0] for own in ([], right))
    assert other < same == 1


def test_what_cannot_be_rated_is_one_sentence(campaign_folder: Path, tmp_path: Path, shell: Shell) -> None:
    """Options that exclude each other, a file that is not there, a window that nothing fills."""
    pulse = campaign_folder / "tests" / "T1.csv"
    for arguments in ([pulse], [pulse, pulse, "--pairs", pulse], [pulse, pulse, "--each-channel", "--unit", "g"]):
        assert shell.wrong_usage("rate", *arguments).startswith("crashfuse: ")
    said = shell.wrong_data("rate", tmp_path / "a.csv", tmp_path / "b.csv")
    assert "a.csv: expected a pulse file, found no such file; check the path." in said
    for window in ("1e9", "-20"):
        assert "expected" in shell.wrong_data("rate", pulse, pulse, "--windows-ms", window)


def test_rate_explains_what_a_rating_is_made_of(campaign_folder: Path, shell: Shell) -> None:
    """In sentences below the table, as an object of each window in JSON; of one pair of files only."""
    one, other = (campaign_folder / "tests" / f"{test}.csv" for test in ("T2", "T3"))
    explained = shell.prints("rate", one, other, "--windows-ms", 60, "--explain")
    *table, overall, corridor, phase, _, _ = explained.splitlines()
    assert overall.startswith(f"{table[-2].split()[2]} (")
    assert corridor.startswith("Corridor ")
    assert "the comparison" in phase
    for row in json.loads(shell.prints("rate", one, other, "--explain", "--json")):
        assert sum(row["explanation"]["losses"].values()) == pytest.approx(1 - row["overall"])
    for wrong in (["--pairs", one], [one, other, "--csv"]):
        assert "--explain is for one pair of files" in shell.wrong_usage("rate", *wrong, "--explain")


def test_check_tells_what_a_campaign_holds(campaign_on_disk: Path, shell: Shell) -> None:
    out = shell.prints("check", campaign_on_disk)
    assert "4 tests, 24 CAE runs" in out
    assert "T1: 15.0 mph (24.1 km/h), front 2000 lb, rear 1450 lb; paired with C20" in out
    assert "Nothing is wrong." in out


@pytest.mark.slow
def test_sample_writes_a_campaign_that_checks(tmp_path: Path, shell: Shell) -> None:
    """What `sample` writes, `check` accepts; both say that it is synthetic; nobody's data are overwritten."""
    folder = tmp_path / "sample"
    for command in ("sample", "check"):
        assert "synthetic" in shell.prints(command, folder).lower()
    before = sorted(folder.rglob("*"))
    assert run("sample", folder) in (cli.WRONG_DATA, cli.WRONG_USAGE)
    assert sorted(folder.rglob("*")) == before
    assert shell.capsys.readouterr().err.strip()


def test_interrupting_says_how_to_go_on(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    """Ctrl-C is no traceback."""

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("crashfuse.cli.studies.run_study", interrupted)
    assert run("study", campaign_on_disk, "--out", tmp_path / "out") == cli.INTERRUPTED
    assert "--resume" in shell.capsys.readouterr().err


def test_version_and_help_end_well(shell: Shell) -> None:
    for flag in ("--version", "--help"):
        with pytest.raises(SystemExit) as ended:
            run(flag)
        assert ended.value.code == 0
    out = shell.capsys.readouterr().out
    assert __version__ in out
    assert all(command in out for command in ("app", "sample", "check", "study", "predict", "rate"))


def test_speeds_and_weights_are_given_in_either_unit(shell: Shell) -> None:
    here = ["predict", "campaign", "--out", "out"]
    weights = ["--front-weight-kg", "950", "--rear-weight-lb", "1500"]
    arguments = cli.parser().parse_args([*here, "--speed-kph", "56", *weights])
    np.testing.assert_allclose(arguments.speed_mps * 3.6, 56)
    np.testing.assert_allclose([arguments.front_weight_kg, arguments.rear_weight_kg], [950, 1500 * 0.45359237])
    both = [*here, *at_condition(35, 2000, 1500), "--speed-kph", "56"]
    assert "--speed-kph: not allowed with argument --speed-mph" in shell.no_command(*both)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        *(["app", "--port", port] for port in ("-1", "99999")),
        *(["study", "campaign", "--out", "out", "--seed", seed] for seed in ("-1", "99999999999999999999", "1.5")),
    ],
)
def test_what_the_parser_refuses_is_wrong_usage(arguments: list[str], shell: Shell) -> None:
    assert shell.no_command(*arguments)


@pytest.mark.slow
def test_saved_models_predict_without_learning_again(
    campaign_on_disk: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    shell: Shell,
    fitting_is_an_error: Callable[[], None],
) -> None:
    """All that train saved is used; with an empty cache nothing is trained."""
    printed = shell.prints("train", campaign_on_disk, "--out", tmp_path / "models")
    assert "Learned from 4 tests and 24 CAE runs" in printed
    assert {path.stem for path in (tmp_path / "models").iterdir()} == set(APPROACHES)
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path / "empty"))
    fitting_is_an_error()
    out = tmp_path / "out"
    command = ["predict", campaign_on_disk, *at_condition(22, 2060, 1520), "--out", out]
    assert run(*command, "--models", tmp_path / "models") == cli.DONE
    assert set(pd.read_csv(out / "pulses.csv")["approach"]) == set(APPROACHES)
    assert json.loads((out / "prediction.json").read_text())["config"]["preset"] == "fast"


@pytest.mark.slow
def test_what_saved_models_cannot_go_with_is_said(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    """An empty folder, settings that the models have in them, an approach that was not saved."""
    models, out = tmp_path / "models", ["--out", tmp_path / "out"]
    train = ["train", campaign_on_disk, "--out", models, "--approach"]
    command = ["predict", campaign_on_disk, *at_condition(22, 2060, 1520), *out, "--models", models]
    assert "no saved model" in shell.wrong_usage(*command)
    assert run(*train, "cae") == cli.DONE
    assert "leave out --preset, --seed and --device" in shell.wrong_usage(*command, "--seed", 1)
    not_saved = "lf_tcn.safetensors: expected a saved model, found no such file"
    assert not_saved in shell.wrong_data(*command, "--approach", "lf_tcn")
    assert run(*train, "displacement_domain", "--seed", 1) == cli.DONE
    assert "different presets or seeds" in shell.wrong_usage(*command)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_whole_study_leaves_speed_groups_out_too(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    """A table of its own, a recommendation for the campaign and for each test, in the record and on the shell."""
    out, tests = tmp_path / "out", ["T1", "T2", "T3", "T4"]
    printed = shell.prints("study", campaign_on_disk, "--out", out, "--approach", "cae", "--workers", 1)
    scores, groups = (pd.read_csv(out / name) for name in ("scores.csv", "speed_groups.csv"))
    assert list(scores) == list(groups)
    assert len(scores) == len(groups)
    record = json.loads((out / "study.json").read_text())
    assert record["config"]["leave_out"] == "both"
    assert record["recommendation"]["campaign"]["approach"] == "cae"
    assert list(record["recommendation"]["tests"]) == tests
    assert record["recommendation"]["tests"]["T2"]["expected_rating"]["tests"] == ["T3", "T4", "T1"]
    mean = groups[groups["window_ms"] == 60]["overall"].mean()
    assert record["speed_groups"]["mean_rating"]["cae"] == pytest.approx(mean, abs=1e-4)
    for test in tests:
        assert set(record["repeatability"][test]) == {"20", "40", "60"}
        repeat = record["repeatability"][test]["60"]
        assert 0 <= repeat["lower"] < repeat["value"] < repeat["upper"] <= 1
    assert "Use the raw CAE model for this campaign." in printed
    names = [name for name in RESULT_FILES["study"] if name != "cae_events.csv"]  # of approaches that learn the bias
    assert printed.endswith(f"Written to {out}: {', '.join(names)}\n")


@pytest.mark.slow
def test_a_series_of_studies_is_what_each_is_alone(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    """Two campaigns of one name with two seeds each: each study is what it is alone."""
    other, out = tmp_path / "other" / campaign_on_disk.name, tmp_path / "series"
    shutil.copytree(campaign_on_disk, other)
    options = ["--held-out", "T2", "T4", "--approach", "cae", "lf_tcn", "--workers", 1]
    printed = shell.prints("study", campaign_on_disk, other, "--out", out, "--seed", "0,1", *options)
    assert "Study 4 of 4: campaign-2/fast-seed-1" in printed
    assert {path.relative_to(out).as_posix() for path in out.rglob("study.json")} == {
        f"{name}/fast-seed-{seed}/study.json" for name in ("campaign", "campaign-2") for seed in (0, 1)
    }
    assert run("study", other, "--out", tmp_path / "one", "--seed", 1, *options) == cli.DONE
    alone = (tmp_path / "one" / "scores.csv").read_bytes()
    assert (out / "campaign-2" / "fast-seed-1" / "scores.csv").read_bytes() == alone
    assert (out / "campaign-2" / "fast-seed-0" / "scores.csv").read_bytes() != alone
    studies, scores = pd.read_csv(out / "studies.csv"), pd.read_csv(tmp_path / "one" / "scores.csv")
    assert len(studies) == 2 * 2 * 2 * 3
    network = "approach == 'lf_tcn' and window_ms == 60"
    (row,) = studies.query(f"campaign == 'campaign-2' and seed == 1 and {network}").to_dict("records")
    overall = scores.query(network)["overall"]
    assert (row["preset"], row["left_out"], row["tests"]) == ("fast", "test", 2)
    assert (row["mean"], row["least"]) == pytest.approx((overall.mean(), overall.min()), abs=1e-5)


@pytest.mark.slow
def test_a_series_goes_on_where_it_was_and_says_first_what_is_impossible(
    campaign_folder: Path, tmp_path: Path, shell: Shell, fitting_is_an_error: Callable[[], None]
) -> None:
    """What is wrong with the last campaign ends it before the first is computed; what was done is not done again."""
    folder, other, out = campaign_folder.rename(tmp_path / "nan"), tmp_path / "other", tmp_path / "series"
    options = ["--out", out, "--held-out", "T2", "--approach", "lf_tcn", "--workers", 1]
    write_campaign(replace(small_campaign(), tests=small_campaign().tests[:1]), other)
    assert run("study", "--preset", "fast", "--seed", 0, folder, other, *options) != cli.DONE
    assert "T2" in shell.capsys.readouterr().err
    assert not out.exists()

    series = ["study", folder, *options, "--seed"]
    assert run(*series, "0,1") == cli.DONE
    first = pd.read_csv(out / "studies.csv")
    assert run(*series, "2,3") == cli.DONE
    table = pd.read_csv(out / "studies.csv")
    assert table["seed"].tolist() == [seed for seed in range(4) for _ in range(3)]
    assert set(table["held_out"]) == {"T2"}
    fitting_is_an_error()
    (out / "nan" / "fast-seed-1" / "study.json").unlink()  # as if it had been killed before the second began
    assert run(*series, "0,1", "--resume") == cli.DONE
    again = pd.read_csv(out / "studies.csv")
    pd.testing.assert_frame_equal(again[again["seed"] < 2].reset_index(drop=True), first)
    assert set(again["seed"]) == {0, 1, 2, 3}
    assert "holds a series of studies" in shell.wrong_usage(*series, "0")


@pytest.mark.slow
def test_a_learning_curve_writes_its_table_its_report_and_its_record(
    campaign_on_disk: Path, tmp_path: Path, shell: Shell
) -> None:
    """The contract's columns first; the sentences that are printed stand in the record, with the cost of a test."""
    out = tmp_path / "out"
    command = ["learning-curve", campaign_on_disk, "--out", out, "--workers", 1, "--repeats", 1, "--windows-ms", 60]
    asked = ["--approach", "cae", "displacement_domain", "--cost-per-test", "60000 EUR"]
    printed = shell.prints(*command, *asked)
    assert {path.name for path in out.iterdir()} == set(RESULT_FILES["learning curve"])
    table = pd.read_csv(out / "learning_curve.csv")
    columns = ["n_tests", "chosen", "choice", "held_out", "approach", "window_ms", "overall", "inside", "half_width_g"]
    assert list(table) == [*columns, "basis"]
    assert set(table["choice"]) == {"even", "random"}
    assert table.loc[table["approach"] == "cae", ["inside", "half_width_g"]].isna().all(axis=None)
    assert table.loc[table["approach"] != "cae", "inside"].between(0, 1).all()
    record = json.loads((out / "learning_curve.json").read_text())
    assert record["fingerprint"]
    assert record["cost_per_test"] == {"amount": 60000.0, "currency": "EUR"}
    assert all(sentence in printed for sentence in record["sentences"])
    assert "--cost-per-test '60,000 EUR'" in unescape((out / "report.html").read_text())


def test_a_curve_of_two_tests_says_what_cannot_be_told(campaign: Campaign, tmp_path: Path, shell: Shell) -> None:
    folder = write_campaign(campaign.without(["T1", "T2"]), tmp_path / "campaign")
    options = ["--out", tmp_path / "out", "--approach", "cae", "--workers", 1]
    printed = shell.prints("learning-curve", folder, *options)
    assert printed.startswith("With 1 of 2 tests the raw CAE model rates")
    assert "Empty" not in printed


def test_the_next_test_is_ranked_over_a_range_or_list(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    """Of two candidates the one far from all tests comes first; a grid is taken where none are given."""
    out, candidates = tmp_path / "out", tmp_path / "candidates.csv"
    header = "id,speed_mph,front_weight_lb,rear_weight_lb"
    candidates.write_text(f"{header}\nA,25.5,2060,1525\nB,34,2000,1650\n")
    command = ["next-test", campaign_on_disk, "--out", out, "--speed-mph", 20, 35, "--factor", "drive=FWD"]
    assert "Gain (%)" in shell.prints(*command, "--candidates", candidates)
    assert pd.read_csv(out / "next_tests.csv")["speed (mph)"].tolist() == [34.0, 25.5]
    assert run(*command) == cli.DONE
    assert pd.read_csv(out / "next_tests.csv")["speed (mph)"].between(20, 35).all()
    candidates.write_text(f"{header}\nA,fast,2060,1525\n")
    assert "candidates.csv" in shell.wrong_data(*command, "--candidates", candidates)


PREDICT = ["predict", "c", "--out", "o", "--front-weight-kg", "950", "--rear-weight-kg", "700"]


@pytest.mark.parametrize("text", ["56,5", "much", "nan", "inf"])
@pytest.mark.parametrize(
    "command",
    [
        [*PREDICT, "--speed-kph"],
        [*PREDICT, "--speed-kph", "56", "--start-ms"],
        ["import", "x.csv", "--out", "c", "--mass-kg"],
        ["import", "x.csv", "--out", "c", "--channel-filter-class"],
        ["rate", "a.csv", "b.csv", "--windows-ms"],
        ["study", "c", "--out", "o", "--windows-ms"],
    ],
)
def test_a_text_that_is_no_number_is_wrong_usage(command: list[str], text: str, shell: Shell) -> None:
    """The last line names the option and what was given, a decimal comma too; nothing of how it is parsed."""
    said = shell.no_command(*command, text).strip().splitlines()[-1]
    assert command[-1] in said
    assert said.endswith(f"must be a number with a decimal point, if any, not {text!r}")
