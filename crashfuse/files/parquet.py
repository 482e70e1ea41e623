"""Untrusted Parquet tables: the requested columns, batch by batch, once it is known what their pages unpack to."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import IO, Self

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.errors import KEEP_ONE, printable, refusal, refuse_if
from crashfuse.files.csv_text import CsvTable, require_file

_BATCH_ROWS = 1_000_000
_HARMLESS = 64 << 20  # bytes of a column that may always be decoded
_MOST_BYTES_A_ROW = 200  # beyond: the longest id, written out in each row
_MOST_PAGES = 200_000
_LONGEST_HEADER = 1 << 20  # it may quote the page's smallest and largest text
_DEEPEST = 8
_SIZE, _PACKED_SIZE, _DATA, _DATA_V2 = 2, 3, 5, 8  # fields of a header
_ENCODING = {_DATA: 2, _DATA_V2: 4}  # a field of these structs
_DELTA_LENGTH_BYTE_ARRAY = 6
_DELTA_BYTE_ARRAY = 7  # a text as what differs from the one before it: any length from a byte
_STRUCT = 12
_AGAIN, EMPTY = "export it again", ("an empty table", "add the rows")
UNSOUND = "a sound Parquet file", "a damaged or another one"


class ParquetTable:
    """A Parquet file read in batches; ``names`` are its columns."""

    def __init__(self, path: Path, where: str) -> None:
        self._path, self._where = path, where
        with pq.ParquetFile(path) as file:
            self._schema, self._rows = file.schema_arrow, file.metadata.num_rows
        self.names = list(self._schema.names)

    @classmethod
    @contextmanager
    def opened(cls, path: Path, where: str) -> Iterator[Self]:
        """Open a file; a DataError if it is not a valid Parquet file (:meth:`blocks` may raise it too)."""
        require_file(path, where)
        try:
            yield cls(path, where)
        except MemoryError:
            trouble = "one that does not", "close other programs, or export fewer runs"
            raise refusal(where, "a table that fits into memory", *trouble) from None
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            found = f"{UNSOUND[1]} ({printable(' '.join(str(error).split()), 80)})"
            raise refusal(where, UNSOUND[0], found, _AGAIN) from None

    def blocks(self, columns: Sequence[str]) -> Iterator[tuple[pd.DataFrame, npt.NDArray[np.int64]]]:
        """Yield these columns and the row numbers, as if a header were 1: float64, and categories for text."""
        texts = [name for name in columns if self._is_text(name)]
        refuse_if(not self._rows, self._where, "at least one row", *EMPTY)
        written_out = check_size(self._path, self._where, columns)
        row = 2
        dictionaries = {field.name for field in self._schema if pa.types.is_dictionary(field.type)}
        plain = [name for name in texts if name not in written_out | dictionaries]
        with pq.ParquetFile(self._path, read_dictionary=plain) as file:
            for batch in file.iter_batches(batch_size=_BATCH_ROWS, columns=list(columns)):
                arrays = {name: batch.column(name) for name in columns}
                arrays |= {name: arrays[name].dictionary_encode() for name in columns if name in written_out}
                arrays |= {name: of.cast(pa.float64(), safe=False) for name, of in arrays.items() if name not in texts}
                yield pa.table(arrays).to_pandas(), row + np.arange(batch.num_rows)
                row += batch.num_rows
        pa.default_memory_pool().release_unused()  # it would keep 60 MB of a small file's blocks for the next one

    def _is_text(self, name: str) -> bool:
        refuse_if(self.names.count(name) > 1, self._where, f"one column {name}", "more of them", KEEP_ONE)
        kind = self._schema.field(name).type
        values = kind.value_type if pa.types.is_dictionary(kind) else kind
        if pa.types.is_string(values) or pa.types.is_large_string(values) or pa.types.is_null(values):
            return True
        if name == "id" and pa.types.is_integer(values):
            return True
        if name != "id" and (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
            return False
        raise refusal(self._where, "text" if name == "id" else "numbers", f"values of type {kind}", _AGAIN, name)


def opened_table(path: Path, where: str) -> AbstractContextManager[ParquetTable | CsvTable]:
    """Open a table in either form."""
    return (ParquetTable if path.suffix == ".parquet" else CsvTable).opened(path, where)


def check_size(path: Path, where: str, columns: Sequence[str]) -> set[str]:
    """The columns that pyarrow cannot read as dictionaries; a DataError if decoding would take far too much memory."""
    written_out: set[str] = set()
    with pq.ParquetFile(path) as file, path.open("rb") as stream:
        for at in range(file.metadata.num_columns):
            name = file.metadata.schema.column(at).path.partition(".")[0]
            if name not in columns:
                continue
            chunks = [file.metadata.row_group(group).column(at) for group in range(file.metadata.num_row_groups)]
            total, pages, most = 0, 0, max(_HARMLESS, _MOST_BYTES_A_ROW * file.metadata.num_rows)
            for chunk in chunks:
                first = chunk.dictionary_page_offset or chunk.data_page_offset
                begin = min(first, chunk.data_page_offset)
                for size, encoding in _pages(stream, begin, chunk.total_compressed_size, where):
                    total, pages = total + size, pages + 1
                    if total > most:
                        expected = f"at most {most >> 20} MiB of values"
                        raise refusal(where, expected, "more, unpacked", "shorten the texts", name)
                    refuse_if(pages > _MOST_PAGES, where, f"at most {_MOST_PAGES} pages", "more", _AGAIN, name)
                    if encoding == _DELTA_BYTE_ARRAY:
                        trouble = "written-out values", "the encoding DELTA_BYTE_ARRAY", "export it with a dictionary"
                        raise refusal(where, *trouble, name)
                    if encoding == _DELTA_LENGTH_BYTE_ARRAY:
                        written_out.add(name)
    return written_out


def _pages(stream: IO[bytes], start: int, length: int, where: str) -> Iterator[tuple[int, int | None]]:
    """Unpacked size and encoding; headers are Thrift structs (``parquet.thrift``)."""
    end = start + length
    while start < end:
        stream.seek(start)
        header = _Header(stream.read(4096))
        try:
            try:
                fields = header.struct()
            except IndexError:  # a long one
                stream.seek(start)
                header = _Header(stream.read(_LONGEST_HEADER))
                fields = header.struct()
            packed, size = fields[_PACKED_SIZE], fields[_SIZE]
            if packed < 0 or size < 0:
                raise ValueError("a negative size")
        except (IndexError, KeyError, ValueError) as error:
            raise refusal(where, *UNSOUND, _AGAIN) from error
        data = next((field for field in _ENCODING if field in header.inner), None)
        yield size, None if data is None else header.inner[data].get(_ENCODING[data])
        start += header.at + packed


class _Header:
    """Integers of a Thrift struct's fields, and of the structs in it as ``inner``."""

    def __init__(self, content: bytes) -> None:
        self._content, self.at = content, 0
        self.inner: dict[int, dict[int, int]] = {}

    def struct(self, depth: int = 0) -> dict[int, int]:
        fields, number = dict[int, int](), 0
        while head := self._byte():
            kind = head & 0x0F
            number = number + (head >> 4) if head >> 4 else self._integer()
            if kind == _STRUCT and depth == 0:
                self.inner[number] = self.struct(1)
            elif (value := self._value(kind, depth)) is not None:
                fields[number] = value
        return fields

    def _value(self, kind: int, depth: int) -> int | None:
        if depth > _DEEPEST:
            raise ValueError("structs too deep")
        if kind in (1, 2):
            return 2 - kind
        if kind == 3:
            return self._byte()
        if kind in (4, 5, 6):
            return self._integer()
        if kind == 7:
            self.at += 8
        elif kind == 8:
            length = self._unsigned()
            self.at += length
        elif kind == _STRUCT:
            self.struct(depth + 1)
        else:
            raise ValueError("a list, which no page has")
        return None

    def _byte(self) -> int:
        self.at += 1
        return self._content[self.at - 1]

    def _unsigned(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value
            if shift > 63:
                raise ValueError("a number without an end")

    def _integer(self) -> int:
        value = self._unsigned()
        return (value >> 1) ^ -(value & 1)
