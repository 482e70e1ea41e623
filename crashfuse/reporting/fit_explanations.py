"""A fit's quality and the reliability of its band, as sentences and tables."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from crashfuse.approaches.calibration import Calibration
from crashfuse.approaches.registry import LABELS
from crashfuse.signals.metrics import MAIN_METRICS, METRIC_LABELS, Metric, missing_sentences
from crashfuse.study.estimate import Estimate
from crashfuse.units import MPH_LB, Quantity, UnitSystem, joined, statements

_HEADINGS = {"accel": "a(t) up to TTZV", "velocity": "v(t) up to TTZV", "rebound": "a(t) after TTZV"}
_COUNTS = {"crush": "Maximum crush", "peak": "Peak deceleration", "whole": "Whole pulse, 0–60 ms"}
_SAME = 0.02  # differences of a metric up to here are not told: others are what repeats scatter


def coverage_table(coverage: Mapping[str, Calibration]) -> pd.DataFrame:
    """One row per approach: shares of time inside the band, and counts of tests; all text, for display."""
    return pd.DataFrame(
        {
            "Approach": LABELS[name],
            **{heading: _percent(calibration.share(column)) for column, heading in _HEADINGS.items()},
            **{title: f"{calibration.count(column)} of {len(calibration.tests)}" for column, title in _COUNTS.items()},
        }
        for name, calibration in coverage.items()
    )


def fit_table(state: Mapping[str, Any], units: UnitSystem = MPH_LB) -> pd.DataFrame:
    """Hyperparameters of a bias model and their uncertainty; empty for an approach without any."""
    spread, touched, rows = state.get("spread_factors", {}), state.get("touched_bounds", []), []
    for name, value in state.get("hyperparameters", {}).items():
        quantity, _, si = name.rpartition(" in ")
        unit = {"m/s": "mph", "kg": "lb"}.get(si)
        rows.append(
            {
                "Hyperparameter": f"{quantity} in {units.unit(unit)}" if unit else name,
                "Value": f"{value / (units.in_si(unit) if unit else 1):.3g}",
                "Known to a factor of": f"{spread[name]:.2f}" if name in spread else "–",
                "At its bound": "yes" if name in touched else "no",
            }
        )
    return pd.DataFrame(rows)


def fit_sentences(state: Mapping[str, Any]) -> list[str]:
    """Sentences on the quality of an approach's fit and the reliability of its band; empty without a fit."""
    check = state.get("band_check")
    values = {name: state.get(name) for name in ("points", "bias_rms_g", "factors", "members", "weights", "penalty")}
    values["verdict"] = _VERDICTS[state["dead"]] if "hyperparameters" in state else None
    values["misfit"] = state.get("left_out_delta_v_misfit")
    if len(densities := state.get("left_out_log_density", {})) > 1:
        values["densities"] = [f"{name} {_whole(value)}" for name, value in densities.items()]
        values["factors"] = state["factors"] or "none"
    if equal := state.get("weights_at_equal_bands"):
        values["equal"] = [f"{name} {weight:.2f}" for name, weight in equal.items()]
    told = [statements(_FIT, values), *([_band_sentence(check)] if check else [])]
    return [sentence for sentence in told if sentence]


_VERDICTS = {False: "more than noise", True: "no more than noise: treat the result as uncorrected"}
_FIT = (
    "Fitted to {points} points of a bias of {bias_rms_g} RMS; it explains {verdict}.",
    "Factors: {factors}; log predictive density of left-out tests (higher is better): {densities}.",
    "Fine-tuning: {members} networks of {weights:,} weights; {penalty:g} of the increments are a test's own. ΔV of "
    "left-out tests was met to {misfit:.1%} of impact speed.",
    "Weights at equally wide bands, by left-out tests: {equal}.",
)
_BAND = (
    "The band, scaled by {widening:g} for {left_out_tests} left-out tests, holds a(t) {accel_inside:.0%} and v(t) "
    "{velocity_inside:.0%} of the time up to TTZV; crush in {crush_inside} tests, peak in {peak_inside}.",
    "After TTZV it is scaled by {late_widening:g}.",
    "After TTZV it holds a(t) {rebound_inside:.0%} of the time.",
)


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
    verdict = "" if check["holds"] else "That is too little for a 95 % band."
    return joined([statements(_BAND, check), *filter(None, [verdict])])


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.0f} %"


def _whole(value: float) -> Quantity:
    return Quantity((value,), "", ".0f")
