"""Untrusted Parquet tables: the requested columns, batch by batch, whatever their types."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.csv_text import require_file
from crashfuse.files.parquet_pages import check_size

_BATCH_ROWS = 1_000_000


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
            expected, found = "a table that fits into memory", "one that does not, or is damaged"
            raise DataError(Problem(where, expected, found, "close other programs, or export fewer runs")) from None
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            found = f"a damaged or another one ({printable(' '.join(str(error).split()), 80)})"
            raise DataError(Problem(where, "a sound Parquet file", found, "export it again")) from None

    def blocks(self, columns: Sequence[str]) -> Iterator[tuple[pd.DataFrame, npt.NDArray[np.int64]]]:
        """Yield these columns and the row number of each line, counted as if a header were row 1.

        Numbers become float64, text becomes categories, so that a long repeated text is in memory only once. A column
        that is neither, or occurs twice, raises a DataError.
        """
        texts = [name for name in columns if self._is_text(name)]
        if not self._rows:
            raise DataError(Problem(self._where, "at least one row", "an empty table", "add the rows"))
        written_out = check_size(self._path, self._where, columns)
        row = 2
        plain = [name for name in texts if name not in written_out | self._dictionaries()]
        with pq.ParquetFile(self._path, read_dictionary=plain) as file:
            for batch in file.iter_batches(batch_size=_BATCH_ROWS, columns=list(columns)):
                arrays = {
                    name: batch.column(name).cast(pa.float64(), safe=False)
                    if name not in texts
                    else batch.column(name).dictionary_encode()
                    if name in written_out
                    else batch.column(name)
                    for name in columns
                }
                yield pa.table(arrays).to_pandas(), row + np.arange(batch.num_rows)
                row += batch.num_rows
        pa.default_memory_pool().release_unused()  # it would keep 60 MB of a small file's blocks for the next one

    def _dictionaries(self) -> set[str]:
        return {field.name for field in self._schema if pa.types.is_dictionary(field.type)}

    def _is_text(self, name: str) -> bool:
        if self.names.count(name) > 1:
            raise DataError(Problem(self._where, f"one column {name}", "more of them", "keep one of them"))
        kind = self._schema.field(name).type
        values = kind.value_type if pa.types.is_dictionary(kind) else kind
        if pa.types.is_string(values) or pa.types.is_large_string(values) or pa.types.is_null(values):
            return True
        if name == "id" and pa.types.is_integer(values):
            return True
        if name != "id" and (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
            return False
        expected = "text" if name == "id" else "numbers"
        raise DataError(Problem(self._where, expected, f"values of type {kind}", "export it again", name))
