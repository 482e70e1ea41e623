"""The campaign: CAE runs and tests of one vehicle, and the fingerprint of their exact content."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crashfuse import views
from crashfuse.cae_library import CaeLibrary, QualityLimits, QualityVerdict, judge_quality
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest, speed_groups
from crashfuse.errors import UsageError, require_a, several
from crashfuse.signals.metrics import Metric, checked_metrics, metric_bases, metric_headings
from crashfuse.signals.occupant import USUAL_OCCUPANT, OccupantModel
from crashfuse.signals.pulse import GRID_S, FloatArray
from crashfuse.signals.rating import filter_class_text, rating_basis
from crashfuse.units import MPH_LB, UnitSystem
from crashfuse.vehicle_archive import Prior, VehicleArchive

if TYPE_CHECKING:
    from typing import Unpack

    import pandas as pd


@dataclass(frozen=True, eq=False)
class Campaign:
    """CAE runs and tests of one vehicle, all on the study grid.

    Parameters
    ----------
    notice : str
        A sentence shown wherever the campaign is shown (such as "synthetic"); empty for none.
    warnings : tuple of str
        Findings of the check that are allowed but worth knowing.
    channel_filter_class : float, optional
        CFC that records were filtered with on reading (SAE J211-1); None if they were not filtered.
    quality_limits : QualityLimits, optional
        Limits that the CAE runs are judged by; None if the campaign sets none.
    occupant : OccupantModel
        Distances of the OLC, slack and spring of the VPI.
    tests_filtered_with : float, optional
        CFC that every test was filtered with on import; None if the campaign does not say, or they differ.
    units : UnitSystem
        Units of speed and weight that the tests are declared in: those that its readers see first.
    unused : tuple of (str, Condition)
        Tests that are left out of use, by id and condition: nothing learns from them, and they are not rated.
    why_unused : mapping of str to str
        Why, by id; without words if nobody says.
    prior : Prior, optional
        What other vehicles teach this one, see :meth:`with_archive`.
    cache_folder : Path, optional
        Where what is computed of it is kept; None for the platform's cache folder.
    """

    name: str
    cae: CaeLibrary
    tests: tuple[CrashTest, ...]
    notice: str = ""
    warnings: tuple[str, ...] = ()
    channel_filter_class: float | None = None
    quality_limits: QualityLimits | None = None
    occupant: OccupantModel = USUAL_OCCUPANT
    tests_filtered_with: float | None = None
    units: UnitSystem = MPH_LB
    unused: tuple[tuple[str, Condition], ...] = ()
    why_unused: Mapping[str, str] = field(default_factory=dict)
    prior: Prior | None = None
    cache_folder: Path | None = None

    @staticmethod
    def from_frames(
        tests: "pd.DataFrame",
        test_pulses: "pd.DataFrame",
        cae: "pd.DataFrame",
        cae_pulses: "pd.DataFrame",
        *,
        name: str,
        notice: str = "",
        channel_filter_class: float | None = None,
        filtered_with: float | None = None,
    ) -> "Campaign":
        """A campaign from tables in memory, checked as a folder is: a DataError names table, column and row, from 0.

        Parameters
        ----------
        tests, cae : DataFrame
            The columns of ``tests.csv`` and ``cae.csv``: id, speed, weights, factors; names end in their units.
        test_pulses, cae_pulses : DataFrame
            Tidy: ``id``, a time (``time_ms``, ``time_s``), an acceleration (``acceleration_g``, ``acceleration_mps2``).
        notice : str
            A sentence shown wherever the campaign is shown; empty for none.
        channel_filter_class, filtered_with : float, optional
            The CFC to filter pulses with, or that they were filtered with, as in ``campaign.toml``.
        """
        settings = {"name": name, "notice": notice, "channel_filter_class": channel_filter_class}
        settings["filtered_with"] = filtered_with
        return views.campaign_of_frames(tests, test_pulses, cae, cae_pulses, settings)

    @property
    def tests_frame(self) -> "pd.DataFrame":
        """The tests' conditions, as ``tests.csv`` has them, in mph and lb."""
        return views.conditions_frame(self, "tests")

    @property
    def cae_frame(self) -> "pd.DataFrame":
        """The CAE runs' conditions, as ``cae.csv`` has them, in mph and lb, with what the solver says of them."""
        return views.conditions_frame(self, "cae")

    @property
    def test_pulses_frame(self) -> "pd.DataFrame":
        """All pulses of the tests, tidy: ``id``, ``time_ms``, ``acceleration_g``, at full precision."""
        return views.pulses_frame(self, "tests")

    @property
    def cae_pulses_frame(self) -> "pd.DataFrame":
        """All pulses of the CAE runs, tidy: ``id``, ``time_ms``, ``acceleration_g``, at full precision."""
        return views.pulses_frame(self, "cae")

    @property
    def quality(self) -> QualityVerdict:
        """What the solver says of the CAE runs, judged by the campaign's limits: tables, and sentences."""
        return judge_quality(self.cae, self.quality_limits)

    def cae_events(self, window_ms: float = 60.0) -> "pd.DataFrame":
        """What to mend in the CAE model: ranges of crush where its force is off, the most expensive first.

        The columns are those of ``cae_events.csv`` (*Read the report*).
        """
        return views.campaign_events(self, window_ms)

    def draw(
        self,
        figure: str = "tests",
        *,
        tests: Sequence[str] = (),
        held_out: str | None = None,
        cfc: float | None = None,
        also: "Sequence[views.Further]" = (),
        **display: "Unpack[views.DisplayOptions]",
    ) -> "views.Drawing":
        """A figure of the pages Data and Compare.

        Parameters
        ----------
        figure : {"tests", "conditions", "cae", "cae and test", "bias", "cae events", "wall"}
            Pulses of the tests; speeds and weights of tests and CAE runs; pulses of the CAE runs; the CAE model over
            the ``held_out`` test; what it got wrong in each test, over displacement; the same as a force, with what to
            mend; the force of the barrier beside mass times deceleration.
        tests : sequence of str
            Ids of the tests that are shown; empty for all.
        held_out : str, optional
            Id of a test that is marked.
        cfc : float, optional
            Channel filter class of the figure ``tests``; the pulses as read are thin.
        also : sequence of str, PredictedPulse or EarlierPrediction
            Shown beside the pulses of tests or CAE runs: others by their ids, and predictions.
        **display
            See :class:`crashfuse.results.display.DisplayOptions`.
        """
        return views.campaign_figure(self, figure, tests=tests, held_out=held_out, cfc=cfc, also=also, **display)

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def __repr__(self) -> str:
        return f"<Campaign {self.name!r}: {len(self.tests)} tests, {len(self.cae):,} CAE runs>"

    def _repr_html_(self) -> str:
        return views.result_html(views.campaign_result(self))

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the CAE runs, the tests, an unusual occupant model and what other vehicles teach."""
        digest = hashlib.sha256(self.cae.fingerprint.encode())
        if self.occupant != USUAL_OCCUPANT:
            digest.update(f"{self.occupant!r}\n".encode())
        for test in self.tests:
            digest.update(f"{test.id}|{test.condition!r}\n".encode())
            digest.update(test.pulse.accel_mps2.tobytes())
        if self.prior is not None:
            digest.update(self.prior.fingerprint.encode())
        return digest.hexdigest()

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of any result should know: the tests that are left out of use, and the warnings."""
        if not self.unused:
            return self.warnings
        names = ", ".join(f"{test_id} ({self.reason_of(test_id)})" for test_id, _ in self.unused)
        return (f"Left out of use, neither learned from nor rated: {names}.", *self.warnings)

    @property
    def notice_label(self) -> str:
        """What stands before the colon of the notice, for a badge: ``Synthetic``."""
        return self.notice.partition(":")[0]

    def reason_of(self, test_id: str) -> str:
        """Why a test is left out of use, in words."""
        return self.why_unused.get(test_id) or "no reason given"

    @property
    def filter_class(self) -> str:
        """The channel filter class of the tests, such as ``CFC 60``, to stand beside ratings and metrics."""
        return filter_class_text(self.channel_filter_class or self.tests_filtered_with)

    @property
    def metric_bases(self) -> dict[str, str]:
        """What each metric rests on, see :func:`crashfuse.signals.metrics.metric_bases`."""
        return metric_bases(self.filter_class, self.occupant)

    @property
    def metric_headings(self) -> dict[str, str]:
        """Labels of the metrics, see :func:`crashfuse.signals.metrics.metric_headings`."""
        return metric_headings(self.filter_class, self.occupant)

    @property
    def rating_basis(self) -> str:
        """What every rating rests on beside its window, such as ``ISO/TS 18571:2024, 10 kHz, CFC 60``."""
        return rating_basis(self.filter_class)

    @property
    def test_ids(self) -> tuple[str, ...]:
        """Ids of the tests in the order of the table."""
        return tuple(test.id for test in self.tests)

    def test(self, test_id: str) -> CrashTest:
        """The test with this id; a UsageError if there is none."""
        require_a(str, test_id, "the id of a test")
        for test in self.tests:
            if test.id == test_id:
                return test
        raise UsageError(f"There is no test {test_id!r} in {self.name}; it has {', '.join(self.test_ids)}.")

    @property
    def factors(self) -> dict[str, tuple[str, ...]]:
        """Values of each further column of the tests table (powertrain, drive), sorted."""
        pairs = {pair for test in self.tests for pair in test.condition.factors if pair[1]}
        return {name: tuple(sorted(value for of, value in pairs if of == name)) for name in sorted(dict(pairs))}

    def metrics_of(self, test: CrashTest) -> tuple[Metric, ...]:
        """Metrics of a test's measured pulse."""
        pulse, speed_mps = test.pulse, test.condition.speed_mps
        return checked_metrics(pulse.accel_mps2, speed_mps, dt_s=pulse.dt_s, occupant=self.occupant)

    def without(self, test_ids: Sequence[str]) -> "Campaign":
        """The campaign with these tests held out: the only data available for predicting them."""
        held_out = {self.test(test_id).id for test_id in several(test_ids)}
        return replace(self, tests=tuple(test for test in self.tests if test.id not in held_out))

    def with_archive(self, archive: VehicleArchive) -> "Campaign":
        """The campaign that past vehicles teach; a UsageError if it shares runs or tests with two of them."""
        require_a(VehicleArchive, archive, "crashfuse.load_archive(path)")
        return replace(self, prior=archive.prior_for(self.name, self.cae.fingerprint, self.tests))

    def evenly_over_speed(self, most: int) -> "Campaign":
        """The campaign with at most so many tests, evenly spaced in the order of speed, the ends included."""
        if len(self.tests) <= most:
            return self
        ordered = sorted(self.tests, key=lambda test: test.condition.speed_mps)
        kept = {ordered[i].id for i in np.linspace(0, len(ordered) - 1, most).round().astype(int)}
        return replace(self, tests=tuple(test for test in self.tests if test.id in kept))

    def speed_group(self, test_id: str) -> tuple[str, ...]:
        """Ids of the tests at about the speed of this one; see :func:`crashfuse.crash_test.speed_groups`."""
        groups = speed_groups(np.array([test.condition.speed_mps for test in self.tests])).tolist()
        mine = groups[self.tests.index(self.test(test_id))]
        return tuple(other for other, group in zip(self.test_ids, groups, strict=True) if group == mine)

    @property
    def time_s(self) -> FloatArray:
        """The common time grid in s, shape (1250,)."""
        return GRID_S
