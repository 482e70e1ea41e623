"""The command certify: verdicts, files and refusals."""

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crashfuse import cli
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note, write_notes
from crashfuse.certification import file_store, seal
from crashfuse.certification.criteria import Costs
from crashfuse.certification.earlier import read_earlier
from crashfuse.signals.pulse import GRID_S, Pulse
from tests.archives import made_archive
from tests.cli.conftest import Shell, run
from tests.conftest import write_campaign

pytestmark = pytest.mark.usefixtures("one_cache")

CRITERIA = """
confidence = 0.8

[[criterion]]
name = "crush"
metric = "max_crush"
at_most = 430.0

[[criterion]]
metric = "peak"
at_most = 25.0

[[criterion]]
metric = "rating"
at_least = 0.7
"""
HEADER = "id,speed_mph,front_weight_lb,rear_weight_lb,drive"
MATRIX = f"{HEADER}\nA,20,2040,1500,FWD\nB,30,2040,1500,FWD\nC,70,2040,1500,FWD\n"
GRID = ["--front-weight-lb", "2040", "--rear-weight-lb", "1500"]
QUICK = ["--approach", "cae", "--workers", "1"]
CONTRACT = ["id", "speed_mph", "front_weight_lb", "rear_weight_lb", "drive", "criterion", "metric", "window_ms"]
CONTRACT += ["at_least", "at_most", "unit", "value", "lower", "upper", "probability", "verdict", "reason"]


@pytest.fixture(scope="module")
def planned(campaign: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small campaign with criteria, a matrix and a note on a test, which no test changes."""
    folder = write_campaign(campaign, tmp_path_factory.mktemp("planned") / "campaign")
    (folder / "criteria.toml").write_text(CRITERIA, encoding="utf-8")
    (folder / "matrix.csv").write_text(MATRIX, encoding="utf-8")
    write_notes(folder, [Note("T2", "bracket came loose", 30.0)])
    return folder


def certifying(campaign: Path, out: Path, *options: object) -> list[object]:
    """The command."""
    return ["certify", campaign, "--out", out, *QUICK, *options]


@pytest.mark.slow
def test_the_files_have_the_columns_and_numbers_of_the_contract(planned: Path, tmp_path: Path, shell: Shell) -> None:
    """Five files and nothing else; counts in the JSON and on the terminal are those of the tables."""
    printed = shell.prints(*certifying(planned, tmp_path / "out"))
    names = {"certification.csv", "track_record.csv", "credibility.csv", "certification.json", "report.html"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    assert "bracket came loose" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    verdicts = pd.read_csv(tmp_path / "out" / "certification.csv")
    further = ["basis", "need_not_be_run", "all_met_at_least", "answer", "all_met", "spot_check"]
    assert list(verdicts) == [*CONTRACT, *further, "probability_lower", "probability_upper"]
    assert verdicts["id"].tolist() == [i for i in "ABC" for _ in range(3)]
    assert verdicts["window_ms"].dropna().unique().tolist() == [60.0]
    assert (verdicts["lower"] <= verdicts["value"]).all()
    assert (verdicts["value"] <= verdicts["upper"]).all()
    assert verdicts.query("id == 'C'")["verdict"].unique().tolist() == ["outside"]
    trials = pd.read_csv(tmp_path / "out" / "track_record.csv")
    columns = ["held_out", "left_out", "criterion", "probability", "verdict", "measured", "met"]
    assert list(trials)[:7] == columns
    assert len(trials) == 4 * 2 * 3
    assert set(trials["unit"].dropna()) == {"mm", "g"}
    crush = trials.query("criterion == 'crush'")
    assert (crush["met"] == (crush["measured"] <= 430)).all()
    record = json.loads((tmp_path / "out" / "certification.json").read_text(encoding="utf-8"))
    told = record["track_record"]
    assert sum(trials["counted"]) == sum(told[word]["n"] for word in ("met", "not met", "open", "outside"))
    for unit in ("verdicts", "tests"):
        (bound,) = trials[f"bounds.{unit}"].unique()
        assert bound == record["bounds"][unit] or np.isnan(bound)
    counts = verdicts["verdict"].value_counts()
    assert record["verdicts"] == {word: int(counts.get(word, 0)) for word in ("met", "not met", "open", "outside")}
    by_criterion = [own["verdicts"] for own in record["by_criterion"].values()]
    assert {word: sum(own[word] for own in by_criterion) for word in record["verdicts"]} == record["verdicts"]
    assert set(verdicts[verdicts["need_not_be_run"]]["id"]) == set(record["waived"])
    assert set(verdicts.query("answer == 'skip'")["id"]) == set(record["waived"])
    assert record["sentences"][0] in printed
    table = printed.partition("Not met Open Outside\n")[2].splitlines()[: len(record["by_criterion"])]
    shown = {words[0]: words[-4:] for words in map(str.split, table)}
    assert shown == {name: [*map(str, own["verdicts"].values())] for name, own in record["by_criterion"].items()}


@pytest.mark.slow
def test_a_sealed_certification_is_verified_and_followed(planned: Path, tmp_path: Path, shell: Shell) -> None:
    """It rests on every file of the campaign, follows the one before, whose seal is told; a key is needed first."""
    key, out = tmp_path / "key", tmp_path / "out"
    assert run("key", key) == cli.DONE
    assert run(*certifying(planned, tmp_path / "none", "--seal", f"{key}.pub")) == cli.WRONG_DATA
    assert not list((tmp_path / "none").glob("*"))
    made_archive().save(tmp_path / "past.cfa")
    assert run(*certifying(planned, out, "--seal", key, "--archive", tmp_path / "past.cfa")) == cli.DONE
    verified = shell.prints("verify", out, "--key", f"{key}.pub", "--campaign", planned)
    assert "Not compared, as not beside the campaign: ../past.cfa." in verified
    record = json.loads((out / "certification.json").read_bytes())
    assert set(record["seal"]["files"]) == {"certification.csv", "track_record.csv", "credibility.csv", "report.html"}
    assert {"tests.csv", "criteria.toml", "cae_pulses.parquet", "../past.cfa"} <= set(record["seal"]["rests_on"])
    report = (out / "report.html").read_text(encoding="utf-8")
    seen = ("Sedan, Van and Coupe; SHA-256", "rating by +0.050", f"key <code>{record['seal']['key']}</code>")
    assert all(text in report for text in seen)
    assert record["command"].partition("--archive ")[2].startswith("archive.cfa")
    assert run(*certifying(planned, tmp_path / "after", "--since", out, "--seal", key)) == cli.DONE
    after = json.loads((tmp_path / "after" / "certification.json").read_bytes())
    assert after["seal"]["before"] == hashlib.sha256((out / "certification.json").read_bytes()).hexdigest()
    (planned / "tests.csv").write_bytes((planned / "tests.csv").read_bytes() + b"\n")
    changed = "tests.csv: expected the file that it rests on, found another one"
    assert changed in shell.wrong_data("verify", out, "--campaign", planned)
    assert run(*certifying(planned, out)) == cli.DONE  # without a seal: none of before stays beside it
    assert not (out / "seal.json").exists()


@pytest.mark.slow
def test_a_forged_verdict_under_a_valid_seal_is_found_by_recomputing(
    planned: Path, campaign: Campaign, tmp_path: Path, shell: Shell
) -> None:
    """What is true agrees to the last digit, with a test run since put aside; a forger's seal holds all the same."""
    key, out, again = tmp_path / "key", tmp_path / "out", ("--recompute", planned, "--workers", "1")
    assert run("key", key) == cli.DONE
    fewer = write_campaign(campaign.without([campaign.test_ids[-1]]), tmp_path / "fewer")
    inputs = ("--criteria", planned / "criteria.toml", "--matrix", planned / "matrix.csv")
    assert run(*certifying(fewer, out, *inputs, "--seal", key)) == cli.DONE
    printed = shell.prints("verify", out, *again)
    head, _, other, verdicts = printed.partition("agree")[2].splitlines()[:4]
    assert " ".join(head.split()) == "not derived to the last digit"
    assert (verdicts.split(), other.split()[:2]) == (["verdicts", "0", "9"], ["other", "values"])
    assert "Not derived: crashfuse, python, platform, packages, date, " in printed
    record = json.loads((out / "certification.json").read_text(encoding="utf-8"))
    word, probability, *ends = record["cells"]["B"]["crush"]
    forged = {"met": "not met"}.get(word, "met")
    record["cells"]["B"]["crush"] = [forged, probability, *ends]
    (out / "certification.json").write_text(json.dumps(record), encoding="utf-8")
    trials = (out / "track_record.csv").read_text(encoding="utf-8")
    (out / "track_record.csv").write_text(trials.replace("True", "False", 1), encoding="utf-8")
    seal.seal(out, seal.read_key(key, "private"), record["seal"]["rests_on"], None)
    assert run("verify", out, "--key", f"{key}.pub") == cli.DONE
    said = shell.wrong_data("verify", out, *again)
    assert f"certification.json, cells, B, crush: expected ['{word}', {probability}" in said
    assert f"found ['{forged}', {probability}" in said
    assert "track_record.csv, " in said
    assert "2 problems found." in said
    stiffer = [replace(t, id=f"V{t.id}", pulse=Pulse(GRID_S, 1.02 * t.pulse.accel_mps2)) for t in campaign.tests]
    stranger = write_campaign(replace(campaign, tests=tuple(stiffer)), tmp_path / "van")
    said = shell.wrong_data("verify", out, "--recompute", stranger)
    assert "found one of fewer, none of whose tests is in van" in said
    assert "1 problem found." in said


@pytest.mark.slow
def test_an_earlier_certification_is_held_against_a_test_run_since(
    campaign: Campaign, planned: Path, tmp_path: Path, shell: Shell
) -> None:
    """Made without a test, then with it: printed, in track_record.csv and in the report, which others do not have."""
    *_, last = campaign.test_ids
    there = campaign.test(last).condition
    fewer = write_campaign(campaign.without([last]), tmp_path / "fewer")
    first, second = tmp_path / "first", tmp_path / "second"
    grid = ["--criteria", planned / "criteria.toml", "--speed-kph", there.speed_mps * 3.6]
    grid += ["--front-weight-kg", there.front_weight_kg, "--rear-weight-kg", there.rear_weight_kg]
    printed = shell.prints(*certifying(fewer, first, *grid))
    for earlier in (first, first / "certification.json"):
        printed += shell.prints(*certifying(planned, second, *grid, "--since", earlier))
    listed = file_store.certifications(campaign).values()  # by the page
    digest = hashlib.sha256((first / "certification.json").read_bytes()).hexdigest()
    assert digest in [own.digest for own in listed]
    assert f"SHA-256 of certification.json: {digest}" in printed
    assert f"Run since: {last}." in printed
    table = pd.read_csv(second / "track_record.csv").query("left_out == 'planned'")
    assert table["held_out"].tolist() == [last, last]  # the rating would be that of another prediction
    measured = {metric.name: metric.value for metric in campaign.metrics_of(campaign.test(last))}
    assert table["measured"].tolist() == pytest.approx([measured["max_crush"], measured["peak"]], rel=1e-5)
    assert "what became of them" in (second / "report.html").read_text(encoding="utf-8")
    said = shell.wrong_data(*certifying(planned, tmp_path / "third", *grid, "--since", planned))
    assert "certification.json: expected the record of a certification" in said
    assert not (tmp_path / "third").exists()
    assert "fixed seeds, the same for everyone" in shell.no_command(*certifying(planned, first, "--seed", "1"))
    assert "holds the earlier certification" in shell.wrong_usage(*certifying(planned, first, *grid, "--since", first))


def test_what_was_typed_in_km_h_and_kg_is_written_so(planned: Path, tmp_path: Path) -> None:
    """A grid of every combination, in every file; and the record is read again."""
    grid = ["--speed-kph", "40", "56", "--front-weight-kg", "930", "--rear-weight-lb", "1500"]
    grid += ["--factor", "drive=FWD"]
    assert run(*certifying(planned, tmp_path / "out", *grid)) == cli.DONE
    table = pd.read_csv(tmp_path / "out" / "certification.csv")
    assert list(table.columns[:4]) == ["id", "speed_kph", "front_weight_kg", "rear_weight_lb"]
    assert table.drop_duplicates("id")[list(table.columns[1:4])].values.tolist() == [[40, 930, 1500], [56, 930, 1500]]
    [first, _] = json.loads((tmp_path / "out" / "certification.json").read_text())["matrix"]
    assert first == {"id": "M001", "speed_kph": 40, "front_weight_kg": 930, "rear_weight_lb": 1500, "drive": "FWD"}
    assert run(*certifying(planned, tmp_path / "again", *grid, "--since", tmp_path / "out")) == cli.DONE


@pytest.mark.parametrize(
    ("options", "code", "sentence"),
    [
        (["--criteria", "{tmp}/none.toml"], 1, "none.toml: expected this file, found no such file"),
        (["--criteria", "{tmp}/long.toml"], 1, "expected a record over 0–100 ms, found 80 ms"),
        (["--costs", "0", "100"], 1, "expected costs test and wrong_answer, above 0"),
        (["--matrix", "{tmp}/none.csv"], 1, "none.csv: expected this file, found no such file; list the conditions in"),
        (["--matrix", "{tmp}/twice.csv"], 1, "row 3: expected each condition once, found that of A again"),
        (["--preset", "paper"], 2, "The preset paper does not act on cae: every preset gives the same"),
        (["--approach", "magic"], 2, "There is no approach 'magic'; choose from cae, "),
        (["--speed-mph", "20"], 2, "A grid takes --speed-mph, --front-weight-lb and --rear-weight-lb"),
        (["--speed-mph", "20", "--matrix", "{tmp}/twice.csv", *GRID], 2, "no --matrix."),
        (["--speed-mph", "2000", *GRID], 2, "No barrier test is made at 2000.0 mph"),
        (["--speed-mph", "20", *GRID, "--factor", "fuel=gas"], 2, "No test has the factor 'fuel=gas'; the tests have"),
    ],
)
def test_what_cannot_be_certified_is_one_sentence_and_leaves_nothing(
    planned: Path, tmp_path: Path, options: list[str], code: int, sentence: str, shell: Shell
) -> None:
    """Exit code 1 for the data, 2 for the usage; the folder for the results is not even made."""
    here = tmp_path / "campaign"
    shutil.copytree(planned, here)
    if "{tmp}/long.toml" in options:
        for path in (here / "tests").iterdir():
            pulse = pd.read_csv(path)
            pulse[pulse["time_ms"] <= 80].to_csv(path, index=False)
    limit = "at_least = 0.5\n"
    (tmp_path / "long.toml").write_text(f'[[criterion]]\nmetric = "rating"\nwindow_ms = 100\n{limit}', encoding="utf-8")
    (tmp_path / "twice.csv").write_text(f"{HEADER}\nA,20,2040,1500,FWD\nB,20,2040,1500,FWD\n", encoding="utf-8")
    asked = [option.format(tmp=tmp_path) for option in options]
    said = (shell.wrong_data if code == 1 else shell.wrong_usage)(*certifying(here, tmp_path / "out", *asked))
    problems = [line for line in said.splitlines() if " of " not in line[:30]]
    assert any(sentence in line for line in problems), problems
    assert not (tmp_path / "out").exists()


def test_a_full_disk_leaves_no_part_of_a_certification(
    planned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    real = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        if len(content) > 1_000_000:  # the report
            raise OSError(28, "No space left on device")
        return real(path, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    assert "Nothing was written to" in shell.wrong_data(*certifying(planned, tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_costs_stand_in_the_record(planned: Path, tmp_path: Path, shell: Shell) -> None:
    shell.prints(*certifying(planned, tmp_path / "out", "--costs", 5, 100))
    assert read_earlier(tmp_path / "out").criteria.costs == Costs(5, 100)
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "skipping pays from a confidence of 0.95; asked for is 0.8." in report
