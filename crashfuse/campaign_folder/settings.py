"""Settings of a campaign: ``campaign.toml``, with the limits on its CAE runs and its occupant model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

from crashfuse.cae_library import NAMED_LIMITS, QUALITIES, QualityLimits, RunQuality
from crashfuse.errors import DataError, Problem, printable
from crashfuse.files.toml_text import read_toml, shown
from crashfuse.signals.filters import CLASSES
from crashfuse.signals.occupant import OCCUPANT_RANGES, USUAL_OCCUPANT, OccupantModel, likely_m
from crashfuse.units import MS

T = TypeVar("T")
_FILE = "campaign.toml"
_MOST_MIB = 4  # some thousands of imported pulses, a paragraph on each
_LONGEST_NAME, _LONGEST_NOTICE = 200, 2000
_LARGEST_GAP_MM = 10_000
_CORRECT = "correct or remove it"
LONGEST_REASON = 200  # characters of why a test is left out of use


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
    """A campaign's description, its limits on CAE runs, and the CFCs its records are to be, or were, filtered with."""

    name: str
    notice: str = ""
    channel_filter_class: float | None = None
    filtered_with: float | None = None
    quality: QualitySettings = field(default_factory=QualitySettings)
    occupant: OccupantModel = USUAL_OCCUPANT
    tests_imported_with: Mapping[str, float] = field(default_factory=dict)  # their CFC, by id
    unused: Mapping[str, str] = field(default_factory=dict)  # why tests are left out of use, by id
    cae_gap_m: float = 0.0  # how far CAE runs move before they meet the barrier


def read_settings(folder: Path, problems: list[Problem], warnings: list[str]) -> Settings:
    """Read ``campaign.toml``, if there is one; append its problems to ``problems``."""
    path = folder / _FILE
    unnamed = Settings(printable(folder.resolve().name, _LONGEST_NAME))
    if not path.exists():
        return unnamed
    try:
        values = _Table(read_toml(path, _MOST_MIB, "leave out what is no setting"), problems)
    except DataError as error:
        problems.extend(error.problems)
        return unnamed

    def text(key: str, default: str, most: int) -> str:
        expected = f"text of at most {most} characters"
        value = values.take(key, default, lambda v: isinstance(v, str) and len(v) <= most, expected)
        return printable(" ".join(value.split("\n")), most)

    def filter_class(key: str, is_class: Callable[[object], bool]) -> float | None:
        expected = 'a channel filter class (60, 180, 600 or 1000), or "none"'
        cfc = values.take(key, "none", lambda v: v == "none" or is_class(v), expected)
        return None if cfc == "none" else float(cfc)

    cfc = filter_class("channel_filter_class", lambda v: _is_number(v, 1, 1000) and v in CLASSES)
    already = filter_class("filtered_with", lambda v: _is_number(v, 1, 1000))  # elsewhere, by whatever filter
    if cfc is not None and already is not None:
        both = "channel_filter_class and filtered_with"
        problems.append(Problem(_FILE, "one of the two", both, "leave out the first, or pulses are filtered twice"))
    imported = values.values.pop("imported", None)
    tables = [entry for entry in (imported if isinstance(imported, list) else []) if isinstance(entry, dict)]
    pairs = [(table.get("id"), table.get("channel_filter_class")) for table in tables if table.get("as") == "tests"]
    expected = f"a distance in mm, at most {_LARGEST_GAP_MM:,}"
    settings = Settings(
        name=text("name", unnamed.name, _LONGEST_NAME),
        notice=text("notice", "", _LONGEST_NOTICE),
        channel_filter_class=cfc,
        filtered_with=already,
        quality=_quality(values),
        occupant=occupant_settings(values.values, problems),
        tests_imported_with={i: float(of) for i, of in pairs if isinstance(i, str) and isinstance(of, int | float)},
        unused=_unused(values),
        cae_gap_m=values.take("cae_gap_mm", 0.0, lambda v: _is_number(v, 0, _LARGEST_GAP_MM), expected) * MS,
    )
    if values.values:
        unknown = printable(", ".join(values.values), 200)
        warnings.append(f"{_FILE}: {unknown} is not a setting that crashfuse knows; it is left alone.")
    return settings


class _Table:
    """What is wrong with it goes to ``problems``."""

    def __init__(self, values: dict[str, Any], problems: list[Problem], name: str = "") -> None:
        self.values, self.problems, self._prefix = values, problems, f"{name}." if name else ""

    def take(self, key: str, default: T, is_sound: Callable[[Any], bool], expected: str) -> T:
        value: T = self.values.pop(key, default)
        if is_sound(value):
            return value
        self.refuse(expected, value, key)
        return default

    def table(self, key: str, expected: str) -> "_Table":
        return _Table(self.take(key, {}, lambda v: isinstance(v, dict), expected), self.problems, key)

    def refuse(self, expected: str, found: object, key: str, advice: str = _CORRECT) -> None:
        self.problems.append(Problem(_FILE, expected, shown(found), advice, f"{self._prefix}{key}"))


def sound_settings(folder: Path) -> Settings:
    """Read ``campaign.toml``; raise a DataError with its problems."""
    problems: list[Problem] = []
    settings = read_settings(folder, problems, [])
    if problems:
        raise DataError(problems)
    return settings


def reason(text: str) -> str:
    """Why a test is left out of use, in one line, cut if it is too long."""
    line = " ".join(text.split())
    whole = printable(line, LONGEST_REASON)
    return whole if len(whole) <= LONGEST_REASON else printable(line, LONGEST_REASON - 1)


def occupant_settings(values: dict[str, Any], problems: list[Problem]) -> OccupantModel:
    """Pop ``[occupant]`` from the settings of a campaign; append its problems to ``problems``."""
    expected = f"a table [occupant] with {', '.join(OCCUPANT_RANGES)}"
    settings = _Table(values, problems)
    table, sound = settings.table("occupant", expected), dict[str, float]()
    for name, value in table.values.items():
        if name not in OCCUPANT_RANGES:
            settings.refuse(expected, name, name)
            continue
        low, high = OCCUPANT_RANGES[name]
        advice = likely_m(name, value) if _is_number(value) else ""
        if _is_number(value, low, high) and not advice:
            sound[name] = float(value)
        else:
            table.refuse(f"a number from {low} to {high}", value, name, advice or _CORRECT)
    return OccupantModel(**sound)


def occupant_lines(occupant: OccupantModel) -> list[str]:
    """What differs from the usual model, as lines of ``campaign.toml``."""
    changed = [name for name in OCCUPANT_RANGES if getattr(occupant, name) != getattr(USUAL_OCCUPANT, name)]
    return ["[occupant]", *(f"{name} = {getattr(occupant, name)!r}" for name in changed)] if changed else []


def _quality(values: _Table) -> QualitySettings:
    before, share = len(values.problems), "a share between 0 and 1 (0.05 for 5 %)"
    keys = f"limits, {', '.join(QUALITIES)} or leave_out_failing"
    table = values.table("cae_quality", f"a table [cae_quality] with {keys}")
    given: dict[str, float | None] = {
        name: table.take(name, None, lambda v: v is None or (_is_number(v) and 0 < v < 1), share) for name in QUALITIES
    }
    single = {name: float(limit) for name, limit in given.items() if limit is not None}
    limits = QualityLimits("limits of this campaign", **single) if single else None
    if (name := table.values.pop("limits", None)) is not None:
        limits, is_both = NAMED_LIMITS.get(name) if isinstance(name, str) else None, limits is not None
        if limits is None or is_both:
            expected = f"one of {', '.join(NAMED_LIMITS)}, without limits of its own"
            table.refuse(expected, f"{name} and limits" if is_both else name, "limits")
    leave_out = table.take("leave_out_failing", False, lambda v: isinstance(v, bool), "true or false")
    if leave_out and limits is None and len(values.problems) == before:
        values.refuse("limits in [cae_quality]", "none", "cae_quality", "say by which limits runs fail")
    if table.values:
        values.refuse(keys, ", ".join(table.values), "cae_quality")
    return QualitySettings() if len(values.problems) > before else QualitySettings(limits, leave_out)


def _unused(values: _Table) -> dict[str, str]:
    expected = 'a list of ids such as ["T09"], or reasons by id such as {T09 = "sensor came loose"}'

    def is_sound(listed: object) -> bool:
        texts = [*listed.values()] if isinstance(listed, dict) else listed
        return isinstance(texts, list) and all(isinstance(text, str) for text in texts)

    listed: Any = values.take("unused", [], is_sound, expected)
    reasons = listed if isinstance(listed, dict) else dict.fromkeys(listed, "")
    return {test_id: reason(why) for test_id, why in reasons.items()}


def _is_number(value: object, least: float = -inf, most: float = inf) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most
