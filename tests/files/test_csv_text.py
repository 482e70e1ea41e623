"""Tables that nobody should trust: what they may hold is bounded before it is held."""

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from crashfuse.errors import DataError
from crashfuse.files.csv_text import CsvTable, read_rows


@contextmanager
def little_memory(most_mb: float) -> Iterator[None]:
    """Raises if more than this was in use at a time."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most_mb * 1e6
    finally:
        tracemalloc.stop()


WIDE = ",".join(f"c{n}" for n in range(490))


@pytest.mark.parametrize(
    "text",
    [
        "id,speed_mph\n" + "T1,35\n" * 400_000,
        f"{WIDE}\n" + "T1,35\n" * 100_000,
        "id,speed_mph\n" + "\n" * 1_000_000,
        "id,text\n" + f"T1,{'x' * 90_000}\n" * 400,
        "id,text\n" + "x" * 200_000,
    ],
    ids=["rows", "cells", "empty lines", "characters", "no end"],
)
def test_a_table_larger_than_any_campaigns_is_refused_before_it_is_held(text: str, tmp_path: Path) -> None:
    """By rows, cells, lines, characters or the length of a line."""
    (tmp_path / "table.csv").write_text(text, encoding="utf-8")
    with little_memory(150), pytest.raises(DataError, match=r"table\.csv"):
        read_rows(tmp_path / "table.csv", "table.csv")


def test_rows_are_bounded_and_empty_lines_are_none(tmp_path: Path) -> None:
    """Five rows where five may be, whatever is empty after them; one more is one too many."""
    path = tmp_path / "table.csv"
    path.write_text("\ufeffid,speed_mph\n" + "T1,35\r\n" * 5 + "\n,\n" * 20, encoding="utf-8")
    names, rows, numbers = read_rows(path, "table.csv", most_rows=5)
    assert (names, rows, numbers) == (["id", "speed_mph"], [["T1", "35"]] * 5, [2, 3, 4, 5, 6])
    with pytest.raises(DataError, match="at most 4 rows"):
        read_rows(path, "table.csv", most_rows=4)


def test_short_lines_of_a_wide_table_do_not_fill_the_memory(tmp_path: Path) -> None:
    """300 kB of empty lines under 490 columns would be 150 million cells; a few of them are as good as none."""
    path = tmp_path / "pulse.csv"
    path.write_text(f"{WIDE}\n" + "\n" * 300_000, encoding="utf-8")
    with little_memory(50), pytest.raises(DataError, match="lines with far fewer"), CsvTable.opened(path, "p") as table:
        next(table.blocks(["c0", "c1"]))
    path.write_text(f"{WIDE}\n" + "1,2\n" * 100, encoding="utf-8")
    with CsvTable.opened(path, "p") as table:
        ((frame, rows),) = table.blocks(["c0", "c1"])
    assert (frame.to_numpy(dtype=float) == [1, 2]).all()
    assert rows.tolist() == list(range(2, 102))
