"""What was computed is listed, and two studies are compared, by folder or by id."""

import json
from io import StringIO
from pathlib import Path

import pandas as pd
import pytest

from crashfuse import cli
from crashfuse.cli.studies import _summary
from crashfuse.results.comparison import read_study
from crashfuse.study.history import past_results
from crashfuse.testing import small_campaign
from tests.cli.conftest import Shell, run
from tests.conftest import write_campaign


@pytest.mark.slow
def test_two_studies_are_compared_by_folder_and_by_id(shell: Shell, tmp_path: Path) -> None:
    """The numbers are those of both scores.csv; every rating as CSV on request."""
    write_campaign(small_campaign(), tmp_path / "campaign")
    options = ["--approach", "cae", "displacement_domain", "--held-out", "T2", "T4", "--workers", "1"]
    options += ["--leave-out", "both"]
    for seed in (0, 1):
        shell.prints("study", tmp_path / "campaign", "--out", tmp_path / f"{seed}", "--seed", seed, *options)
    listed = shell.prints("studies")
    ids = [result.id for result in past_results()]
    assert len(ids) == 2
    assert all(name in listed for name in ids)
    assert "study of 2 tests" in listed

    told = shell.prints("compare", tmp_path / "0", tmp_path / "1")
    assert "CAE: the same in both" in told
    assert told.count("mean rating over 0–60 ms") == 2  # alone, and with the speed group
    table = shell.prints("compare", tmp_path / "0", tmp_path / "1", "--csv")
    ratings = pd.read_csv(StringIO(table)).query("left_out == 'test'").reset_index(drop=True)
    for side in (0, 1):
        scores = pd.read_csv(tmp_path / f"{side}" / "scores.csv")
        assert list(ratings[["first", "second"][side]]) == pytest.approx(list(scores["overall"]))
    report = tmp_path / "new" / "both.html"
    assert shell.prints("compare", *ids, "--report", report) == f"Written to {report}\n"
    assert all(name in report.read_text(encoding="utf-8") for name in ids)
    assert "is a folder; name a file for --report" in shell.wrong_usage("compare", *ids, "--report", tmp_path)
    assert shell.prints("compare", *ids) == shell.prints("compare", tmp_path / "1", tmp_path / "0")

    record = tmp_path / "1" / "study.json"
    whole = json.loads(record.read_text())
    for complains, damage in ((shell.wrong_usage, {"finished": False}), (shell.wrong_data, {"config": 3})):
        record.write_text(json.dumps({**whole, **damage}))
        assert "Traceback" not in complains("compare", tmp_path / "0", tmp_path / "1")
    (tmp_path / "0" / "scores.csv").write_text("held_out,approach\n", encoding="utf-8")
    assert run("compare", tmp_path / "0", tmp_path / "0") == cli.WRONG_DATA


def test_what_is_no_study_is_refused(shell: Shell, tmp_path: Path) -> None:
    """An empty folder, an unknown id; and an empty list says so."""
    assert shell.prints("studies") == "Nothing was computed on this machine yet.\n"
    assert "no study.json" in shell.wrong_usage("compare", tmp_path, tmp_path)
    assert "crashfuse studies lists them" in shell.wrong_usage("compare", "012345", tmp_path)


def test_a_written_study_is_read_back(tmp_path: Path) -> None:
    """Whatever its tests are called: numbers and words that others take for missing, too."""
    ids = ["007", "1e5", "NA", "nan", "None", "null", "inf", "True"]
    config = {"approaches": ["cae"], "preset": "fast", "seed": 3, "windows_ms": [60.0]}
    config |= {"leave_out": "test", "device": "cpu"}
    advice = {"campaign": {"approach": "cae"}}
    record = {"campaign": "a", "fingerprint": "f", "config": config, "rating": "b", "recommendation": advice}
    (tmp_path / "study.json").write_text(json.dumps({**record, "finished": True}))
    rows = (f"{i},cae,60,0.5,Poor\n" for i in ids)
    (tmp_path / "scores.csv").write_text("".join(["held_out,approach,window_ms,overall,grade\n", *rows]))
    found = read_study(tmp_path)
    assert found.ratings == {test: {"cae": {60.0: 0.5}} for test in ids}
    assert (found.config.seed, found.approach, found.condition) == (3, "cae", None)


def test_a_series_is_summed_up_by_one_way_of_leaving_out() -> None:
    """As its heading says, over the longest window; the range is that of the seeds."""
    columns = ["campaign", "preset", "seed", "approach", "left_out", "window_ms", "mean"]
    rows = [
        ("alpha", "fast", seed, "cae", way, window, mean + seed / 10)
        for seed in (0, 1)
        for way, window, mean in (("test", 40.0, 0.7), ("test", 60.0, 0.6), ("speed group", 60.0, 0.3))
    ]
    assert _summary([pd.DataFrame(rows, columns=columns)]).split()[-1] == "0.600–0.700"
