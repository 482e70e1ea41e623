"""Settings of a campaign: ``campaign.toml``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crashfuse.campaign_folder.occupant_settings import occupant_settings
from crashfuse.campaign_folder.quality_columns import QualitySettings, quality_settings
from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.toml_text import read_toml, shown
from crashfuse.signals.occupant import USUAL_OCCUPANT, OccupantModel
from crashfuse.units import MS

_MOST_MIB = 4  # some thousands of imported pulses, a paragraph on each
_LONGEST_NAME, _LONGEST_NOTICE = 200, 2000
_LARGEST_GAP_MM = 10_000
LONGEST_REASON = 200
"""Characters of why a test is left out of use."""


@dataclass(frozen=True, slots=True)
class Settings:
    """A campaign's description, its limits on CAE runs, and the CFCs its records are to be, or were, filtered with.

    ``tests_imported_with`` holds the CFC of each imported test by its id, ``unused`` why tests are left out of use by
    theirs, with no words if nobody says, ``cae_gap_m`` how far CAE runs move before they meet the barrier.
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
    path = folder / "campaign.toml"
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
        problems.append(Problem(path.name, expected, "channel_filter_class and filtered_with", advice))
    imported = _imported_with(values.pop("imported", None))
    quality, occupant = quality_settings(values, problems), occupant_settings(values, problems)
    unused = _unused(values.pop("unused", []), problems)
    gap_m = _gap(values, problems)
    name = _text(values, "name", unnamed.name, _LONGEST_NAME, problems)
    notice = _text(values, "notice", "", _LONGEST_NOTICE, problems)
    if values:
        unknown = printable(", ".join(values), 200)
        warnings.append(f"{path.name}: {unknown} is not a setting that crashfuse knows; it is left alone.")
    return Settings(name, notice, cfc, already, quality, occupant, imported, unused, gap_m)


def own_filter_class(folder: Path) -> float | None:
    """The channel filter class that a campaign applies to all its records on reading; None if it has none."""
    problems: list[Problem] = []
    settings = read_settings(folder, problems, [])
    if problems:
        raise DataError(problems)
    return settings.channel_filter_class


def reason(text: str) -> str:
    """Why a test is left out of use, in one line; a longer one is cut, and ends with a sign of that."""
    line = " ".join(text.split())
    whole = printable(line, LONGEST_REASON)
    return whole if len(whole) <= LONGEST_REASON else printable(line, LONGEST_REASON - 1)


def _imported_with(entries: object) -> dict[str, float]:
    """The CFCs that ``crashfuse import`` filtered tests with, by id, from the provenance that it wrote."""
    found: dict[str, float] = {}
    for entry in entries if isinstance(entries, list) else []:
        told = entry if isinstance(entry, dict) else {}
        run_id, cfc = told.get("id"), told.get("channel_filter_class")
        if told.get("as") == "tests" and isinstance(run_id, str) and isinstance(cfc, int | float):
            found[run_id] = float(cfc)
    return found


def _unused(listed: object, problems: list[Problem]) -> dict[str, str]:
    """Ids as a list, or with a reason each."""
    why = dict.fromkeys(listed, "") if isinstance(listed, list) and all(map(_is_text, listed)) else listed
    if not isinstance(why, dict) or not all(map(_is_text, why.values())):
        expected = 'a list of ids such as ["T09"], or reasons by id such as {T09 = "sensor came loose"}'
        problems.append(Problem("campaign.toml", expected, shown(listed), "correct the value", "unused"))
        return {}
    return {test_id: reason(own) for test_id, own in why.items()}


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _text(values: dict[str, Any], key: str, default: str, most: int, problems: list[Problem]) -> str:
    """Pop a line of text from the settings."""
    text = values.pop(key, default)
    if not isinstance(text, str) or len(text) > most:
        found = "a longer one" if isinstance(text, str) else shown(text)
        expected = f"text of at most {most} characters"
        problems.append(Problem("campaign.toml", expected, found, "correct the value", key))
        return default
    return printable(" ".join(text.split("\n")), most)


def _filter_class(values: dict[str, Any], key: str, problems: list[Problem]) -> float | None:
    """Pop a channel filter class from the settings, None for "none"."""
    cfc = values.pop(key, "none")
    if cfc == "none":
        return None
    if isinstance(cfc, bool) or not isinstance(cfc, int | float) or not 1 <= cfc <= 1000:
        expected = 'a channel filter class such as 60 or 180, or "none"'
        problems.append(Problem("campaign.toml", expected, shown(cfc), "correct the value", key))
        return None
    return float(cfc)


def _gap(values: dict[str, Any], problems: list[Problem]) -> float:
    """Pop the gap before the barrier, in m."""
    gap_mm = values.pop("cae_gap_mm", 0.0)
    if isinstance(gap_mm, bool) or not isinstance(gap_mm, int | float) or not 0 <= gap_mm <= _LARGEST_GAP_MM:
        expected = f"a distance in mm, at most {_LARGEST_GAP_MM:,}"
        problems.append(Problem("campaign.toml", expected, shown(gap_mm), "correct the value", "cae_gap_mm"))
        return 0.0
    return gap_mm * MS
