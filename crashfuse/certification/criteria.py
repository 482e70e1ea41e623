"""Acceptance criteria: limits of pulse metrics or of the rating, the confidence to meet them with, and costs."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard, cast

import pandas as pd

from crashfuse.campaign import Campaign
from crashfuse.errors import NO_FILE, DataError, Problem, printable, require_a, several
from crashfuse.files.toml_text import read_toml, shown, toml_text
from crashfuse.signals.metrics import METRIC_LABELS, METRIC_UNITS, in_sentence
from crashfuse.signals.rating import STANDARD
from crashfuse.study.config import WINDOWS_MS
from crashfuse.units import KPH, MPH, G, Quantity, Sentence, UnitSystem, joined

RATING = "rating"
CONFIDENCE = 0.95
WINDOW_MS = 60.0
"""Window of a rating if none is named."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """One limit, or two, on a pulse metric, in its unit, or on the rating of the prediction against a test."""

    name: str
    metric: str
    at_least: float | None = None
    at_most: float | None = None
    window_ms: float | None = None  # [0, window_ms), of a rating only

    @property
    def unit(self) -> str:
        """The metric's unit; empty for the rating."""
        return METRIC_UNITS.get(self.metric, "")

    @property
    def label(self) -> str:
        """The metric in words."""
        rating = "" if self.window_ms is None else f"{STANDARD} rating over 0–{self.window_ms:g} ms"
        return METRIC_LABELS.get(self.metric, rating)

    @property
    def title(self) -> str:
        """The name that was given, else the metric as within a sentence."""
        return in_sentence(self.label) if self.name == self.metric != RATING else self.name

    @property
    def limits(self) -> str:
        """The limits in words, such as ``at most 650 mm``, with all the digits that were declared."""
        return self.limits_by("at least", "at most")

    def limits_by(self, least: str, most: str) -> str:
        """The limits by such words or signs."""
        ends = {word: end for word, end in ((least, self.at_least), (most, self.at_most)) if end is not None}
        shown = {word: Quantity((end,), self.unit, self._form(f"{end:.10g}")) for word, end in ends.items()}
        return joined([Sentence("{} {}", *own) for own in shown.items()], " and ")

    def _form(self, declared: str) -> str:
        if self.unit:
            return f".{max(len(declared.replace('.', '').lstrip('0')), 4)}g"
        return f".{max(len(declared.partition('.')[2]), 2)}f"

    def shown(self, *values: float | None) -> Quantity:
        """Values of the metric as displayed; no rounding carries one over a limit: 0.7997 misses 0.80."""
        for more in range(9):
            form = f"#.{4 + more}g" if self.unit else f".{3 + more}f"
            known = [value for value in values if value is not None]
            if all(self.is_met_by(float(format(value, form))) == self.is_met_by(value) for value in known):
                break
        return Quantity(values, self.unit, form, " to ")

    def interval(self, lower: float | None, upper: float | None) -> Quantity | Sentence:
        """The interval of a value as displayed; of one that the record is too short for, the end that is known."""
        if (lower is None) is (upper is None):
            return self.shown(lower) if lower is None else self.shown(lower, upper)
        return Sentence("≤ {}", self.shown(upper)) if lower is None else Sentence("≥ {}", self.shown(lower))

    def compared(self, value: float | None, lower: float | None, upper: float | None) -> Sentence:
        """An expected value with its interval, and the limits, in words."""
        interval = self.interval(lower, upper)
        if value is None:
            return Sentence("95 % of tests: {}, no single value expected (record too short); {}", interval, self.limits)
        return Sentence("We expect {} (95 % of tests: {}); {}", self.shown(value), interval, self.limits)

    def is_met_by(self, value: float) -> bool:
        """Whether a value lies within the limits."""
        return (self.at_least is None or value >= self.at_least) and (self.at_most is None or value <= self.at_most)

    def margin(self, value: float) -> float:
        """Distance of a value from the nearest limit."""
        return min(abs(value - end) for end in (self.at_least, self.at_most) if end is not None)


@dataclass(frozen=True, slots=True)
class Costs:
    """Costs of a test, and of a wrong answer in its place, in one currency."""

    test: float
    wrong_answer: float

    def __str__(self) -> str:
        return f"{self.test:,.10g} a test, {self.wrong_answer:,.10g} a wrong answer"

    @property
    def confidence(self) -> float:
        """The confidence from which it pays to skip a test."""
        return 1 - self.test / self.wrong_answer

    def saving(self, wrong: float) -> float:
        """Expected saving by a test that is skipped, if its answer is wrong with this probability."""
        return self.test - wrong * self.wrong_answer


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Standard deviations of what a planned test is run and measured with, each normal: of shares but for the speed."""

    speed_kph: float = 0.0
    weight: float = 0.0  # of each axle
    acceleration: float = 0.0  # of the sensors

    def __str__(self) -> str:
        shares = f"{100 * self.weight:g} % of each weight, {100 * self.acceleration:g} % of the acceleration"
        return f"{self.speed_kph:g} km/h, {shares}"


@dataclass(frozen=True, slots=True)
class Criteria:
    """Criteria with unique names, and the confidence, costs and tolerances that were declared with them."""

    items: tuple[Criterion, ...]
    declared: float | None = None  # confidence
    costs: Costs | None = None
    tolerances: Tolerances | None = None

    @property
    def confidence(self) -> float:
        """The probability from which one counts as met: as declared, else as the costs ask for, else 0.95."""
        if self.declared is None and self.costs is not None:
            return min(max(self.costs.confidence, LEAST_SURE), MOST_SURE)
        return CONFIDENCE if self.declared is None else self.declared

    @property
    def scatter(self) -> str:
        """Which tolerances probabilities have in them, in words."""
        if self.tolerances is None:
            return "No tolerance of speed, weights or sensors is stated, so the probabilities have none in them."
        return f"Tests are run and measured to {self.tolerances} (standard deviations): it is in their probabilities."

    def __repr__(self) -> str:
        return f"<Criteria at {self.confidence:g}: {', '.join(f'{own.name} {own.limits}' for own in self.items)}>"

    @property
    def windows_ms(self) -> tuple[float, ...]:
        """All windows of ratings, ascending."""
        return tuple(sorted({c.window_ms for c in self.items if c.window_ms is not None}))

    @property
    def spot_check(self) -> Criterion:
        """What a test that is drawn and run has to rate: the limit of the longest window, else 0.80 over 0–60 ms."""
        usual = Criterion(RATING, RATING, at_least=_GOOD, window_ms=WINDOW_MS)
        rated = (own for own in self.items if own.window_ms is not None and own.at_least is not None)
        return max(rated, key=lambda own: own.window_ms or 0.0, default=usual)


LEAST_SURE, MOST_SURE = 0.5, 0.999999
_MOST_CRITERIA = 100
_LEAST_LIMITS = {"mm": (5.0, "m"), "ms": (0.5, "s")}
"""Limits below these, by their unit, are in the unit a thousand times as large: no vehicle crushes less."""
_OTHER_UNITS = {"km/h": {"mph": MPH / KPH, "m/s": 1 / KPH}, "mm": {"inches": 25.4, "cm": 10.0}, "g": {"m/s²": 1 / G}}
_NEAR = 1.2  # below the least or above the largest: a mile per hour is 1.6 km/h
CriteriaGiven: TypeAlias = str | Path | pd.DataFrame | Mapping[str, Any] | Sequence[Mapping[str, Any]] | Criteria
"""``criteria.toml``, its tables as rows of a frame or as mappings, or criteria as they are judged."""
_TO_START = {"crush": "max_crush", "peak": "peak", "velocity change": "delta_v", "OLC": "olc"}
_GOOD = 0.8  # the grade of ISO/TS 18571
_KEYS = ("name", "metric", "unit", "window_ms", "at_least", "at_most")
COSTS = ("test", "wrong_answer")
_LARGEST = {"speed_kph": 5.0, "weight": 0.1, "acceleration": 0.1}  # tolerances


def read_criteria(path: Path) -> Criteria:
    """Read ``criteria.toml``; a DataError has every problem of it."""
    if not path.is_file():
        raise DataError(Problem(path.name, "this file", NO_FILE, "declare the acceptance criteria in it"))
    values = read_toml(path, 1, "keep the criteria alone")
    items, problems = values.pop("criterion", []), list[Problem]()
    declared, costs, tolerances = (values.pop(key, None) for key in ("confidence", "costs", "tolerances"))
    if values:
        known = "confidence, [costs], [tolerances] and [[criterion]]"
        problems.append(Problem(path.name, known, ", ".join(values), "remove or rename it"))
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise DataError(Problem(path.name, "tables [[criterion]]", "another value", "begin each with [[criterion]]"))
    return _checked(items, declared, costs, tolerances, path.name, problems)


def criteria_of(
    criteria: Sequence[Mapping[str, Any]],
    confidence: float | None = None,
    costs: Mapping[str, Any] | None = None,
    tolerances: Mapping[str, Any] | None = None,
) -> Criteria:
    """Create criteria from mappings with the keys of ``criteria.toml``; raises as :func:`read_criteria`."""
    return _checked([dict(item) for item in criteria], confidence, costs, tolerances, "the criteria", [])


def with_costs(criteria: Criteria, costs: Mapping[str, object]) -> Criteria:
    """The criteria with these costs (``test``, ``wrong_answer``), or none; a DataError if they are wrong."""
    problems: list[Problem] = []
    checked = _costs(costs, "the costs", problems) if costs else None
    if problems:
        raise DataError(problems)
    return replace(criteria, costs=checked)


def criteria_given(criteria: CriteriaGiven, confidence: float | None = None) -> Criteria:
    """Criteria in any form in which the library takes them; raises as :func:`read_criteria`."""
    if isinstance(criteria, Criteria):
        return criteria
    if isinstance(criteria, str | Path):
        return read_criteria(Path(criteria))
    if isinstance(criteria, pd.DataFrame):
        criteria = [{str(k): v for k, v in row.items() if pd.notna(v)} for row in criteria.to_dict("records")]
    items = (criteria,) if isinstance(criteria, Mapping) else several(criteria)
    for item in items:
        require_a(Mapping, item, "such as {'metric': 'max_crush', 'at_most': 430}")
    return criteria_of(cast(Sequence[Mapping[str, Any]], items), confidence)


def criteria_text(criteria: Criteria) -> str:
    """The criteria as the text of ``criteria.toml``."""
    costs = criteria.costs
    lines = [f"confidence = {criteria.confidence!r}"] if criteria.declared is not None or costs is None else []
    lines += [] if costs is None else ["", "[costs]", *(f"{key} = {getattr(costs, key)!r}" for key in COSTS)]
    if (tolerances := criteria.tolerances) is not None:
        lines += ["", "[tolerances]", *(f"{key} = {getattr(tolerances, key)!r}" for key in _LARGEST)]
    for criterion in criteria.items:
        values = {key: getattr(criterion, key) for key in _KEYS}
        lines += ["", "[[criterion]]", *(f"{k} = {toml_text(v)}" for k, v in values.items() if v not in (None, ""))]
    return "\n".join([*lines, ""]).lstrip()


def limits_of_tests(campaign: Campaign, units: UnitSystem) -> list[dict[str, Any]]:
    """Five criteria to start from: the most that a test showed, rounded up in a reader's units, and a good rating."""
    shown = [{own.name: own.value for own in campaign.metrics_of(test)} for test in campaign.tests]
    rows: list[dict[str, Any]] = []
    for name, metric in _TO_START.items():
        factor = units.factor(METRIC_UNITS[metric])
        most = max((value * factor for own in shown if (value := own[metric]) is not None), default=0.0)
        if most > 0:
            step = 10.0 ** (math.floor(math.log10(most)) - 1)
            rows.append({"name": name, "metric": metric, "at_most": math.ceil(most / step) * step / factor})
    return [*rows, {"metric": RATING, "window_ms": WINDOW_MS, "at_least": _GOOD}]


def varied(criteria: Criteria) -> dict[str, Criteria]:
    """The criteria at another confidence, or with limits 5 % stricter or looser, by what is other."""
    others = {f"confidence {p:g}": replace(criteria, declared=p) for p in (0.9, 0.99) if p != criteria.confidence}
    for word, by in (("stricter", 0.05), ("looser", -0.05)):
        others[f"limits 5 % {word}"] = replace(criteria, items=tuple(_tightened(own, by) for own in criteria.items))
    return others


def _tightened(criterion: Criterion, share: float) -> Criterion:
    least, most = criterion.at_least, criterion.at_most
    highest = 1.0 if criterion.window_ms is not None else math.inf
    least = None if least is None else min((1 + share) * least, highest)
    most = None if most is None else min((1 - share) * most, highest)
    return replace(criterion, at_least=least, at_most=most)


def ratings_wanted() -> list[dict[str, Any]]:
    """Criteria on the prediction alone: good ratings over the usual windows."""
    rating = {"metric": RATING, "at_least": _GOOD}
    return [{"name": f"rating {window:g} ms", "window_ms": window, **rating} for window in WINDOWS_MS]


def _checked(
    items: list[dict[str, Any]],
    confidence: object,
    costs: object,
    tolerances: object,
    where: str,
    problems: list[Problem],
) -> Criteria:
    declared = float(confidence) if is_number(confidence) else None
    if confidence is not None and (declared is None or not LEAST_SURE <= declared <= MOST_SURE):
        expected = f"a confidence from {LEAST_SURE} to {MOST_SURE}"
        problems.append(Problem(where, expected, shown(confidence), "0.95 is usual"))
    checked_costs = None if costs is None else _costs(costs, where, problems)
    checked_tolerances = None if tolerances is None else _tolerances(tolerances, where, problems)
    if not items:
        problems.append(Problem(where, "at least one criterion", "none", "add a table [[criterion]]"))
    if len(items) > _MOST_CRITERIA:
        raise DataError(Problem(where, f"at most {_MOST_CRITERIA} criteria", str(len(items)), "leave some out"))
    found: dict[str, Criterion] = {}
    for number, item in enumerate(items, start=1):
        own = f"{where}, criterion {number}"
        criterion = _criterion(item, own, problems)
        if criterion is not None and criterion.name in found:
            problems.append(Problem(own, "each name once", f"{criterion.name!r} a second time", "rename one"))
        elif criterion is not None:
            found[criterion.name] = criterion
    problems += [problem for pair in combinations(found.values(), 2) if (problem := _at_odds(*pair, where)) is not None]
    if problems:
        raise DataError(problems)
    return Criteria(tuple(found.values()), declared, checked_costs, checked_tolerances)


def _tolerances(values: object, where: str, problems: list[Problem]) -> Tolerances | None:
    given = values if isinstance(values, dict) else {"": values}
    if all(key in _LARGEST and is_number(own) and 0 <= own <= _LARGEST[key] for key, own in given.items()):
        return Tolerances(**given)
    expected = f"tolerances from 0 to {', '.join(f'{most:g} ({key})' for key, most in _LARGEST.items())}"
    found = ", ".join(f"{key} {shown(own)}" for key, own in given.items())
    problems.append(Problem(where, expected, found, "give standard deviations: in km/h, and as shares (0.01 for 1 %)"))
    return None


def _costs(values: object, where: str, problems: list[Problem]) -> Costs | None:
    if isinstance(values, dict) and {*values} == {*COSTS} and all(map(is_number, values.values())):
        costs = Costs(*(float(values[key]) for key in COSTS))
        if 0 < costs.test < costs.wrong_answer:
            return costs
    expected = "costs test and wrong_answer, above 0, the wrong answer the dearer"
    found = ", ".join(f"{k} {shown(v)}" for k, v in values.items()) if isinstance(values, dict) else shown(values)
    problems.append(Problem(where, expected, found or "none", "declare both in one currency"))
    return None


def _at_odds(one: Criterion, other: Criterion, where: str) -> Problem | None:
    if (one.metric, one.window_ms) != (other.metric, other.window_ms):
        return None
    low = max((own.at_least for own in (one, other) if own.at_least is not None), default=-math.inf)
    high = min((own.at_most for own in (one, other) if own.at_most is not None), default=math.inf)
    found = f"{one.name!r} with {one.limits}, {other.name!r} with {other.limits}"
    if high < low:
        return Problem(where, f"limits of {one.metric} that one value can meet", found, "correct one of them")
    if (one.at_least, one.at_most) == (other.at_least, other.at_most):
        return Problem(where, f"each limit of {one.metric} once", found, "remove one of them")
    return None


def _criterion(item: dict[str, Any], where: str, problems: list[Problem]) -> Criterion | None:
    before = len(problems)

    def wrong(expected: str, found: object, advice: str) -> None:
        text = "nothing" if found is None else found if isinstance(found, str) else shown(found)
        problems.append(Problem(where, expected, text, advice))

    for key in [key for key in item if key not in _KEYS]:
        wrong(f"the keys {', '.join(_KEYS)}", key, "remove or rename it; a limit is in the metric's own unit")
    metric, name = item.get("metric"), item.get("name", item.get("metric"))
    if not isinstance(metric, str) or (metric not in METRIC_LABELS and metric != RATING):
        wrong(f"a metric of {', '.join(METRIC_LABELS)} or {RATING}", metric, "choose one of them")
        return None
    unit, is_rating = METRIC_UNITS.get(metric, ""), metric == RATING
    if item.get("unit", unit) != unit:
        wrong(f"limits of {metric} in {unit}" if unit else f"no unit for {metric}", item["unit"], "convert the limits")
    if not isinstance(name, str) or not name.strip() or len(name) > 100 or printable(name) != name:
        wrong("a name of at most 100 characters in one line", name, "rename it")
    limits = {key: item[key] for key in ("at_least", "at_most") if item.get(key) is not None}
    if not limits:
        wrong("at_least or at_most", "neither", "add a limit")
    least, larger = _LEAST_LIMITS.get(unit, (0.0, "")) if "unit" not in item else (0.0, "")
    for key, limit in limits.items():
        if not is_number(limit) or not 0 <= limit <= (1.0 if is_rating else math.inf):
            scale = f", in {unit}" if unit else ", up to 1" * is_rating
            wrong(f"a number of 0 or more for {key}{scale}", shown(limit), "correct the limit")
        elif 0 < limit < least:
            advice = f"if {limit:g} {larger} is meant, write {1e3 * limit:g}; else state the unit"
            wrong(f"{key} of {metric} in {unit}", f"{limit:g}", advice)
    window = item.get("window_ms", WINDOW_MS if is_rating else None)
    if is_rating and (not is_number(window) or not 10 <= window <= 100):
        wrong("a window_ms from 10 to 100", shown(window), "correct the window")
    if not is_rating and window is not None:
        wrong(f"no window_ms, which only the {RATING} has", window, "remove it")
    if len(problems) > before:
        return None
    at_least, at_most = limits.get("at_least"), limits.get("at_most")
    if at_least is not None and at_most is not None and at_most < at_least:
        ends = [Quantity((end,), unit, "g") for end in (at_least, at_most)]
        wrong(f"at_most of at least {ends[0]}, which is at_least", str(ends[1]), "correct or exchange the limits")
        return None
    numbers = (None if value is None else float(value) for value in (at_least, at_most, window))
    return Criterion(str(name).strip(), metric, *numbers)


def likely_unit(criterion: Criterion, values: Sequence[float]) -> str:
    """Another unit than the metric's, if a limit lies near these values in that unit alone; else empty."""
    low, high = min(values, default=0.0) / _NEAR, max(values, default=0.0) * _NEAR
    ends = [end for end in (criterion.at_least, criterion.at_most) if end is not None]
    factors = {"": 1.0, **_OTHER_UNITS.get(criterion.unit, {})}
    near = [unit for unit, factor in factors.items() if any(low <= factor * end <= high for end in ends)]
    return "" if "" in near else next(iter(near), "")


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value that was read is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
