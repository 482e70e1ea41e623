"""Sections common to reports: metrics, notes and fits of estimates, and how tests repeat."""

import re
from collections.abc import Mapping, Sequence

import pandas as pd

from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.crash_test import CrashTest
from crashfuse.reporting import fit_explanations
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.result_tables import metric_texts
from crashfuse.signals.metrics import MAIN_METRICS
from crashfuse.study.estimate import Estimate
from crashfuse.study.repeatability import Repeatability
from crashfuse.wording import joined

_INTERVAL = re.compile(r" ?\[[^]]*\]")


def details(
    campaign: Campaign,
    estimates: Sequence[Estimate],
    display: Display,
    test: CrashTest | None = None,
    *,
    said: Sequence[str] = (),
) -> dict[str, object]:
    """Metrics by approach (and of the test), the main ones and the others; notes not ``said`` yet; their fits."""
    columns = [] if test is None else [("Measured", campaign.metrics_of(test))]
    columns += [(LABELS[estimate.approach], estimate.metrics) for estimate in estimates]
    of_test = "" if test is None else f", {test.id}"  # on paper the table may begin a page
    metrics = metric_texts(columns, campaign, display, f"Pulse metric{of_test}").map(unbroken_interval)
    main = metrics.index.isin(MAIN_METRICS)
    missing, more_missing = fit_explanations.metric_remarks(columns)
    makers = fit_explanations.notes_by_makers(estimates).items()
    remarks = [joined([", ".join(who), note], ": ") for note, who in makers if note not in said]
    return {
        "whole": fit_explanations.whole_sentences(estimates),
        "metrics": metrics[main],
        "more_metrics": metrics[~main],
        "more_missing": more_missing,
        "remarks": [*missing, *remarks],
        "fits": [
            (LABELS[estimate.approach], sentences, fit_explanations.fit_table(estimate.state, display.units))
            for estimate in estimates
            if (sentences := fit_explanations.fit_sentences(estimate.state))
        ],
    }


def repeats_table(
    found: Mapping[str, Mapping[float, Repeatability]], tests: Sequence[str], windows_ms: Sequence[float]
) -> pd.DataFrame | None:
    """What a repeat of each of these tests would rate, by window, with its interval; None if nothing is known."""
    known = {test: found.get(test, {}) for test in tests}
    if not any(window in own for own in known.values() for window in windows_ms):
        return None
    rows = []
    for test, own in known.items():
        row = {"Test": test, **{f"0–{w:g} ms": own[w].text if w in own else "–" for w in windows_ms}}
        repeats = next(iter(own.values())).repeats if own else ()
        rows.append({**row, "Repeats among the tests": ", ".join(repeats) or "none"})
    return pd.DataFrame(rows)


def unbroken_interval(text: str) -> str:
    """A value with its interval, which no line may cut."""
    return _INTERVAL.sub(lambda found: found[0].replace(" ", "\N{NO-BREAK SPACE}"), text)
