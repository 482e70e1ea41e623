"""Conditions in a sentence can be read at a glance, however many there are."""

from crashfuse.reporting.evidence_sentences import listed_conditions

ROWS = [f"M{i:04}" for i in range(1, 2001)]


def test_a_few_conditions_are_told_one_by_one() -> None:
    """Also neighbours with the same answer; an answer that needs no words has no brackets."""
    assert listed_conditions(ROWS, {"M0001": "crush", "M0002": "crush"}) == "M0001 (crush), M0002 (crush)"
    assert listed_conditions(ROWS, dict.fromkeys(ROWS[:6], "")) == "M0001, M0002, M0003, M0004, M0005, M0006"


def test_of_many_neighbours_with_the_same_answer_are_a_range() -> None:
    """What most of them share comes first; two neighbours are no range, and a row between that is not told ends one."""
    answers = {"M0001": "peak"} | dict.fromkeys(ROWS[2:10], "crush") | {"M0012": "crush", "M0013": "peak"}
    assert listed_conditions(ROWS, answers) == "M0003 to M0010, M0012 (crush); M0001, M0013 (peak)"
    assert listed_conditions(ROWS, dict.fromkeys((*ROWS[:5], *ROWS[6:8]), "")) == "M0001 to M0005, M0007, M0008"


def test_of_two_thousand_in_no_order_the_first_ranges_are_told_and_where_all_of_them_are() -> None:
    """Never a paragraph; all of them and the rest are counted."""
    assert listed_conditions(ROWS, dict.fromkeys(ROWS, "0.97 or more")) == "M0001 to M2000 (0.97 or more)"
    told = listed_conditions(ROWS, {i: "peak" if place % 3 else "crush" for place, i in enumerate(ROWS)}, "x.csv")
    assert told.startswith("2,000 conditions, M0002, M0003, M0005, M0006, ")
    assert told.endswith(" (peak) and 1,984 more, all in x.csv")
    assert len(told) < 200
