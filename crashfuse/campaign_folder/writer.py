"""Writing a whole campaign folder, and the text of its files."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.ids import id_trouble
from crashfuse.campaign_folder.occupant_settings import occupant_lines
from crashfuse.campaign_folder.quality_columns import QualitySettings
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, require_a
from crashfuse.files.atomic import new_folder
from crashfuse.files.csv_output import csv_text
from crashfuse.files.toml_text import toml_text
from crashfuse.run_quality import QUANTITIES, RunQuality
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.units import MASS, SPEED

_RUNS_A_BATCH = 2000


def write_campaign(campaign: Campaign, folder: str | Path) -> None:
    """Write a campaign as a folder that reads back to the same fingerprint.

    Conditions are written in SI units at full precision, each test as ``tests/<id>.csv``, the CAE runs as
    ``cae_pulses.parquet``. Pulses that were filtered on reading are written filtered; ``filtered_with`` in
    ``campaign.toml`` says so, and they are not filtered again. Runs that were left out for their quality, and tests
    that are left out of use, are not written.

    Raises
    ------
    DataError
        If the folder is not empty, or an id is not a valid file name.
    OSError
        If writing fails; nothing is left behind.
    """
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    folder = Path(folder)
    check_ids([*campaign.test_ids, *campaign.cae.ids], folder.name)
    with new_folder(folder) as home:
        for role in ("tests", "cae"):
            header, lines = condition_rows(campaign, role, "mps", "kg")
            (home / f"{role}.csv").write_text(csv_text([header, *lines]), encoding="utf-8", newline="")
        (home / "tests").mkdir()
        for test in campaign.tests:
            (home / "tests" / f"{test.id}.csv").write_text(pulse_csv(test.pulse), encoding="utf-8", newline="")
        _write_runs(campaign, home / "cae_pulses.parquet")
        settings = [f"name = {toml_text(campaign.name)}"]
        settings += [f"notice = {toml_text(campaign.notice)}"] if campaign.notice else []
        cfc = campaign.channel_filter_class
        settings += [f"filtered_with = {cfc:g}"] if cfc is not None else []
        settings += occupant_lines(campaign.occupant)
        settings += QualitySettings(campaign.quality_limits, bool(campaign.cae.left_out)).lines()
        (home / "campaign.toml").write_text("\n".join(settings) + "\n", encoding="utf-8", newline="")


def condition_rows(campaign: Campaign, role: str, speed: str, weight: str) -> tuple[list[str], list[list[object]]]:
    """The columns and rows of ``tests.csv`` or ``cae.csv``, speeds and weights in these units."""
    rows = [(test.id, test.condition) for test in campaign.tests]
    quality: tuple[RunQuality, ...] = ()
    if role == "cae":
        rows, quality = list(zip(campaign.cae.ids, campaign.cae.conditions, strict=True)), campaign.cae.quality
    told = quality or (RunQuality(),) * len(rows)
    factors = list(dict.fromkeys(name for _, condition in rows for name, _ in condition.factors))
    units = f"speed_{speed}", f"front_weight_{weight}", f"rear_weight_{weight}"
    header = ["id", *units, *factors, *quality_columns(told)]
    return header, [table_row(header, *row, own) for row, own in zip(rows, told, strict=True)]


def quality_columns(quality: Sequence[RunQuality]) -> list[str]:
    """The columns for what the solver says of runs; none for what it says of no run."""
    return [name for name in QUANTITIES if any(getattr(run, name) is not None for run in quality)]


def table_row(header: Sequence[str], run_id: str, condition: Condition, quality: RunQuality) -> list[object]:
    """The cells of a condition in the columns of a table, empty for factors and quality it does not have."""
    quantities = {
        "speed": (condition.speed_mps, SPEED),
        "front_weight": (condition.front_weight_kg, MASS),
        "rear_weight": (condition.rear_weight_kg, MASS),
    }
    told = {name: value for name in QUANTITIES if (value := getattr(quality, name)) is not None}
    cells: dict[str, object] = {"id": run_id, **dict(condition.factors), **told}
    for quantity, (value, units) in quantities.items():
        for unit, factor in units.items():
            exact = factor == 1.0
            cells[f"{quantity}_{unit}"] = float(value) if exact else float(f"{value / factor:.12g}")
    return [cells.get(column, "") for column in header]


def pulse_csv(pulse: Pulse) -> str:
    """A pulse as CSV at full precision."""
    rows = zip(pulse.time_s.tolist(), pulse.accel_mps2.tolist(), strict=True)
    return "time_s,acceleration_mps2\n" + "".join(f"{t!r},{a!r}\n" for t, a in rows)


def _write_runs(campaign: Campaign, path: Path) -> None:
    """Write all CAE runs in batches, so that a library of any size needs little extra memory."""
    schema = pa.schema(
        [("id", pa.dictionary(pa.int32(), pa.string())), ("time_s", pa.float64()), ("acceleration_mps2", pa.float32())]
    )
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
