"""Writing campaign folders: a whole one, or pulses added to one; never half of either.

A pulse becomes part of a campaign by its row in the table of conditions, which is written last: whatever interrupts
before that leaves the campaign as it was.
"""

import csv
import io
import json
import shutil
import tempfile
import tomllib
import uuid
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.condition_tables import Role, id_trouble, read_conditions
from crashfuse.campaign_folder.tidy_tables import append_to_table
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem
from crashfuse.files.atomic import write_atomically
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.units import MASS, SPEED

Told = Mapping[str, str | float | Sequence[str]]
_RUNS_A_BATCH = 2000
_LINE = 100
_MARKS = ("tests.csv", "cae.csv", "campaign.toml")  # of a campaign folder


@dataclass(frozen=True, eq=False, slots=True)
class Addition:
    """A pulse to be added to a campaign folder, and what ``campaign.toml`` shall say of where it came from."""

    id: str
    condition: Condition
    pulse: Pulse
    told: Told = field(default_factory=dict)


def write_campaign(campaign: Campaign, folder: Path) -> None:
    """Write a campaign as a folder that reads back to the same fingerprint.

    Conditions are written in SI units with all their digits, each test as ``tests/<id>.csv``, the CAE runs as
    ``cae_pulses.parquet``. Pulses that were filtered when they were read are written filtered; ``filtered_with`` in
    ``campaign.toml`` says so, and nobody filters them again.

    Parameters
    ----------
    campaign : Campaign
    folder : Path
        Must not exist, or be empty.

    Raises
    ------
    DataError
        If the folder holds anything already, or an id cannot name a file.
    OSError
        If it cannot be written; nothing is left behind.
    """
    _check_ids([*campaign.test_ids, *campaign.cae.ids], folder.name)
    with _new_folder(folder) as home:
        tests = [(test.id, test.condition) for test in campaign.tests]
        cae = list(zip(campaign.cae.ids, campaign.cae.conditions, strict=True))
        for role, rows in (("tests", tests), ("cae", cae)):
            factors = list(dict.fromkeys(name for _, condition in rows for name, _ in condition.factors))
            header = ["id", "speed_mps", "front_weight_kg", "rear_weight_kg", *factors]
            lines = [_row(header, run_id, condition) for run_id, condition in rows]
            (home / f"{role}.csv").write_text(_csv([header, *lines]), encoding="utf-8", newline="")
        (home / "tests").mkdir()
        for test in campaign.tests:
            (home / "tests" / f"{test.id}.csv").write_text(_pulse_csv(test.pulse), encoding="utf-8", newline="")
        _write_runs(campaign, home / "cae_pulses.parquet")
        settings = [f"name = {_toml(campaign.name)}"]
        settings += [f"notice = {_toml(campaign.notice)}"] if campaign.notice else []
        cfc = campaign.channel_filter_class
        settings += [f"filtered_with = {cfc:g}"] if cfc is not None else []
        (home / "campaign.toml").write_text("\n".join(settings) + "\n", encoding="utf-8", newline="")


def add_to_campaign(folder: Path, role: Role, additions: Sequence[Addition]) -> None:
    """Add tests or CAE runs to a campaign folder, or begin one with them.

    Rows go into the existing table, in its units; pulses go where the others are, by default
    ``<role>/<id>.csv``; ``campaign.toml`` gets an ``[[imported]]`` table for each.

    Parameters
    ----------
    folder : Path
        A campaign folder, or one that does not exist or is empty.
    role : {"tests", "cae"}
    additions : sequence of Addition

    Raises
    ------
    DataError
        If an id is in the campaign already, twice in the additions or cannot name a file, or if the campaign's own
        table is not in order; nothing is changed then.
    OSError
        If it cannot be written; the campaign is as it was.
    """
    ids = [addition.id for addition in additions]
    _check_ids(ids, role)
    if twice := next((run_id for run_id, times in Counter(ids).items() if times > 1), None):
        raise DataError(Problem(role, "each id once", f"{twice!r} twice", "give one of them another id"))
    if folder.is_dir() and any(folder.iterdir()) and not any((folder / name).is_file() for name in _MARKS):
        found, advice = "other files", "name a campaign, or a folder that does not exist yet"
        raise DataError(Problem(str(folder), "a campaign folder, or an empty one", found, advice))
    if not folder.is_dir() or not any(folder.iterdir()):
        with _new_folder(folder) as home:
            _add(home, role, additions)
    else:
        _add(folder, role, additions)


def _add(folder: Path, role: Role, additions: Sequence[Addition]) -> None:
    table = folder / f"{role}.csv"
    text, header = _table_to_extend(table, role, additions)
    settings = _settings_with(folder / "campaign.toml", role, additions)
    rows = [_row(header, addition.id, addition.condition) for addition in additions]
    content = (text + _csv(rows)).encode()
    _check_table(table.name, content, role)
    written: list[Path] = []
    try:
        tables = [path for ending in ("parquet", "csv") if (path := folder / f"{role}_pulses.{ending}").is_file()]
        if tables:
            append_to_table(tables[0], [(addition.id, addition.pulse) for addition in additions])
        else:
            for addition in additions:
                path = folder / role / f"{addition.id}.csv"
                pulse = _pulse_csv(addition.pulse).encode()
                if path.exists() and path.read_bytes() != pulse:
                    found, advice = "another pulse there, without a row in the table", "rename or remove the file"
                    raise DataError(Problem(f"{role}/{path.name}", "no such file yet", found, advice))
                written.append(path)
                write_atomically(path, pulse)
        write_atomically(folder / "campaign.toml", settings.encode())
        write_atomically(table, content)
    except BaseException:
        for path in written:
            path.unlink(missing_ok=True)
        raise


def _table_to_extend(table: Path, role: str, additions: Sequence[Addition]) -> tuple[str, list[str]]:
    """The table of conditions as text that rows can follow, and its columns."""
    if not table.is_file():
        factors = list(dict.fromkeys(name for addition in additions for name, _ in addition.condition.factors))
        header = ["id", "speed_kph", "front_weight_kg", "rear_weight_kg", *factors]
        return _csv([header]), header
    problems: list[Problem] = []
    known = read_conditions(table, standstill_allowed=role == "cae", problems=problems)
    if known is None:
        raise DataError(problems)
    there = {run_id.casefold() for run_id in known.ids}
    # file systems that take V1 for v1 would lose one of them
    twice = [addition.id for addition in additions if addition.id.casefold() in there]
    if twice:
        advice = "give it another id, or remove the one that is there"
        raise DataError([Problem(table.name, "an id that is not there yet", repr(i), advice, "id") for i in twice[:20]])
    text = table.read_bytes().decode("utf-8-sig")
    header = [cell.strip() for cell in next(csv.reader(io.StringIO(text), skipinitialspace=True))]
    return text if text.endswith("\n") else f"{text}\n", header


def _check_table(name: str, content: bytes, role: str) -> None:
    """Raise a DataError if a table could not be read back: the whole campaign could not be opened any more."""
    problems: list[Problem] = []
    with tempfile.TemporaryDirectory() as scratch:
        table = Path(scratch) / name
        table.write_bytes(content)
        read_conditions(table, standstill_allowed=role == "cae", problems=problems)
    if problems:
        raise DataError([replace(problem, where=f"{name} as it would become") for problem in problems])


def _settings_with(path: Path, role: str, additions: Sequence[Addition]) -> str:
    """The text of campaign.toml with the additions told at its end."""
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    for addition in additions:
        told = {"id": addition.id, "as": role, **addition.told}
        lines = [f"{key} = {_toml(value)}" for key, value in told.items()]
        text += ("\n" if text else "") + "\n".join(["[[imported]]", *lines]) + "\n"
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DataError(Problem(path.name, "a TOML file in UTF-8", str(error), "correct the file first")) from None
    return text


def _row(header: Sequence[str], run_id: str, condition: Condition) -> list[object]:
    """Cells of a condition in the columns of a table, empty where it knows nothing of a factor."""
    quantities = {
        "speed": (condition.speed_mps, SPEED),
        "front_weight": (condition.front_weight_kg, MASS),
        "rear_weight": (condition.rear_weight_kg, MASS),
    }
    cells: dict[str, object] = {"id": run_id, **dict(condition.factors)}
    for quantity, (value, units) in quantities.items():
        for unit, factor in units.items():
            exact = factor == 1.0
            cells[f"{quantity}_{unit}"] = float(value) if exact else float(f"{value / factor:.12g}")
    return [cells.get(column, "") for column in header]


def _csv(rows: Sequence[Sequence[object]]) -> str:
    """Rows as CSV; every text between quotes, so that spaces at its ends stay."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC).writerows(rows)
    return stream.getvalue()


def _pulse_csv(pulse: Pulse) -> str:
    rows = zip(pulse.time_s.tolist(), pulse.accel_mps2.tolist(), strict=True)
    return "time_s,acceleration_mps2\n" + "".join(f"{t!r},{a!r}\n" for t, a in rows)


def _write_runs(campaign: Campaign, path: Path) -> None:
    """All CAE runs, some at a time, so that a library of any size needs little memory beside its own."""
    schema = pa.schema(
        [
            ("id", pa.dictionary(pa.int32(), pa.string())),
            ("time_s", pa.float64()),
            ("acceleration_mps2", pa.float32()),
        ]
    )
    accel, ids = campaign.cae.accel_mps2, campaign.cae.ids
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for first in range(0, len(ids), _RUNS_A_BATCH):
            batch = accel[first : first + _RUNS_A_BATCH]
            numbers = np.repeat(np.arange(len(batch), dtype=np.int32), GRID_S.size)
            names = pa.DictionaryArray.from_arrays(numbers, pa.array(ids[first : first + len(batch)], pa.string()))
            columns = [names, np.tile(GRID_S, len(batch)), np.ascontiguousarray(batch).ravel()]
            writer.write_table(pa.table(columns, schema=schema))


def _check_ids(ids: Sequence[str], where: str) -> None:
    problems = [Problem(where, *trouble, "id") for run_id in ids if (trouble := id_trouble(run_id)) is not None]
    if problems:
        raise DataError(problems[:20])


@contextmanager
def _new_folder(folder: Path) -> Iterator[Path]:
    """A folder to write into, which takes its place and name only when all of it is there."""
    folder = folder.resolve()
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise DataError(Problem(str(folder), "a folder that holds nothing yet", "one that does", "choose another"))
    folder.parent.mkdir(parents=True, exist_ok=True)
    home = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}")
    home.mkdir()
    try:
        yield home
        if folder.exists():
            folder.rmdir()
        home.rename(folder)
    except BaseException:
        shutil.rmtree(home, ignore_errors=True)
        raise


def _toml(value: str | float | Sequence[str]) -> str:
    """A value as TOML: JSON's strings are TOML's, but for one character."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    items = [_toml(item) for item in value]
    line = f"[{', '.join(items)}]"
    return line if len(line) < _LINE else "[\n" + "".join(f"    {item},\n" for item in items) + "]"
