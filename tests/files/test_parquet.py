"""Parquet tables are read whatever wrote them, and what they unpack to is bounded before it is unpacked."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crashfuse.errors import DataError
from crashfuse.files import parquet
from crashfuse.files.parquet import ParquetTable, check_size

ROWS = 30_000


def table(ids: pa.Array, path: Path, **options: Any) -> Path:
    samples = {"time_ms": np.arange(len(ids)) * 0.1, "acceleration_g": np.sin(np.arange(len(ids)))}
    pq.write_table(pa.table({"id": ids, **samples}), path, **options)
    return path


@pytest.mark.parametrize("compression", ["none", "snappy", "gzip", "brotli", "lz4", "zstd"])
@pytest.mark.parametrize(
    "form",
    [
        {},
        {"use_dictionary": False},
        {"data_page_version": "2.0", "data_page_size": 1000},
        {"write_statistics": False, "row_group_size": 777},
        {"use_dictionary": False, "column_encoding": {"id": "DELTA_LENGTH_BYTE_ARRAY", "time_ms": "BYTE_STREAM_SPLIT"}},
        {"dictionary_pagesize_limit": 500, "write_page_checksum": True},
    ],
)
def test_the_headers_of_its_pages_say_what_a_column_unpacks_to(
    tmp_path: Path, compression: str, form: dict[str, Any]
) -> None:
    """Page after page to the end of each column; all of them, with their headers, are what the footer says."""
    ids = pa.array([f"run {i // 100:04d}" for i in range(ROWS)])
    path = table(ids, tmp_path / "t.parquet", compression=compression, **form)
    check_size(path, path.name, ["id", "time_ms", "acceleration_g"])
    with pq.ParquetFile(path) as file, path.open("rb") as stream:
        for group in range(file.metadata.num_row_groups):
            for at in range(3):
                chunk = file.metadata.row_group(group).column(at)
                start = chunk.dictionary_page_offset or chunk.data_page_offset
                pages = list(parquet._pages(stream, start, chunk.total_compressed_size, path.name))
                unpacked = sum(size for size, _ in pages)
                assert unpacked < chunk.total_uncompressed_size <= unpacked + 200 * len(pages)
    with ParquetTable.opened(path, path.name) as read:
        frames = [frame for frame, _ in read.blocks(["id", "time_ms"])]
    assert all(frame["id"].dtype == "category" for frame in frames)
    assert [run_id for frame in frames for run_id in frame["id"]] == ids.to_pylist()
    np.testing.assert_array_equal(np.concatenate([frame["time_ms"] for frame in frames]), np.arange(ROWS) * 0.1)


@pytest.mark.parametrize("column", ["id", "time_ms"])
@pytest.mark.parametrize("row_group_size", [1_000_000, 500])
@pytest.mark.slow
def test_a_small_file_of_long_texts_is_refused_unread(tmp_path: Path, column: str, row_group_size: int) -> None:
    """A hundred kilobytes that would be 160 MB as text, whatever its row groups."""
    texts = pa.array([f"{i:08d}{'x' * 7992}" for i in range(20_000)])
    path = tmp_path / "t.parquet"
    columns = {"id": pa.array(["A"] * 20_000), "time_ms": np.zeros(20_000), column: texts}
    pq.write_table(pa.table(columns), path, compression="zstd", row_group_size=row_group_size)
    assert path.stat().st_size < 500_000
    before = pa.total_allocated_bytes()
    with (
        pytest.raises(DataError, match=f"column {column}: expected at most 64 MiB of values, found more, unpacked"),
        ParquetTable.opened(path, path.name) as read,
    ):
        next(read.blocks(["id", "time_ms"]))
    assert pa.total_allocated_bytes() - before < 1 << 20


def test_texts_written_as_changes_of_the_one_before_are_refused(tmp_path: Path) -> None:
    ids = pa.array([f"{'x' * 8000}{i:08d}" for i in range(2000)])
    options = {"use_dictionary": False, "column_encoding": {"id": "DELTA_BYTE_ARRAY"}}
    path = table(ids, tmp_path / "t.parquet", **options)
    with pytest.raises(DataError, match="expected written-out values, found the encoding DELTA_BYTE_ARRAY"):
        check_size(path, path.name, ["id"])


def test_damaged_headers_of_pages_are_a_sentence(tmp_path: Path) -> None:
    path = table(pa.array(["A"] * 100), tmp_path / "t.parquet", compression="none")
    sound = path.read_bytes()
    refused = 0
    for at in range(4, 60):
        for byte in (0x00, 0x19, 0x1C, 0x7F, 0xFF):
            path.write_bytes(sound[:at] + bytes([byte]) + sound[at + 1 :])
            try:
                check_size(path, path.name, ["id", "time_ms", "acceleration_g"])
            except DataError as error:
                refused += str(error).count("\n") == 0
    assert refused > 20
