"""Acceptance criteria: what a file declares, and what is refused, each in a sentence."""

from dataclasses import asdict, astuple, replace
from pathlib import Path

import pytest

from crashfuse.certification.criteria import Costs, Criterion, criteria_of, criteria_text, likely_unit, read_criteria
from crashfuse.errors import DataError
from tests.conftest import not_none, problems_of

SOUND = """
confidence = 0.9

[[criterion]]
name = "crush"
metric = "max_crush"
unit = "mm"
at_most = 650

[[criterion]]
metric = "olc"
at_least = 10.5
at_most = 25.0

[[criterion]]
metric = "rating"
at_least = 0.8
"""


def criteria_file(folder: Path, text: str) -> Path:
    """A file of criteria."""
    path = folder / "criteria.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_declares_criteria_and_their_confidence(tmp_path: Path) -> None:
    """A criterion takes the metric's name unless it has its own; a rating is over 60 ms unless a window is given."""
    found = read_criteria(criteria_file(tmp_path, SOUND))
    assert found.confidence == 0.9
    assert found.items == (
        Criterion("crush", "max_crush", at_most=650.0),
        Criterion("olc", "olc", at_least=10.5, at_most=25.0),
        Criterion("rating", "rating", at_least=0.8, window_ms=60.0),
    )
    assert found.windows_ms == (60.0,)
    asked = read_criteria(criteria_file(tmp_path, f"[tolerances]\nspeed_kph = 0.5\n{CRUSH}at_most = 650"))
    assert astuple(not_none(asked.tolerances)) == (0.5, 0.0, 0.0)
    assert read_criteria(criteria_file(tmp_path, criteria_text(asked))) == replace(asked, declared=0.95)


@pytest.mark.parametrize(
    ("metric", "limit", "unit"),
    [("delta_v", 40, "mph"), ("delta_v", 49, ""), ("delta_v", 66, ""), ("delta_v", 17, "m/s"), ("delta_v", 300, ""),
     ("max_crush", 2.3, "inches"), ("max_crush", 6.2, "cm"), ("olc", 588, "m/s²"), ("t0", 40, ""), ("rating", 0.8, "")],
)  # fmt: skip
def test_a_limit_that_is_near_in_another_unit_alone_gets_that_unit(metric: str, limit: float, unit: str) -> None:
    """Tests show 58 to 66 of the metric's unit; 40 mph is 64 km/h, 17 m/s is 61 km/h."""
    assert likely_unit(Criterion("own", metric, at_most=limit), [58.0, 66.0]) == unit
    assert likely_unit(Criterion("own", metric, at_most=limit), []) == ""


def test_mappings_declare_the_same_criteria_as_a_file(tmp_path: Path) -> None:
    items = [
        {"name": "crush", "metric": "max_crush", "unit": "mm", "at_most": 650},
        {"metric": "olc", "at_least": 10.5, "at_most": 25.0},
        {"metric": "rating", "at_least": 0.8},
    ]
    assert criteria_of(items, 0.9) == read_criteria(criteria_file(tmp_path, SOUND))
    assert criteria_of(items).confidence == 0.95
    found = criteria_of(items, 0.9)
    assert read_criteria(criteria_file(tmp_path, criteria_text(found))) == found


@pytest.mark.parametrize(
    ("costs", "pays", "asked"),
    [(Costs(5, 100), 0.95, 0.95), (Costs(3, 4), 0.25, 0.5), (Costs(1, 1e9), 1 - 1e-9, 0.999999)],
)
def test_without_a_confidence_the_costs_ask_for_one(tmp_path: Path, costs: Costs, pays: float, asked: float) -> None:
    """One minus their ratio, as far as it can be asked for; one that is declared stays, and both are written."""
    found = criteria_of([{"metric": "peak", "at_most": 30}], costs=asdict(costs))
    assert (found.costs, found.confidence, found.declared) == (costs, asked, None)
    assert costs.confidence == pytest.approx(pays, rel=1e-12)
    stated = replace(found, declared=0.9)
    assert stated.confidence == 0.9
    for own in (found, stated):
        assert read_criteria(criteria_file(tmp_path, criteria_text(own))) == own


CRUSH = '[[criterion]]\nmetric = "max_crush"\n'
NO_COSTS = "expected costs test and wrong_answer, above 0, the wrong answer the dearer, found "


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "criteria.toml: expected at least one criterion, found none"),
        ("[[criterion]", "criteria.toml: expected a TOML file in UTF-8, found "),
        (f"{'[' * 3000}", "criteria.toml: expected a TOML file in UTF-8, found "),
        ("criterion = 3", "expected tables [[criterion]], found another value"),
        ("criterion = [3]", "expected tables [[criterion]], found another value"),
        ('[[criterion]]\nmetric = "hic"\nat_most = 3', "criterion 1: expected a metric of peak, peak_time, "),
        ('[[criterion]]\nmetric = ["olc"]\nat_most = 3', "criterion 1: expected a metric of peak, peak_time, "),
        ("[[criterion]]\nat_most = 3", "restitution or rating, found nothing; choose one of them."),
        (CRUSH, "criterion 1: expected at_least or at_most, found neither; add a limit."),
        (f'{CRUSH}unit = "m"\nat_most = 0.65', "expected limits of max_crush in mm, found m; convert the limits."),
        (f"{CRUSH}at_most = 0.45", "max_crush in mm, found 0.45; if 0.45 m is meant, write 450; else state the unit"),
        (f"{CRUSH}at_most = 650\nat_most_m = 0.65", "found at_most_m; remove or rename it; a limit is in the metric's"),
        (f'{CRUSH}at_most = "650 mm"', "expected a number of 0 or more for at_most, in mm, found '650 mm'; correct"),
        (f"{CRUSH}at_most = true", "expected a number of 0 or more for at_most, in mm, found True; correct the limit."),
        (f"{CRUSH}at_most = inf", "expected a number of 0 or more for at_most, in mm, found inf; correct the limit."),
        (f"{CRUSH}at_most = 0x1{'0' * 5000}", "criteria.toml, row 3: expected numbers of fewer than 1000 characters"),
        (f"{CRUSH}at_most = -1", "expected a number of 0 or more for at_most, in mm, found -1; correct the limit."),
        (f"{CRUSH}at_least = 700\nat_most = 600", "at_most of at least 700 mm, which is at_least, found 600 mm;"),
        (f"{CRUSH}at_most = 650\nwindow_ms = 60", "expected no window_ms, which only the rating has, found 60"),
        (f"{CRUSH}at_most = 650\nhint = 1", "the keys name, metric, unit, window_ms, at_least, at_most, found"),
        (f'{CRUSH}at_most = 650\nname = " "', "expected a name of at most 100 characters in one line"),
        (f"{CRUSH}at_most = 100\n{CRUSH}at_most = 200", "criterion 2: expected each name once, found 'max_crush' a"),
        (f'{CRUSH}at_most = 600\n{CRUSH}name = "deep"\nat_least = 700', "'max_crush' with at most 600 mm, 'deep' with"),
        (f'{CRUSH}at_most = 600\n{CRUSH}name = "again"\nat_most = 600', "expected each limit of max_crush once, found"),
        ('[[criterion]]\nmetric = "rating"\nat_least = 1.2', "for at_least, up to 1, found 1.2"),
        ('[[criterion]]\nmetric = "rating"\nunit = "g"\nat_least = 0.8', "expected no unit for rating, found g"),
        ('[[criterion]]\nmetric = "rating"\nwindow_ms = 150\nat_least = 0.8', "expected a window_ms from 10 to 100"),
        (f"confidence = 1\n{CRUSH}at_most = 650", "expected a confidence from 0.5 to 0.999999, found 1; 0.95 is usual"),
        (f"confidence = 0.4\n{CRUSH}at_most = 650", "expected a confidence from 0.5 to 0.999999, found 0.4"),
        (f'confidence = "0.95"\n{CRUSH}at_most = 650', "from 0.5 to 0.999999, found '0.95'"),
        (f'confidence = "high"\n{CRUSH}at_most = 650', "expected a confidence from 0.5 to 0.999999, found 'high'"),
        (f"sure = 0.95\n{CRUSH}at_most = 650", "expected confidence, [costs], [tolerances] and [[criterion]], found"),
        (f"costs = 3\n{CRUSH}at_most = 650", f"{NO_COSTS}3"),
        (f"tolerances = 3\n{CRUSH}at_most = 650", "tolerances from 0 to 5 (speed_kph), 0.1 (weight)"),
        (f"[tolerances]\nweight = 2.0\n{CRUSH}at_most = 650", "found weight 2"),
        (f"[tolerances]\nspeed_mph = 1.0\n{CRUSH}at_most = 650", "found speed_mph 1"),
        (f"[costs]\ntest = 5\n{CRUSH}at_most = 650", f"{NO_COSTS}test 5"),
        (f"[costs]\ntest = -1\nwrong_answer = 5\n{CRUSH}at_most = 650", f"{NO_COSTS}test -1, wrong_answer 5"),
        (f"[costs]\ntest = 5\nwrong_answer = 5\n{CRUSH}at_most = 650", f"{NO_COSTS}test 5, wrong_answer 5"),
        (f"[costs]\ntest = 5\nwrong = 9\n{CRUSH}at_most = 650", f"{NO_COSTS}test 5, wrong 9"),
    ],
)
def test_what_cannot_be_judged_is_refused_in_a_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    """File and criterion, what was expected, what was found, what to do."""
    [problem] = map(str, problems_of(lambda: read_criteria(criteria_file(tmp_path, text))))
    assert sentence in problem
    assert problem.startswith("criteria.toml")


def test_every_problem_of_a_file_is_told_at_once_and_another_file_is_one_sentence(tmp_path: Path) -> None:
    """Nobody has to correct one criterion to learn of the next; no file, no text, one far too large, too many."""
    text = f'confidence = 1\n{CRUSH}\n[[criterion]]\nmetric = "hic"\nat_most = 1000\n'
    assert len(problems_of(lambda: read_criteria(criteria_file(tmp_path, text)))) == 3
    (tmp_path / "criteria.toml").unlink()
    with pytest.raises(DataError, match=r"criteria\.toml: expected this file, found no such file"):
        read_criteria(tmp_path / "criteria.toml")
    (tmp_path / "criteria.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match=r"criteria\.toml"):
        read_criteria(tmp_path / "criteria.toml")
    with pytest.raises(DataError, match="at most 1 MiB"):
        read_criteria(criteria_file(tmp_path, "#" * (1 << 21)))
    with pytest.raises(DataError, match="at most 100 criteria, found 101"):
        criteria_of([{"name": f"{i}", "metric": "peak", "at_most": 30} for i in range(101)])
