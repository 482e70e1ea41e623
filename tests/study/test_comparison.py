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
    given = {"fingerprint": "a", "basis": "ISO/TS 18571:2024", "ratings": ratings, "config": StudyConfig(), **changes}
    return PastResult("alpha", approach="fused", date="2030-01-01T00:00:00+00:00", **given)  # type: ignore[arg-type]


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


def test_a_clear_gain_is_called_one_and_a_lucky_one_is_not() -> None:
    """The same mean gain of 0.02: in every test alike, or in one test alone."""
    steady = StudyComparison(study(FIRST), study({t: r + 0.02 + 0.001 * i for i, (t, r) in enumerate(FIRST.items())}))
    lucky = StudyComparison(study(FIRST), study({**FIRST, "T4": 0.68}))
    assert steady.sentences()[0].startswith("Fused: the second is better; mean 0.772 in the second, 0.750 in the first")
    assert lucky.sentences()[0].startswith("Fused: no clear difference;")
    assert "differs most in T4 (+0.080)" in lucky.sentences()[0]
    assert lucky.sentences()[1] == "CAE: the same in both, mean 0.500."
    worse = StudyComparison(steady.second, steady.first)
    assert "the first is better" in worse.sentences()[0]


def test_windows_and_ways_are_compared_like_with_like() -> None:
    """The shorter window on request; speed groups with speed groups, and what only one has is left out."""
    both = study(FIRST, config=StudyConfig(leave_out="both"), speed_groups={"T1": {"fused": {60.0: 0.3}}})
    groups = study({}, config=StudyConfig(leave_out="speed group"), ratings={"T1": {"fused": {60.0: 0.4}}})
    compared = StudyComparison(both, groups)
    assert compared.ways == ["speed group"]
    assert compared.ratings["difference"].tolist() == pytest.approx([0.1])
    assert compared.sentences() == (
        "Fused: mean 0.400 in the second, 0.300 in the first, a difference of +0.100 in one test.",
    )
    assert StudyComparison(both, both).means(40.0)["first"].tolist() == pytest.approx([0.80])


def test_other_data_and_another_basis_are_said() -> None:
    """Ids alone don't make two tests the same."""
    other = study(FIRST, fingerprint="b", basis="ISO/TS 18571:2024, CFC 60")
    first, second = StudyComparison(study(FIRST), other).cautions
    assert "data differ" in first
    assert "CFC 60" in second


def test_two_without_anything_in_common_are_refused() -> None:
    """Other tests, or left out in another way."""
    for other in (study({"T9": 0.5}), study(FIRST, config=StudyConfig(leave_out="speed group"))):
        with pytest.raises(UsageError, match="no rating in common"):
            StudyComparison(study(FIRST), other)
