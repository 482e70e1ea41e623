"""The command that rates files against each other."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from crashfuse.cli.conditions import ACCELERATION_UNITS
from crashfuse.errors import CrashfuseError, UsageError
from crashfuse.files.csv_text import csv_bytes
from crashfuse.importing.ratings import WINDOWS_MS, RatingChoices, explain_files, rate_channels, rate_files, rate_pairs
from crashfuse.results.rating_tables import explanation_record

_SCORES = ("overall", "corridor", "phase", "magnitude", "slope")


def rate(arguments: argparse.Namespace) -> None:
    """Rate a file against another, pairs of a table, or two tests by channel."""
    if arguments.explain and (arguments.pairs or arguments.each_channel or arguments.csv):
        raise UsageError("--explain is for one pair of files, as text or with --json.")
    channels, others, also = map(tuple, (arguments.channel, arguments.comparison_channel, arguments.also))
    unit = ACCELERATION_UNITS.get(arguments.unit, arguments.unit)
    choices = RatingChoices(channels, others, arguments.channel_filter_class, unit, also, arguments.as_given)
    files, windows = (arguments.reference, arguments.comparison), arguments.windows_ms or WINDOWS_MS
    table = _rated(arguments, files, windows, choices)
    explanations = explain_files(*files, windows, choices=choices) if arguments.explain else []
    explained = [explanation_record(own, "comparison") for own in explanations]
    if arguments.json:
        rows = table.drop(columns=[name for name in table if (table[name] == "").all()]).to_dict("records")
        for row, own in zip(rows, explained, strict=bool(explained)):
            row["explanation"] = own
        plain = [{name: None if value != value else value for name, value in row.items()} for row in rows]
        print(json.dumps(plain, indent=2))
    elif arguments.csv:
        print(csv_bytes(table).decode(), end="")
    else:
        _print(table)
        for own in explained:
            print("", *own["sentences"].values(), sep="\n")
    if lacking := int(table["overall"].isna().sum()):
        found = f"{len(table) - lacking} rated, {lacking} not; each says why."
        if arguments.pairs or lacking == len(table):
            raise CrashfuseError(found)
        if not (arguments.json or arguments.csv):
            print(found)


def _rated(
    arguments: argparse.Namespace, files: tuple[Path, Path], windows: Sequence[float], choices: RatingChoices
) -> pd.DataFrame:
    if arguments.pairs is not None:
        if any(files) or arguments.each_channel:
            raise UsageError("--pairs takes its files from the table alone.")
        return rate_pairs(arguments.pairs, windows, choices=choices)
    if None in files:
        raise UsageError("Name a reference and a comparison, or a table of them with --pairs.")
    if arguments.each_channel:
        return rate_channels(*files, windows, choices=choices)
    return rate_files(*files, windows, choices=choices)


def _print(table: pd.DataFrame) -> None:
    rated = table[table["overall"].notna()]
    varying = [name for name in ("reference", "comparison", "channel") if table[name].nunique() > 1]
    bases = rated["basis"].unique().tolist()
    shown = rated[varying].assign(window=rated["window_ms"].map("0–{:g} ms".format))
    shown = shown.join(rated[[*_SCORES]].map("{:.3f}".format)).assign(grade=rated["grade"])
    further = [name for name in rated if name.startswith(("sg_", "anova_"))]
    shown = shown.join(rated[further].map("{:z.3f}".format))
    if len(bases) == 1:
        print(bases[0])
    else:
        shown["basis"] = rated["basis"]
    if len(shown):
        print(shown.to_string(index=False))
    for row in table[table["note"] != ""].drop_duplicates([*varying, "note"]).to_dict("records"):
        what = "Not rated" if row["overall"] != row["overall"] else "Careful"
        print(": ".join([what, *filter(None, (row[name] for name in varying)), row["note"]]))
