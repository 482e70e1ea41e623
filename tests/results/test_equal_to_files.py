"""Every table that the library gives is the file that the command line writes, number by number."""

import json
from pathlib import Path

import pandas as pd
import pytest

import crashfuse
from crashfuse import Condition, StudyConfig, cli
from crashfuse.files.csv_text import csv_bytes
from crashfuse.importing.ratings import explain_files
from crashfuse.results.rating_tables import excursions_table, humps_table
from tests.conftest import Capture

pytestmark = pytest.mark.usefixtures("one_cache")

APPROACHES = ("cae", "displacement_domain")
CONFIG = StudyConfig(approaches=APPROACHES)
AT = {"speed_mph": 30.0, "front_weight_lb": 2050.0, "rear_weight_lb": 1500.0}
CONDITION = Condition.of(**AT, drive="FWD")
CRITERIA = [{"name": "crush", "metric": "max_crush", "at_most": 430.0}]
MATRIX = pd.DataFrame([{"id": "A", **AT, "drive": "FWD"}])
OPTIONS = [text for name, value in AT.items() for text in (f"--{name.replace('_', '-')}", f"{value:g}")]


@pytest.fixture(scope="module")
def read(campaign_on_disk: Path) -> crashfuse.Campaign:
    return crashfuse.load_campaign(campaign_on_disk)


def run(command: str, folder: Path, out: Path, *options: str) -> Path:
    assert cli.main([command, str(folder), "--out", str(out), *options]) == cli.DONE
    return out


def assert_is_file(table: pd.DataFrame, path: Path) -> None:
    """A table is the content of a file: its columns, its texts, its numbers as they are rounded there."""
    texts = dict.fromkeys((name for name in table if not pd.api.types.is_numeric_dtype(table[name])), str)
    read = pd.read_csv(path, dtype=texts).fillna(dict.fromkeys(texts, ""))
    pd.testing.assert_frame_equal(read, table.fillna(dict.fromkeys(texts, "")), check_dtype=False, rtol=1e-5, atol=1e-9)
    assert csv_bytes(table) == path.read_bytes()


@pytest.mark.slow
def test_those_of_a_study(read: crashfuse.Campaign, campaign_on_disk: Path, tmp_path: Path) -> None:
    """Scores, pulses, metrics, speed groups, and what repeats would rate."""
    out = run("study", campaign_on_disk, tmp_path / "out", "--approach", *APPROACHES, "--workers", "1")
    study = crashfuse.run_study(read, StudyConfig(approaches=APPROACHES, leave_out="both"), workers=1)
    assert study.speed_groups is not None
    assert_is_file(study.scores, out / "scores.csv")
    assert_is_file(study.pulses, out / "pulses.csv")
    assert_is_file(study.metrics, out / "metrics.csv")
    assert_is_file(read.cae_events(), out / "cae_events.csv")
    assert_is_file(study.speed_groups.scores, out / "speed_groups.csv")
    recorded = json.loads((out / "study.json").read_text(encoding="utf-8"))["repeatability"]
    found = {(test, w): own for test, by_window in study.repeatability.items() for w, own in by_window.items()}
    assert len(found) == 4 * 3
    for (test, w), own in found.items():
        ends = {end: getattr(own, end) for end in ("value", "lower", "upper")}
        assert recorded[test][f"{w:g}"] == pytest.approx(ends, abs=1e-4)


@pytest.mark.slow
def test_those_of_a_prediction(read: crashfuse.Campaign, campaign_on_disk: Path, tmp_path: Path) -> None:
    """Pulses and metrics of all approaches asked for; the table of one is its part of the file."""
    options = (*OPTIONS, "--factor", "drive=FWD", "--approach", *APPROACHES)
    out = run("predict", campaign_on_disk, tmp_path / "out", *options)
    prediction = crashfuse.predict(read, CONDITION, APPROACHES)
    assert_is_file(prediction.pulses, out / "pulses.csv")
    assert_is_file(prediction.metrics, out / "metrics.csv")
    own = prediction.pulses.query("approach == 'displacement_domain'")[["time_ms", "acceleration_g", "lower_g"]]
    assert prediction.to_frame()[list(own)].equals(own.reset_index(drop=True))
    prediction.write(tmp_path / "library")
    files = (of / "prediction.json" for of in (tmp_path / "library", out))
    ours, theirs = (json.loads(path.read_text(encoding="utf-8"))["config"] for path in files)
    assert (ours, ours["approaches"]) == (theirs, list(APPROACHES))


@pytest.mark.slow
def test_those_of_plans(read: crashfuse.Campaign, campaign_on_disk: Path, tmp_path: Path) -> None:
    weights, kind = OPTIONS[2:], ("--factor", "drive=FWD")
    speeds = ("--speed-mph", "28", "30.5")
    out = run("sweep", campaign_on_disk, tmp_path / "sweep", *weights, *speeds, *kind, "--approach", *APPROACHES)
    sweep = crashfuse.sweep(read, CONDITION, (28, 30.5), APPROACHES)
    assert_is_file(sweep.table, out / "sweep.csv")
    sweep.write(tmp_path / "library")
    assert (tmp_path / "library" / "report.html").read_bytes() == (out / "report.html").read_bytes()
    out = run("next-test", campaign_on_disk, tmp_path / "next")
    assert_is_file(crashfuse.next_test(read).table, out / "next_tests.csv")


@pytest.mark.slow
def test_those_of_a_certification(read: crashfuse.Campaign, campaign_on_disk: Path, tmp_path: Path) -> None:
    (tmp_path / "criteria.toml").write_text(
        '[[criterion]]\nname = "crush"\nmetric = "max_crush"\nat_most = 430.0\n', encoding="utf-8"
    )
    (tmp_path / "matrix.csv").write_bytes(csv_bytes(MATRIX))
    files = ("--criteria", str(tmp_path / "criteria.toml"), "--matrix", str(tmp_path / "matrix.csv"))
    out = run("certify", campaign_on_disk, tmp_path / "out", *files, "--approach", "cae", "--workers", "1")
    verdicts = crashfuse.certify(read, CRITERIA, MATRIX, approach="cae", workers=1)
    assert_is_file(verdicts.table, out / "certification.csv")
    assert_is_file(verdicts.credibility, out / "credibility.csv")
    assert_is_file(verdicts.track_record, out / "track_record.csv")
    assert verdicts.counts[["met", "not met", "open", "outside"]].sum(axis=1).tolist() == [1]


@pytest.mark.slow
def test_that_of_a_learning_curve(read: crashfuse.Campaign, campaign_on_disk: Path, tmp_path: Path) -> None:
    (tmp_path / "criteria.toml").write_text('[[criterion]]\nmetric = "max_crush"\nat_most = 430.0\n', encoding="utf-8")
    criteria = ("--criteria", str(tmp_path / "criteria.toml"))
    options = ("--approach", *APPROACHES, "--repeats", "0", "--workers", "1", *criteria)
    out = run("learning-curve", campaign_on_disk, tmp_path / "out", *options)
    curve = crashfuse.with_decided(crashfuse.learning_curve(read, CONFIG, repeats=0, workers=1), CRITERIA)
    assert_is_file(curve.table, out / "learning_curve.csv")
    assert curve.table["decided"].notna().all()


def test_what_check_says_of_the_runs(read: crashfuse.Campaign, campaign_on_disk: Path, capsys: Capture) -> None:
    assert cli.main(["check", str(campaign_on_disk)]) == cli.DONE
    printed = capsys.readouterr().out.splitlines()
    assert all(sentence in printed for sentence in read.quality.sentences)
    assert isinstance(read.quality.table, pd.DataFrame)


def test_those_of_a_rating(campaign_on_disk: Path, capsys: Capture) -> None:
    one, other = files = [str(campaign_on_disk / "tests" / f"{name}.csv") for name in ("T2", "T3")]
    assert cli.main(["rate", *files, "--csv"]) == cli.DONE
    assert capsys.readouterr().out.encode() == csv_bytes(crashfuse.rate_files(one, other))
    assert cli.main(["rate", *files, "--json", "--explain", "--windows-ms", "60"]) == cli.DONE
    (told,) = json.loads(capsys.readouterr().out)
    (explanation,) = explain_files(one, other, [60.0])
    assert len(humps_table(explanation)) == len(told["explanation"]["humps"])
    outside = told["explanation"]["outside_inner_corridor"]
    ends = excursions_table(explanation).frame[["begin_ms", "end_ms"]].to_numpy().tolist()
    assert ends == [[own["begin_ms"], own["end_ms"]] for own in outside]
