"""A whole campaign folder written, and the text of its files; its tables as data frames."""

import csv
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from crashfuse.cae_library import QUALITIES, RunQuality
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import id_trouble
from crashfuse.campaign_folder.load import WALL_COLUMNS, WALLS, read_folder
from crashfuse.campaign_folder.settings import QualitySettings, occupant_lines
from crashfuse.condition import QUANTITIES, About, Condition
from crashfuse.errors import DataError, Problem, as_path, refusal, refuse_if, require_a
from crashfuse.files.atomic import new_folder
from crashfuse.files.csv_text import csv_bytes, csv_text, original, write_rows
from crashfuse.files.parquet import UNSOUND, check_size
from crashfuse.files.toml_text import toml_text
from crashfuse.signals.pulse import GRID_S, N_SAMPLES, FloatArray, Pulse
from crashfuse.signals.wall import Wall
from crashfuse.units import ACCELERATION, KN, MS, TIME, G

_RUNS_A_BATCH, _REPAIR = 2000, "repair it first"
# what a folder's sentences call its files, as patterns, and what the arguments of a call are called
_IN_MEMORY = {
    r"^(tests|cae): pulses without a row in \1\.csv": r"\1_pulses: pulses without a row in \1",
    r"\b(tests|cae)/ or \1_pulses\b": r"\1_pulses",
    r"\b(tests|cae)_pulses\.parquet\b": r"\1_pulses",
    r"\btests_pulses\b": "test_pulses",
    r"\b(tests|cae|matrix)\.csv\b": r"\1",
    r"\bcampaign\.toml\b": "campaign",
    r"^sort the file\b": "sort the table",
}


def write_campaign(campaign: Campaign, folder: str | Path) -> None:
    """Write a campaign as a folder that reads back to the same fingerprint.

    Conditions are in SI units, tests in ``tests/<id>.csv``, CAE runs in ``cae_pulses.parquet``. Pulses that were
    filtered on reading are written filtered, which ``campaign.toml`` says; what is left out is not written. A DataError
    (the folder is not empty, an id is no file name) or an OSError leaves nothing behind.
    """
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    folder = as_path(folder, "the new campaign folder")
    check_ids([*campaign.test_ids, *campaign.cae.ids], folder.name)
    with new_folder(folder) as home:
        for role in ("tests", "cae"):
            header, lines = condition_rows(campaign, role, "mps", "kg")
            (home / f"{role}.csv").write_bytes(csv_text([header, *lines]).encode())
        (home / "tests").mkdir()
        for test in campaign.tests:
            (home / "tests" / f"{test.id}.csv").write_bytes(pulse_csv(test.pulse).encode())
        _write_runs(campaign, home / "cae_pulses.parquet")
        if walls := {test.id: test.wall for test in campaign.tests if test.wall is not None}:
            write_walls(home / WALLS["tests"], home / WALLS["tests"], walls)
        cfc = campaign.channel_filter_class
        settings = [f"name = {toml_text(campaign.name)}"]
        settings += [f"notice = {toml_text(campaign.notice)}"] if campaign.notice else []
        settings += [f"filtered_with = {cfc:g}"] if cfc is not None else []
        settings += occupant_lines(campaign.occupant)
        settings += QualitySettings(campaign.quality_limits, bool(campaign.cae.left_out)).lines()
        (home / "campaign.toml").write_bytes("\n".join([*settings, ""]).encode())


def condition_rows(campaign: Campaign, role: str, speed: str, weight: str) -> tuple[list[str], list[list[object]]]:
    """The columns and rows of ``tests.csv`` or ``cae.csv``, speeds and weights in these units."""
    rows = [(test.id, test.condition, further_cells(RunQuality(), test.statements)) for test in campaign.tests]
    if role == "cae":
        cae = campaign.cae
        quality, about = cae.quality or (RunQuality(),) * len(cae), cae.about or ((),) * len(cae)
        rows = list(zip(cae.ids, cae.conditions, map(further_cells, quality, about), strict=True))
    factors = list(dict.fromkeys(name for _, condition, _ in rows for name, _ in condition.factors))
    units = f"speed_{speed}", f"front_weight_{weight}", f"rear_weight_{weight}"
    header = ["id", *units, *factors, *further_columns([further for *_, further in rows])]
    return header, [table_row(header, *row) for row in rows]


def further_cells(quality: RunQuality, about: About) -> dict[str, object]:
    """What the solver says of a run, and where a test or run comes from, by column."""
    return {name: value for name in QUALITIES if (value := getattr(quality, name)) is not None} | dict(about)


def further_columns(rows: Sequence[Mapping[str, object]]) -> list[str]:
    """The columns of such cells, those of the solver first."""
    names = dict.fromkeys(name for row in rows for name in row)
    return [*(name for name in QUALITIES if name in names), *(name for name in names if name not in QUALITIES)]


def table_row(header: Sequence[str], run_id: str, condition: Condition, further: Mapping[str, object]) -> list[object]:
    """The cells of a condition in the columns of a table, empty for what it does not have."""
    cells: dict[str, object] = {"id": run_id, **dict(condition.factors), **further}
    for (quantity, units), value in zip(QUANTITIES.items(), condition.vector.tolist(), strict=True):
        for unit, factor in units.items():
            cells[f"{quantity}_{unit}"] = float(value) if factor == 1.0 else float(f"{value / factor:.12g}")
    return [cells.get(column, "") for column in header]


def pulse_csv(pulse: Pulse) -> str:
    """A pulse as CSV at full precision."""
    rows = zip(pulse.time_s.tolist(), pulse.accel_mps2.tolist(), strict=True)
    return "time_s,acceleration_mps2\n" + "".join(f"{t!r},{a!r}\n" for t, a in rows)


def _write_runs(campaign: Campaign, path: Path) -> None:
    kinds = {"id": pa.dictionary(pa.int32(), pa.string()), "time_s": pa.float64(), "acceleration_mps2": pa.float32()}
    schema = pa.schema([*kinds.items()])
    accel, ids = campaign.cae.accel_mps2, campaign.cae.ids
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for first in range(0, len(ids), _RUNS_A_BATCH):
            batch = accel[first : first + _RUNS_A_BATCH]
            numbers = np.repeat(np.arange(len(batch), dtype=np.int32), GRID_S.size)
            names = pa.DictionaryArray.from_arrays(numbers, pa.array(ids[first : first + len(batch)], pa.string()))
            columns = [names, np.tile(GRID_S, len(batch)), np.ascontiguousarray(batch).ravel()]
            writer.write_table(pa.table(columns, schema=schema))


def check_ids(ids: Sequence[str], where: str) -> None:
    """Raise a DataError if an id is not a valid file name."""
    problems = [Problem(where, *trouble, "id") for run_id in ids if (trouble := id_trouble(run_id)) is not None]
    if problems:
        raise DataError(problems[:20])


def write_walls(path: Path, to: Path, walls: Mapping[str, Wall | None]) -> None:
    """Write the forces of barriers to another path; None takes out those that are there already."""
    try:
        there = pd.read_parquet(path) if path.is_file() else None  # with any further columns
    except pa.ArrowException as error:
        raise refusal(path.name, *UNSOUND, _REPAIR) from error
    frames = [] if there is None else [there[~there["id"].isin([*walls])]]
    for test_id, wall in walls.items():
        if wall is not None:
            columns = (test_id, wall.time_s / MS, wall.force_n / KN)
            frames.append(pd.DataFrame(dict(zip(WALL_COLUMNS, columns, strict=True))))
    if len(rows := pd.concat(frames, ignore_index=True)):  # no file rather than an empty one, which is none
        rows.to_parquet(to, index=False)


def append_to_table(path: Path, to: Path, pulses: Sequence[tuple[str, Pulse]], without: Sequence[str] = ()) -> None:
    """Write ``<role>_pulses.parquet`` or ``.csv`` with more pulses (or others of an id), without some, elsewhere."""
    left_out = {*without, *(run_id for run_id, _ in pulses)}
    try:
        (_append_parquet if path.suffix == ".parquet" else _append_csv)(path, to, pulses, left_out)
    except (pa.ArrowException, UnicodeDecodeError, csv.Error) as error:
        raise refusal(path.name, "a table that can be added to", " ".join(str(error).split())[:200], _REPAIR) from None


def _append_parquet(path: Path, to: Path, pulses: Sequence[tuple[str, Pulse]], left_out: Set[str]) -> None:
    with pq.ParquetFile(path) as file:
        schema = file.schema_arrow
        check_size(path, path.name, schema.names)
        out = pa.array(sorted(left_out), pa.string())
        with pq.ParquetWriter(to, schema, compression="zstd") as writer:
            for batch in file.iter_batches():
                ids = batch.column("id").cast(pa.string())
                writer.write_batch(batch.filter(pc.invert(pc.is_in(ids, value_set=out))))
            for run_id, pulse in pulses:
                n, columns = pulse.time_s.size, _columns(schema.names, pulse, path.name)
                arrays = {"id": pa.array([run_id] * n, pa.string()).dictionary_encode()}
                arrays |= {name: pa.array(values) for name, values in columns.items()}
                table = [arrays[of.name].cast(of.type) if of.name in arrays else pa.nulls(n, of.type) for of in schema]
                writer.write_table(pa.table(table, schema=schema))


def _append_csv(path: Path, to: Path, pulses: Sequence[tuple[str, Pulse]], left_out: Set[str]) -> None:
    with path.open(encoding="utf-8-sig", newline="") as old, to.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.reader(old, skipinitialspace=True)
        header = [original(cell.strip()) for cell in next(rows, [])]
        refuse_if("id" not in header, path.name, "a column id", "none", _REPAIR)
        at = header.index("id")
        kept = ([*map(original, row)] for row in rows if len(row) <= at or row[at].strip() not in left_out)
        write_rows(stream, chain([header], kept))
        for run_id, pulse in pulses:
            columns = _columns(header, pulse, path.name)
            cells = {name: [*map(repr, values.tolist())] for name, values in columns.items()}
            cells["id"], empty = [run_id] * pulse.time_s.size, [""] * pulse.time_s.size
            write_rows(stream, zip(*(cells.get(name, empty) for name in header), strict=True))


def _columns(names: Sequence[str], pulse: Pulse, where: str) -> Mapping[str, FloatArray]:
    wanted = {f"time_{unit}": pulse.time_s / factor for unit, factor in TIME.items()}
    wanted |= {f"acceleration_{unit}": pulse.accel_mps2 / factor for unit, factor in ACCELERATION.items()}
    columns = {name: np.asarray(wanted[name]) for name in names if name in wanted}
    refuse_if(len(columns) != 2, where, "one column time_… and one acceleration_…", ", ".join(names[:12]), _REPAIR)
    return columns


def campaign_of_frames(
    tests: pd.DataFrame,
    test_pulses: pd.DataFrame,
    cae: pd.DataFrame,
    cae_pulses: pd.DataFrame,
    settings: Mapping[str, str | float | None],
) -> Campaign:
    """The campaign of these tables and what ``campaign.toml`` would say, see :meth:`Campaign.from_frames`."""
    tables = {"tests": tests, "test_pulses": test_pulses, "cae": cae, "cae_pulses": cae_pulses}
    for argument, table in tables.items():
        refuse_if(not isinstance(table, pd.DataFrame), argument, "a pandas DataFrame", type(table).__name__, "give one")
        if twice := [str(column) for column in table.columns[table.columns.duplicated()]]:
            raise refusal(argument, "each column once", f"{twice[0]} twice", "rename or remove one")
    with in_memory() as folder:
        stated = {name: value for name, value in settings.items() if value not in ("", None)}
        lines = (f"{k} = {toml_text(v) if isinstance(v, str) else repr(v)}\n" for k, v in stated.items())
        (folder / "campaign.toml").write_text("".join(lines), encoding="utf-8")
        for role, table, pulses in (("tests", tests, test_pulses), ("cae", cae, cae_pulses)):
            (folder / f"{role}.csv").write_bytes(csv_bytes(table, float_format=None))
            path = folder / f"{role}_pulses.parquet"
            try:
                pulses.to_parquet(path, index=False)
            except (pa.ArrowException, TypeError, ValueError) as error:  # texts and numbers in one column, say
                expected, found = "columns that are numbers or text", " ".join(str(error).split())
                raise refusal(path.name, expected, found, "give each column one type") from None
        campaign = read_folder(folder)
    return replace(campaign, warnings=tuple(map(_of_tables, campaign.warnings)))


def conditions_frame(campaign: Campaign, role: str) -> pd.DataFrame:
    """``tests.csv`` or ``cae.csv`` of a campaign, in mph and lb, see :attr:`Campaign.tests_frame`."""
    header, rows = condition_rows(campaign, role, "mph", "lb")
    return pd.DataFrame(rows, columns=header)


def pulses_frame(campaign: Campaign, role: str) -> pd.DataFrame:
    """All pulses of one kind, tidy, at full precision, see :attr:`Campaign.test_pulses_frame`."""
    ids = campaign.test_ids if role == "tests" else campaign.cae.ids
    accel = campaign.cae.accel_mps2 if role == "cae" else np.array([test.pulse.accel_mps2 for test in campaign.tests])
    names = pd.Categorical.from_codes(np.repeat(np.arange(len(ids)), N_SAMPLES), list(ids))
    time_ms, accel_g = np.tile(GRID_S / MS, len(ids)), accel.ravel() / np.float64(G)
    return pd.DataFrame({"id": names, "time_ms": time_ms, "acceleration_g": accel_g})


@contextmanager
def in_memory() -> Iterator[Path]:
    """A folder for tables in memory: problems of its files name the arguments, with rows that count from 0."""
    with tempfile.TemporaryDirectory(prefix="crashfuse-") as folder:
        try:
            yield Path(folder)
        except DataError as error:
            raise DataError([_of_argument(problem) for problem in error.problems]) from None


def _of_argument(problem: Problem) -> Problem:
    texts = {name: _of_tables(getattr(problem, name)) for name in ("where", "expected", "found", "advice")}
    return replace(problem, row=None if problem.row is None else problem.row - 2, **texts)


def _of_tables(text: str) -> str:
    for file, argument in _IN_MEMORY.items():
        text = re.sub(file, argument, text)
    return text
