"""Two studies are compared test by test, and called different only if they clearly are."""

import numpy as np
import pytest
from scipy import stats

from crashfuse.errors import UsageError
from crashfuse.study.comparison import StudyComparison
from crashfuse.study.config import StudyConfig
from crashfuse.study.history import PastResult, Ratings

FIRST = {"T1": 0.80, "T2": 0.70, "T3": 0.90, "T4": 0.60}


def study(overall: dict[str, float], **changes: object) -> PastResult:
    """A study of one approach over two windows; over the shorter one everything rates 0.05 higher."""
    ratings: Ratings = {test: {"fused": {40.0: r + 0.05, 60.0: r}, "cae": {60.0: 0.5}} for test, r in overall.items()}
    given = {
        "campaign": "alpha", "fingerprint": "a", "basis": "ISO/TS 18571:2024", "ratings": ratings,
        "config": StudyConfig(), "date": "2030-01-01T00:00:00+00:00", **changes,
    }  # fmt: skip
    return PastResult(approach="fused", **given)  # type: ignore[arg-type]


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
    assert "Rated in the first only: T4." in compared.cautions
    assert "Rated in the second only: T5." in compared.cautions


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
    assert "Rated in the second only: T2." in one_test_more.cautions
    renamed = study({}, ratings={"T1": {"fused": {60.0: 0.8}}}, campaign="copy of alpha")
    assert StudyComparison(study(FIRST), renamed).ways == ["test"]


def test_two_without_anything_in_common_are_refused() -> None:
    for other in (study({"T9": 0.5}), study({}, ratings={"T1": {"time_domain": {60.0: 0.5}}})):
        with pytest.raises(UsageError, match="no rating in common"):
            StudyComparison(study(FIRST), other)
