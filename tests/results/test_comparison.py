"""Two studies beside each other: tables, figure and report have the numbers of the comparison."""

import re
from html import unescape

import numpy as np
import pytest

from crashfuse.results import comparison
from crashfuse.results.plots.ratings import rating_differences
from crashfuse.results.render.html import report
from crashfuse.study.config import StudyConfig
from crashfuse.study.history import StudyComparison
from tests.study.test_history import FIRST, study

SECOND = {"T1": 0.85, "T2": 0.66, "T3": 0.91}
BOTH = {"config": StudyConfig(leave_out="both"), "speed_groups": {"T1": {"fused": {40.0: 0.4, 60.0: 0.3}}}}


@pytest.fixture
def compared() -> StudyComparison:
    """Two studies with and without whole speed groups; the second lacks T4, and has another seed."""
    config = StudyConfig(leave_out="both", seed=7)
    return StudyComparison(study(FIRST, **BOTH), study(SECOND, **{**BOTH, "config": config}))


def test_the_figure_shows_every_difference_and_the_mean_with_two_standard_errors(compared: StudyComparison) -> None:
    figure = rating_differences(compared, 60.0, "test").figure()
    fused = next(trace for trace in figure.data if trace.name == "Fused")
    gains = [SECOND[test] - FIRST[test] for test in SECOND]
    assert list(fused.y) == pytest.approx([*gains, np.mean(gains)])
    assert np.round(fused.x).tolist() == [0, 1, 2, 3]
    assert fused.error_y.array[-1] == pytest.approx(2 * np.std(gains, ddof=1) / np.sqrt(3))
    assert not any(fused.error_y.array[:-1])
    assert figure.layout.yaxis.range is None


def test_the_report_tells_what_differs_and_what_the_studies_are(compared: StudyComparison) -> None:
    text = report(comparison.comparison_result(compared, 40.0))
    words = unescape(re.sub(r"<script>.*?</script>|<style>.*?</style>", "", text, flags=re.DOTALL))
    for sentence in (*compared.sentences(40.0, "test"), *compared.cautions):
        assert sentence in words
    assert "Each test left out alone: mean rating over 0–40 ms" in words
    assert "Each test left out with all at its speed" in words
    assert "fast, seed 7" in words
    assert f"crashfuse compare {compared.first.id} {compared.second.id} --report FILE" in words
    assert len(text.contents.figures) == 2
    assert not re.findall(r"(?:src|href)=[\"']?http", words)
    assert report(comparison.comparison_result(compared, 40.0)) == text


def test_studies_stand_beside_each_other(compared: StudyComparison) -> None:
    table = comparison.studies_table(compared.first, compared.second).texts().set_index("Study")
    assert table.loc["Settings"].tolist() == ["fast, seed 0", "fast, seed 7"]
    assert table.loc["What"].tolist() == ["study of 4 tests, each both ways", "study of 3 tests, each both ways"]
    assert table.loc["Mean rating"].tolist() == [f"{np.mean([*own.values()]):.3f}" for own in (FIRST, SECOND)]
    assert table.loc["Id"].tolist() == [compared.first.id, compared.second.id]


def test_a_result_is_told_from_the_same_tests_left_out_otherwise() -> None:
    alone, grouped = study({"T1": 0.6}), study({"T1": 0.8}, config=StudyConfig(leave_out="speed group"))
    assert comparison.described(alone) == "2030-01-01 00:00 · test T1 alone · fast, seed 0 · alpha"
    assert "test T1 with all at its speed" in comparison.described(grouped)
    (way,) = StudyComparison(alone, grouped).ways
    assert (
        comparison.left_out_in_words(way)
        == "Each test left out alone in the first, with all at its speed in the second"
    )


def test_a_single_test_has_ratings_and_no_mean() -> None:
    """Neither an error nor a count would say anything."""
    compared = StudyComparison(study({"T1": 0.6}), study({"T1": 0.8}))
    table = comparison.comparison_means(compared, 60.0, "test").texts().set_index("Approach")
    assert table.loc["Fused"].to_dict() == {"First": "0.600", "Second": "0.800", "Difference": "+0.200"}
