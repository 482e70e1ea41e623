"""Pulses are added to a tidy table in its own columns and units, and what was there stays."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crashfuse.campaign_folder.tidy_tables import append_to_table
from crashfuse.errors import DataError
from crashfuse.signals.pulse import Pulse

NEW = Pulse(np.array([0.0, 0.001, 0.002]), np.array([0.0, -98.0665, -196.133]))
HEADER = "run,id,acceleration_g,time_ms,sensor"
OLD = [("1", "A", "0.5", "0.0", "x"), ("1", "A", "-1.5", "1.0", "x"), ("2", "B", "-2.5", "0.0", "y")]


def table(path: Path, ids: str = "id") -> Path:
    """A table of two runs, in g and ms, with columns of its own."""
    if path.suffix == ".csv":
        path.write_text("\n".join([HEADER.replace("id", ids), *(",".join(row) for row in OLD)]) + "\n")
    else:
        frame = pd.DataFrame(OLD, columns=HEADER.replace("id", ids).split(","))
        frame = frame.astype({"acceleration_g": "float32", "time_ms": float})
        frame.to_parquet(path, index=False)
    return path


def append(path: Path, pulses: Sequence[tuple[str, Pulse]]) -> None:
    """Have the table with more pulses in its place."""
    new = path.with_name("new")
    append_to_table(path, new, pulses)
    new.replace(path)


def rows_of(path: Path) -> pd.DataFrame:
    """What the table holds; text is text."""
    return pd.read_csv(path, dtype={"run": str, "id": str}) if path.suffix == ".csv" else pd.read_parquet(path)


@pytest.mark.parametrize("name", ["cae_pulses.csv", "cae_pulses.parquet"])
def test_new_rows_follow_in_the_tables_own_units_and_are_empty_in_other_columns(tmp_path: Path, name: str) -> None:
    """Time in ms, acceleration in g, whatever the order of columns; old rows are as they were."""
    path = table(tmp_path / name)
    before = rows_of(path)
    append(path, [("007", NEW), ("D", NEW)])
    after = rows_of(path)
    assert list(after) == HEADER.split(",")
    pd.testing.assert_frame_equal(after[:3], before)
    assert after["id"][3:].tolist() == ["007"] * 3 + ["D"] * 3
    np.testing.assert_allclose(after["time_ms"][3:], [0.0, 1.0, 2.0] * 2)
    np.testing.assert_allclose(after["acceleration_g"][3:], [0.0, -10.0, -20.0] * 2, rtol=1e-6)
    assert after[["run", "sensor"]][3:].isna().all(axis=None)
    assert [other.name for other in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["cae_pulses.csv", "cae_pulses.parquet"])
def test_rows_that_an_import_left_behind_are_replaced(tmp_path: Path, name: str) -> None:
    """Those of the same id; others stay, in their order."""
    path = table(tmp_path / name)
    append(path, [("A", NEW)])
    after = rows_of(path)
    assert after["id"].tolist() == ["B", "A", "A", "A"]
    np.testing.assert_allclose(after["acceleration_g"], [-2.5, 0.0, -10.0, -20.0], rtol=1e-6)


def test_the_kinds_of_columns_stay(tmp_path: Path) -> None:
    """Ids kept as dictionaries or as numbers, and accelerations in single precision."""
    schema = pa.schema([("id", pa.dictionary(pa.int32(), pa.string())), ("time_s", pa.float64())])
    schema = schema.append(pa.field("acceleration_mps2", pa.float32()))
    pq.write_table(pa.table([["A"], [0.0], [-1.0]], schema=schema), tmp_path / "a.parquet")
    append(tmp_path / "a.parquet", [("B", NEW)])
    found = pq.read_table(tmp_path / "a.parquet")
    assert found.schema.equals(schema)
    assert found.column("id").to_pylist() == ["A", "B", "B", "B"]
    assert found.column("time_s").to_pylist() == [0.0, 0.0, 0.001, 0.002]
    numbers = pa.table({"id": [7], "time_s": [0.0], "acceleration_g": [-1.0]})
    pq.write_table(numbers, tmp_path / "n.parquet")
    append(tmp_path / "n.parquet", [("8", NEW)])
    assert pq.read_table(tmp_path / "n.parquet").column("id").to_pylist() == [7, 8, 8, 8]
    before = (tmp_path / "n.parquet").read_bytes()
    with pytest.raises(DataError, match=r"n\.parquet: expected a table that can be added to"):
        append(tmp_path / "n.parquet", [("T9", NEW)])
    assert (tmp_path / "n.parquet").read_bytes() == before


@pytest.mark.parametrize("header", ["id,time_ms", "id,acceleration_g", "id,time_ms,time_s,acceleration_g", "", "x,y"])
def test_a_table_without_its_columns_is_refused_and_stays(tmp_path: Path, header: str) -> None:
    """One of time, one of acceleration, and the ids."""
    path = tmp_path / "tests_pulses.csv"
    path.write_text(f"{header}\n")
    with pytest.raises(DataError, match=r"tests_pulses\.csv: expected (a column id|one column time_)"):
        append(path, [("A", NEW)])
    assert path.read_text() == f"{header}\n"


def test_what_a_person_typed_is_read_as_meant(tmp_path: Path) -> None:
    """Spaces after commas and around names, a byte-order mark, and lines without anything."""
    path = tmp_path / "tests_pulses.csv"
    path.write_bytes("\ufeffid , time_ms, acceleration_g\n A, 0, -1\n\nB , 0, -2\n".encode())
    append(path, [("A", NEW)])
    after = pd.read_csv(path, skip_blank_lines=True)
    assert list(after) == ["id", "time_ms", "acceleration_g"]
    assert [str(run).strip() for run in after["id"]] == ["B", "A", "A", "A"]
