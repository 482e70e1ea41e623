"""What was computed is kept in small records: found again, bounded, and never in the way."""

import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import DataError
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.study import history
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.history import LONGEST_NOTE, PastResult, annotate, keep, past_results
from crashfuse.study.running import run_study
from crashfuse.study.study import Study
from crashfuse.units import MPH

CONFIG = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(40.0, 60.0), leave_out="both")


@pytest.fixture(scope="module")
def finished(campaign: Campaign, shared_cache: Path) -> Study:
    """Two tests left out, alone and with their speed groups."""
    return run_study(campaign, CONFIG, held_out=["T2", "T4"], cache=Cache(shared_cache), workers=1)


@pytest.fixture
def past(finished: Study) -> PastResult:
    """The record of it."""
    return PastResult.of_study(finished)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the records."""
    monkeypatch.setattr(history, "_home", lambda: tmp_path)
    return tmp_path


def test_a_study_is_found_again_with_every_rating(finished: Study, past: PastResult) -> None:
    """To six digits, in both ways; the worst test and the mean are those of the study."""
    keep(past)
    (found,) = past_results()
    assert found == past
    for way, study in (("test", finished), ("speed group", finished.speed_groups)):
        assert study is not None
        for fold in study.folds:
            for name, by_window in fold.ratings.items():
                for window, rating in by_window.items():
                    assert found.by_way[way][fold.held_out][name][window] == pytest.approx(rating.overall, abs=1e-6)
    assert found.mean("cae", 60.0) == pytest.approx(finished.mean_rating("cae", 60.0), abs=1e-6)
    rated = {fold.held_out: fold.ratings["cae"][60.0].overall for fold in finished.folds}
    assert found.worst("cae", 60.0)[0] == min(rated, key=lambda test: rated[test])


def test_a_prediction_is_found_again_with_its_condition(campaign: Campaign, shared_cache: Path) -> None:
    """Speed and weights to nine digits, in whatever unit they were given."""
    fit = Fit.of(campaign, "displacement_domain", CONFIG, Run(Cache(shared_cache)))
    asked = Condition.of_vector([31.7 * MPH, 910.0, 790.5], (("drive", "2 wheels"),))
    past = PastResult.of_prediction(campaign, [fit.estimate(asked)], CONFIG)
    keep(past)
    (found,) = past_results()
    assert found.condition is not None
    assert found.condition.vector == pytest.approx(asked.vector, rel=1e-8)
    assert found.condition.factors == asked.factors
    assert found.ratings == {}
    assert found.expected == past.expected


def test_a_note_stays_when_the_result_is_found_again(past: PastResult) -> None:
    """It is one line of bounded length."""
    keep(past)
    annotate(past, "  before\n the rail " + "x" * 500)
    keep(past)
    (found,) = past_results()
    assert found.note.startswith("before the rail xxx")
    assert len(found.note) <= LONGEST_NOTE
    assert replace(found, note="") == past


def test_a_note_that_somebody_else_wrote_since_is_not_lost(past: PastResult) -> None:
    """Whose list still shows another is told; a record that was computed anew stays."""
    keep(past)
    annotate(past, "before the new rail")
    with pytest.raises(DataError, match="found “before the new rail”, which was written since"):
        annotate(past, "with the old barrier")
    assert past_results()[0].note == "before the new rail"
    anew = replace(past, basis="another basis")
    keep(anew)
    annotate(replace(past, note="before the new rail"), "with the old barrier")
    assert past_results() == [replace(anew, note="with the old barrier")]


def test_a_note_brings_no_forgotten_result_back(past: PastResult, home: Path) -> None:
    """A list that still shows it may be older than the records."""
    keep(past)
    (home / f"{past.id}.json").unlink()
    with pytest.raises(DataError, match="found one that was forgotten since"):
        annotate(past, "before the new rail")
    assert past_results() == []


def test_the_same_question_has_one_record_and_another_has_its_own(past: PastResult) -> None:
    """The seed, the preset, the tests and the data make a question; an answer found again keeps its date."""
    for result in (
        past,
        replace(past, date="2030-01-01T00:00:00+00:00"),
        replace(past, config=replace(past.config, seed=1)),
        replace(past, fingerprint="other"),
        replace(past, ratings={"T2": past.ratings["T2"]}),
    ):
        keep(result)
    assert len(past_results()) == 4
    assert {result.date for result in past_results()} == {past.date}
    better = replace(past, ratings={test: {**own, "cae": {40.0: 1.0, 60.0: 1.0}} for test, own in past.ratings.items()})
    keep(replace(better, date="2030-01-01T00:00:00+00:00"))  # by another version of the program
    assert len(past_results()) == 4
    assert past_results()[0].mean("cae", 60.0) == 1.0


def test_only_the_latest_are_kept(past: PastResult, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The oldest file makes room."""
    monkeypatch.setattr(history, "MOST", 3)
    for seed in range(5):
        result = replace(past, config=replace(past.config, seed=seed))
        keep(result)
        os.utime(home / f"{result.id}.json", (seed, seed))
    assert sorted(result.config.seed for result in past_results()) == [2, 3, 4]


@pytest.mark.parametrize(
    "change",
    [
        {"date": "yesterday"},
        {"campaign": 7},
        {"ratings": {"T2": {"cae": {"60": "nan"}}}},
        {"ratings": {"T2": {}}},
        {"ratings": [1, 2]},
        {"ratings": {}},
        {"config": {"seed": "0"}},
        {"config": {"preset": "slow"}},
        {"config": {"rm": 1}},
        {"condition": "35 mph"},
        {"expected": [1]},
    ],
)
def test_a_damaged_record_is_passed_over(past: PastResult, home: Path, change: dict[str, object]) -> None:
    """Cut off, of another form, or no JSON at all: the others are listed nevertheless."""
    keep(past)
    whole = (home / f"{past.id}.json").read_text(encoding="utf-8")
    (home / "cut.json").write_text(whole[:100], encoding="utf-8")
    (home / "deep.json").write_text("[" * 100_000, encoding="utf-8")
    (home / "bytes.json").write_bytes(b"\xff\x00")
    (home / "huge.json").write_text(whole + " " * 2_000_000, encoding="utf-8")
    (home / "changed.json").write_text(json.dumps({**json.loads(whole), **change}), encoding="utf-8")
    assert past_results() == [past]


def test_two_that_write_at_once_lose_nothing(past: PastResult, home: Path) -> None:
    """Each record is a file of its own, renamed when it is whole."""
    results = [replace(past, config=replace(past.config, seed=seed % 20)) for seed in range(60)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda result: keep(result), results))
    assert sorted(result.config.seed for result in past_results()) == list(range(20))
    assert {path.suffix for path in home.iterdir()} == {".json"}


def test_where_nothing_can_be_written_the_result_stands(
    past: PastResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk, or a folder of someone else, costs the record alone."""
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    monkeypatch.setattr(history, "_home", lambda: tmp_path / "file")
    keep(past)
    assert past_results() == []
