"""Two studies beside each other: which one rates higher, in which tests, and by how much."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from crashfuse.approaches.cae import Cae
from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.errors import UsageError
from crashfuse.study.history import PastResult, Ratings
from crashfuse.units import counted, difference

_CLEARLY = 2.0  # standard errors
_SAME = 1e-6  # records are rounded to six digits
_KEY = ["held_out", "approach", "window_ms"]


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
        """One for each approach, the preferred one first: which study rates it higher, and whether that is clear."""
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
            cautions.append(f"Rated by {first.basis}, and by {second.basis}.")
        for one, other, which in ((first, second, "first"), (second, first, "second")):
            if alone := [test for test in one.tests if test not in other.tests]:
                cautions.append(f"Rated in the {which} only: {', '.join(alone)}.")
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
