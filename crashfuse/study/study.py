"""What a leave-one-out study found: its folds, and what they say together."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crashfuse.approaches.calibration import Calibration, shares_inside
from crashfuse.campaign import Campaign
from crashfuse.errors import UsageError, one_of
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.fold import Fold
from crashfuse.study.repeatability import Repeatability

if TYPE_CHECKING:
    from typing import Unpack

    import pandas as pd
    import plotly.graph_objects as go

    from crashfuse.campaign_folder.notes import Note
    from crashfuse.reporting.figures import Further
    from crashfuse.reporting.plots.display import DisplayOptions
    from crashfuse.reporting.report import ReportOptions


@dataclass(frozen=True, eq=False)
class Study:
    """A finished study: one fold for each held-out test, in the order of the campaign.

    Attributes
    ----------
    speed_groups : Study, optional
        The same tests, each left out with all others at about its speed, if both were requested and are possible.
    repeatability : mapping of str to mapping of float to Repeatability
        By test, then window in ms, see :func:`crashfuse.study.repeatability.repeatability`.
    """

    campaign: Campaign
    config: StudyConfig
    folds: tuple[Fold, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    speed_groups: "Study | None" = None
    repeatability: Mapping[str, Mapping[float, Repeatability]] = field(default_factory=dict)

    def fold(self, held_out: str) -> Fold:
        """The fold with this test held out.

        Raises
        ------
        UsageError
            If there is none.
        """
        for fold in self.folds:
            if fold.held_out == held_out:
                return fold
        known = ", ".join(fold.held_out for fold in self.folds)
        raise UsageError(f"Test {held_out!r} was not left out in this study; left out were {known}.")

    @property
    def scores(self) -> "pd.DataFrame":
        """Ratings, one row a held-out test, approach and window, as ``scores.csv``."""
        from crashfuse.reporting.result_tables import scores_table

        return scores_table(self)

    @property
    def pulses(self) -> "pd.DataFrame":
        """Pulses of the tests and their predictions with their bands, as ``pulses.csv``."""
        from crashfuse.reporting.result_tables import study_pulses

        return study_pulses(self)

    @property
    def metrics(self) -> "pd.DataFrame":
        """Pulse metrics of the tests and their predictions, as ``metrics.csv``."""
        from crashfuse.reporting.result_tables import study_metrics

        return study_metrics(self)

    @property
    def repeat_scores(self) -> "pd.DataFrame":
        """What a repeat of each held-out test would rate, one row a test and window, as in ``study.json``."""
        from crashfuse.reporting.result_tables import repeat_scores

        return repeat_scores(self)

    def plot(
        self,
        held_out: str = "",
        figure: str = "",
        *,
        approaches: Sequence[str] | None = None,
        also: "Sequence[Further]" = (),
        band: str | None = None,
        measured: bool = True,
        corridors: bool = False,
        notes: "Sequence[Note]" = (),
        **display: "Unpack[DisplayOptions]",
    ) -> "go.Figure":
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
            The approaches that are shown; by default all. Of several, ``rating`` and the figures of networks show the
            preferred one.
        also : sequence of str, PredictedPulse or EarlierPrediction
            Pulses put beside those of a test: tests and CAE runs by their ids, predictions elsewhere, and of the same
            test with other settings.
        band : str, optional
            The approach whose band is filled; by default the preferred one.
        measured : bool
            Whether to show the test itself.
        corridors : bool
            Whether to shade the corridors of the rating about the test.
        notes : sequence of Note
            Drawn as marks over time, those that are about this test.
        **display
            ``window_ms``, by default the longest, ``unit``, ``deceleration``, ``units``, see
            :class:`crashfuse.reporting.plots.display.DisplayOptions`.

        Raises
        ------
        UsageError
            If the test was not held out; if there is no such figure, approach, test, CAE run, option or unit; or if the
            study was not rated over this window.
        """
        from crashfuse.reporting.study_figures import figure_of_test, overview

        if not held_out:
            return overview(self, figure or "ratings", approaches, **display)
        return figure_of_test(
            self, held_out, figure or "motion", approaches,
            also=also, band=band, measured=measured, corridors=corridors, notes=notes, **display,
        )  # fmt: skip

    def write(
        self, folder: str | Path, *, report: "ReportOptions | None" = None, **display: "Unpack[DisplayOptions]"
    ) -> None:
        """Write what ``crashfuse study`` writes: tables, ``study.json``, ``report.html``.

        Raises
        ------
        OSError
            If the folder cannot be written.
        """
        from crashfuse.reporting.plots.display import Display
        from crashfuse.reporting.report import ReportOptions
        from crashfuse.reporting.results import write_study

        shown = Display.of(self.campaign.units, **display)
        write_study(self, folder, shown, ReportOptions() if report is None else report)

    def __repr__(self) -> str:
        window = self.config.windows_ms[-1]
        means = ", ".join(f"{name} {self.mean_rating(name, window):.3f}" for name in self.config.approaches)
        tests = self.folds[0].held_out if len(self.folds) == 1 else f"{len(self.folds)} tests"
        return f"<Study of {self.campaign.name!r}, {tests} left out: {means} (0–{window:g} ms)>"

    def _repr_html_(self) -> str:
        from crashfuse.reporting.notebook import study_html

        return study_html(self)

    def mean_rating(self, approach: str, window_ms: float | None = None) -> float:
        """Overall rating of an approach over one window, by default the longest, averaged over the held-out tests."""
        window_ms = max(self.config.windows_ms) if window_ms is None else window_ms
        one_of("approach of this study", approach, dict.fromkeys(self.config.approaches))
        return float(np.mean([fold.ratings[approach][window_ms].overall for fold in self.folds]))

    def mean_repeat(self, window_ms: float) -> float | None:
        """What repeats would rate over one window, averaged over the held-out tests; None unless known for all."""
        values = [repeat.value for repeat in self.repeats(window_ms).values()]
        return float(np.mean(values)) if len(values) == len(self.folds) else None

    def repeats(self, window_ms: float) -> dict[str, Repeatability]:
        """What a repeat of each held-out test would rate over one window, where it is known."""
        found = {fold.held_out: self.repeatability.get(fold.held_out, {}).get(window_ms) for fold in self.folds}
        return {test: repeat for test, repeat in found.items() if repeat is not None}

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
        found: dict[str, Calibration] = {}
        for name in self.config.approaches:
            inside = tuple(own for fold in self.folds if (own := fold.coverage(name)) is not None)
            if inside:
                found[name] = Calibration(1.0, inside)
        return found

    @cached_property
    def reliability(self) -> dict[str, FloatArray]:
        """Mean share of a(t) inside the bands at :data:`~crashfuse.approaches.calibration.LEVELS`, by approach."""
        shares = defaultdict[str, list[FloatArray]](list)
        for fold in self.folds:
            for estimate in fold.estimates:
                if (draws := estimate.prediction.draws_mps2) is not None:
                    shares[estimate.approach].append(shares_inside(fold.test, draws))
        return {name: np.mean(own, axis=0) for name, own in shares.items()}
