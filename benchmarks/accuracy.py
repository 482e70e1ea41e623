"""How good the predictions are: ``python benchmarks/accuracy.py CAMPAIGN …`` (default: the sample).

Each test is left out in turn, alone and with its whole speed group. *Gap closed* is the share of the way from the raw
CAE to 0.975, what repeated tests rate against each other; *change* is the least of all tests against the raw CAE.
"""

import argparse
from pathlib import Path

import numpy as np

from crashfuse.approaches import LABELS
from crashfuse.formats.folder import load_campaign
from crashfuse.pulse import DT_S, kinematics
from crashfuse.study import Fold, HoldOut, Study, StudyConfig, run_study

_REPEATS = 0.975
_WINDOW_MS = 60.0


def main() -> None:
    """Run the studies and print Markdown tables."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaigns", type=Path, nargs="*", default=[Path("sample_data")])
    hold_outs: tuple[HoldOut, ...] = ("test", "speed group")
    for folder in arguments.parse_args().campaigns:
        campaign = load_campaign(folder)
        for hold_out in hold_outs:
            study = run_study(campaign, StudyConfig(hold_out=hold_out))
            print(f"\n### {campaign.name}, one {hold_out} left out\n")
            _print_summary(study)
            if hold_out == "test":
                _print_tests(study)


def _print_summary(study: Study) -> None:
    print("| | 0–20 ms | 0–40 ms | 0–60 ms | worst | gap closed | change | inside the 95 % band: a, v, crush |")
    print("|---|---:|---:|---:|---:|---:|---:|---|")
    raw = _overall(study, "cae")
    for approach in study.config.approaches:
        means = " | ".join(f"{study.mean_rating(approach, window):.3f}" for window in study.config.windows_ms)
        scores = _overall(study, approach)
        gap = (scores.mean() - raw.mean()) / (_REPEATS - raw.mean())
        print(
            f"| {LABELS[approach]} | {means} | {scores.min():.3f} | {gap:.2f} | {(scores - raw).min():+.3f} "
            f"| {_coverage(study, approach)} |"
        )


def _print_tests(study: Study) -> None:
    print(f"\nBy test, 0–{_WINDOW_MS:g} ms:\n")
    print("| | " + " | ".join(LABELS[approach] for approach in study.config.approaches) + " |")
    print("|---|" + "---:|" * len(study.config.approaches))
    for fold in study.folds:
        scores = (f"{fold.ratings[approach][_WINDOW_MS].overall:.3f}" for approach in study.config.approaches)
        print(f"| {fold.held_out} | " + " | ".join(scores) + " |")


def _overall(study: Study, approach: str) -> np.ndarray:
    return np.array([fold.ratings[approach][_WINDOW_MS].overall for fold in study.folds])


def _coverage(study: Study, approach: str) -> str:
    """Shares of the loading phase inside the band of a(t) and v(t), and of tests inside that of maximum crush."""
    counts = [found for fold in study.folds if (found := _inside(study, fold, approach)) is not None]
    if not counts:
        return "–"
    accel, velocity, crush = np.array(counts).T
    return f"{accel.mean():.2f}, {velocity.mean():.2f}, {crush.sum():.0f} of {len(counts)}"


def _inside(study: Study, fold: Fold, approach: str) -> tuple[float, float, float] | None:
    draws = fold.estimate(approach).prediction.draws_mps2
    if draws is None:
        return None
    test = study.campaign.test(fold.held_out)
    speed = test.condition.speed_mps
    truth, drawn = test.pulse.kinematics(speed), kinematics(draws, speed, DT_S)
    loading = ~(test.pulse.time_s > truth.t0_s)

    def share(values: np.ndarray, true: np.ndarray) -> float:
        lower, upper = np.quantile(values, [0.025, 0.975], axis=0)
        return float(np.mean((true >= lower) & (true <= upper)))

    return (
        share(draws[:, loading], test.pulse.accel_mps2[loading]),
        share(drawn.velocity_mps[:, loading], truth.velocity_mps[loading]),
        share(drawn.displacement_m.max(axis=1), truth.displacement_m.max()),
    )


if __name__ == "__main__":
    main()
