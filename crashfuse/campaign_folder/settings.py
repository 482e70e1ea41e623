"""Settings of a campaign: ``campaign.toml``, with the limits on its CAE runs and its occupant model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeGuard

from crashfuse.cae_library import NAMED_LIMITS, QUALITIES, QualityLimits, RunQuality
from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.toml_text import read_toml, shown
from crashfuse.signals.occupant import OCCUPANT_RANGES, USUAL_OCCUPANT, OccupantModel, likely_m
from crashfuse.units import MS

_FILE = "campaign.toml"
_MOST_MIB = 4  # some thousands of imported pulses, a paragraph on each
_LONGEST_NAME, _LONGEST_NOTICE = 200, 2000
_LARGEST_GAP_MM = 10_000
LONGEST_REASON = 200
"""Characters of why a test is left out of use."""


@dataclass(frozen=True, slots=True)
class QualitySettings:
    """Limits on the quality of the CAE runs, and whether runs beyond them are left out: ``[cae_quality]``."""

    limits: QualityLimits | None = None
    leave_out_failing: bool = False

    def lines(self) -> list[str]:
        """The settings as lines of ``campaign.toml``."""
        if self.limits is None:
            return []
        names = [f'limits = "{name}"' for name, limits in NAMED_LIMITS.items() if limits == self.limits][:1]
        single = [f"{name} = {getattr(self.limits, name)!r}" for name in self.limits.limited]
        return ["[cae_quality]", *(names or single), *["leave_out_failing = true"] * self.leave_out_failing]

    def failing(self, quality: Sequence[RunQuality]) -> list[int]:
        """Places of the runs to be left out."""
        if self.limits is None or not self.leave_out_failing:
            return []
        return [place for place, run in enumerate(quality) if self.limits.exceeded(run)]


@dataclass(frozen=True, slots=True)
class Settings:
    """A campaign's description, its limits on CAE runs, and the CFCs its records are to be, or were, filtered with.

    ``tests_imported_with`` holds the CFC of imported tests, ``unused`` why tests are left out of use, both by id;
    ``cae_gap_m`` is how far CAE runs move before they meet the barrier.
    """

    name: str
    notice: str = ""
    channel_filter_class: float | None = None
    filtered_with: float | None = None
    quality: QualitySettings = field(default_factory=QualitySettings)
    occupant: OccupantModel = USUAL_OCCUPANT
    tests_imported_with: Mapping[str, float] = field(default_factory=dict)
    unused: Mapping[str, str] = field(default_factory=dict)
    cae_gap_m: float = 0.0


def read_settings(folder: Path, problems: list[Problem], warnings: list[str]) -> Settings:
    """Read ``campaign.toml``, if there is one; append its problems to ``problems``."""
    path = folder / _FILE
    unnamed = Settings(printable(folder.resolve().name, _LONGEST_NAME))
    if not path.exists():
        return unnamed
    try:
        values = read_toml(path, _MOST_MIB, "leave out what is no setting")
    except DataError as error:
        problems.extend(error.problems)
        return unnamed
    cfc, already = (_filter_class(values, key, problems) for key in ("channel_filter_class", "filtered_with"))
    if cfc is not None and already is not None:
        expected, advice = "one of the two", "leave out channel_filter_class, or pulses are filtered twice"
        problems.append(Problem(_FILE, expected, "channel_filter_class and filtered_with", advice))
    imported = _imported_with(values.pop("imported", None))
    quality, occupant = _quality(values, problems), occupant_settings(values, problems)
    unused = _unused(values.pop("unused", []), problems)
    gap_mm = values.pop("cae_gap_mm", 0.0)
    if not _is_number(gap_mm) or not 0 <= gap_mm <= _LARGEST_GAP_MM:
        _refuse(f"a distance in mm, at most {_LARGEST_GAP_MM:,}", gap_mm, "cae_gap_mm", problems)
        gap_mm = 0.0
    name = _text(values, "name", unnamed.name, _LONGEST_NAME, problems)
    notice = _text(values, "notice", "", _LONGEST_NOTICE, problems)
    if values:
        unknown = printable(", ".join(values), 200)
        warnings.append(f"{_FILE}: {unknown} is not a setting that crashfuse knows; it is left alone.")
    return Settings(name, notice, cfc, already, quality, occupant, imported, unused, gap_mm * MS)


def own_filter_class(folder: Path) -> float | None:
    """The channel filter class that a campaign applies to its records on reading; None if it has none."""
    problems: list[Problem] = []
    settings = read_settings(folder, problems, [])
    if problems:
        raise DataError(problems)
    return settings.channel_filter_class


def reason(text: str) -> str:
    """Why a test is left out of use, in one line, cut if it is too long."""
    return printable(" ".join(text.split()), LONGEST_REASON - 1)


def occupant_settings(values: dict[str, Any], problems: list[Problem]) -> OccupantModel:
    """Pop ``[occupant]`` from the settings of a campaign; append its problems to ``problems``."""
    table = values.pop("occupant", {})
    expected = f"a table [occupant] with {', '.join(OCCUPANT_RANGES)}"
    if not isinstance(table, dict):
        _refuse(expected, table, "occupant", problems)
        return USUAL_OCCUPANT
    sound: dict[str, float] = {}
    for name, value in table.items():
        if name not in OCCUPANT_RANGES:
            _refuse(expected, name, name, problems, "correct or remove it")
            continue
        low, high = OCCUPANT_RANGES[name]
        advice = likely_m(name, value) if _is_number(value) else ""
        if _is_number(value) and low <= value <= high and not advice:
            sound[name] = float(value)
        else:
            advice = advice or "correct the value"
            _refuse(f"a number from {low} to {high}", value, f"occupant.{name}", problems, advice)
    return OccupantModel(**sound)


def occupant_lines(occupant: OccupantModel) -> list[str]:
    """What differs from the usual model, as lines of ``campaign.toml``."""
    changed = [name for name in OCCUPANT_RANGES if getattr(occupant, name) != getattr(USUAL_OCCUPANT, name)]
    return ["[occupant]", *(f"{name} = {getattr(occupant, name)!r}" for name in changed)] if changed else []


def _quality(values: dict[str, Any], problems: list[Problem]) -> QualitySettings:
    table, before = values.pop("cae_quality", {}), len(problems)
    keys = f"limits, {', '.join(QUALITIES)} or leave_out_failing"
    if not isinstance(table, dict):
        _refuse(f"a table [cae_quality] with {keys}", table, "cae_quality", problems)
        return QualitySettings()
    single: dict[str, float] = {}
    for name in QUALITIES:
        limit = table.get(name)
        if _is_number(limit) and 0 < limit < 1:
            single[name] = float(limit)
        elif name in table:
            _refuse("a share between 0 and 1 (0.05 for 5 %)", limit, f"cae_quality.{name}", problems)
    limits = QualityLimits("limits of this campaign", **single) if single else None
    if "limits" in table:
        name = table["limits"]
        if limits is not None:
            expected, advice = "a named set or limits of its own", "keep one of the two"
            problems.append(Problem(_FILE, expected, "both", advice, "cae_quality.limits"))
        limits = NAMED_LIMITS.get(name) if isinstance(name, str) else None
        if limits is None:
            _refuse(f"one of {', '.join(NAMED_LIMITS)}", name, "cae_quality.limits", problems)
    leave_out = table.get("leave_out_failing", False)
    if not isinstance(leave_out, bool):
        _refuse("true or false", leave_out, "cae_quality.leave_out_failing", problems)
    elif leave_out and limits is None and len(problems) == before:
        advice = "say by which limits runs fail"
        problems.append(Problem(_FILE, "limits in [cae_quality]", "none", advice, "cae_quality"))
    if unknown := [key for key in table if key not in (*QUALITIES, "limits", "leave_out_failing")]:
        found = printable(", ".join(unknown), 100)
        problems.append(Problem(_FILE, keys, found, "correct or remove it", "cae_quality"))
    return QualitySettings() if len(problems) > before else QualitySettings(limits, leave_out)


def _imported_with(entries: object) -> dict[str, float]:
    """The CFCs that ``crashfuse import`` filtered tests with, by id, from the provenance that it wrote."""
    tables = [entry for entry in (entries if isinstance(entries, list) else []) if isinstance(entry, dict)]
    pairs = [(table.get("id"), table.get("channel_filter_class")) for table in tables if table.get("as") == "tests"]
    return {run_id: float(cfc) for run_id, cfc in pairs if isinstance(run_id, str) and isinstance(cfc, int | float)}


def _unused(listed: object, problems: list[Problem]) -> dict[str, str]:
    """Why tests are left out of use: they are listed by ids alone, or with a reason each."""
    reasons = dict.fromkeys(listed, "") if _is_texts(listed) else listed
    if not isinstance(reasons, dict) or not _is_texts([*reasons.values()]):
        expected = 'a list of ids such as ["T09"], or reasons by id such as {T09 = "sensor came loose"}'
        _refuse(expected, listed, "unused", problems)
        return {}
    return {test_id: reason(text) for test_id, text in reasons.items()}


def _text(values: dict[str, Any], key: str, default: str, most: int, problems: list[Problem]) -> str:
    text = values.pop(key, default)
    if not isinstance(text, str) or len(text) > most:
        found = "a longer one" if isinstance(text, str) else shown(text)
        problems.append(Problem(_FILE, f"text of at most {most} characters", found, "correct the value", key))
        return default
    return printable(" ".join(text.split("\n")), most)


def _filter_class(values: dict[str, Any], key: str, problems: list[Problem]) -> float | None:
    cfc = values.pop(key, "none")
    if cfc == "none":
        return None
    if not _is_number(cfc) or not 1 <= cfc <= 1000:
        _refuse('a channel filter class such as 60 or 180, or "none"', cfc, key, problems)
        return None
    return float(cfc)


def _refuse(expected: str, found: object, key: str, problems: list[Problem], advice: str = "correct the value") -> None:
    problems.append(Problem(_FILE, expected, shown(found), advice, key))


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_texts(values: object) -> TypeGuard[list[str]]:
    return isinstance(values, list) and all(isinstance(value, str) for value in values)
