"""A leave-one-out study (cross-validation): a fold for each test left out, and what the folds say together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self, Unpack

import numpy as np

from crashfuse import views
from crashfuse.approaches.calibration import Calibration, Coverage, shares_inside
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError, one_of
from crashfuse.signals.metrics import checked_metrics, further_metrics
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import SHORTEST_WINDOW_S, Ratings, rate_many, rate_windows, rated_curves
from crashfuse.signals.rating_explanation import RatingExplanation, explain_rating
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.repeatability import Repeatability
from crashfuse.units import MS

_RATED_DRAWS = 100

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Fold:
    """One held-out test with the prediction of each approach: the only place where both are compared."""

    test: CrashTest
    estimates: tuple[Estimate, ...]
    ratings: dict[str, Ratings]  # by approach, then by window in ms
    _drawn: dict[tuple[str, float], FloatArray] = field(default_factory=dict, repr=False)
    _explained: dict[tuple[str, float], RatingExplanation] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, test: CrashTest, estimates: Sequence[Estimate], windows_ms: Sequence[float]) -> Self:
        """Rate the predictions for a test, whose pulse is first used here."""
        pulses = {estimate.approach: Pulse(GRID_S, estimate.accel_mps2) for estimate in estimates}
        ratings = {name: rate_windows(test.pulse, pulse, windows_ms) for name, pulse in pulses.items()}
        return cls(test, tuple(estimates), ratings)

    def __repr__(self) -> str:
        window_ms = max(next(iter(self.ratings.values()), {0.0: None}))
        rated = ", ".join(f"{name} {by_window[window_ms].overall:.3f}" for name, by_window in self.ratings.items())
        return f"<Fold of {self.held_out}: {rated} (0–{window_ms:g} ms)>"

    @property
    def held_out(self) -> str:
        """Id of the held-out test."""
        return self.test.id

    @cached_property
    def ttzv_ms(self) -> float | None:
        """The test's time of zero velocity, if over 10 ms and in its record."""
        stop_s = float(self.test.pulse.kinematics(self.test.condition.speed_mps).t0_s)
        return round(stop_s / MS, 1) if SHORTEST_WINDOW_S <= stop_s <= self.test.recorded_s else None

    @cached_property
    def _to_ttzv(self) -> dict[str, Ratings]:
        return Fold.of(self.test, self.estimates, [] if self.ttzv_ms is None else [self.ttzv_ms]).ratings

    def overall_to_ttzv(self, approach: str) -> float:
        """Overall rating of an approach up to :attr:`ttzv_ms`, for tables alone; NaN if that is not known."""
        return np.nan if self.ttzv_ms is None else self._to_ttzv[approach][self.ttzv_ms].overall

    def further(self, approach: str, window_ms: float, names: Sequence[str]) -> dict[str, float]:
        """Measures of an approach's prediction beside its rating over [0, window_ms), by column."""
        predicted = Pulse(GRID_S, self.estimate(approach).accel_mps2)
        return further_metrics(rated_curves(self.test.pulse, predicted, window_ms), names) if names else {}

    @property
    def with_band(self) -> tuple[str, ...]:
        """Names of the approaches whose predictions have a band."""
        return tuple(e.approach for e in self.estimates if e.draws_mps2 is not None)

    def coverage(self, approach: str) -> Coverage | None:
        """Whether the test lies inside an approach's band, crush and peak in calibrated intervals; None without one."""
        estimate = self.estimate(approach)
        draws, speed_mps = estimate.draws_mps2, self.test.condition.speed_mps
        if draws is None:
            return None
        band, intervals = Coverage.of(self.test, draws), {metric.name: metric for metric in estimate.metrics}
        measured = {m.name: m.value for m in checked_metrics(self.test.pulse.accel_mps2, speed_mps)}
        crush, peak = (intervals[name].holds(measured[name]) for name in ("max_crush", "peak"))
        return replace(band, crush=band.crush if crush is None else crush, peak=band.peak if peak is None else peak)

    def estimate(self, approach: str) -> Estimate:
        """The estimate of this approach; a UsageError if the study is without it."""
        return one_of("prediction of this test by", approach, {e.approach: e for e in self.estimates})

    def explained(self, approach: str, window_ms: float) -> RatingExplanation:
        """What the rating of an approach's prediction over [0, window_ms) is made of."""
        if (key := (approach, window_ms)) not in self._explained:
            predicted = Pulse(GRID_S, self.estimate(approach).accel_mps2)
            self._explained[key] = explain_rating(self.test.pulse, predicted, window_ms)
        return self._explained[key]

    def rating_draws(self, approach: str, window_ms: float) -> FloatArray:
        """Overall ratings of pulses drawn from an approach's band, shape (n_draws,): a repeat's, if it is right."""
        if (key := (approach, window_ms)) not in self._drawn:  # a hundred ratings: computed on request, and once
            draws = self.estimate(approach).draws_mps2
            if draws is None:
                raise UsageError(f"{approach} has no band to draw pulses from.")
            n = round(window_ms / 1e3 / DT_S)
            chosen = draws[:: -(-len(draws) // _RATED_DRAWS), :n]
            rated = rate_many(self.test.pulse.accel_mps2[:n], chosen, dt_s=DT_S)
            self._drawn[key] = np.array([rating.overall for rating in rated])
        return self._drawn[key]

    def rating_interval(self, approach: str, window_ms: float) -> tuple[float, float]:
        """Central 95 % interval of the ratings of drawn pulses."""
        lower, upper = np.quantile(self.rating_draws(approach, window_ms), [0.025, 0.975])
        return float(lower), float(upper)


@dataclass(frozen=True, eq=False)
class Study:
    """A finished study: one fold for each held-out test, in the order of the campaign."""

    campaign: Campaign
    config: StudyConfig
    folds: tuple[Fold, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    speed_groups: Study | None = None  # each left out with all others at about its speed, if both were requested
    repeatability: Mapping[str, Mapping[float, Repeatability]] = field(default_factory=dict)  # by test, window in ms

    def fold(self, held_out: str) -> Fold:
        """The fold with this test held out; a UsageError if there is none."""
        by_test = {fold.held_out: fold for fold in self.folds}
        if held_out not in by_test:
            raise UsageError(f"Test {held_out!r} was not left out in this study; left out were {', '.join(by_test)}.")
        return by_test[held_out]

    @property
    def scores(self) -> pd.DataFrame:
        """Ratings, one row a held-out test, approach and window, as ``scores.csv``."""
        return views.scores_table(self)

    @property
    def pulses(self) -> pd.DataFrame:
        """Pulses of the tests and their predictions with their bands, as ``pulses.csv``."""
        return views.study_pulses(self)

    @property
    def metrics(self) -> pd.DataFrame:
        """Pulse metrics of the tests and their predictions, as ``metrics.csv``."""
        return views.study_metrics(self)

    def draw(
        self,
        held_out: str = "",
        figure: str = "",
        *,
        approaches: Sequence[str] | None = None,
        also: Sequence[views.Further] = (),
        band: str | None = None,
        measured: bool = True,
        corridors: bool = False,
        notes: Sequence[Note] = (),
        **display: Unpack[views.DisplayOptions],
    ) -> views.Drawing:
        """A figure of the page Compare, of one held-out test, or of the page Study, of all of them.

        Parameters
        ----------
        held_out : str
            Id of the test; empty for a figure of all.
        figure : str
            Of a test: ``motion`` (the default), ``acceleration``, ``residuals``, ``displacement``, ``energy``,
            ``integration``, ``bias parts``, ``scores``, ``rating``, ``training``, ``fine-tuning``. Of all: ``ratings``
            (the default), ``draws``, ``calibration``.
        approaches : sequence of str, optional
            By default all. Of several, ``rating`` and the figures of networks show the preferred one.
        also : sequence of str, PredictedPulse or EarlierPrediction
            Pulses put beside those of a test: tests and CAE runs by their ids, and predictions.
        band : str, optional
            The approach whose band is filled; by default the preferred one.
        measured, corridors : bool
            Whether to show the test itself, and to shade the corridors of the rating about it.
        notes : sequence of Note
            Drawn as marks over time, those that are about this test.
        **display
            See :class:`crashfuse.results.display.DisplayOptions`; by default the longest window.
        """
        if not held_out:
            return views.overview(self, figure or "ratings", approaches, **display)
        return views.figure_of_test(
            self,
            held_out,
            figure or "motion",
            approaches,
            also=also,
            band=band,
            measured=measured,
            corridors=corridors,
            notes=notes,
            **display,
        )

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def write(
        self, folder: str | Path, *, report: views.ReportOptions | None = None, **display: Unpack[views.DisplayOptions]
    ) -> None:
        """Write what ``crashfuse study`` writes: tables, ``study.json``, ``report.html``."""
        shown = views.Display.of(self.campaign.units, **display)
        views.write_result(views.study_result(self, report or views.ReportOptions(), shown.window_ms), folder, shown)

    def __repr__(self) -> str:
        window = self.config.windows_ms[-1]
        means = ", ".join(f"{name} {self.mean_rating(name, window):.3f}" for name in self.config.approaches)
        tests = self.folds[0].held_out if len(self.folds) == 1 else f"{len(self.folds)} tests"
        return f"<Study of {self.campaign.name!r}, {tests} left out: {means} (0–{window:g} ms)>"

    def _repr_html_(self) -> str:
        return views.result_html(views.study_result(self))

    def mean_rating(self, approach: str, window_ms: float | None = None) -> float:
        """Overall rating of an approach over one window, by default the longest, averaged over the held-out tests."""
        window_ms = max(self.config.windows_ms) if window_ms is None else window_ms
        one_of("approach of this study", approach, dict.fromkeys(self.config.approaches))
        return float(np.mean([fold.ratings[approach][window_ms].overall for fold in self.folds]))

    def rating_spread(self, window_ms: float) -> dict[str, dict[str, tuple[float, float, float]]]:
        """Overall rating over one window and interval of single draws, by test and approach with a band."""
        return {
            fold.held_out: {
                name: (fold.ratings[name][window_ms].overall, *fold.rating_interval(name, window_ms))
                for name in fold.with_band
            }
            for fold in self.folds
        }

    @cached_property
    def coverage(self) -> dict[str, Calibration]:
        """Coverage of the held-out tests by the 95 % bands and intervals of each approach that has them."""
        by_approach = {
            name: tuple(own for fold in self.folds if (own := fold.coverage(name)) is not None)
            for name in self.config.approaches
        }
        return {name: Calibration(1.0, coverages) for name, coverages in by_approach.items() if coverages}

    @cached_property
    def reliability(self) -> dict[str, FloatArray]:
        """Mean share of a(t) inside the bands at :data:`~crashfuse.approaches.calibration.LEVELS`, by approach."""
        shares = defaultdict[str, list[FloatArray]](list)
        for fold in self.folds:
            for estimate in fold.estimates:
                if (draws := estimate.draws_mps2) is not None:
                    shares[estimate.approach].append(shares_inside(fold.test, draws))
        return {name: np.mean(rows, axis=0) for name, rows in shares.items()}
