"""The quality of CAE runs in a campaign folder: columns of ``cae.csv``, and ``[cae_quality]`` in ``campaign.toml``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from crashfuse.campaign_folder.columns import MOST_PROBLEMS, count_rest
from crashfuse.errors import Problem, printable
from crashfuse.files.toml_text import shown
from crashfuse.run_quality import NAMED_LIMITS, QUANTITIES, QualityLimits, RunQuality

_WHERE, _TABLE = "campaign.toml", "[cae_quality]"
_KNOWN = f"limits, {', '.join(QUANTITIES)} or leave_out_failing"
_OWN = QualityLimits("limits of this campaign")


@dataclass(frozen=True, slots=True)
class QualitySettings:
    """Limits on the quality of the CAE runs, and whether runs beyond them are left out."""

    limits: QualityLimits | None = None
    leave_out_failing: bool = False

    def lines(self) -> list[str]:
        """The settings as lines of ``campaign.toml``."""
        if self.limits is None:
            return []
        names = [name for name, limits in NAMED_LIMITS.items() if limits == self.limits]
        own = [f"{name} = {getattr(self.limits, name)!r}" for name in self.limits.limited]
        left_out = ["leave_out_failing = true"] if self.leave_out_failing else []
        return [_TABLE, *([f'limits = "{names[0]}"'] if names else own), *left_out]


def quality_settings(values: dict[str, Any], problems: list[Problem]) -> QualitySettings:
    """Pop ``[cae_quality]`` from the settings of a campaign; append its problems to ``problems``."""
    given = values.pop("cae_quality", {})
    if not isinstance(given, dict):
        expected = f"a table {_TABLE} with {_KNOWN}"
        problems.append(Problem(_WHERE, expected, shown(given), "correct it", "cae_quality"))
        return QualitySettings()
    before = len(problems)
    own = _own_limits(given, problems)
    limits = None if own == _OWN else own
    if "limits" in given:
        name = given["limits"]
        if limits is not None:
            advice = "keep one of the two"
            problems.append(Problem(_WHERE, "a named set or limits of its own", "both", advice, "cae_quality.limits"))
        limits = NAMED_LIMITS.get(name) if isinstance(name, str) else None
        if limits is None:
            expected = f"one of {', '.join(NAMED_LIMITS)}"
            problems.append(Problem(_WHERE, expected, shown(name), "correct it", "cae_quality.limits"))
    leave_out = given.get("leave_out_failing", False)
    if not isinstance(leave_out, bool):
        column = "cae_quality.leave_out_failing"
        problems.append(Problem(_WHERE, "true or false", shown(leave_out), "correct it", column))
    elif leave_out and limits is None and len(problems) == before:
        problems.append(Problem(_WHERE, f"limits in {_TABLE}", "none", "say by which limits runs fail", "cae_quality"))
    if unknown := [key for key in given if key not in (*QUANTITIES, "limits", "leave_out_failing")]:
        found = printable(", ".join(unknown), 100)
        problems.append(Problem(_WHERE, _KNOWN, found, "correct or remove it", "cae_quality"))
    return QualitySettings() if len(problems) > before else QualitySettings(limits, leave_out)


def read_quality(frame: pd.DataFrame, where: str, problems: list[Problem]) -> tuple[RunQuality, ...]:
    """The quality of each row of a table whose cells are text, indexed by row; empty if no cell says anything."""
    columns = [name for name in QUANTITIES if name in frame]
    if not columns or not (frame[columns] != "").to_numpy().any():
        return ()
    values = {name: _shares(frame[name], where, problems) for name in columns}
    return tuple(RunQuality(**dict(zip(columns, row, strict=True))) for row in zip(*values.values(), strict=True))


def _shares(cells: pd.Series, where: str, problems: list[Problem]) -> list[float | None]:
    """The shares in a column, None where a cell is empty; what is no share is a problem."""
    signed = cells.name == "energy_change"
    expected = f"a share from {'-1' if signed else '0'} to 1, or an empty cell where it is not recorded"
    shares: list[float | None] = []
    bad = 0
    for row, text in cells.items():
        value = _number(str(text))
        shares.append(value)
        if value is None or (-1 if signed else 0) <= value <= 1:
            continue
        bad += 1
        if bad <= MOST_PROBLEMS:
            advice = "give a share: 5 % is 0.05" if math.isfinite(value) and abs(value) > 1 else "correct the cell"
            problems.append(Problem(where, expected, repr(printable(str(text), 60)), advice, str(cells.name), row))
    count_rest(bad, MOST_PROBLEMS, "cells that are no share", where, str(cells.name), problems)
    return shares


def _number(text: str) -> float | None:
    """The number in a cell, None for an empty one, NaN for what is none."""
    if not text.strip():
        return None
    try:
        return float(text)
    except ValueError:
        return math.nan


def _own_limits(given: dict[str, Any], problems: list[Problem]) -> QualityLimits:
    own: dict[str, float] = {}
    for name in QUANTITIES:
        limit = given.get(name)
        if name in given and not isinstance(limit, bool) and isinstance(limit, int | float) and 0 < limit < 1:
            own[name] = float(limit)
        elif name in given:
            expected, advice = "a share between 0 and 1 (0.05 for 5 %)", "correct the limit"
            problems.append(Problem(_WHERE, expected, shown(limit), advice, f"cae_quality.{name}"))
    return QualityLimits(_OWN.name, *(own.get(name) for name in QUANTITIES))


def failing(quality: Sequence[RunQuality], settings: QualitySettings) -> list[int]:
    """Places of the runs to be left out."""
    if settings.limits is None or not settings.leave_out_failing:
        return []
    return [place for place, run in enumerate(quality) if settings.limits.exceeded(run)]
