"""Tables of numbers as CSV, which the documentation shows (``docs/data``)."""

import argparse
from pathlib import Path

import pandas as pd


def add_data_option(parser: argparse.ArgumentParser) -> None:
    """Give a script the option ``--data``."""
    parser.add_argument("--data", type=Path, help="folder of CSV files, whose rows are replaced by those measured here")


def write(table: pd.DataFrame, file: Path, key: str = "campaign") -> None:
    """Write a table; rows of other campaigns, or other values of ``key``, that the file had stay."""
    if file.exists():
        before = pd.read_csv(file, dtype=str, keep_default_na=False)
        table = pd.concat([table, before[~before[key].isin(table[key])]])
    file.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(file, index=False, lineterminator="\n")
