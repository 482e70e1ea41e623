"""Tables of the pages: numbers can be compared at a glance."""

import pandas as pd

from crashfuse.signals.metrics import Metric
from crashfuse.ui.tables import aligned

FIGURE_SPACE = "\u2007"  # as wide as a digit
POINT, BRACKET = "\u2008", "\u2004"  # as wide as a point or a bracket
UNBROKEN = "\N{NO-BREAK SPACE}"


def shown(cells: list[object]) -> tuple[bool, list[str]]:
    """True if a column stands at the right, and its cells as they are shown."""
    styler = aligned(pd.DataFrame({"Test": [f"T{i}" for i in range(len(cells))], "x": cells}).style)
    styler._compute()
    drawn = styler._translate(sparse_index=False, sparse_cols=False)
    styled = {cell for style in drawn["cellstyle"] for cell in style["selectors"] if "right" in str(style["props"])}
    assert not any(cell.endswith("col0") for cell in styled)  # names stay at the left
    assert any(style["selector"] == "th.col1" for style in drawn.get("table_styles", [])) == bool(styled)
    assert len(styled) in (0, len(cells))
    return bool(styled), [row[2]["display_value"] for row in drawn["body"]]


def test_numbers_end_at_one_place_before_intervals_that_are_lighter() -> None:
    """The shorter interval is filled up; what is missing has its place, too."""
    whole, tenth = 3 * FIGURE_SPACE, POINT + FIGURE_SPACE
    blank = f"{UNBROKEN}{BRACKET}{whole}{tenth}{POINT}{UNBROKEN}{whole}{tenth}{BRACKET}"
    assert shown(["9.1 [8.0, 10.2]", "608.8 [570.8, 621.7]", "–"]) == (
        True,
        [
            rf"9.1{UNBROKEN}:gray[\[8.0,{UNBROKEN}10.2\]]{3 * FIGURE_SPACE}",
            rf"608.8{UNBROKEN}:gray[\[570.8,{UNBROKEN}621.7\]]",
            "–" + blank,
        ],
    )


def test_an_open_interval_and_its_remark_are_numbers_too() -> None:
    """What is known of it is read as the value, the remark as its interval."""
    texts = [Metric("olc", None, lower, 15.3, "g").text for lower in (None, 12.1)]
    right, cells = shown([*texts, "12.0 [≥ 11.0]"])
    assert right
    assert [cell.replace(UNBROKEN, " ").rstrip(FIGURE_SPACE) for cell in cells[:2]] == [
        f"{known} :gray[(95 %, record too short)]" for known in ("≤ 15.3", "12.1–15.3")
    ]
    _, cells = shown(["29.0 [≤ 32.1]", "28.5 [27.0, 29.6]"])
    assert cells[0].endswith(f"]{2 * FIGURE_SPACE}{POINT}{POINT}")  # "27.0," is two digits, a point and a comma wider


def test_numbers_of_any_type_stand_at_the_right_and_words_at_the_left() -> None:
    """Counts, signed numbers and ranges are numbers; a rating with its grade begins with one, and stays in line.

    A dash stands for a number, in a column of nothing else, too.
    """
    assert shown([1, 20])[0]
    assert shown(["+0.28", "−1,200"])[0]
    assert shown(["0.86–0.94", "–"])[0]
    assert shown(["+0.075 ± 0.023", "−0.015"]) == (True, ["+0.075 ± 0.023", "−0.015"])
    assert not shown(["0.846 Good", "0.951 Excellent"])[0]
    assert shown(["11 of 11", "9 of 11"])[0]
    assert shown(["–", "–"])[0]
    assert not shown(["", ""])[0]
