"""Speed of the ISO/TS 18571 rating relative to the public package objective-rating-metrics, as ratios within one run.

Run by hand: ``python benchmarks/rating.py``. Both rate the same curves of 600 samples (60 ms at 10 kHz) and must agree.
"""

import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from functools import partial

import numpy as np

from crashfuse.signals.rating import rate_iso18571, rate_many

warnings.simplefilter("ignore")  # those of that package

N, N_CURVES, DT_S = 600, 500, 1e-4
TRIES = 3

FIRST_RATING = {
    "crashfuse": """
import numpy as np
from crashfuse.signals.rating import rate_iso18571
t = np.sin(np.arange(600) / 90)
rate_iso18571(t, 0.9 * t, dt_s=1e-4)
""",
    "peer": """
import warnings; warnings.simplefilter("ignore")
import numpy as np
from objective_rating_metrics.rating import ISO18571
t, time_s = np.sin(np.arange(600) / 90), np.arange(600) / 1e4
ISO18571(np.column_stack([time_s, t]), np.column_stack([time_s, 0.9 * t])).overall_rating(-1)
""",
}


def pulses() -> tuple[np.ndarray, np.ndarray]:
    """A reference pulse, and curves around it that differ in time (0.8 ms) and shape, like draws of a prediction."""
    rng = np.random.default_rng(0)
    time, knots = np.arange(N), np.arange(0, N + 30, 30)

    def wiggle(size: float) -> np.ndarray:
        return np.interp(time, knots, rng.normal(0, size, knots.size))

    reference = -400 * np.sin(np.pi * time / 900) + wiggle(60)
    moved = (np.interp(time + rng.normal(0, 8), time, reference) for _ in range(N_CURVES))
    return reference, np.array([curve + wiggle(30) for curve in moved])


def seconds(work: Callable[[], object], tries: int = TRIES) -> float:
    """Shortest wall time of several tries."""
    times = []
    for _ in range(tries):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    """Measure and print one Markdown table."""
    from objective_rating_metrics.rating import ISO18571

    reference, curves = pulses()
    time_s = np.arange(N) * DT_S
    stacked = [np.column_stack([time_s, curve]) for curve in (reference, *curves)]

    def peer(curve: int) -> float:
        return float(ISO18571(stacked[0], stacked[1 + curve], dt=DT_S).overall_rating(-1))

    ours = [rating.overall for rating in rate_many(reference, curves, dt_s=DT_S)]
    np.testing.assert_allclose(ours[:50], [peer(curve) for curve in range(50)], atol=1e-9)

    cold = {name: seconds(partial(run, code)) for name, code in FIRST_RATING.items()}
    rows = [
        ("import and first rating, fresh process", cold["peer"], cold["crashfuse"]),
        (
            "one pair",
            sum(seconds(partial(peer, curve)) for curve in range(20)) / 20,
            sum(seconds(partial(rate_iso18571, reference, curve, dt_s=DT_S)) for curve in curves[:20]) / 20,
        ),
        (
            f"{N_CURVES} curves against one reference",
            seconds(lambda: [peer(curve) for curve in range(N_CURVES)], tries=1),
            seconds(lambda: rate_many(reference, curves, dt_s=DT_S)),
        ),
    ]
    print("| | objective-rating-metrics | crashfuse | ratio |\n|---|---:|---:|---:|")
    for name, theirs, own in rows:
        print(f"| {name} | {theirs * 1e3:.1f} ms | {own * 1e3:.1f} ms | {theirs / own:.1f} |")


def run(code: str) -> None:
    """Run Python code in a fresh interpreter."""
    subprocess.run([sys.executable, "-c", code], check=True)


if __name__ == "__main__":
    main()
