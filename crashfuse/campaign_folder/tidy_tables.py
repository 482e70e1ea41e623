"""Adding pulses to, and removing them from, a tidy table in its own columns and units, batch by batch."""

import csv
from collections.abc import Mapping, Sequence, Set
from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from crashfuse.errors import DataError, Problem
from crashfuse.files.csv_output import original, write_rows
from crashfuse.files.parquet_pages import check_size
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.units import ACCELERATION, TIME


def append_to_table(path: Path, to: Path, pulses: Sequence[tuple[str, Pulse]], without: Sequence[str] = ()) -> None:
    """Write ``<role>_pulses.parquet`` or ``.csv`` with more pulses, and without those of some ids, to another path.

    Rows with the ids of added pulses, which no row of the condition table names, are replaced. A DataError says what
    the table lacks.
    """
    gone = {*without, *(run_id for run_id, _ in pulses)}
    try:
        (_append_parquet if path.suffix == ".parquet" else _append_csv)(path, to, pulses, gone)
    except (pa.ArrowException, UnicodeDecodeError, csv.Error) as error:
        found = " ".join(str(error).split())[:200]
        raise DataError(Problem(path.name, "a table that can be added to", found, "repair it first")) from None


def _append_parquet(path: Path, to: Path, pulses: Sequence[tuple[str, Pulse]], gone: Set[str]) -> None:
    with pq.ParquetFile(path) as file:
        schema = file.schema_arrow
        check_size(path, path.name, schema.names)
        out = pa.array(sorted(gone), pa.string())
        with pq.ParquetWriter(to, schema, compression="zstd") as writer:
            for batch in file.iter_batches():
                ids = batch.column("id").cast(pa.string())
                writer.write_batch(batch.filter(pc.invert(pc.is_in(ids, value_set=out))))
            for run_id, pulse in pulses:
                columns = _columns(schema.names, pulse, path.name)
                size = pulse.time_s.size
                arrays = [
                    _ids(run_id, size, field.type)
                    if field.name == "id"
                    else pa.array(columns[field.name]).cast(field.type)
                    if field.name in columns
                    else pa.nulls(size, field.type)
                    for field in schema
                ]
                writer.write_table(pa.table(arrays, schema=schema))


def _ids(run_id: str, size: int, kind: pa.DataType) -> pa.Array:
    texts = pa.array([run_id] * size, pa.string())
    return texts.dictionary_encode().cast(kind) if pa.types.is_dictionary(kind) else texts.cast(kind)


def _append_csv(path: Path, to: Path, pulses: Sequence[tuple[str, Pulse]], gone: Set[str]) -> None:
    with (
        path.open(encoding="utf-8-sig", newline="") as old,
        to.open("w", encoding="utf-8", newline="") as stream,
    ):
        rows = csv.reader(old, skipinitialspace=True)
        header = [original(cell.strip()) for cell in next(rows, [])]
        if "id" not in header:
            raise DataError(Problem(path.name, "a column id", "none", "repair it first"))
        at = header.index("id")
        kept = ([*map(original, row)] for row in rows if len(row) <= at or row[at].strip() not in gone)
        write_rows(stream, chain([header], kept))
        for run_id, pulse in pulses:
            columns = _columns(header, pulse, path.name)
            numbers = {name: [repr(value) for value in values.tolist()] for name, values in columns.items()}
            of_name = {"id": [run_id] * pulse.time_s.size, **numbers}
            empty = [""] * pulse.time_s.size
            write_rows(stream, zip(*(of_name.get(name, empty) for name in header), strict=True))


def _columns(names: Sequence[str], pulse: Pulse, where: str) -> Mapping[str, FloatArray]:
    """Time and acceleration in the columns and units of a table."""
    wanted = {f"time_{unit}": pulse.time_s / factor for unit, factor in TIME.items()}
    wanted |= {f"acceleration_{unit}": pulse.accel_mps2 / factor for unit, factor in ACCELERATION.items()}
    columns = {name: np.asarray(wanted[name]) for name in names if name in wanted}
    if len(columns) != 2:
        found = ", ".join(names[:12])
        raise DataError(Problem(where, "one column time_… and one acceleration_…", found, "repair it first"))
    return columns
