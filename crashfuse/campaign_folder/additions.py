"""Adding pulses to a campaign folder: all of them or none.

A pulse belongs to a campaign once its row is in the condition table, which is written last: an interruption before
that leaves the campaign unchanged.
"""

import csv
import io
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from crashfuse.campaign_folder.columns import listed
from crashfuse.campaign_folder.condition_tables import Role, read_conditions
from crashfuse.campaign_folder.ids import folded
from crashfuse.campaign_folder.settings import read_settings
from crashfuse.campaign_folder.tidy_tables import append_to_table
from crashfuse.campaign_folder.writer import check_ids, pulse_csv, quality_columns, table_row, toml_text
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem
from crashfuse.files.atomic import new_folder, write_atomically
from crashfuse.files.csv_output import csv_text
from crashfuse.run_quality import RunQuality
from crashfuse.signals.pulse import Pulse

Told = Mapping[str, str | float | Sequence[str]]
_MARKS = ("tests.csv", "cae.csv", "campaign.toml")  # any of these marks a campaign folder


@dataclass(frozen=True, eq=False, slots=True)
class Addition:
    """A pulse to be added to a campaign folder, what the solver says of it, and provenance for ``campaign.toml``."""

    id: str
    condition: Condition
    pulse: Pulse
    told: Told = field(default_factory=dict)
    quality: RunQuality = field(default_factory=RunQuality)


def add_to_campaign(folder: Path, role: Role, additions: Sequence[Addition]) -> None:
    """Add tests or CAE runs to a campaign folder, or start a new one with them.

    Rows go into the existing table, in its units; pulses go where the others are, by default
    ``<role>/<id>.csv``; ``campaign.toml`` gets an ``[[imported]]`` table for each.

    Parameters
    ----------
    folder : Path
        A campaign folder, or a folder that is empty or does not exist yet.

    Raises
    ------
    DataError
        If an id is already in the campaign, occurs twice in the additions or is not a valid file name, or if the
        campaign's own table is invalid; nothing is changed.
    OSError
        If writing fails; the campaign is unchanged.
    """
    ids = [addition.id for addition in additions]
    check_ids(ids, role)
    names = Counter(map(folded, ids))
    if twice := [run_id for run_id in ids if names[folded(run_id)] > 1]:
        raise DataError(Problem(role, "each id once", listed(twice[:2]), "give one of them another id"))
    if folder.is_dir() and any(folder.iterdir()) and not any((folder / name).is_file() for name in _MARKS):
        found, advice = "other files", "name a campaign, or a folder that does not exist yet"
        raise DataError(Problem(str(folder), "a campaign folder, or an empty one", found, advice))
    if not folder.is_dir() or not any(folder.iterdir()):
        with new_folder(folder) as home:
            _add(home, role, additions)
    else:
        _add(folder, role, additions)


def _add(folder: Path, role: Role, additions: Sequence[Addition]) -> None:
    table = folder / f"{role}.csv"
    text, header = _table_to_extend(table, role, additions)
    settings = _settings_with(folder / "campaign.toml", role, additions)
    rows = [table_row(header, addition.id, addition.condition, addition.quality) for addition in additions]
    content = text + csv_text(rows)
    _check_readable({table.name: content, "campaign.toml": settings}, role)
    written: list[Path] = []
    try:
        tables = [path for ending in ("parquet", "csv") if (path := folder / f"{role}_pulses.{ending}").is_file()]
        if tables:
            append_to_table(tables[0], [(addition.id, addition.pulse) for addition in additions])
        else:
            for addition in additions:
                path = folder / role / f"{addition.id}.csv"
                pulse = pulse_csv(addition.pulse).encode()
                if path.exists() and path.read_bytes() != pulse:
                    found, advice = "another pulse there, without a row in the table", "rename or remove the file"
                    raise DataError(Problem(f"{role}/{path.name}", "no such file yet", found, advice))
                written.append(path)
                write_atomically(path, pulse)
        write_atomically(folder / "campaign.toml", settings.encode())
        write_atomically(table, content.encode())
    except BaseException:
        for path in written:
            path.unlink(missing_ok=True)
        raise


def _table_to_extend(table: Path, role: str, additions: Sequence[Addition]) -> tuple[str, list[str]]:
    """The text of the condition table, ready for rows to be appended, and its columns.

    Columns of run quality that it lacks are added to its header; its rows are then short, which counts as empty cells.
    """
    quality = quality_columns([addition.quality for addition in additions])
    if not table.is_file():
        factors = list(dict.fromkeys(name for addition in additions for name, _ in addition.condition.factors))
        header = ["id", "speed_kph", "front_weight_kg", "rear_weight_kg", *factors, *quality]
        return csv_text([header]), header
    problems: list[Problem] = []
    known = read_conditions(table, standstill_allowed=role == "cae", problems=problems)
    if known is None:
        raise DataError(problems)
    there = set(map(folded, known.ids))
    twice = [addition.id for addition in additions if folded(addition.id) in there]
    if twice:
        advice = "give it another id, or remove the one that is there"
        raise DataError([Problem(table.name, "an id that is not there yet", repr(i), advice, "id") for i in twice[:20]])
    text = table.read_bytes().decode("utf-8-sig")
    header = [cell.strip() for cell in next(csv.reader(io.StringIO(text), skipinitialspace=True))]
    text = text if text.endswith("\n") else f"{text}\n"
    if new := [name for name in quality if name not in header]:
        first, _, rest = text.partition("\n")
        text, header = f"{first.rstrip()},{','.join(new)}\n{rest}", [*header, *new]
    return text, header


def _check_readable(files: Mapping[str, str], role: Role) -> None:
    """Raise a DataError if a file could not be read back: the whole campaign could no longer be opened."""
    problems: list[Problem] = []
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in files.items():
            (Path(scratch) / name).write_bytes(text.encode(errors="surrogateescape"))
        read_conditions(Path(scratch) / f"{role}.csv", standstill_allowed=role == "cae", problems=problems)
        read_settings(Path(scratch), problems, [])
    if problems:
        raise DataError([replace(problem, where=f"{problem.where} as it would become") for problem in problems])


def _settings_with(path: Path, role: str, additions: Sequence[Addition]) -> str:
    """The text of campaign.toml with the additions recorded at its end."""
    text = path.read_bytes().decode(errors="surrogateescape") if path.is_file() else ""
    for addition in additions:
        told = {"id": addition.id, "as": role, **addition.told}
        lines = [f"{key} = {toml_text(value)}" for key, value in told.items()]
        text += ("\n" if text else "") + "\n".join(["[[imported]]", *lines]) + "\n"
    return text
