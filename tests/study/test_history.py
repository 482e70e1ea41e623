"""What was computed is kept in small records, never in the way; two are compared, different only if clearly so."""

import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import DataError, UsageError
from crashfuse.execution.cache import Cache
from crashfuse.execution.run import Run
from crashfuse.study import history
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.history import LONGEST_NOTE, PastResult, Ratings, StudyComparison, annotate, keep, past_results
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
    """The oldest file makes room, predictions first: they are made again at once."""
    monkeypatch.setattr(history, "MOST", 3)
    for seed in range(5):
        result = replace(past, config=replace(past.config, seed=seed))
        keep(result)
        os.utime(home / f"{result.id}.json", (seed, seed))
    assert sorted(result.config.seed for result in past_results()) == [2, 3, 4]
    prediction = replace(past, ratings={}, condition=Condition.of_vector([10.0, 900.0, 700.0]))
    for result in (prediction, replace(past, fingerprint="another")):
        keep(result)
    assert all(result.tests for result in past_results())


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


FIRST = {"T1": 0.80, "T2": 0.70, "T3": 0.90, "T4": 0.60}


def study(overall: dict[str, float], **changes: object) -> PastResult:
    """A study of one approach over two windows; over the shorter one everything rates 0.05 higher."""
    ratings: Ratings = {test: {"fused": {40.0: r + 0.05, 60.0: r}, "cae": {60.0: 0.5}} for test, r in overall.items()}
    past = PastResult("alpha", "a", StudyConfig(), "ISO/TS 18571:2024", "fused", "2030-01-01T00:00:00+00:00", ratings)
    return replace(past, **changes)  # type: ignore[arg-type]


def raw(overall: dict[str, float], **changes: object) -> PastResult:
    return study({}, ratings={test: {"cae": {60.0: rating}} for test, rating in overall.items()}, **changes)


def test_the_difference_is_second_minus_first_with_its_standard_error() -> None:
    """Over the common tests, paired: what SciPy's t-test on the pairs has as its statistic."""
    second = {"T1": 0.85, "T2": 0.78, "T3": 0.91, "T5": 0.10}
    compared = StudyComparison(study(FIRST), study(second))
    fused = compared.means().set_index("approach").loc["fused"]
    common = ("T1", "T2", "T3")
    paired = stats.ttest_rel([second[t] for t in common], [FIRST[t] for t in common])
    assert fused["tests"] == 3
    assert fused["difference"] == pytest.approx(np.mean([0.05, 0.08, 0.01]))
    assert fused["difference"] / fused["standard_error"] == pytest.approx(paired.statistic)
    assert (fused["higher"], fused["lower"]) == (3, 0)
    assert "Only the first has T4." in compared.cautions
    assert "Only the second has T5." in compared.cautions


def test_windows_and_ways_are_compared_like_with_like() -> None:
    """The shorter window on request; speed groups with speed groups, and what only one has is left out."""
    both = study(FIRST, config=StudyConfig(leave_out="both"), speed_groups={"T1": {"fused": {60.0: 0.3}}})
    groups = study({}, config=StudyConfig(leave_out="speed group"), ratings={"T1": {"fused": {60.0: 0.4}}})
    compared = StudyComparison(both, groups)
    assert compared.ways == ["speed group"]
    assert compared.ratings["difference"].tolist() == pytest.approx([0.1])
    assert StudyComparison(both, both).means(40.0)["first"].tolist() == pytest.approx([0.80])


def test_a_test_left_out_alone_is_compared_with_itself_left_out_with_its_speed_group() -> None:
    alone, grouped = study({"T1": 0.6}), study({"T1": 0.8}, config=StudyConfig(leave_out="speed group"))
    for first, second, harder in ((alone, grouped, "second"), (grouped, alone, "first")):
        compared = StudyComparison(first, second)
        assert compared.ways == [", ".join([*first.by_way, *second.by_way])]
        assert f"The {harder} left out all tests at about a speed" in compared.cautions[0]
        assert compared.means()["first"].tolist()[0] == first.ratings["T1"]["fused"][60.0]
    assert StudyComparison(alone, alone).cautions == ()


def test_studies_of_two_vehicles_are_refused() -> None:
    """A test of one is not that of the other for having its name; a changed copy is the same vehicle."""
    with pytest.raises(UsageError, match="alpha and eta are not known to be one vehicle"):
        StudyComparison(raw({"T1": 0.5, "T2": 0.5}), raw({"T1": 0.6, "T2": 0.4}, campaign="eta", fingerprint="b"))
    fused = study({}, ratings={"T1": {"fused": {60.0: 0.8}}}, campaign="alpha 2", fingerprint="b")  # nothing tells
    with pytest.raises(UsageError, match="alpha and alpha 2 are not known to be one vehicle"):
        StudyComparison(study(FIRST), fused)
    copy = {"campaign": "copy of alpha", "fingerprint": "b"}
    one_test_more = StudyComparison(raw({"T1": 0.5}), raw({"T1": 0.5 + 4e-7, "T2": 0.4}, **copy))
    assert "Only the second has T2." in one_test_more.cautions
    renamed = study({}, ratings={"T1": {"fused": {60.0: 0.8}}}, campaign="copy of alpha")
    assert StudyComparison(study(FIRST), renamed).ways == ["test"]


def test_two_without_anything_in_common_are_refused() -> None:
    for other in (study({"T9": 0.5}), study({}, ratings={"T1": {"time_domain": {60.0: 0.5}}})):
        with pytest.raises(UsageError, match="no rating in common"):
            StudyComparison(study(FIRST), other)
