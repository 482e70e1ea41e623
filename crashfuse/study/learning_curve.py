"""Learning curve: how well tests are predicted from fewer of the others, chosen evenly over speed or at random.

Sorted by speed, an even choice of k of n tests takes one test of each kth part of the list (systematic sampling), at
places that move until each test was left out at least once.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing
from dataclasses import astuple, dataclass, replace
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import Any, Literal, NamedTuple, Unpack, cast

import numpy as np
import pandas as pd

from crashfuse import views
from crashfuse.approaches.base import MOST_TESTS
from crashfuse.approaches.metric_calibration import Distribution, metric_distributions
from crashfuse.approaches.registry import CLASSES
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError, one_of, require_a
from crashfuse.execution.cache import Cache, Code
from crashfuse.execution.run import Run, RunOptions, one_thread_throughout
from crashfuse.execution.workers import running
from crashfuse.signals.pulse import DT_S, GRID_S, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.config import StudyConfig, StudyPlan, require_rated
from crashfuse.study.estimate import Estimate, Fit, estimates_at, find_estimate, store_estimate
from crashfuse.study.running import prepare
from crashfuse.units import G

Choice = Literal["even", "random"]

_SIZES = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 24, MOST_TESTS)
_LEAST = 3  # even choices of a size, where there are as many

REPEATS = 3
"""Random choices of each number of tests."""

CURVE_CONFIG = StudyConfig(approaches=("cae", "fused"))
"""Default settings: the raw CAE model, which needs no test, beside the fused prediction."""

_STEP = "Predictions from fewer tests"
_KIND = "learning curve"  # kind of cache entry
_FORECAST = "forecast"  # column of what is kept, but not of the table
_Row = dict[str, Any]


class Subset(NamedTuple):
    """Tests to learn from, and how they were chosen."""

    choice: Choice
    chosen: tuple[str, ...]  # ids in the order of the campaign


def subsets(campaign: Campaign, repeats: int, seed: int) -> tuple[Subset, ...]:
    """Choices of 1, 2, 3, 4, 6, 8, 10 … and of all but one of a campaign's tests.

    Of each size ``repeats`` are random; of all tests but one, the even choices are all that there are.
    """
    n = len(campaign.tests)
    by_speed = sorted(range(n), key=lambda i: (campaign.tests[i].condition.speed_mps, i))
    choices: list[tuple[Choice, list[int]]] = []
    for size in sorted({size for size in _SIZES if size < n - 1} | {n - 1} - {0}):
        even = list(dict.fromkeys(_evenly(n, size)))
        choices += [("even", [by_speed[place] for place in places]) for places in even]
        if len(even) < math.comb(n, size):
            rng = np.random.default_rng([seed, size])
            drawn = {tuple(sorted(rng.choice(n, size, replace=False).tolist())): None for _ in range(repeats)}
            choices += [("random", list(numbers)) for numbers in drawn]
    return tuple(Subset(way, tuple(campaign.test_ids[i] for i in sorted(numbers))) for way, numbers in choices)


def _evenly(n: int, size: int) -> Iterator[tuple[int, ...]]:
    # A test is left out by a share 1 - size / n of all places within the parts, so this many leave out each of them.
    choices = max(_LEAST, math.ceil(n / (n - size)))
    for number in range(choices):
        yield tuple((2 * (part * choices + number) + 1) * n // (2 * choices * size) for part in range(size))


@dataclass(frozen=True, eq=False)
class LearningCurve:
    """How well tests are predicted from fewer of the others.

    Attributes
    ----------
    table : DataFrame
        One row for each part of the tests, held-out test, approach and window: n_tests, chosen (ids that were learned
        from), choice (``even`` or ``random``), held_out, approach, window_ms, overall (rating), inside (share of a(t)
        in the 95 % band), half_width_g (mean, of that band; both NaN without one) and basis (what the rating rests on).
    forecasts : tuple of dict
        For each row, the calibrated distributions of the held-out test's metrics, by name; None where unknown.
    """

    campaign: Campaign
    config: StudyConfig
    repeats: int
    table: pd.DataFrame
    forecasts: tuple[dict[str, Distribution | None], ...]
    seconds: float

    @property
    def window_ms(self) -> float:
        """The longest rated window, for which results are summarised."""
        return max(self.config.windows_ms)

    def over(self, window_ms: float) -> LearningCurve:
        """The same curve, summarised over another of its windows; a UsageError if it was not rated over that."""
        require_rated("learning curve", window_ms, self.table["window_ms"].unique().tolist())
        return replace(self, config=replace(self.config, windows_ms=(window_ms,)))

    @property
    def judged(self) -> str:
        """The approach that the summary is about: of those that learn from tests, the preferred one."""
        return next(name for name in ("fused", *self.config.approaches[::-1]) if name in self.config.approaches)

    def by_test(self, approach: str) -> pd.DataFrame:
        """Ratings over the longest window, by held-out test and number of tests: means over the even choices."""
        one_of("approach of this learning curve", approach, dict.fromkeys(self.config.approaches))
        table = self.table
        rows = (table["approach"] == approach) & (table["window_ms"] == self.window_ms) & (table["choice"] == "even")
        return table[rows].pivot_table(index="held_out", columns="n_tests", values="overall")

    def draw(self, **display: Unpack[views.DisplayOptions]) -> views.Drawing:
        """Rating and width of the band over the number of tests, as the page Study shows them."""
        shown = views.Display.of(self.campaign.units, self.window_ms, **display)
        return views.over_number_of_tests(self.over(shown.window_ms), shown)

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def write(self, folder: str | Path, *, cost: str | None = None, **display: Unpack[views.DisplayOptions]) -> None:
        """Write what ``crashfuse learning-curve`` writes; ``cost`` is that of one test, such as ``60,000 EUR``."""
        result = views.learning_curve_result(self, cost)
        views.write_result(result, folder, views.Display.of(self.campaign.units, **display))

    def __repr__(self) -> str:
        sizes = self.table["n_tests"].unique()
        return f"<LearningCurve of {self.campaign.name!r}: {self.judged} with {sizes.min()} to {sizes.max()} tests>"

    def _repr_html_(self) -> str:
        return views.result_html(views.learning_curve_result(self))


def learning_curve(
    campaign: Campaign, config: StudyConfig = CURVE_CONFIG, *, repeats: int = REPEATS, **run: Unpack[RunOptions]
) -> LearningCurve:
    """Predict and rate tests from 1, 2, 3, 4, 6, 8, 10 … and all but one of the others.

    Of each number of tests ``repeats`` choices are random, beside the even ones. The config gives approaches, windows
    and seed; ``run`` is :class:`crashfuse.execution.run.RunOptions`.
    """
    require_a(StudyConfig, config, "crashfuse.StudyConfig()")
    if isinstance(repeats, bool) or not (isinstance(repeats, Integral) and repeats >= 0):
        raise UsageError(f"The number of random choices is 0 (even ones alone) or more, not {repeats!r}.")
    start = time.perf_counter()
    config = replace(config, leave_out="test")
    StudyPlan(campaign, config)  # checks tests, windows and settings
    parts = subsets(campaign, repeats, config.seed)
    with running(campaign, **run) as started:
        campaign = started.bind(campaign)
        distinct = dict.fromkeys(part.chosen for part in parts)
        table, forecasts = _table(parts, _known(campaign, config, distinct, started))
    table["basis"] = campaign.rating_basis
    return LearningCurve(campaign, config, repeats, table, forecasts, time.perf_counter() - start)


def _known(
    campaign: Campaign, config: StudyConfig, distinct: Collection[tuple[str, ...]], run: Run
) -> dict[tuple[str, ...], list[_Row]]:
    cache = run.cache
    known = {chosen: rows for chosen in distinct if (rows := cache.find(_KIND, _key(campaign, chosen, config), _rows))}
    # the largest first: at the end, no worker is left alone with a long task
    unknown = sorted((chosen for chosen in distinct if chosen not in known), key=len, reverse=True)
    shared = prepare(campaign, set(config.approaches) if unknown else set(), config, run)
    work = partial(_predicted, config=config.on_this_device)
    run.watch.report(_STEP, len(known), len(distinct))
    with closing(shared.completed(work, campaign, unknown)) as completed:
        for finished in completed:
            for chosen, rows in finished:
                cache.put(_KIND, _key(campaign, chosen, config), {"rows": np.array(json.dumps(rows))})
                known[chosen] = rows
            run.watch.report(_STEP, len(known), len(distinct))
    return known


def is_curve_cached(campaign: Campaign, config: StudyConfig, repeats: int = REPEATS) -> bool:
    """Whether :func:`learning_curve` would find everything in the cache."""
    config = replace(config, leave_out="test")
    parts, cache = subsets(campaign, repeats, config.seed), Cache(campaign.cache_folder)
    return all(cache.is_cached(_KIND, _key(campaign, part.chosen, config)) for part in parts)


def _predicted(
    campaign: Campaign, chosen: tuple[str, ...], run: Run, *, config: StudyConfig
) -> list[tuple[tuple[str, ...], list[_Row]]]:
    held_out = [test for test in campaign.tests if test.id not in chosen]
    training = campaign.without([test.id for test in held_out])
    as_in_studies = len(held_out) == 1
    with one_thread_throughout():
        condition, cache = held_out[0].condition, run.cache
        studied = (find_estimate(training, condition, name, config, cache) for name in config.approaches)
        estimates = [estimate for estimate in studied if estimate is not None] if as_in_studies else []
        if len(estimates) < len(config.approaches):
            # mixtures come last, so that they find the fits of the others in the cache
            names = sorted(config.approaches, key=CLASSES.declared.index)
            fits = [Fit.of(training, name, config, run) for name in names]
            estimates = [estimate for test in held_out for estimate in estimates_at(fits, test.condition)]
            for estimate in estimates if as_in_studies else ():
                store_estimate(estimate, training, config, run.cache)
        pairs = zip(estimates, [test for test in held_out for _ in config.approaches], strict=True)
        return [(chosen, [row for pair in pairs for row in _measured(*pair, config.windows_ms)])]


def _measured(estimate: Estimate, test: CrashTest, windows_ms: Sequence[float]) -> Iterator[_Row]:
    forecast = metric_distributions(estimate.drawn, estimate.metric_errors)
    plain = {name: None if metric is None else astuple(metric) for name, metric in forecast.items()}
    for window in windows_ms:
        yield {**measure(estimate, test, window), _FORECAST: plain}


def measure(estimate: Estimate, test: CrashTest, window_ms: float) -> _Row:
    """What a prediction is worth, by column of the table, against a test that it did not learn from."""
    n = round(window_ms / 1e3 / DT_S)
    rating = rate_windows(test.pulse, Pulse(GRID_S, estimate.accel_mps2), [window_ms])[float(window_ms)]
    inside = half_width_g = None
    if (band := estimate.band()) is not None:
        lower, upper = (end[:n] for end in band)
        measured = test.pulse.accel_mps2[:n]
        inside = float(((measured >= lower) & (measured <= upper)).mean())
        half_width_g = float((upper - lower).mean()) / 2 / G
    asked = {"held_out": test.id, "approach": estimate.approach, "window_ms": float(window_ms)}
    return {**asked, "overall": rating.overall, "inside": inside, "half_width_g": half_width_g}


def _table(
    parts: Sequence[Subset], known: dict[tuple[str, ...], list[_Row]]
) -> tuple[pd.DataFrame, tuple[dict[str, Distribution | None], ...]]:
    rows = list[_Row]()
    for part in parts:
        subset = {"n_tests": len(part.chosen), "chosen": " ".join(part.chosen), "choice": part.choice}
        rows += [{**subset, **row} for row in known[part.chosen]]
    table = pd.DataFrame(rows).astype({"inside": float, "half_width_g": float})
    plain = table.pop(_FORECAST)
    return table, tuple({name: own and Distribution(*own) for name, own in row.items()} for row in plain)


def _rows(entry: dict[str, Any]) -> list[_Row]:
    return cast(list[_Row], json.loads(str(entry["rows"])))


def _key(campaign: Campaign, chosen: tuple[str, ...], config: StudyConfig) -> dict[str, object]:
    fits = [config.create(name).identity for name in config.approaches]
    learned = {"windows_ms": config.windows_ms, "campaign": campaign.fingerprint, "chosen": chosen}
    return {"fits": fits, **learned, "code": Code(__name__)}
