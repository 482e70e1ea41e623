"""The command line: what it prints, what it writes, how it ends."""

import argparse
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
from crashfuse.campaign_folder import load as campaign_folder_module
from crashfuse.cli.output import display_of
from crashfuse.reporting.results import RESULT_FILES
from crashfuse.signals.metrics import METRIC_LABELS
from crashfuse.signals.pulse import GRID_S
from crashfuse.study.config import StudyPlan
from crashfuse.testing import small_campaign
from crashfuse.units import MS
from crashfuse.version import __version__
from crashfuse.wording import KPH_KG, MPH_LB
from tests.conftest import write_campaign

CONTRACT = ["peak", "peak_time", "delta_v", "t0", "max_crush", "mean", "sm25", "olc", "vpi"]


def at_condition(speed_mph: float, front_weight_lb: float, rear_weight_lb: float) -> list[str]:
    """The options of a condition."""
    values = {"speed-mph": speed_mph, "front-weight-lb": front_weight_lb, "rear-weight-lb": rear_weight_lb}
    return [part for name, value in values.items() for part in (f"--{name}", str(value))]


pytestmark = pytest.mark.usefixtures("quick_networks", "one_cache")


@pytest.fixture(scope="module")
def study_folder(
    campaign_on_disk: Path,
    quick_networks: None,  # noqa: ARG001
    shared_cache: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """The results of a study of two held-out tests, run once."""
    out = tmp_path_factory.mktemp("out") / "study"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CRASHFUSE_CACHE", str(shared_cache))
        command = ["study", str(campaign_on_disk), "--out", str(out), "--held-out", "T2", "T4", "--workers", "1"]
        assert cli.main(command) == cli.DONE
    return out


@pytest.mark.slow
def test_a_study_writes_the_five_files_and_nothing_else(study_folder: Path) -> None:
    """No temporary file stays."""
    names = {path.name for path in study_folder.iterdir()}
    assert names == set(RESULT_FILES["study"]) - {"speed_groups.csv"}
    assert names == {"scores.csv", "pulses.csv", "metrics.csv", "study.json", "report.html"}


@pytest.mark.slow
def test_scores_have_a_row_for_each_test_approach_and_window(study_folder: Path) -> None:
    """The contract's columns, then what the rating rests on; the overall one is the weighted sum of its parts."""
    scores = pd.read_csv(study_folder / "scores.csv")
    assert list(scores) == [
        *("held_out", "approach", "window_ms", "overall", "corridor", "phase", "magnitude", "slope", "grade", "basis")
    ]
    assert set(scores["basis"]) == {"ISO/TS 18571:2024, 10 kHz, filtered as supplied"}
    assert len(scores) == 2 * len(APPROACHES) * 3
    assert tuple(scores["approach"].unique()) == APPROACHES
    parts = 0.4 * scores["corridor"] + 0.2 * (scores["phase"] + scores["magnitude"] + scores["slope"])
    np.testing.assert_allclose(scores["overall"], parts, atol=1e-5)


@pytest.mark.slow
def test_pulses_are_on_the_study_grid_with_a_band_where_there_is_one(study_folder: Path) -> None:
    """12.5 kHz over 0–100 ms; the raw CAE and the LF TCN have no band, the displacement domain has."""
    pulses = pd.read_csv(study_folder / "pulses.csv", dtype={"held_out": str})
    assert list(pulses) == ["held_out", "approach", "time_ms", "acceleration_g", "lower_g", "upper_g"]
    assert set(pulses["approach"]) == {"test", *APPROACHES}
    for _, rows in pulses.groupby(["held_out", "approach"]):
        np.testing.assert_allclose(rows["time_ms"], GRID_S / MS, atol=1e-6)
    banded = pulses.groupby("approach")["lower_g"].apply(lambda column: column.notna().all())
    assert banded["displacement_domain"]
    assert pulses[pulses["approach"].isin(["test", "cae", "lf_tcn"])][["lower_g", "upper_g"]].isna().all(axis=None)


@pytest.mark.slow
def test_metrics_hold_the_measured_test_beside_the_predictions(study_folder: Path) -> None:
    """Positive numbers, each with its unit; the measured ΔV is the impact speed and a tenth, as the pulse was made."""
    metrics = pd.read_csv(study_folder / "metrics.csv")
    assert list(metrics) == ["held_out", "approach", "metric", "value", "lower", "upper", "unit", "basis"]
    assert set(metrics["basis"]) == {"filtered as supplied"}
    assert set(metrics["approach"]) == {"test", *APPROACHES}
    assert list(metrics["metric"].unique()) == list(METRIC_LABELS)
    assert list(METRIC_LABELS)[: len(CONTRACT)] == CONTRACT
    measured = metrics.query("held_out == 'T2' and approach == 'test' and metric == 'delta_v'").iloc[0]
    assert measured["unit"] == "km/h"
    assert measured["value"] == pytest.approx(1.1 * 25 * 1.609344, rel=1e-3)


@pytest.mark.slow
def test_the_record_says_what_made_the_numbers(study_folder: Path) -> None:
    """Versions, seed, settings, fingerprint, seconds, and what each fit found."""
    record = json.loads((study_folder / "study.json").read_text())
    assert record["crashfuse"] == __version__
    assert record["finished"] is True
    assert record["seed"] == 0
    assert record["config"]["preset"] == "fast"
    assert re.fullmatch("[0-9a-f]{64}", record["fingerprint"])
    assert set(record["packages"]) >= {"numpy", "torch", "scikit-learn"}
    assert all(fit["seconds"] >= 0 for fit in record["fits"])
    assert {fit["approach"] for fit in record["fits"]} == set(APPROACHES)


@pytest.mark.slow
def test_the_report_needs_no_network(study_folder: Path) -> None:
    """No address is loaded; tests, tables and fingerprint are inside."""
    text = (study_folder / "report.html").read_text()
    assert not re.search(r"<(script|link|img)[^>]+(src|href)\s*=\s*[\"']?https?:", text)
    record = json.loads((study_folder / "study.json").read_text())
    assert record["fingerprint"] in text
    assert "Test T2: 25.0 mph" in text
    assert "Maximum dynamic crush (mm)" in text


@pytest.mark.slow
def test_resuming_takes_the_settings_that_were_recorded(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A study that was begun goes on without its options being repeated."""
    out = tmp_path / "out"
    command = ["study", str(campaign_on_disk), "--out", str(out), "--workers", "1"]
    options = ["--held-out", "T1", "--approach", "cae", "--windows-ms", "30", "--seed", "3"]
    assert cli.main([*command, *options]) == cli.DONE
    record = json.loads((out / "study.json").read_text())
    (out / "study.json").write_text(json.dumps(record | {"finished": False}))
    (out / "scores.csv").unlink()
    assert cli.main([*command, "--resume"]) == cli.DONE
    assert pd.read_csv(out / "scores.csv")["window_ms"].tolist() == [30.0]
    assert cli.main([*command, "--resume", "--seed", "4"]) == cli.WRONG_USAGE
    assert "was begun with other settings (seed)" in capsys.readouterr().err


@pytest.mark.slow
def test_a_killed_study_resumes_to_the_same_files(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed in mid-study, it leaves no table; resumed, it keeps what was finished and ends with the same bytes."""
    study = ["study", str(campaign_on_disk), "--workers", "1", "--approach", "cae", "displacement_domain"]
    study += ["--held-out", "T1", "T2"]
    assert cli.main([*study, "--out", str(tmp_path / "undisturbed")]) == cli.DONE
    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path / "cache"))
    command = [sys.executable, "-m", "crashfuse", *study, "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and len(list((tmp_path / "cache").glob("predictions/*.bin"))) < 2:
            time.sleep(0.001)
        process.kill()
    kept = {path: path.stat().st_ino for path in (tmp_path / "cache" / "predictions").glob("*.bin")}
    assert 2 <= len(kept) < 4
    assert not (tmp_path / "out" / "scores.csv").exists()
    assert cli.main(["study", str(campaign_on_disk), "--out", str(tmp_path / "out"), "--resume"]) == cli.DONE
    assert all(path.stat().st_ino == file for path, file in kept.items())
    for name in ("scores.csv", "pulses.csv", "metrics.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "undisturbed" / name).read_bytes()


def test_resuming_where_nothing_was_begun_is_wrong_usage(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The message says what is missing."""
    assert cli.main(["study", str(campaign_on_disk), "--out", str(tmp_path), "--resume"]) == cli.WRONG_USAGE
    assert "no study to resume" in capsys.readouterr().err


def test_bad_data_end_with_1_and_leave_nothing(
    campaign_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every problem is a line on standard error; the output folder is not even made."""
    (campaign_folder / "tests" / "T1.csv").unlink()
    (campaign_folder / "campaign.toml").write_text("name = ")
    out = tmp_path / "out"
    assert cli.main(["study", str(campaign_folder), "--out", str(out)]) == cli.WRONG_DATA
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 3
    assert lines[-1] == "2 problems found."
    assert not out.exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["study", "{campaign}", "--out", "{out}", "--held-out", "T9"],
        ["study", "{campaign}", "--out", "{out}", "--approach", "magic"],
        ["study", "{campaign}", "--out", "{out}", "--windows-ms", "400"],
        ["predict", "{campaign}", "--out", "{out}", *at_condition(0, 2000, 1500)],
    ],
)
def test_wrong_usage_ends_with_2_and_leaves_nothing(
    campaign_on_disk: Path, tmp_path: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Asked for what does not exist: one sentence."""
    out = tmp_path / "out"
    command = [part.format(campaign=campaign_on_disk, out=out) for part in arguments]
    assert cli.main(command) == cli.WRONG_USAGE
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("out", "sentence"),
    [
        ("{tmp}/file", "file is a file, not a folder; name another folder for --out."),
        ("{tmp}/file/results", "file is a file, not a folder; name another folder for --out."),
        ("{campaign}", "name a folder outside it for --out."),
        ("{campaign}/results", "name a folder outside it for --out."),
        ("{tmp}/other", "other is a campaign folder; name another for --out."),
        ("{tmp}/sweep", "sweep holds a sweep (sweep.csv); name another folder for the "),
        ("", "one of the arguments is empty; was a variable not set?"),
    ],
)
@pytest.mark.parametrize("command", [["study"], ["predict", *at_condition(30, 2100, 1500)]])
def test_a_folder_that_results_do_not_belong_in_is_one_sentence(
    campaign_on_disk: Path,
    tmp_path: Path,
    command: list[str],
    out: str,
    sentence: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A file, the campaign, another campaign, results of another kind, nothing: said before anything is computed."""
    (tmp_path / "file").write_text("")
    for folder, table in (("other", "tests.csv"), ("sweep", "sweep.csv")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / table).write_text("")
    before = {path: path.stat().st_mtime_ns for place in (tmp_path, campaign_on_disk) for path in place.rglob("*")}
    place = out.format(tmp=tmp_path, campaign=campaign_on_disk)
    assert cli.main([command[0], str(campaign_on_disk), *command[1:], "--out", place]) == cli.WRONG_USAGE
    (said,) = capsys.readouterr().err.strip().splitlines()
    assert sentence in said
    after = {path: path.stat().st_mtime_ns for place in (tmp_path, campaign_on_disk) for path in place.rglob("*")}
    assert after == before


def test_a_folder_that_may_not_be_written_is_one_sentence(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Asked beforehand; and what the system refuses later is a sentence too."""
    command = ["train", str(campaign_on_disk), "--approach", "cae", "--out", str(tmp_path / "out")]
    with monkeypatch.context() as patch:
        patch.setattr("os.access", lambda *_: False)
        assert cli.main(command) == cli.WRONG_USAGE
    assert f"Nothing can be written to {tmp_path}; name another folder for --out." in capsys.readouterr().err

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "model")

    monkeypatch.setattr("crashfuse.study.saved_models.write_atomically", full)
    assert cli.main(command) == cli.WRONG_DATA
    assert "crashfuse: model cannot be read or written: no space left on device.\n" in capsys.readouterr().err


@pytest.mark.slow
def test_what_older_results_of_the_same_kind_had_more_does_not_stay(campaign_on_disk: Path, tmp_path: Path) -> None:
    """Speed groups that are not asked for again, channels of approaches that are left out; a stranger's file stays."""
    study, predict = tmp_path / "study", tmp_path / "prediction"
    command = ["study", str(campaign_on_disk), "--out", str(study), "--approach", "cae", "--workers", "1"]
    assert cli.main(command) == cli.DONE
    (study / "notes.txt").write_text("")
    assert (study / "speed_groups.csv").is_file()
    assert cli.main([*command, "--leave-out", "test"]) == cli.DONE
    names = {"notes.txt", "scores.csv", "pulses.csv", "metrics.csv", "study.json", "report.html"}
    assert {path.name for path in study.iterdir()} == names

    command = ["predict", str(campaign_on_disk), *at_condition(30, 2100, 1500), "--out", str(predict)]
    assert cli.main([*command, "--approach", "cae", "displacement_domain"]) == cli.DONE
    assert cli.main([*command, "--approach", "cae"]) == cli.DONE
    once = tmp_path / "once"
    assert cli.main([*command[:-1], str(once), "--approach", "cae"]) == cli.DONE
    assert {p.relative_to(predict) for p in predict.rglob("*")} == {p.relative_to(once) for p in once.rglob("*")}


def test_a_name_that_the_terminal_cannot_show_is_no_traceback(
    campaign_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Letters that its encoding lacks are escaped."""
    (campaign_folder / "campaign.toml").write_text('name = "\u540d\u524d"', encoding="utf-8")
    with TextIOWrapper(BytesIO(), encoding="ascii") as terminal, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", terminal)
        assert cli.main(["check", str(campaign_folder)]) == cli.DONE
        assert terminal.buffer.getvalue().startswith(b"\\u540d\\u524d: 4 tests, 24 CAE runs.")


def test_memory_that_runs_out_is_a_sentence(
    campaign_on_disk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not a traceback; other errors of the program stay what they are."""

    def allocate(*_: object, **__: object) -> None:
        np.zeros(1 << 50)

    monkeypatch.setattr("crashfuse.campaign_folder.load.read_lenient", allocate)
    assert cli.main(["check", str(campaign_on_disk)]) == cli.WRONG_DATA
    assert capsys.readouterr().err.startswith("crashfuse: Memory ran out. Close other programs")

    def fail(*_: object) -> None:
        raise RuntimeError("another")

    monkeypatch.setattr("crashfuse.campaign_folder.load.read_lenient", lambda *_, **__: fail())
    with pytest.raises(RuntimeError, match="another"):
        cli.main(["check", str(campaign_on_disk)])


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
def test_predict_writes_pulses_metrics_and_report(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the study's form, with no held-out test; an extrapolation is said aloud."""
    out = tmp_path / "out"
    command = ["predict", str(campaign_on_disk), "--out", str(out), *at_condition(30, 2400, 1500)]
    assert cli.main([*command, "--approach", "cae", "displacement_domain"]) == cli.DONE
    files = {"pulses.csv", "pulses.parquet", "metrics.csv", "report.html", "prediction.json", "isomme"}
    assert {path.name for path in out.iterdir()} == files
    pd.testing.assert_frame_equal(
        pd.read_parquet(out / "pulses.parquet").astype({"approach": str, "held_out": str}).drop(columns="held_out"),
        pd.read_csv(out / "pulses.csv", keep_default_na=True).drop(columns="held_out"),
        rtol=1e-5,
        check_dtype=False,
    )
    assert {path.stem for path in out.rglob("*.mme")} == {"cae_30mph_expected", "displacement_domain_30mph_expected"}
    record = json.loads((out / "prediction.json").read_text())
    assert record["extrapolation"][0].startswith("Extrapolation: front weight 2400 lb")
    assert record["condition"]["speed_mps"] == pytest.approx(30 * 0.44704)
    pulses = pd.read_csv(out / "pulses.csv")
    assert len(pulses) == 2 * GRID_S.size
    assert pulses["held_out"].isna().all()
    said = capsys.readouterr().out
    assert "Extrapolation: front weight 2400 lb" in said
    files_said = "pulses.csv, pulses.parquet, metrics.csv, report.html, isomme/, prediction.json"
    assert said.endswith(f"Written to {out}: {files_said}\n")
    assert all(list(out.glob(part)) for part in set(RESULT_FILES["prediction"]) - {"lsdyna/", "radioss/"})
    assert "Extrapolation: front weight 2400 lb" in (out / "report.html").read_text()
    assert "Method and settings" in (out / "report.html").read_text()
    assert cli.main([*command, "--approach", "cae", "displacement_domain", "--report", "short"]) == cli.DONE
    assert "Method and settings" not in (out / "report.html").read_text()


def test_predict_takes_factors_that_tests_have_and_no_others(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The factor is in the record; one that no test has is refused with what there is."""
    command = ["predict", str(campaign_on_disk), *at_condition(30, 2100, 1500), "--approach", "cae"]
    assert cli.main([*command, "--out", str(tmp_path / "a"), "--factor", "drive=FWD"]) == cli.DONE
    record = json.loads((tmp_path / "a" / "prediction.json").read_text())
    assert record["condition"]["factors"] == [["drive", "FWD"]]
    for wrong in ("drive=AWD", "engine=V6", "drive"):
        capsys.readouterr()
        assert cli.main([*command, "--out", str(tmp_path / "b"), "--factor", wrong]) == cli.WRONG_USAGE
        assert f"No test has the factor '{wrong}'; the tests have: drive=FWD." in capsys.readouterr().err
    assert not (tmp_path / "b").exists()


def test_rate_prints_the_rating_as_a_table_and_as_json(
    campaign_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A pulse against itself is perfect in every part."""
    pulse = str(campaign_folder / "tests" / "T1.csv")
    assert cli.main(["rate", pulse, pulse, "--windows-ms", "50"]) == cli.DONE
    assert "0–50 ms" in capsys.readouterr().out
    assert cli.main(["rate", pulse, pulse, "--json"]) == cli.DONE
    ratings = json.loads(capsys.readouterr().out)
    assert [rating["window_ms"] for rating in ratings] == [20.0, 40.0, 60.0]
    assert all(rating["overall"] == 1.0 and rating["grade"] == "Excellent" for rating in ratings)


def test_rate_prints_the_pairs_of_a_table_as_csv_and_fails_if_one_is_missing(
    campaign_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each pair over each window, with standard, rate and filter class beside it; the others with a note."""
    tests = campaign_folder / "tests"
    (tests / "pairs.csv").write_text("reference,comparison\nT1.csv,T2.csv\nT1.csv,T3.csv\n")
    assert cli.main(["rate", "--pairs", str(tests / "pairs.csv"), "--windows-ms", "40", "60", "--csv"]) == cli.DONE
    table = pd.read_csv(StringIO(capsys.readouterr().out))
    assert table[["comparison", "window_ms"]].to_numpy().tolist() == [
        *(["T2.csv", 40.0], ["T2.csv", 60.0]),
        *(["T3.csv", 40.0], ["T3.csv", 60.0]),
    ]
    assert set(table["basis"]) == {"ISO/TS 18571:2024, 10 kHz, filtered as supplied"}
    (tests / "pairs.csv").write_text("reference,comparison\nT1.csv,T2.csv\nT1.csv,T9.csv\n")
    assert cli.main(["rate", "--pairs", str(tests / "pairs.csv"), "--windows-ms", "60"]) == cli.WRONG_DATA
    out, err = capsys.readouterr()
    assert "0–60 ms" in out
    assert "Not rated: T9.csv: " in out
    assert "1 rated, 1 not; each says why." in err


def test_rate_takes_two_files_or_a_table(campaign_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Anything else is wrong usage, said in a sentence."""
    pulse = str(campaign_folder / "tests" / "T1.csv")
    for arguments in ([pulse], [pulse, pulse, "--pairs", pulse], [pulse, pulse, "--each-channel", "--unit", "g"]):
        assert cli.main(["rate", *arguments]) == cli.WRONG_USAGE
        assert capsys.readouterr().err.startswith("crashfuse: ")


def test_rate_explains_what_a_rating_is_made_of(campaign_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In sentences below the table, as an object of each window in JSON; of one pair of files only."""
    one, other = (str(campaign_folder / "tests" / f"{test}.csv") for test in ("T2", "T3"))
    assert cli.main(["rate", one, other, "--windows-ms", "60", "--explain"]) == cli.DONE
    *table, overall, corridor, phase, _, _ = capsys.readouterr().out.splitlines()
    score = table[-2].split()[2]
    assert overall.startswith(f"{score} (")
    assert "costs most" in overall
    assert corridor.startswith("Corridor ")
    assert "the comparison" in phase
    assert cli.main(["rate", one, other, "--explain", "--json"]) == cli.DONE
    for row in json.loads(capsys.readouterr().out):
        assert sum(row["explanation"]["losses"].values()) == pytest.approx(1 - row["overall"])
    for wrong in (["--pairs", one], [one, other, "--csv"]):
        assert cli.main(["rate", *wrong, "--explain"]) == cli.WRONG_USAGE
        assert "--explain is for one pair of files" in capsys.readouterr().err


def test_rate_says_which_file_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A missing file is named."""
    assert cli.main(["rate", str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]) == cli.WRONG_DATA
    assert "a.csv: expected a pulse file, found no such file; check the path." in capsys.readouterr().err


def test_a_campaign_is_shown_in_its_own_units_unless_others_are_asked_for(campaign: Campaign) -> None:
    """As on the pages: those of its tests.csv."""
    metric = replace(campaign, units=KPH_KG)
    for asked, own, shown in ((None, campaign, MPH_LB), (None, metric, KPH_KG), ("mph-lb", metric, MPH_LB)):
        assert display_of(argparse.Namespace(units=asked), own).system == shown


def test_check_tells_what_a_campaign_holds(campaign_on_disk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Counts, each test's condition and its pair, and the fingerprint."""
    assert cli.main(["check", str(campaign_on_disk)]) == cli.DONE
    out = capsys.readouterr().out
    assert "4 tests, 24 CAE runs" in out
    assert "T1: 15.0 mph (24.1 km/h), front 2000 lb, rear 1450 lb; paired with C20" in out
    assert "Nothing is wrong." in out


@pytest.mark.slow
def test_sample_writes_a_campaign_that_checks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What `sample` writes, `check` accepts; both say that it is synthetic."""
    folder = tmp_path / "sample"
    assert cli.main(["sample", str(folder)]) == cli.DONE
    assert cli.main(["check", str(folder)]) == cli.DONE
    assert capsys.readouterr().out.lower().count("synthetic") >= 2


def test_sample_does_not_touch_a_folder_in_use(campaign_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nobody's data are overwritten."""
    before = sorted(campaign_folder.rglob("*"))
    assert cli.main(["sample", str(campaign_folder)]) in (cli.WRONG_DATA, cli.WRONG_USAGE)
    assert sorted(campaign_folder.rglob("*")) == before
    assert len(capsys.readouterr().err.strip().splitlines()) >= 1


def test_interrupting_says_how_to_go_on(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C is no traceback."""

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("crashfuse.study.running.run_plan", interrupted)
    assert cli.main(["study", str(campaign_on_disk), "--out", str(tmp_path / "out")]) == cli.INTERRUPTED
    assert "--resume" in capsys.readouterr().err


def test_version_and_help_end_well(capsys: pytest.CaptureFixture[str]) -> None:
    """Both print and exit with 0; help names every command."""
    for flag in ("--version", "--help"):
        with pytest.raises(SystemExit) as ended:
            cli.main([flag])
        assert ended.value.code == 0
    out = capsys.readouterr().out
    assert __version__ in out
    assert all(command in out for command in ("app", "sample", "check", "study", "predict", "rate"))


def test_speeds_and_weights_are_given_in_either_unit(capsys: pytest.CaptureFixture[str]) -> None:
    """Never in both at once."""
    here = ["predict", "campaign", "--out", "out"]
    found = cli.parser().parse_args(
        [*here, "--speed-kph", "56", "--front-weight-kg", "950", "--rear-weight-lb", "1500"]
    )
    np.testing.assert_allclose(found.speed_mps * 3.6, 56)
    np.testing.assert_allclose([found.front_weight_kg, found.rear_weight_kg], [950, 1500 * 0.45359237])
    with pytest.raises(SystemExit) as ended:
        cli.parser().parse_args([*here, *at_condition(35, 2000, 1500), "--speed-kph", "56"])
    assert ended.value.code == cli.WRONG_USAGE
    assert "--speed-kph: not allowed with argument --speed-mph" in capsys.readouterr().err


@pytest.mark.parametrize("seed", ["-1", "99999999999999999999", "x"])
def test_an_impossible_seed_is_wrong_usage(campaign_on_disk: Path, tmp_path: Path, seed: str) -> None:
    """Said before anything is computed."""
    with pytest.raises(SystemExit) as ended:
        cli.main(["study", str(campaign_on_disk), "--out", str(tmp_path / "out"), "--seed", seed])
    assert ended.value.code == cli.WRONG_USAGE


@pytest.mark.parametrize("window", ["1e9", "-20"])
def test_an_impossible_window_is_one_sentence(
    campaign_on_disk: Path, window: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """No traceback, no memory."""
    pulse = str(campaign_on_disk / "tests" / "T1.csv")
    assert cli.main(["rate", pulse, pulse, "--windows-ms", window]) == cli.WRONG_DATA
    assert "expected" in capsys.readouterr().err


@pytest.mark.parametrize("port", ["-1", "99999"])
def test_an_impossible_port_is_wrong_usage(port: str) -> None:
    """Said before a server starts."""
    with pytest.raises(SystemExit) as ended:
        cli.main(["app", "--port", port])
    assert ended.value.code == cli.WRONG_USAGE


def test_no_command_is_wrong_usage() -> None:
    """Usage goes to standard error, the exit code is 2."""
    with pytest.raises(SystemExit) as ended:
        cli.main([])
    assert ended.value.code == cli.WRONG_USAGE


@pytest.mark.slow
def test_saved_models_predict_without_learning_again(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All that train saved is used; with an empty cache nothing is trained."""
    assert cli.main(["train", str(campaign_on_disk), "--out", str(tmp_path / "models")]) == cli.DONE
    assert "Learned from 4 tests and 24 CAE runs" in capsys.readouterr().out
    names = {path.stem for path in (tmp_path / "models").iterdir()}
    assert names == set(APPROACHES)

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setenv("CRASHFUSE_CACHE", str(tmp_path / "empty"))
    monkeypatch.setattr("crashfuse.approaches.time_domain.lf_tcn.train", forbidden)
    monkeypatch.setattr("crashfuse.approaches.displacement_domain.gaussian_process.GaussianProcess.fit", forbidden)
    out = tmp_path / "out"
    command = ["predict", str(campaign_on_disk), *at_condition(22, 2060, 1520), "--out", str(out)]
    assert cli.main([*command, "--models", str(tmp_path / "models")]) == cli.DONE
    assert set(pd.read_csv(out / "pulses.csv")["approach"]) == set(APPROACHES)
    record = json.loads((out / "prediction.json").read_text())
    assert record["config"]["preset"] == "fast"


@pytest.mark.slow
def test_what_saved_models_cannot_be_combined_with_is_said(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An empty folder, settings that the models have in them, an approach that was not saved."""
    models, out = tmp_path / "models", ["--out", str(tmp_path / "out")]
    command = ["predict", str(campaign_on_disk), *at_condition(22, 2060, 1520), *out, "--models", str(models)]
    assert cli.main(command) == cli.WRONG_USAGE
    assert "no saved model" in capsys.readouterr().err
    assert cli.main(["train", str(campaign_on_disk), "--out", str(models), "--approach", "cae"]) == cli.DONE
    assert cli.main([*command, "--seed", "1"]) == cli.WRONG_USAGE
    assert "leave out --preset, --seed and --device" in capsys.readouterr().err
    assert cli.main([*command, "--approach", "lf_tcn"]) == cli.WRONG_DATA
    assert "lf_tcn.safetensors: expected a saved model, found no such file" in capsys.readouterr().err
    other = ["train", str(campaign_on_disk), "--out", str(models), "--approach", "displacement_domain", "--seed", "1"]
    assert cli.main(other) == cli.DONE
    assert cli.main(command) == cli.WRONG_USAGE
    assert "different presets or seeds" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_device_that_is_not_there_is_wrong_usage(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Said before anything is computed, by study, predict and train."""
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    condition = at_condition(22, 2060, 1520)
    for command, more in (("study", []), ("predict", condition), ("train", [])):
        run = [command, str(campaign_on_disk), *more, "--out", str(tmp_path / "out"), "--device", "cuda"]
        assert cli.main(run) == cli.WRONG_USAGE
        assert "There is no CUDA device" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_device_is_recorded(campaign_on_disk: Path, tmp_path: Path) -> None:
    """In study.json, with the other settings."""
    command = ["study", str(campaign_on_disk), "--out", str(tmp_path), "--held-out", "T2", "--approach", "cae"]
    assert cli.main([*command, "--device", "cpu"]) == cli.DONE
    assert json.loads((tmp_path / "study.json").read_text())["config"]["device"] == "cpu"


@pytest.mark.slow
def test_a_whole_study_leaves_speed_groups_out_too(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table of its own, a recommendation for the campaign and for each test, in the record and on the terminal."""
    out = tmp_path / "out"
    assert cli.main(["study", str(campaign_on_disk), "--out", str(out), "--approach", "cae", "--workers", "1"]) == 0
    scores, groups = (pd.read_csv(out / name) for name in ("scores.csv", "speed_groups.csv"))
    assert list(scores) == list(groups)
    assert len(scores) == len(groups)
    record = json.loads((out / "study.json").read_text())
    assert record["config"]["leave_out"] == "both"
    assert record["recommendation"]["campaign"]["approach"] == "cae"
    assert set(record["recommendation"]["tests"]) == {"T1", "T2", "T3", "T4"}
    assert record["recommendation"]["tests"]["T2"]["expected_rating"]["tests"] == ["T3", "T4", "T1"]
    assert record["speed_groups"]["mean_rating"]["cae"] == pytest.approx(
        groups[groups["window_ms"] == 60]["overall"].mean(), abs=1e-4
    )
    for test in ("T1", "T2", "T3", "T4"):
        assert set(record["repeatability"][test]) == {"20", "40", "60"}
        repeat = record["repeatability"][test]["60"]
        assert 0 <= repeat["lower"] < repeat["value"] < repeat["upper"] <= 1
    said = capsys.readouterr().out
    assert "Use the raw CAE model for this campaign." in said
    assert said.endswith(
        f"Written to {out}: scores.csv, speed_groups.csv, pulses.csv, metrics.csv, report.html, study.json\n"
    )


@pytest.mark.slow
def test_a_series_of_studies_gives_what_each_gives_alone(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two campaigns of one name with two seeds each: each study is what it is alone."""
    other = tmp_path / "other" / campaign_on_disk.name
    shutil.copytree(campaign_on_disk, other)
    options = ["--held-out", "T2", "T4", "--approach", "cae", "lf_tcn", "--workers", "1"]
    campaigns, out = [str(campaign_on_disk), str(other)], tmp_path / "series"
    assert cli.main(["study", *campaigns, "--out", str(out), "--seed", "0,1", *options]) == cli.DONE
    assert "Study 4 of 4: campaign-2/fast-seed-1" in capsys.readouterr().out
    assert {path.relative_to(out).as_posix() for path in out.rglob("study.json")} == {
        f"{name}/fast-seed-{seed}/study.json" for name in ("campaign", "campaign-2") for seed in (0, 1)
    }
    assert cli.main(["study", campaigns[1], "--out", str(tmp_path / "one"), "--seed", "1", *options]) == cli.DONE
    alone = (tmp_path / "one" / "scores.csv").read_bytes()
    assert (out / "campaign-2" / "fast-seed-1" / "scores.csv").read_bytes() == alone
    assert (out / "campaign-2" / "fast-seed-0" / "scores.csv").read_bytes() != alone
    studies, scores = pd.read_csv(out / "studies.csv"), pd.read_csv(tmp_path / "one" / "scores.csv")
    assert len(studies) == 2 * 2 * 2 * 3
    (row,) = studies[
        (studies["campaign"] == "campaign-2") & (studies["seed"] == 1) & (studies["approach"] == "lf_tcn")
        & (studies["window_ms"] == 60)
    ].to_dict("records")  # fmt: skip
    own = scores[(scores["approach"] == "lf_tcn") & (scores["window_ms"] == 60)]["overall"]
    assert (row["preset"], row["left_out"], row["tests"]) == ("fast", "test", 2)
    assert (row["mean"], row["least"]) == pytest.approx((own.mean(), own.min()), abs=1e-5)


@pytest.mark.slow
def test_a_series_loads_each_campaign_once_and_checks_each_study_once(
    campaign_on_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two studies of one campaign: one campaign is read, two plans are made."""
    loaded: list[Path] = []
    planned: list[int] = []
    load, check = campaign_folder_module.load_campaign, StudyPlan.__post_init__

    def noted_load(path: Path) -> Campaign:
        loaded.append(path)
        return load(path)

    def noted_check(self: StudyPlan) -> None:
        planned.append(self.config.seed)
        check(self)

    monkeypatch.setattr(campaign_folder_module, "load_campaign", noted_load)
    monkeypatch.setattr(StudyPlan, "__post_init__", noted_check)
    options = ["--held-out", "T2", "--approach", "cae", "--seed", "0,1", "--workers", "1"]
    assert cli.main(["study", str(campaign_on_disk), "--out", str(tmp_path / "out"), *options]) == cli.DONE
    assert loaded == [campaign_on_disk]
    assert planned == [0, 1]


@pytest.mark.slow
def test_a_series_goes_on_where_it_was_and_says_first_what_is_impossible(
    campaign_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], fitting_is_an_error: Callable[[], None]
) -> None:
    """What is wrong with the last campaign ends it before the first is computed; what was done is not done again.

    Its folder has a name that others take for a missing value.
    """
    folder = campaign_folder.rename(tmp_path / "nan")
    options = ["--held-out", "T2", "--approach", "lf_tcn", "--workers", "1"]
    other, out = tmp_path / "other", tmp_path / "series"
    write_campaign(replace(small_campaign(), tests=small_campaign().tests[:1]), other)
    command = [
        "study",
        "--preset",
        "fast",
        "--seed",
        "0",
        str(folder),
        str(other),
        "--out",
        str(out),
        *options,
    ]
    assert cli.main(command) != cli.DONE
    assert "T2" in capsys.readouterr().err
    assert not out.exists()

    series = ["study", str(folder), "--out", str(out), *options, "--seed"]
    assert cli.main([*series, "0,1"]) == cli.DONE
    first = pd.read_csv(out / "studies.csv")
    assert cli.main([*series, "2,3"]) == cli.DONE
    table = pd.read_csv(out / "studies.csv")
    assert table["seed"].tolist() == [seed for seed in range(4) for _ in range(3)]
    assert set(table["held_out"]) == {"T2"}
    fitting_is_an_error()
    (out / "nan" / "fast-seed-1" / "study.json").unlink()  # as if it had been killed before the second began
    assert cli.main([*series, "0,1", "--resume"]) == cli.DONE
    again = pd.read_csv(out / "studies.csv")
    pd.testing.assert_frame_equal(again[again["seed"] < 2].reset_index(drop=True), first)
    assert set(again["seed"]) == {0, 1, 2, 3}
    assert cli.main([*series, "0"]) == cli.WRONG_USAGE
    assert "holds a series of studies" in capsys.readouterr().err


@pytest.mark.slow
def test_a_sweep_writes_metrics_over_speed_with_the_tests_beside(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The ends of the range, every full mph between them, and each test at its own speed."""
    out = tmp_path / "out"
    command = ["sweep", str(campaign_on_disk), "--out", str(out), "--approach", "cae", "--speed-mph", "24.5", "27"]
    assert cli.main([*command, "--front-weight-lb", "2050", "--rear-weight-lb", "1500"]) == cli.DONE
    table = pd.read_csv(out / "sweep.csv")
    peak = table[table["metric"] == "peak"].set_index("approach")
    np.testing.assert_allclose(peak.loc["cae", "speed_mph"], [24.5, 25, 26, 27], rtol=1e-5)
    np.testing.assert_allclose(peak.loc["test", "speed_mph"], [15, 25, 26, 35], rtol=1e-5)
    assert "4 speeds from 24.5 to 27.0 mph" in capsys.readouterr().out
    assert (out / "report.html").is_file()


@pytest.mark.slow
def test_a_learning_curve_writes_its_table_its_report_and_its_record(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The contract's columns first; the sentences that are printed stand in the record, with the cost of a test."""
    out = tmp_path / "out"
    command = ["learning-curve", str(campaign_on_disk), "--out", str(out), "--workers", "1", "--repeats", "1"]
    command += ["--approach", "cae", "displacement_domain", "--windows-ms", "60", "--cost-per-test", "60000 EUR"]
    assert cli.main(command) == cli.DONE
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
    printed = capsys.readouterr().out
    assert all(sentence in printed for sentence in record["sentences"])
    report = (out / "report.html").read_text()
    assert "how many tests are enough" in report
    assert "--cost-per-test '60,000 EUR'" in unescape(report)


def test_a_learning_curve_of_two_tests_says_what_cannot_be_told(
    campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One predicts the other; there is no gain to list."""
    folder = write_campaign(campaign.without(["T1", "T2"]), tmp_path / "campaign")
    command = ["learning-curve", str(folder), "--out", str(tmp_path / "out"), "--approach", "cae", "--workers", "1"]
    assert cli.main(command) == cli.DONE
    printed = capsys.readouterr().out
    assert printed.startswith("With 1 of 2 tests the raw CAE model rates")
    assert "Empty" not in printed


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--cost-per-test", "-5"], "The cost of a test is a number above 0"),
        (["--cost-per-test", "much"], "The cost of a test is a number above 0"),
        (["--approach", "magic"], "magic"),
        (["--windows-ms", "400"], "A rating window of 400 ms is not possible"),
    ],
)
def test_a_learning_curve_that_is_impossible_is_one_sentence(
    campaign_on_disk: Path, tmp_path: Path, options: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is computed, and nothing is written."""
    out = tmp_path / "out"
    assert cli.main(["learning-curve", str(campaign_on_disk), "--out", str(out), *options]) == cli.WRONG_USAGE
    (said,) = capsys.readouterr().err.strip().splitlines()
    assert sentence in said
    assert not out.exists()


def test_the_next_test_is_ranked_over_a_range_or_from_a_list(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two candidates the one far from all tests comes first; a grid is taken where none are given."""
    out, candidates = tmp_path / "out", tmp_path / "candidates.csv"
    candidates.write_text("id,speed_mph,front_weight_lb,rear_weight_lb\nA,25.5,2060,1525\nB,34,2000,1650\n")
    over = ["--speed-mph", "20", "35", "--factor", "drive=FWD"]
    command = ["next-test", str(campaign_on_disk), "--out", str(out), *over]
    assert cli.main([*command, "--candidates", str(candidates)]) == cli.DONE
    table = pd.read_csv(out / "next_tests.csv")
    assert table["speed (mph)"].tolist() == [34.0, 25.5]
    assert "gain (%)" in capsys.readouterr().out
    assert cli.main(command) == cli.DONE
    assert pd.read_csv(out / "next_tests.csv")["speed (mph)"].between(20, 35).all()


def test_a_bad_list_of_candidates_is_named_cell_by_cell(
    campaign_on_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As any other table."""
    candidates = tmp_path / "candidates.csv"
    candidates.write_text("id,speed_mph,front_weight_lb,rear_weight_lb\nA,fast,2060,1525\n")
    command = ["next-test", str(campaign_on_disk), "--out", str(tmp_path / "out"), "--candidates", str(candidates)]
    assert cli.main(command) == cli.WRONG_DATA
    assert "candidates.csv" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_name_that_is_not_utf_8_is_one_sentence(
    campaign_folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """It names the file, and says what to do."""
    name = os.fsdecode(b"b\xff")
    assert cli.main(["check", str(campaign_folder.rename(tmp_path / name))]) == 2
    assert "is not UTF-8; rename the file or folder." in capsys.readouterr().err
