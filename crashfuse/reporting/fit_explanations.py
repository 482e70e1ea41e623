"""How a fit went and what its band is worth, in words and tables for people: the page, the report, the record."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from crashfuse.approaches.calibration import Calibration
from crashfuse.approaches.registry import LABELS

_HEADINGS = {"accel": "a(t) up to t0", "velocity": "v(t) up to t0", "rebound": "a(t) after t0"}
_COUNTS = {"crush": "Maximum crush", "peak": "Peak deceleration"}


def coverage_table(coverage: Mapping[str, Calibration]) -> pd.DataFrame:
    """One row an approach: shares of time inside the band, and counts of tests; for people, so all text."""
    return pd.DataFrame(
        {
            "Approach": LABELS[name],
            **{heading: _percent(calibration.share(column)) for column, heading in _HEADINGS.items()},
            **{
                heading: f"{calibration.count(column)} of {len(calibration.tests)}"
                for column, heading in _COUNTS.items()
            },
        }
        for name, calibration in coverage.items()
    )


def fit_table(state: Mapping[str, Any]) -> pd.DataFrame:
    """Hyperparameters of a bias model with how well they are known; empty for an approach that has none."""
    spread, touched = state.get("spread_factors", {}), state.get("touched_bounds", [])
    return pd.DataFrame(
        {
            "Hyperparameter": name,
            "Value": f"{value:.3g}",
            "Known to a factor of": f"{spread[name]:.2f}" if name in spread else "–",
            "At its bound": "yes" if name in touched else "no",
        }
        for name, value in state.get("hyperparameters", {}).items()
    )


def fit_sentences(state: Mapping[str, Any]) -> list[str]:
    """What a bias model's fit found, a sentence each."""
    sentences = []
    if "hyperparameters" in state:
        explains = "nothing: treat the result as uncorrected" if state["dead"] else "more than noise"
        sentences.append(
            f"Fitted to {state['points']} points of a bias of {state['bias_rms_g']:.1f} g (root mean square); "
            f"log marginal likelihood {state['log_marginal_likelihood']:.0f}, further starts {state['retries']}. "
            f"The fit explains {explains}."
        )
    if len(densities := state.get("left_out_log_density", {})) > 1:
        compared = ", ".join(f"{name} {value:.0f}" for name, value in densities.items())
        used = " and ".join(state["factors"]) or "none"
        sentences.append(f"Factors: {used}. Log density of tests left out in turn (more is better): {compared}.")
    if errors := state.get("left_out_rmse"):
        sentences.append(
            f"Fine-tuning: {state['members']} networks of {state['weights']:,} weights. A test has a share of "
            f"{state['penalty']:g} of the increments to itself, chosen of {', '.join(errors)} by leaving each out; "
            f"such a test's change of velocity was met to {100 * state['left_out_delta_v_misfit']:.1f} % of its speed."
        )
    if beside := state.get("weights_beside_a_test"):
        far = state["weights_far_from_tests"]
        weights = ", ".join(f"{voice} {beside[voice]:.2f} (far from all tests {far[voice]:.2f})" for voice in beside)
        sentences.append(f"Weights beside a test: {weights}; by how each predicted tests that it had not seen (CRPS).")
    if check := state.get("band_check"):
        n = check["left_out_tests"]
        verdict = "" if check["holds"] else " That is less than a 95 % band should hold."
        late = f" ({check['late_widening']:g} after t0)" if "late_widening" in check else ""
        after = np.nan if check["rebound_inside"] is None else check["rebound_inside"]
        sentences.append(
            f"Band: checked on {n} tests, each predicted from the others, and scaled by {check['widening']:g}"
            f"{late}; then a(t) lies inside {_percent(check['accel_inside'])} and v(t) "
            f"{_percent(check['velocity_inside'])} of the time up to t0, a(t) {_percent(after)} of the time after it, "
            f"maximum crush in "
            f"{check['crush_inside']} of {n} tests and peak in {check['peak_inside']} of {n}.{verdict}"
        )
    return sentences


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.0f} %"
