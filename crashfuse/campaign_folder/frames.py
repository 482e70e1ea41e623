"""A campaign as tables in memory: the tables of its folder, taken and given as data frames."""

import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.folder import read_folder
from crashfuse.campaign_folder.writer import condition_rows
from crashfuse.errors import DataError, Problem
from crashfuse.files.csv_output import csv_bytes
from crashfuse.files.toml_text import toml_text
from crashfuse.signals.pulse import GRID_S, N_SAMPLES
from crashfuse.units import MS, G

_IN_MEMORY = {
    r"^(tests|cae): pulses without a row in \1\.csv": r"\1_pulses: pulses without a row in \1",
    r"\b(tests|cae)/ or \1_pulses\b": r"\1_pulses",
    r"\b(tests|cae)_pulses\.parquet\b": r"\1_pulses",
    r"\btests_pulses\b": "test_pulses",
    r"\b(tests|cae|matrix)\.csv\b": r"\1",
    r"\bcampaign\.toml\b": "campaign",
    r"^sort the file\b": "sort the table",
}
"""What a folder's sentences call its files, as patterns, and what the arguments of a call are called."""


def campaign_of_frames(
    tests: pd.DataFrame,
    test_pulses: pd.DataFrame,
    cae: pd.DataFrame,
    cae_pulses: pd.DataFrame,
    settings: Mapping[str, str | float | None],
) -> Campaign:
    """The campaign of these tables and what ``campaign.toml`` would say, see :meth:`Campaign.from_frames`."""
    given = {"tests": tests, "test_pulses": test_pulses, "cae": cae, "cae_pulses": cae_pulses}
    for argument, table in given.items():
        if not isinstance(table, pd.DataFrame):
            found, advice = type(table).__name__, "give a pandas DataFrame"
            raise DataError(Problem(argument, "a DataFrame", found, advice))
        if twice := [str(column) for column in table.columns[table.columns.duplicated()]]:
            raise DataError(Problem(argument, "each column once", f"{twice[0]} twice", "rename or remove one"))
    with in_memory() as folder:
        stated = {name: value for name, value in settings.items() if value not in ("", None)}
        lines = (f"{k} = {toml_text(v) if isinstance(v, str) else repr(v)}\n" for k, v in stated.items())
        (folder / "campaign.toml").write_text("".join(lines), encoding="utf-8")
        for role, table, pulses in (("tests", tests, test_pulses), ("cae", cae, cae_pulses)):
            (folder / f"{role}.csv").write_bytes(csv_bytes(table, float_format=None))
            _write(pulses, folder / f"{role}_pulses.parquet")
        read = read_folder(folder)
    return replace(read, warnings=tuple(map(_said, read.warnings)))


def _write(pulses: pd.DataFrame, path: Path) -> None:
    """Write pulses for the reader of folders, which tells what is wrong with them."""
    try:
        pulses.to_parquet(path, index=False)
    except (pa.ArrowException, TypeError, ValueError) as error:  # texts and numbers in one column, say
        expected, found = "columns that are numbers or text", " ".join(str(error).split())
        raise DataError(Problem(path.name, expected, found, "give each column one type")) from None


def conditions_frame(campaign: Campaign, role: str) -> pd.DataFrame:
    """``tests.csv`` or ``cae.csv`` of a campaign, in mph and lb, see :attr:`Campaign.tests_frame`."""
    header, rows = condition_rows(campaign, role, "mph", "lb")
    return pd.DataFrame(rows, columns=header)


def pulses_frame(campaign: Campaign, role: str) -> pd.DataFrame:
    """All pulses of one kind, tidy, at full precision, see :attr:`Campaign.test_pulses_frame`."""
    ids = campaign.test_ids if role == "tests" else campaign.cae.ids
    accel = campaign.cae.accel_mps2 if role == "cae" else np.array([test.pulse.accel_mps2 for test in campaign.tests])
    return pd.DataFrame(
        {
            "id": pd.Categorical.from_codes(np.repeat(np.arange(len(ids)), N_SAMPLES), list(ids)),
            "time_ms": np.tile(GRID_S / MS, len(ids)),
            "acceleration_g": accel.ravel() / np.float64(G),
        }
    )


@contextmanager
def in_memory() -> Iterator[Path]:
    """A folder for tables in memory: a problem of its files is told of the arguments, with rows that count from 0."""
    with tempfile.TemporaryDirectory(prefix="crashfuse-") as folder:
        try:
            yield Path(folder)
        except DataError as error:
            raise DataError([_of_argument(problem) for problem in error.problems]) from None


def _of_argument(problem: Problem) -> Problem:
    told = {name: _said(getattr(problem, name)) for name in ("where", "expected", "found", "advice")}
    return replace(problem, row=None if problem.row is None else problem.row - 2, **told)


def _said(text: str) -> str:
    """A folder's sentence, or a part of it, about tables in memory."""
    for file, argument in _IN_MEMORY.items():
        text = re.sub(file, argument, text)
    return text
