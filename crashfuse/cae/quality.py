"""Is the CAE model fit to be believed? What the solver says of its runs, judged by limits."""

from dataclasses import dataclass

import pandas as pd

from crashfuse.cae_library import QUALITIES, CaeLibrary, QualityLimits, RunQuality
from crashfuse.units import number

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
    table: pd.DataFrame  # one row a quantity; without a limit passed and failed are 0
    failing_runs: pd.DataFrame  # one row each, with what fails

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
        return (
            f"CAE runs by {self.limits}: {self.passed:,} of {self.runs:,} pass, {len(self.failing):,} fail, "
            f"{self.unknown:,} cannot be judged, for not everything is recorded."
        )

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

    def _quantity(self, row: dict[str, object]) -> str:
        name, missing = str(row["quantity"]), int(str(row["not_recorded"]))
        unrecorded = f"not recorded for {missing:,} of {self.runs:,} runs" if missing else "recorded for every run"
        start = f"{name[0].upper()}{name[1:]}"
        if missing == self.runs:
            return f"{start}: not recorded for any run."
        worst = f"at worst {number(100 * float(str(row['worst'])), '.3g')} % (run {row['worst_run']})"
        judged = f"{row['passed']:,} pass, {row['failed']:,} fail; " if pd.notna(row["limit"]) else ""
        return f"{start}: {judged}{worst}; {unrecorded}."


def judge_quality(library: CaeLibrary, limits: QualityLimits | None) -> QualityVerdict:
    """Judge the CAE runs of a campaign, those left out included, by limits."""
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
    passed, ids = len(judged) - len(failing) - unknown, tuple(run for run, *_ in failing)
    return QualityVerdict(limits, len(judged), passed, ids, unknown, bool(library.left_out), table, runs)


def _row(name: str, judged: list[tuple[str, RunQuality]], limits: QualityLimits) -> tuple[object, ...]:
    recorded = [(run, value) for run, quality in judged if (value := getattr(quality, name)) is not None]
    limit = getattr(limits, name)
    failed = sum(name in limits.exceeded(quality) for _, quality in judged)
    passed = len(recorded) - failed if limit is not None else 0
    run, worst = max(recorded, key=lambda row: abs(row[1]), default=("", None))
    return QUALITIES[name], limit, passed, failed, len(judged) - len(recorded), worst, run


def _beyond(quality: RunQuality, failed: tuple[str, ...]) -> str:
    return ", ".join(f"{QUALITIES[name]} {number(100 * getattr(quality, name), '.3g')} %" for name in failed)
