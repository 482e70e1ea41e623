"""A fit's quality and the reliability of its band, as sentences and tables."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from crashfuse.approaches.calibration import Calibration
from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.table import Column, Table, frame_of
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_LABELS, Metric, missing_sentences
from crashfuse.study.estimate import Estimate
from crashfuse.units import IN_SI, Quantity, Sentence

_HEADINGS = {"accel": "a(t) up to TTZV", "velocity": "v(t) up to TTZV", "rebound": "a(t) after TTZV"}
_COUNTS = {"crush": "Maximum crush", "peak": "Peak deceleration", "whole": "Whole pulse, 0–60 ms"}
_SAME = 0.02  # differences of a metric up to here are not told: others are what repeats scatter


def coverage_table(coverage: Mapping[str, Calibration]) -> Table:
    """One row per approach: shares of time inside the band, and counts of tests."""
    rows = (
        {
            "Approach": LABELS[name],
            **{heading: calibration.share(column) for column, heading in _HEADINGS.items()},
            **{title: f"{calibration.count(column)} of {len(calibration.tests)}" for column, title in _COUNTS.items()},
        }
        for name, calibration in coverage.items()
    )
    return Table.of("coverage", rows, *(Column(heading, "share", form=".0f") for heading in _HEADINGS.values()))


_FIT = (
    Column("Hyperparameter", source="name"),
    Column("Value", "number", units="unit", form=".3g", source="value"),
    Column("Known to a factor of", "number", form=".2f", source="spread"),
    Column("At its bound", source="touched"),
)


def fit_table(approach: str, state: Mapping[str, Any]) -> Table:
    """Hyperparameters of a bias model and their uncertainty; empty for an approach without any."""
    spread, touched, rows = state.get("spread_factors", {}), state.get("touched_bounds", []), []
    for name, value in state.get("hyperparameters", {}).items():
        quantity, _, si = name.rpartition(" in ")
        unit = {"m/s": "mph", "kg": "lb"}.get(si, "")
        row = {"name": name, "value": value, "spread": spread.get(name), "touched": name in touched, "unit": unit}
        if unit:
            row |= {"name": Sentence("{} in {}", quantity, Quantity((), unit)), "value": value / IN_SI[unit]}
        rows.append(row)
    return Table(f"fit of {approach}", frame_of(rows), _FIT)


def fit_sentences(state: Mapping[str, Any]) -> list[str]:
    """Sentences on the quality of an approach's fit and the reliability of its band; empty without a fit."""
    sentences: list[str] = []
    if "hyperparameters" in state:
        verdict = "no more than noise: treat the result as uncorrected" if state["dead"] else "more than noise"
        sentences.append(
            Sentence(
                f"Fitted to {state['points']} points of a bias of {{}} RMS; log marginal likelihood "
                f"{_whole(state['log_marginal_likelihood'])}, restarts {state['retries']}. The fit explains {verdict}.",
                Quantity((state["bias_rms_g"],), "g"),
            )
        )
    if len(densities := state.get("left_out_log_density", {})) > 1:
        compared = ", ".join(f"{name} {_whole(value)}" for name, value in densities.items())
        used = " and ".join(state["factors"]) or "none"
        sentences.append(f"Factors: {used}. Log predictive density of left-out tests (higher is better): {compared}.")
    if errors := state.get("left_out_rmse"):
        sentences.append(
            f"Fine-tuning: {state['members']} networks of {state['weights']:,} weights; {state['penalty']:g} of the "
            f"increments are a test's own, chosen from {', '.join(errors)} by leaving each test out; ΔV of left-out "
            f"tests was met to {100 * state['left_out_delta_v_misfit']:.1f} % of impact speed."
        )
    if weights := state.get("weights_at_equal_bands"):
        shares = ", ".join(f"{name} {weight:.2f}" for name, weight in weights.items())
        sentences.append(f"Weights at equally wide bands: {shares}; from predictions of left-out tests (CRPS).")
    if check := state.get("band_check"):
        sentences.append(_band_sentence(check))
    return sentences


def whole_sentences(estimates: Iterable[Estimate]) -> list[str]:
    """How many left-out tests lie inside the band of whole pulses of each approach, if any has one: a sentence."""
    states: dict[str, Any] = {LABELS[own.approach]: own.state.get("band_check") for own in estimates}
    counts = {who: (check["whole_inside"], check["left_out_tests"]) for who, check in states.items() if check}
    return [whole_sentence(counts)] if counts else []


def whole_sentence(counts: Mapping[str, tuple[int, int]]) -> str:
    """How many left-out tests lie inside bands of whole pulses, and of how many, by whose band or how left out."""
    shown = ", ".join(f"{key} {inside} of {n}" for key, (inside, n) in counts.items())
    return f"Left-out tests inside as a whole (0–60 ms; nine of ten are meant to be): {shown}."


def notes_by_makers(estimates: Iterable[Estimate]) -> dict[str, list[str]]:
    """Each note once, with the labels of the approaches it applies to."""
    makers: dict[str, list[str]] = {}
    for estimate in estimates:
        for note in estimate.prediction.notes:
            makers.setdefault(note, []).append(LABELS[estimate.approach])
    return makers


def metric_remarks(columns: Sequence[tuple[str, Sequence[Metric]]]) -> tuple[list[str], list[str]]:
    """Sentences on metrics that are missing or not those of the averaged pulse: on the main ones, and on the others."""

    def of(is_main: bool) -> list[str]:
        shown = [(who, [metric for metric in own if (metric.name in MAIN_METRICS) is is_main]) for who, own in columns]
        return [*missing_sentences(shown), *(text for who, own in shown if (text := _averaged(who, own)))]

    return of(True), of(False)


def _averaged(who: str, metrics: Sequence[Metric]) -> str:
    away = {m.name: m.of_pulse / m.value - 1 for m in metrics if m.drawn and m.value and m.of_pulse is not None}
    texts = [f"{METRIC_LABELS[name]} {100 * x:+.0f} %" for name, x in away.items() if abs(x) > _SAME]
    return f"{who}: values are those of a single test; the averaged pulse has {', '.join(texts)}." if texts else ""


def _band_sentence(check: Mapping[str, Any]) -> str:
    n = check["left_out_tests"]
    late = f" ({check['late_widening']:g} after TTZV)" if "late_widening" in check else ""
    after = np.nan if check["rebound_inside"] is None else check["rebound_inside"]
    verdict = "" if check["holds"] else " That is too little for a 95 % band."
    return (
        f"Band: calibrated on {n} tests, each predicted from the others, and scaled by {check['widening']:g}{late}. "
        f"Up to TTZV it holds a(t) {_percent(check['accel_inside'])} and v(t) {_percent(check['velocity_inside'])} of "
        f"the time, after it a(t) {_percent(after)}; maximum crush in {check['crush_inside']} of {n} tests, peak "
        f"deceleration in {check['peak_inside']}.{verdict}"
    )


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.0f} %"


def _whole(value: float) -> Quantity:
    return Quantity((value,), "", ".0f")
