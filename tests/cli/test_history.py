"""What was computed is listed, and two studies are compared, by folder or by id."""

import json
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import pandas as pd
import pytest

from crashfuse import cli
from crashfuse.reporting.past_results import read_study
from crashfuse.study.history import past_results
from crashfuse.testing import small_campaign
from tests.conftest import Capture, write_campaign

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: Capture) -> Run:
    """A command's exit code, and what it printed and complained of."""

    def command(*arguments: object) -> tuple[int, str, str]:
        code = cli.main([str(argument) for argument in arguments])
        return (code, *capsys.readouterr())

    return command


@pytest.mark.slow
def test_two_studies_are_compared_by_folder_and_by_id(run: Run, tmp_path: Path) -> None:
    """The numbers are those of both scores.csv; every rating as CSV on request."""
    write_campaign(small_campaign(), tmp_path / "campaign")
    options = ["--approach", "cae", "displacement_domain", "--held-out", "T2", "T4", "--workers", "1"]
    options += ["--leave-out", "both"]
    for seed in (0, 1):
        code, *_ = run("study", tmp_path / "campaign", "--out", tmp_path / f"{seed}", "--seed", seed, *options)
        assert code == cli.DONE
    code, listed, _ = run("studies")
    assert code == cli.DONE
    ids = [result.id for result in past_results()]
    assert len(ids) == 2
    assert all(name in listed for name in ids)
    assert "study of 2 tests" in listed

    code, told, _ = run("compare", tmp_path / "0", tmp_path / "1")
    assert code == cli.DONE
    assert "CAE: the same in both" in told
    assert told.count("Over 0–60 ms") == 2  # alone, and with the speed group
    code, table, _ = run("compare", tmp_path / "0", tmp_path / "1", "--csv")
    ratings = pd.read_csv(StringIO(table)).query("left_out == 'test'").reset_index(drop=True)
    for side in (0, 1):
        scores = pd.read_csv(tmp_path / f"{side}" / "scores.csv")
        assert list(ratings[["first", "second"][side]]) == pytest.approx(list(scores["overall"]))
    code, told, _ = run("compare", *ids, "--report", tmp_path / "new" / "both.html")
    assert (code, told) == (cli.DONE, f"Written to {tmp_path / 'new' / 'both.html'}\n")
    assert all(name in (tmp_path / "new" / "both.html").read_text(encoding="utf-8") for name in ids)
    code, _, complaint = run("compare", *ids, "--report", tmp_path)
    assert (code, "is a folder; name a file for --report" in complaint) == (cli.WRONG_USAGE, True)
    assert run("compare", *ids)[1] == run("compare", tmp_path / "1", tmp_path / "0")[1]

    record = tmp_path / "1" / "study.json"
    for damage in ({"finished": False}, {"config": 3}):
        record.write_text(json.dumps({**json.loads(record.read_text()), **damage}))
        code, _, complaint = run("compare", tmp_path / "0", tmp_path / "1")
        assert code == (cli.WRONG_USAGE if "finished" in damage else cli.WRONG_DATA), complaint
        assert "Traceback" not in complaint
        record.write_text(json.dumps({**json.loads(record.read_text()), "finished": True}))
    (tmp_path / "0" / "scores.csv").write_text("held_out,approach\n", encoding="utf-8")
    assert run("compare", tmp_path / "0", tmp_path / "0")[0] == cli.WRONG_DATA


def test_what_is_no_study_is_refused(run: Run, tmp_path: Path) -> None:
    """An empty folder, an unknown id; and an empty list says so."""
    assert run("studies")[1] == "Nothing was computed on this machine yet.\n"
    code, _, complaint = run("compare", tmp_path, tmp_path)
    assert (code, "no study.json" in complaint) == (cli.WRONG_USAGE, True)
    code, _, complaint = run("compare", "012345", tmp_path)
    assert (code, "crashfuse studies lists them" in complaint) == (cli.WRONG_USAGE, True)


def test_a_written_study_is_read_back(tmp_path: Path) -> None:
    """Whatever its tests are called: numbers and words that others take for missing, too."""
    ids = ["007", "1e5", "NA", "nan", "None", "null", "inf", "True"]
    config = {
        "approaches": ["cae"], "preset": "fast", "seed": 3, "windows_ms": [60.0], "leave_out": "test", "device": "cpu"
    }  # fmt: skip
    advice = {"campaign": {"approach": "cae"}}
    record = {"campaign": "a", "fingerprint": "f", "config": config, "rating": "b", "recommendation": advice}
    (tmp_path / "study.json").write_text(json.dumps({**record, "finished": True}))
    (tmp_path / "scores.csv").write_text(
        "held_out,approach,window_ms,overall,grade\n" + "".join(f"{i},cae,60,0.5,Poor\n" for i in ids)
    )
    found = read_study(tmp_path)
    assert found.ratings == {test: {"cae": {60.0: 0.5}} for test in ids}
    assert (found.config.seed, found.approach, found.condition) == (3, "cae", None)
