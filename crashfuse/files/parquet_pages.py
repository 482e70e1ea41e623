"""What a Parquet file unpacks to, from the headers of its pages, before any page is decoded.

A megabyte may hold gigabytes of text. What the footer says of that is not trusted: the pages themselves say it, and a
decoder believes them. A page's header is a Thrift struct in the compact protocol (Apache Parquet, ``parquet.thrift``).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import pyarrow.parquet as pq

from crashfuse.errors import DataError, Problem

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
_AGAIN = "export it again"


@dataclass(frozen=True, slots=True)
class _Page:
    size: int
    encoding: int | None


def check_size(path: Path, where: str, columns: Sequence[str]) -> set[str]:
    """Raise a DataError if decoding these columns would take far more memory than tables of pulses need.

    Returns the columns that pyarrow cannot read as dictionaries, for want of a decoder.
    """
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
                for page in _pages(stream, min(first, chunk.data_page_offset), chunk.total_compressed_size, where):
                    total, pages = total + page.size, pages + 1
                    if total > most:
                        expected, found = f"at most {most >> 20} MiB of values", "more, once unpacked"
                        raise DataError(Problem(where, expected, found, "shorten the texts", name))
                    if pages > _MOST_PAGES:
                        raise DataError(Problem(where, f"at most {_MOST_PAGES} pages", "more", _AGAIN, name))
                    if page.encoding == _DELTA_BYTE_ARRAY:
                        expected, found = "values that are written out", "the encoding DELTA_BYTE_ARRAY"
                        raise DataError(Problem(where, expected, found, "export it with a dictionary", name))
                    if page.encoding == _DELTA_LENGTH_BYTE_ARRAY:
                        written_out.add(name)
    return written_out


def _pages(stream: IO[bytes], start: int, length: int, where: str) -> Iterator[_Page]:
    """The pages of a column chunk."""
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
            raise DataError(Problem(where, "a sound Parquet file", "a damaged one (page header)", _AGAIN)) from error
        data = next((field for field in _ENCODING if field in header.inner), None)
        yield _Page(size, None if data is None else header.inner[data].get(_ENCODING[data]))
        start += header.at + packed


class _Header:
    """Reader of a Thrift struct: integers of its fields, and those of the structs in it as ``inner``."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self.at = 0
        self.inner: dict[int, dict[int, int]] = {}

    def struct(self, depth: int = 0) -> dict[int, int]:
        """The integers of a struct by field; raises IndexError if it goes on beyond the content."""
        fields: dict[int, int] = {}
        number = 0
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
