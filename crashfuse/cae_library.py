"""The CAE runs of a campaign: their conditions and pulses, what the solver says of them, what lies beyond them."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from crashfuse.condition import SAME_CONDITION, STEP_KG, STEP_MPS, About, Condition
from crashfuse.errors import UsageError, require_a, require_number
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import LB, Sentence, number, speed, weight

if TYPE_CHECKING:
    import pandas as pd

QUALITIES = {"energy_change": "energy change", "hourglass_share": "hourglass energy", "added_mass_share": "added mass"}
"""Columns of ``cae.csv`` and what each is called."""


@dataclass(frozen=True, slots=True)
class RunQuality:
    """What the solver says of one run, each a share; None where it is not recorded.

    ``energy_change`` is the largest deviation of the total energy, less the work done from outside, from its value at
    the start, over that value; with its sign (negative: energy was lost).
    """

    energy_change: float | None = None
    hourglass_share: float | None = None  # largest hourglass over largest internal energy, both of the whole model
    added_mass_share: float | None = None  # largest mass added by mass scaling, over the model's without it

    @classmethod
    def of(cls, energy_change: float | None, hourglass: float | None, added_mass: float | None) -> Self:
        """Quality from computed shares: what lies beyond 1 counts as 1, what rounding put below 0 as 0."""
        shares = [None if share is None else min(max(share, 0.0), 1.0) for share in (hourglass, added_mass)]
        return cls(None if energy_change is None else min(max(energy_change, -1.0), 1.0), *shares)

    @property
    def recorded(self) -> bool:
        """Whether anything is recorded."""
        return self != RunQuality()


@dataclass(frozen=True, slots=True)
class QualityLimits:
    """Limits on the quality of CAE runs, as shares; None where there is no limit.

    The change of energy, in size, may reach its limit; the other shares must lie below theirs.
    """

    name: str
    energy_change: float | None = None
    hourglass_share: float | None = None
    added_mass_share: float | None = None

    def __post_init__(self) -> None:
        require_a(str, self.name, "what the limits are called")
        for name in QUALITIES:
            if (limit := getattr(self, name)) is not None:
                require_number(name, limit)
                if not 0 < limit <= 1:
                    raise UsageError(f"{name} is a share from 0 to 1 (5 % is 0.05), not {limit:g}.")

    @property
    def limited(self) -> tuple[str, ...]:
        """The quantities that have a limit."""
        return tuple(name for name in QUALITIES if getattr(self, name) is not None)

    def exceeded(self, quality: RunQuality) -> tuple[str, ...]:
        """The quantities of a run that are recorded and beyond their limit."""
        found = []
        for name in self.limited:
            value, limit = getattr(quality, name), getattr(self, name)
            if value is not None and (abs(value) > limit if name == "energy_change" else value >= limit):
                found.append(name)
        return tuple(found)

    def missing(self, quality: RunQuality) -> tuple[str, ...]:
        """The quantities that have a limit but are not recorded for a run."""
        return tuple(name for name in self.limited if getattr(quality, name) is None)

    def __str__(self) -> str:
        ends = {name: "at most" if name == "energy_change" else "below" for name in self.limited}
        terms = [f"{QUALITIES[name]} {end} {100 * getattr(self, name):g} %" for name, end in ends.items()]
        return f"{self.name} ({', '.join(terms)})"


NAMED_LIMITS: Mapping[str, QualityLimits] = {
    # Euro NCAP, Crash Protection Virtual Testing Protocol 1.0.2 (2025), section 5: largest hourglass energy of the full
    # setup over its largest internal energy; mass added by mass scaling over the mass at the beginning of the run.
    "euro-ncap-vt-2025": QualityLimits("Euro NCAP virtual testing 2025", hourglass_share=0.10, added_mass_share=0.05),
    # NCHRP Web-Only Document 179 (2011), Table E-1: energy at the end of the run against its start; hourglass energy at
    # the end below 5 % of the initial energy and below 10 % of the internal energy at the end; added mass over the
    # mass at the start. The internal energy can't outgrow the initial energy by more than the energy change, so a share
    # below 5 % of it meets both limits on hourglass energy.
    "nchrp-179": QualityLimits("NCHRP 179", energy_change=0.10, hourglass_share=0.05, added_mass_share=0.05),
}
"""Sets of limits by their names in ``campaign.toml``."""


_ROWS = ("ids", "conditions", "quality", "about")
_AXES = (("speed", speed, STEP_MPS), ("front weight", weight, STEP_KG), ("rear weight", weight, STEP_KG))


@dataclass(frozen=True, eq=False)
class CaeLibrary:
    """All CAE runs of a campaign.

    What the solver says of them is not in the fingerprint, because nothing that is learned depends on it.
    """

    ids: tuple[str, ...]
    conditions: tuple[Condition, ...]
    accel_mps2: npt.NDArray[np.float32]  # shape (n_runs, 1250), on :data:`crashfuse.signals.pulse.GRID_S`
    quality: tuple[RunQuality, ...] = ()  # of each run; empty if nothing is recorded for any
    left_out: tuple[tuple[str, RunQuality], ...] = ()  # runs that exceed the campaign limits, by id
    about: tuple[About, ...] = ()  # where each comes from; empty likewise
    untrained: frozenset[str] = frozenset()  # ids of runs that networks are not trained on
    paired_only: frozenset[str] = frozenset()  # ids of runs that nothing is learned from, but found at their conditions

    def __repr__(self) -> str:
        return f"<CaeLibrary of {len(self):,} runs>"

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def vectors(self) -> FloatArray:
        """Conditions as rows [v0, wf, wr] in m/s and kg, shape (n_runs, 3)."""
        return np.array([condition.vector for condition in self.conditions])

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of ids, conditions and every sample."""
        digest = hashlib.sha256()
        for run_id, condition in zip(self.ids, self.conditions, strict=True):
            digest.update(f"{run_id}|{condition!r}\n".encode())
        digest.update(np.ascontiguousarray(self.accel_mps2).tobytes())
        digest.update("|".join([*sorted(self.untrained), *(f"\n{own}" for own in sorted(self.paired_only))]).encode())
        return digest.hexdigest()

    def paired_run(self, condition: Condition) -> int | None:
        """Index of the run at this condition (to a relative 2e-3), or None; known factors that differ tell runs apart.

        Of several, one that states most of the factors, then the nearest.
        """
        target = np.abs(condition.vector)
        gap = np.abs(self.vectors - condition.vector)
        away = np.divide(gap, target, out=np.where(gap > 0, np.inf, 0.0), where=target > 0).max(axis=1)
        alike = [i for i in np.flatnonzero(away <= SAME_CONDITION).tolist() if condition.may_be(self.conditions[i])]
        return min(alike, key=lambda i: (-condition.shared_factors(self.conditions[i]), away[i]), default=None)

    @cached_property
    def learned_from(self) -> Self:
        """The runs that anything is learned from."""
        left = self.without(self.paired_only)
        return replace(left, paired_only=frozenset()) if left.paired_only else left

    @cached_property
    def for_networks(self) -> Self:
        """The runs that networks are trained on."""
        left = self.learned_from.without(self.untrained)
        return replace(left, untrained=frozenset()) if left.untrained else left

    def paired_ids(self, conditions: Iterable[Condition]) -> frozenset[str]:
        """Ids of all runs at these conditions."""
        left, found = self, frozenset[str]()
        for condition in conditions:
            while len(left) and (run := left.paired_run(condition)) is not None:
                found |= {left.ids[run]}
                left = left.without(found)
        return found

    def without(self, ids: frozenset[str]) -> Self:
        """The library without these runs."""
        kept = [number for number, run_id in enumerate(self.ids) if run_id not in ids]
        if len(kept) == len(self):
            return self
        rows: dict[str, Any] = {n: tuple(values[i] for i in kept) for n in _ROWS if (values := getattr(self, n))}
        return replace(self, accel_mps2=self.accel_mps2[kept], **rows)

    @cached_property
    def range(self) -> tuple[FloatArray, FloatArray]:
        """The range of the runs: smallest and largest [v0, wf, wr] in m/s and kg, each of shape (3,)."""
        return self.vectors.min(axis=0), self.vectors.max(axis=0)

    def extrapolation(self, condition: Condition) -> tuple[str, ...]:
        """One sentence for every input of a condition outside :attr:`range`: this alone decides what is in range."""
        notes = []
        ends = (end.tolist() for end in self.range)
        for (name, quantity, step), x, lo, hi in zip(_AXES, condition.vector.tolist(), *ends, strict=True):
            tolerance = max(SAME_CONDITION * abs(x), step)  # that of a paired run
            if x < lo - tolerance or x > hi + tolerance:
                outside = quantity(x), quantity(lo, hi, between=" to ")
                mistaken = quantity is weight and any(lo <= x * factor <= hi for factor in (LB, 1 / LB))
                advice = " Its unit may be the other one." * mistaken
                notes.append(Sentence("Extrapolation: {} {} lies outside the CAE runs' {}.{}", name, *outside, advice))
        return tuple(notes)


_NAMED = 5  # runs in a sentence


@dataclass(frozen=True, eq=False)
class QualityVerdict:
    """The CAE runs of a campaign, those left out included, judged by limits; quantities are shares."""

    limits: QualityLimits | None  # None if the campaign sets none; then no run passes or fails
    runs: int
    passed: int  # with every limited quantity recorded and within its limit
    failing: tuple[str, ...]  # ids of the runs with a quantity beyond its limit
    unknown: int  # with nothing beyond a limit but something not recorded
    left_out: bool  # the failing runs are left out of the campaign
    table: "pd.DataFrame"  # one row a quantity; without a limit passed and failed are 0
    failing_runs: "pd.DataFrame"  # one row each, with what fails

    def __repr__(self) -> str:
        return f"<QualityVerdict: {self.summary}>"

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict in words; what is not recorded never counts as passed."""
        return (self.summary, *map(self._quantity, self.table.to_dict("records")), *self.named)

    @property
    def summary(self) -> str:
        """How many runs pass, fail and cannot be judged."""
        if not len(self.table):
            what = "Energy balance, hourglass energy and added mass"
            return f"{what} are not recorded for any of the {self.runs:,} CAE runs."
        if self.limits is None:
            return "No CAE run is judged by its quality: [cae_quality] in campaign.toml sets no limits."
        unknown = f"; {self.unknown:,} cannot be judged, as not everything is recorded" if self.unknown else ""
        judged = f"{self.passed:,} of {self.runs:,} pass, {len(self.failing):,} fail"
        return f"CAE runs by {self.limits}: {judged}{unknown}."

    @property
    def unpassed(self) -> tuple[str, ...]:
        """The quantities that not every run is known to pass: without a limit or a record none does."""
        passed = dict(zip(self.table["quantity"], self.table["passed"], strict=True))
        return tuple(name for name in QUALITIES.values() if passed.get(name, 0) < self.runs)

    @property
    def checks(self) -> str:
        """How many of the checks are passed."""
        passed, n = len(QUALITIES) - len(self.unpassed), len(QUALITIES)
        others = f" (not: {', '.join(self.unpassed)})" if self.unpassed else ""
        return f"The CAE runs pass {passed} of {n} quality checks{others}."

    @property
    def named(self) -> tuple[str, ...]:
        """The runs that fail, by name, and what becomes of them."""
        if not self.failing:
            return ()
        shown = [f"{row['id']} ({row['fails']})" for row in self.failing_runs.head(_NAMED).to_dict("records")]
        more = f" and {len(self.failing) - _NAMED:,} more" if len(self.failing) > _NAMED else ""
        fate = "They are left out" if self.left_out else "They are used all the same"
        advice = "" if self.left_out else "; leave_out_failing = true in campaign.toml leaves them out"
        return (f"Runs that fail: {', '.join(shown)}{more}. {fate}{advice}.",)

    def _quantity(self, row: dict[str, Any]) -> str:
        start, missing = row["quantity"].capitalize(), row["not_recorded"]
        if missing == self.runs:
            return f"{start}: not recorded for any run."
        unrecorded = f"not recorded for {missing:,} of {self.runs:,} runs" if missing else "recorded for every run"
        judged = f"{row['passed']:,} pass, {row['failed']:,} fail; " if (row["limit"] or 0.0) > 0 else ""
        worst = f"at worst {number(100 * row['worst'], '.3g')} % (run {row['worst_run']})"
        return f"{start}: {judged}{worst}; {unrecorded}."


def judge_quality(library: CaeLibrary, limits: QualityLimits | None) -> QualityVerdict:
    """Judge the CAE runs of a campaign, those left out included, by limits."""
    import pandas as pd  # it takes a while

    in_use = library.quality or (RunQuality(),) * len(library)
    judged = [*zip(library.ids, in_use, strict=True), *library.left_out]
    by = limits or QualityLimits("")
    failing = [(run, quality, failed) for run, quality in judged if (failed := by.exceeded(quality))]
    unknown = sum(not by.exceeded(own) and bool(by.missing(own)) for _, own in judged) if limits else len(judged)
    is_recorded = any(quality.recorded for _, quality in judged)
    rows = [_row(name, judged, by) for name in QUALITIES] if is_recorded else []
    table = pd.DataFrame(rows, columns=["quantity", "limit", "passed", "failed", "not_recorded", "worst", "worst_run"])
    failed_runs = [(run, *(getattr(q, name) for name in QUALITIES), _beyond(q, failed)) for run, q, failed in failing]
    runs = pd.DataFrame(failed_runs, columns=["id", *QUALITIES, "fails"])
    return QualityVerdict(
        limits=limits,
        runs=len(judged),
        passed=len(judged) - len(failing) - unknown,
        failing=tuple(run for run, *_ in failing),
        unknown=unknown,
        left_out=bool(library.left_out),
        table=table,
        failing_runs=runs,
    )


def _row(name: str, judged: list[tuple[str, RunQuality]], limits: QualityLimits) -> tuple[object, ...]:
    recorded = [(run, value) for run, quality in judged if (value := getattr(quality, name)) is not None]
    limit = getattr(limits, name)
    failed = sum(name in limits.exceeded(quality) for _, quality in judged)
    passed = len(recorded) - failed if limit is not None else 0
    run, worst = max(recorded, key=lambda row: abs(row[1]), default=("", None))
    return QUALITIES[name], limit, passed, failed, len(judged) - len(recorded), worst, run


def _beyond(quality: RunQuality, failed: tuple[str, ...]) -> str:
    return ", ".join(f"{QUALITIES[name]} {number(100 * getattr(quality, name), '.3g')} %" for name in failed)
