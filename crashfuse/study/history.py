"""What was computed on this machine: a small record of every study and prediction, and two studies compared.

A record is kept beside the cache; it holds ratings and settings, no pulses.
"""

import hashlib
import json
import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd

from crashfuse.approaches.cae import Cae
from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import DataError, Problem, UsageError, printable
from crashfuse.execution.cache import default_folder
from crashfuse.files.atomic import sole_writer, write_atomically
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.recommendation import recommend, recommend_for
from crashfuse.study.study import Study
from crashfuse.units import counted, difference, read_out

Ratings = Mapping[str, Mapping[str, Mapping[float, float]]]
"""Overall ratings by held-out test, approach and window in ms."""

log = logging.getLogger(__name__)

MOST = 300  # records that are kept; the oldest make room
LONGEST_NOTE = 200  # characters

_LARGEST = 1_000_000  # bytes of a record; one of 40 tests has 40,000
_PATIENCE_S = 10.0  # to wait for another process that writes a record
_CLEARLY = 2.0  # standard errors
_SAME = 1e-6  # records are rounded to six digits
_KEY = ["held_out", "approach", "window_ms"]
_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00")


@dataclass(frozen=True)
class PastResult:
    """A study, or a prediction at a condition, that was computed before."""

    campaign: str
    fingerprint: str  # SHA-256 of the campaign's content
    config: StudyConfig
    basis: str  # what its ratings rest on
    approach: str  # the recommended one
    date: str  # UTC
    ratings: Ratings = field(default_factory=dict)  # of a study
    speed_groups: Ratings = field(default_factory=dict)  # with whole speed groups left out, if both were asked for
    condition: Condition | None = None  # of a prediction
    expected: str = ""  # rating to expect of a prediction: "0.78 to 0.93"
    note: str = ""

    @classmethod
    def of_study(cls, study: Study) -> Self:
        """The record of a finished study."""
        asked = _asked(study.campaign, study.config, recommend(study).approach)
        groups = {} if study.speed_groups is None else _overall(study.speed_groups)
        return cls(*asked, ratings=_overall(study), speed_groups=groups)

    @classmethod
    def of_prediction(cls, campaign: Campaign, estimates: Sequence[Estimate], config: StudyConfig) -> Self:
        """The record of a prediction by several approaches at one condition."""
        condition = estimates[0].condition
        advice = recommend_for(estimates, campaign, condition)
        expected = "" if advice.expected is None else advice.expected.range
        return cls(*_asked(campaign, config, advice.approach), condition=condition, expected=expected)

    @property
    def id(self) -> str:
        """Twelve hexadecimal digits of data, question and settings: a repetition replaces the record."""
        settings = asdict(self.config)
        del settings["to_ttzv"], settings["also"]  # of which nothing is kept
        asked = [self.fingerprint, settings, sorted(self.ratings), self.condition and self.condition.text]
        return hashlib.sha256(json.dumps(asked).encode()).hexdigest()[:12]

    @property
    def tests(self) -> tuple[str, ...]:
        """The tests that were held out in turn; none of a prediction."""
        return tuple(self.ratings)

    @property
    def by_way(self) -> dict[str, Ratings]:
        """Ratings by the way in which tests were left out: ``test``, or ``speed group``."""
        ways = self.config.split_configs
        return {ways[0].leave_out: self.ratings, **({ways[-1].leave_out: self.speed_groups} if len(ways) > 1 else {})}

    @property
    def windows_ms(self) -> tuple[float, ...]:
        """Windows over which it was rated."""
        return tuple(sorted({w for test in self.ratings.values() for by_window in test.values() for w in by_window}))

    def mean(self, approach: str, window_ms: float) -> float:
        """Mean rating over the tests."""
        overall = [test[approach][window_ms] for test in self.ratings.values()]
        return sum(overall) / len(overall)

    def worst(self, approach: str, window_ms: float) -> tuple[str, float]:
        """The test that was predicted worst, and its rating."""
        overall = {test_id: test[approach][window_ms] for test_id, test in self.ratings.items()}
        return min(overall.items(), key=lambda rated: rated[1])


def _asked(campaign: Campaign, config: StudyConfig, approach: str) -> tuple[str, str, StudyConfig, str, str, str]:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return campaign.name, campaign.fingerprint, config, campaign.rating_basis, approach, now


def keep(result: PastResult) -> None:
    """Keep a record among those of this machine; where nothing can be written, none is kept.

    A result that is computed again keeps its date and its note.
    """
    folder = _home()
    try:
        with sole_writer(folder, _PATIENCE_S):
            before = _read(folder / f"{result.id}.json")
            if before is not None:
                result = replace(result, note=result.note or before.note)
                if replace(before, date=result.date) == result:
                    return
            _write(result, folder)
    except (OSError, DataError) as error:
        log.warning("Results could not be kept in %s: %s", folder, error)


def annotate(result: PastResult, note: str) -> None:
    """Write a note on a result that is kept; a DataError if it no longer is, or has another note since."""
    text = printable(" ".join(note.split())[:LONGEST_NOTE], LONGEST_NOTE)
    with sole_writer(_home(), _PATIENCE_S):
        before = _read(_home() / f"{result.id}.json")
        if before is None:
            kept, found = "a result that is kept", "one that was forgotten since"
            raise DataError(Problem(result.campaign, kept, found, "compute it again"))
        if before.note not in (result.note, text):
            found = f"“{before.note}”, which was written since"
            raise DataError(Problem(result.campaign, f"the note “{result.note}”", found, "write yours again"))
        _write(replace(before, note=text), _home())


def _write(result: PastResult, folder: Path) -> None:
    values = {**asdict(result), "condition": result.condition and result.condition.text}
    write_atomically(folder / f"{result.id}.json", json.dumps(values, ensure_ascii=False).encode())
    with suppress(OSError):  # a record was forgotten between two looks
        files = sorted((path.stat().st_mtime, path) for path in folder.glob("*.json"))
        if len(files) > MOST:  # a prediction is made again at once
            files.sort(key=lambda own: (before := _read(own[1])) is not None and bool(before.tests or before.note))
        for _, oldest in files[: max(len(files) - MOST, 0)]:
            oldest.unlink()


def past_results() -> list[PastResult]:
    """All that was kept and can be read, the latest first."""
    results = [record for path in _home().glob("*.json") if (record := _read(path)) is not None]
    return sorted(results, key=lambda result: result.date, reverse=True)[:MOST]


def parsed(values: Mapping[str, Any]) -> PastResult:
    """A record from plain JSON values; a ValueError, TypeError, KeyError or UsageError if it is none."""
    texts = {name: values[name] for name in ("campaign", "fingerprint", "basis", "approach", "date")}
    if not all(isinstance(text, str) for text in texts.values()) or not _DATE.fullmatch(texts["date"]):
        raise ValueError("no texts, or no date")
    condition = None if values["condition"] is None else Condition.parse(values["condition"])
    expected = values["expected"] or ""
    if not isinstance(expected, str):
        raise ValueError("no expectation")  # or of an earlier version
    ratings, groups = (_ratings(values[name], texts["approach"]) for name in ("ratings", "speed_groups"))
    if not ratings and condition is None:
        raise ValueError("neither a study nor a prediction")
    note = printable(str(values.get("note", "")), LONGEST_NOTE)
    config = StudyConfig.parse(values["config"])
    return PastResult(
        **texts, config=config, ratings=ratings, speed_groups=groups, condition=condition, expected=expected, note=note
    )


def _read(path: Path) -> PastResult | None:
    try:
        if path.stat().st_size <= _LARGEST:
            return parsed(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        pass
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError, UsageError) as error:
        log.info("%s is no record of a result: %r", path.name, error)
    return None


def _ratings(values: Mapping[str, Any], approach: str) -> Ratings:
    ratings = {
        test: {name: {float(w): float(r) for w, r in by_window.items()} for name, by_window in by_approach.items()}
        for test, by_approach in values.items()
    }
    kinds = {tuple((name, *windows) for name, windows in by_approach.items()) for by_approach in ratings.values()}
    if len(kinds) > 1 or any(not by_approach.get(approach) for by_approach in ratings.values()):
        raise ValueError("ratings that differ in their approaches or windows")
    if not all(isfinite(r) for test in ratings.values() for by_window in test.values() for r in by_window.values()):
        raise ValueError("a rating that is no number")
    return ratings


def _overall(study: Study) -> Ratings:
    return {
        fold.held_out: {name: {w: round(r.overall, 6) for w, r in own.items()} for name, own in fold.ratings.items()}
        for fold in study.folds
    }


def _home() -> Path:
    return default_folder() / "history"


@dataclass(frozen=True, eq=False)
class StudyComparison:
    """Ratings that two studies of one vehicle have in common; a UsageError if none, or if they are of two vehicles."""

    first: PastResult
    second: PastResult

    def __post_init__(self) -> None:
        first, second = self.first, self.second
        if self.ratings.empty:
            raise UsageError("These two have no rating in common: no common test, approach, or window.")
        # of one vehicle: one campaign, or a changed copy of which some test and CAE run are the same
        is_named = first.campaign == second.campaign or first.fingerprint == second.fingerprint
        if not (is_named or any(_alike(first, second).values())):
            raise UsageError(f"{first.campaign} and {second.campaign} are not known to be one vehicle.")

    @cached_property
    def ratings(self) -> pd.DataFrame:
        """One row per way of leaving out, test, approach and window: both ratings, and second minus first."""
        parts = []
        for way, ratings in self._by_way.items():
            first, second = (
                pd.DataFrame(_rows(own), columns=[*_KEY, which]).astype({"window_ms": float, which: float})
                for which, own in zip(("first", "second"), ratings, strict=True)
            )
            both = first.merge(second, on=_KEY)
            both.insert(0, "left_out", way)
            parts.append(both)
        table = pd.concat(parts, ignore_index=True)
        return table.assign(difference=table["second"] - table["first"])

    def window(self, asked_ms: float) -> float:
        """The window asked for, if both were rated over it, else the longest."""
        return asked_ms if asked_ms in set(self.ratings["window_ms"]) else self.longest_ms

    @property
    def longest_ms(self) -> float:
        """The longest window that both were rated over."""
        return float(self.ratings["window_ms"].max())

    @property
    def ways(self) -> list[str]:
        """The ways of leaving tests out that both have; if none, the first of each."""
        return list(self.ratings["left_out"].unique())

    def means(self, window_ms: float | None = None, left_out: str | None = None) -> pd.DataFrame:
        """Means over the common tests by approach, with the standard error of their difference (NaN of one test)."""
        rows = []
        for approach, part in self.over(window_ms, left_out).groupby("approach", sort=False):
            gain, means = part["difference"].to_numpy(), (part["first"].mean(), part["second"].mean())
            error = gain.std(ddof=1) / np.sqrt(gain.size) if gain.size > 1 else np.nan
            counts = int((gain > 0).sum()), int((gain < 0).sum())
            rows.append((approach, gain.size, *means, gain.mean(), error, *counts))
        names = ["approach", "tests", "first", "second", "difference", "standard_error", "higher", "lower"]
        return pd.DataFrame(rows, columns=names)

    def sentences(self, window_ms: float | None = None, left_out: str | None = None) -> tuple[str, ...]:
        """For each approach, the preferred one first: which study rates it higher, and whether clearly."""
        table = self.over(window_ms, left_out)
        means = {row["approach"]: row for row in self.means(window_ms, left_out).to_dict("records")}
        return tuple(_sentence(means[name], table[table["approach"] == name]) for name in by_preference(means))

    @property
    def cautions(self) -> tuple[str, ...]:
        """What the two differ in beside their settings, if anything."""
        first, second = self.first, self.second
        cautions = []
        if self.ways[0] not in first.by_way:  # both
            harder = "second" if "speed group" in second.by_way else "first"
            cautions.append(f"The {harder} left out all tests at about a speed, the harder question.")
        if first.fingerprint != second.fingerprint:
            cautions.append(f"Their data differ: {_what_differs(first, second)}")
        if first.basis != second.basis:
            cautions.append(f"The first is rated by {first.basis}, the second by {second.basis}.")
        for one, other, which in ((first, second, "first"), (second, first, "second")):
            if alone := [test for test in one.tests if test not in other.tests]:
                cautions.append(f"Only the {which} has {read_out(alone)}.")
        return tuple(cautions)

    def over(self, window_ms: float | None = None, left_out: str | None = None) -> pd.DataFrame:
        """The ratings over one window (default: the longest) and one way of leaving out (default: the first)."""
        window = self.longest_ms if window_ms is None else window_ms
        way = self.ways[0] if left_out is None else left_out
        return self.ratings[(self.ratings["window_ms"] == window) & (self.ratings["left_out"] == way)]

    @property
    def _by_way(self) -> dict[str, tuple[Ratings, Ratings]]:
        first, second = self.first.by_way, self.second.by_way
        if common := [way for way in first if way in second]:
            return {way: (first[way], second[way]) for way in common}
        (way, ratings), (other_way, others) = *first.items(), *second.items()
        return {f"{way}, {other_way}": (ratings, others)}


def _rows(ratings: Ratings) -> Iterator[tuple[str, str, float, float]]:
    return (
        (test, approach, window, rating)
        for test, by_approach in ratings.items()
        for approach, by_window in by_approach.items()
        for window, rating in by_window.items()
    )


def _sentence(row: dict[str, float], table: pd.DataFrame) -> str:
    label = LABELS.get(str(row["approach"]), row["approach"])
    gain, error, n = row["difference"], row["standard_error"], row["tests"]
    if not table["difference"].any():
        return f"{label}: the same in both, mean {row['first']:.3f}."
    verdict = f"{'' if abs(gain) > _CLEARLY * error else 'not '}clearly {'higher' if gain > 0 else 'lower'}"
    scatter, most = "" if n == 1 else f" ± {error:.3f}", table.loc[table["difference"].abs().idxmax()]
    return (
        f"{label}: {verdict} in the second ({difference(row['second'], row['first'], 3)}{scatter} over "
        f"{counted(int(n), 'test')}), most in {most['held_out']} ({difference(most['second'], most['first'], 3)})."
    )


def _what_differs(one: PastResult, other: PastResult) -> str:
    alike = _alike(one, other)
    if not alike:
        return "tests are compared by their ids."
    changed = ", ".join(test for test, is_alike in alike.items() if not is_alike)
    if not changed:
        return "not in these tests."
    vehicles = "" if any(alike.values()) else " These are perhaps two vehicles."
    return f"the raw CAE model is rated differently in {changed}: other tests or CAE runs.{vehicles}"


def _alike(one: PastResult, other: PastResult) -> dict[str, bool]:
    alike = {}
    for test in one.ratings:
        first, second = (result.ratings.get(test, {}).get(Cae.name, {}) for result in (one, other))
        if common := first.keys() & second.keys():
            alike[test] = all(abs(first[window] - second[window]) <= _SAME for window in common)
    return alike
