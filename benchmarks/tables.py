"""Tables of numbers as CSV, which the documentation shows (``docs/data``)."""

from pathlib import Path

import pandas as pd


def write(table: pd.DataFrame, file: Path) -> None:
    """Write a table; rows of other campaigns that the file had stay."""
    if file.exists():
        before = pd.read_csv(file, dtype=str, keep_default_na=False)
        table = pd.concat([table, before[~before["campaign"].isin(table["campaign"])]])
    file.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(file, index=False, lineterminator="\n")
