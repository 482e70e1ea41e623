"""Two studies beside each other: which one rates better, on which tests, and by how much."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.errors import UsageError
from crashfuse.study.history import PastResult
from crashfuse.wording import signed

_CLEARLY = 2.0  # standard errors


@dataclass(frozen=True, eq=False)
class StudyComparison:
    """Ratings of the tests, by the approaches and over the windows that two studies have in common.

    Raises
    ------
    UsageError
        If they have nothing in common.
    """

    first: PastResult
    second: PastResult

    def __post_init__(self) -> None:
        if self.ratings.empty:
            raise UsageError(
                "These two have no rating in common: no test that both left out in the same way, no approach, or no "
                "window."
            )

    @cached_property
    def ratings(self) -> pd.DataFrame:
        """One row per way of leaving out, test, approach and window: both ratings, and second minus first."""
        ways = self.second.by_way
        rows = [
            (way, test, approach, window, rating, ways[way][test][approach][window])
            for way, by_test in self.first.by_way.items()
            for test, by_approach in by_test.items()
            for approach, by_window in by_approach.items()
            for window, rating in by_window.items()
            if window in ways.get(way, {}).get(test, {}).get(approach, {})
        ]
        table = pd.DataFrame(rows, columns=["left_out", "held_out", "approach", "window_ms", "first", "second"])
        return table.assign(difference=table["second"] - table["first"])

    @property
    def windows_ms(self) -> list[float]:
        """The windows that both were rated over, ascending."""
        return sorted(map(float, self.ratings["window_ms"].unique()))

    @property
    def longest_ms(self) -> float:
        """The longest of them."""
        return self.windows_ms[-1]

    def window(self, asked_ms: float) -> float:
        """The window asked for, if both were rated over it, else the longest."""
        return asked_ms if asked_ms in self.windows_ms else self.longest_ms

    @property
    def ways(self) -> list[str]:
        """The ways of leaving tests out that both have."""
        return list(self.ratings["left_out"].unique())

    def means(self, window_ms: float | None = None, left_out: str | None = None) -> pd.DataFrame:
        """One row per approach, over one window, by default the longest, and one way of leaving out.

        Means over the common tests, their difference with its standard error over the tests (NaN of a single one), and
        in how many tests the second rates higher or lower.
        """
        rows = []
        for approach, own in self.over(window_ms, left_out).groupby("approach", sort=False):
            gain = own["difference"].to_numpy()
            error = gain.std(ddof=1) / np.sqrt(gain.size) if gain.size > 1 else np.nan
            rows.append(
                (approach, gain.size, own["first"].mean(), own["second"].mean(), gain.mean(), error,
                 int((gain > 0).sum()), int((gain < 0).sum()))
            )  # fmt: skip
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
        said = []
        if first.fingerprint != second.fingerprint:
            said.append("Their data differ: tests are compared by their ids, whatever was measured in them.")
        if first.basis != second.basis:
            said.append(f"Their ratings rest on different things: {first.basis}; {second.basis}.")
        for one, other, which in ((first, second, "first"), (second, first, "second")):
            if alone := [test for test in one.tests if test not in other.tests]:
                said.append(f"Rated in the {which} only: {', '.join(alone)}.")
        return tuple(said)

    def over(self, window_ms: float | None = None, left_out: str | None = None) -> pd.DataFrame:
        """The ratings over one window (default: the longest) and one way of leaving out (default: the first)."""
        window = self.longest_ms if window_ms is None else window_ms
        way = self.ways[0] if left_out is None else left_out
        return self.ratings[(self.ratings["window_ms"] == window) & (self.ratings["left_out"] == way)]


def _sentence(row: dict[str, float], table: pd.DataFrame) -> str:
    label, gain, error, n = (
        LABELS.get(str(row["approach"]), row["approach"]),
        *(row[name] for name in ("difference", "standard_error", "tests")),
    )
    if not table["difference"].any():
        return f"{label}: the same in both, mean {row['first']:.3f}."
    told = f"mean {row['second']:.3f} in the second, {row['first']:.3f} in the first"
    if n == 1:
        return f"{label}: {told}, a difference of {signed(gain, 3)} in one test."
    clear = abs(gain) > _CLEARLY * error
    better = "second" if gain > 0 else "first"
    verdict = f"the {better} is better" if clear else "no clear difference"
    most = table.loc[table["difference"].abs().idxmax()]
    return (
        f"{label}: {verdict}; {told} ({signed(gain, 3)} ± {error:.3f} over {n} tests). The second is higher in "
        f"{row['higher']}, lower in {row['lower']}, and differs most in {most['held_out']} "
        f"({signed(most['difference'], 3)})."
    )
