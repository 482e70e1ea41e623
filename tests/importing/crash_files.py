"""Crashes as files of foreign formats, in memory, and how they get onto the disk."""

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from openpyxl import Workbook

from crashfuse.readers.isomme import Channel, IsommeTest
from crashfuse.results.export.isomme import isomme_files
from crashfuse.signals.pulse import FloatArray
from crashfuse.testing.readers import written
from crashfuse.units import KPH, MS, G
from tests.conftest import problems_of
from tests.importing.crashes import SPEED_MPS, clock, half_sine_g, scatter_g


def german(time_s: FloatArray, *pulses: FloatArray, header: str = "Zeit [ms];a_x [g]") -> bytes:
    """A table with semicolons and decimal commas."""
    rows = np.column_stack([time_s / MS, *pulses])
    lines = [header, *(";".join(f"{cell:.6f}" for cell in row) for row in rows.tolist())]
    return "\n".join(lines).replace(".", ",").encode("cp1252")


def isomme(
    name: str, scatter: float = 0.0, values_g: FloatArray | None = None, start_s: float = -0.05
) -> dict[str, bytes]:
    values_g = half_sine_g(clock()) + scatter_g(clock(), scatter) if values_g is None else values_g
    descriptors = [("Velocity test object 1", f"{SPEED_MPS:.9g}"), ("Mass test object 1", "1700")]
    channel = Channel("10VEHC000000ACXP", "X", "g", values_g, 1e-4, start_s)
    return isomme_files(IsommeTest(name, descriptors, (channel,)))


def library(folder: Path) -> Path:
    """Twelve CAE runs in one foreign table, deceleration positive, and their conditions in another."""
    time_s = clock(0.0, 0.12)
    speeds = np.linspace(30, 60, 12)
    header = "Time [s];" + ";".join(f"Run {i} [m/s^2]" for i in range(12))
    pulses = [
        -G * (half_sine_g(time_s) * v * KPH / SPEED_MPS + scatter_g(time_s, 0.5 * i)) for i, v in enumerate(speeds)
    ]
    table = german(time_s * MS, *pulses, header=header)
    rows = [f"Run {i};{v:.6f};950;750".replace(".", ",") for i, v in enumerate(speeds.tolist())]
    conditions = "\n".join(["Lauf;v0 [km/h];Gewicht VA [kg];Gewicht HA [kg]", *rows])
    return written(folder, {"runs.csv": table, "conditions.csv": conditions.encode()})


def workbook(sheets: Mapping[str, Iterable[Sequence[object]]], hidden: str = "") -> bytes:
    book, content = Workbook(), BytesIO()
    book.remove(book.worksheets[0])
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        sheet.sheet_state = "hidden" if name == hidden else "visible"
        for row in rows:
            sheet.append(list(row))
    book.save(content)
    return content.getvalue()


def sentence(call: Callable[[], object]) -> str:
    """The one sentence that a call is refused with."""
    (problem,) = problems_of(call)
    return str(problem)


def imported(folder: Path) -> list[dict[str, object]]:
    """What campaign.toml tells."""
    found: list[dict[str, object]] = tomllib.loads((folder / "campaign.toml").read_text())["imported"]
    return found
