"""Usual errors of metrics, learned from many vehicles: ``python benchmarks/metric_errors.py FOLDER``.

Each seed is another vehicle (``benchmarks/vehicles.py``): every third a sister of the sample's, the others of any kind.
It has twelve tests, evenly over speed, in groups, or at the speeds of Zeng et al. 2023, Table 1. Fused predictions
learn from two or three choices of 1 to 12 of them. FOLDER keeps their left-out errors and those at 24 further crashes,
a file each, so that a run that was stopped goes on.

The usual error is √((a·value)² + (b·spread)²), with the spread of the draws' central half; left-out tests scale it as
in ``approaches/metric_calibration.py``. Printed by metric, for the shares a and b that are shipped and for those with
the least continuous ranked probability score of vehicles left out when learning (five folds): that score, how many
intervals hold, the stated spread beside that of errors, limits at 0.9 to 1.1 of the value that are decided from a
probability of 0.95, and how many of these wrongly. With ``--judge`` nothing is learned. With ``--data`` the table is
written to ``metric_errors.csv``.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.special import betaln, ndtri, stdtr, stdtrit
from scipy.stats import t as student
from tables import add_data_option, write
from vehicles import KINDS, metrics_of

from crashfuse.approaches.metric_calibration import USUAL_ERRORS, drawn_metrics
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.run import Run, one_thread_throughout
from crashfuse.signals.pulse import FloatArray
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.synthetic.sample import TABLE_1

_TESTS, _UNSEEN = 12, 24
_SIZES = ((1, 4, 11), (2, 6, 12), (3, 8, 11), (2, 5, 9))
_PRIOR, _WORST, _FOLDS = 8.0, 6.0, 5
_LIMITS = np.linspace(0.9, 1.1, 21)
_INNER = 0.25  # draws beyond the central half do not count
_FEW = 5  # fewer tests
_SHOWN = ("peak", "sm25", "olc", "max_crush", "t0", "mean", "vpi")


def _conditions(seed: int, low: Condition, high: Condition, even: Sequence[Condition]) -> list[Condition]:
    """Where a vehicle's twelve tests are."""
    rng = np.random.default_rng([seed, 661])
    span = high.speed_mps - low.speed_mps
    if seed % 3 == 1:
        centres = np.sort(rng.uniform(low.speed_mps, high.speed_mps, rng.integers(4, 8)))
        centres[[0, -1]] = low.speed_mps + 0.5, high.speed_mps - 0.1
        speeds = np.concatenate([centres, rng.choice(centres, _TESTS - len(centres))]) + rng.normal(0, 0.05, _TESTS)
    elif seed % 3 == 2:
        speeds = np.array([*(row[0] for row in TABLE_1), rng.uniform(TABLE_1[0][0], TABLE_1[-1][0])])
        speeds = low.speed_mps + span * (speeds - speeds.min()) / np.ptp(speeds)
    else:
        return list(even)
    return [replace(at, speed_mps=speed) for at, speed in zip(even, speeds.tolist(), strict=True)]


def _errors(seed: int, folder: Path) -> None:
    """Write medians, spreads and measured values of all metrics, of left-out tests and of unseen crashes."""
    missing = {size: file for size in _SIZES[seed % 4] if not (file := folder / f"{seed}-{size}.csv").exists()}
    if not missing:
        return
    world, rng = KINDS["any" if seed % 3 else "sister"](seed), np.random.default_rng([seed, 660])
    even = world.over_speed(rng, _TESTS)
    tests = world.test(_conditions(seed, world.range.low, world.range.high, even), first=0)
    cae = world.library(tests) if rng.random() < 0.7 else world.cae
    new, order = world.test(world.conditions(rng, _UNSEEN), first=1000), rng.permutation(_TESTS)
    for size, file in missing.items():
        chosen = np.linspace(0, _TESTS - 1, size).round().astype(int) if seed % 3 == 0 and size > 1 else order[:size]
        campaign = Campaign(f"vehicle {seed}", cae, tuple(tests[n] for n in sorted(chosen.tolist())))
        with one_thread_throughout():
            fit, rows = Fit.of(campaign, "fused", StudyConfig(), Run()), []
            pairs = [(test, fit.estimate(test.condition), "unseen") for test in new]
            pairs += [(campaign.test(name), own, "left out") for name, own in fit.left_out.items()]
            for test, prediction, role in pairs:
                measured = metrics_of(test.pulse.accel_mps2, test.condition)
                for name, draws in drawn_metrics(prediction).items():
                    low, median, high = np.quantile(draws, [_INNER, 0.5, 1 - _INNER], method="nearest")
                    spread = (high - low) / (2 * -ndtri(_INNER))
                    rows.append((seed, size, role, name, median, spread, measured[name]))
        columns = ["seed", "size", "role", "metric", "median", "spread", "measured"]
        pd.DataFrame(rows, columns=columns).to_csv(file, index=False)
        print(f"vehicle {seed}, {size} tests", flush=True)


def _predicted(rows: pd.DataFrame, a: float, b: float) -> pd.DataFrame:
    """Centre, scale and degrees of freedom at unseen crashes of each campaign, in one metric."""
    rows = rows.assign(usual=np.hypot(a * rows["median"], b * rows["spread"]))
    campaign = ["seed", "size"]
    out = rows[rows["role"] == "left out"]
    errors = ((out["measured"] - out["median"]) / out["usual"]).clip(-_WORST, _WORST)
    known = errors.groupby([out[name] for name in campaign]).agg(["size", "sum", lambda own: (own**2).sum()])
    known.columns = pd.Index(["n", "sum", "squares"])
    new = rows[rows["role"] == "unseen"].join(known, on=campaign).fillna({"n": 0, "sum": 0, "squares": 0})
    moved = new["sum"] / (new["n"] + _PRIOR)
    squares = new["squares"] - 2 * moved * new["sum"] + new["n"] * moved**2
    freedom = _PRIOR + new["n"]
    scale = np.sqrt((_PRIOR + squares) / freedom) * new["usual"]
    return new.assign(centre=new["median"] + moved * new["usual"], scale=scale, freedom=freedom)


def _crps(predicted: pd.DataFrame) -> pd.Series:
    """Score of Student's t (Jordan, Krüger and Lerch, Journal of Statistical Software 90, 2019), as a share."""
    freedom, scale = predicted["freedom"], predicted["scale"]
    z = (predicted["measured"] - predicted["centre"]) / scale
    beta = np.exp(betaln(0.5, freedom - 0.5) - 2 * betaln(freedom / 2, 0.5))
    density = student.pdf(z, freedom) * (freedom + z**2) / (freedom - 1)
    score = scale * (z * (2 * stdtr(freedom, z) - 1) + 2 * density - 2 * np.sqrt(freedom) / (freedom - 1) * beta)
    return score / predicted["median"]


def _learned(rows: pd.DataFrame) -> FloatArray:
    """Shares of the value and of the spread with the least score."""

    def loss(logs: FloatArray) -> float:
        predicted = _predicted(rows, *np.exp(logs))
        by_campaign = _crps(predicted).groupby([predicted["seed"], predicted["size"]]).mean()
        return float(np.log(by_campaign).mean())

    return np.exp(minimize(loss, np.log([0.02, 0.6]), method="Nelder-Mead", options={"xatol": 0.02, "fatol": 1e-5}).x)


def _judged(predicted: pd.DataFrame) -> dict[str, float]:
    """How intervals came out; limits are decided from a probability of 0.95."""
    centre, scale, freedom = (predicted[name].to_numpy() for name in ("centre", "scale", "freedom"))
    measured = predicted["measured"].to_numpy()
    half = stdtrit(freedom, 0.975) * scale
    below = stdtr(freedom[:, None], (_LIMITS - 1) * (centre / scale)[:, None])
    decided = (below >= 0.95) | (below <= 0.05)
    wrong = decided & ((below >= 0.95) != (measured[:, None] <= centre[:, None] * _LIMITS))
    error = float(np.sqrt(np.mean((measured / centre - 1) ** 2)))
    stated = float(np.mean(half / centre)) / 1.96
    found = {"crps": float(_crps(predicted).mean()), "inside": float((np.abs(measured - centre) <= half).mean())}
    shares = {"decided": float(decided.mean()), "wrong": float(wrong.sum() / max(decided.sum(), 1))}
    return found | {"stated": stated, "error": error, "ratio": stated / error} | shares


def _learned_without(rows: pd.DataFrame) -> tuple[FloatArray, pd.DataFrame]:
    """Shares learned from all vehicles, and predictions of each by shares learned from the others."""
    folds = rows["seed"].rank(method="dense").astype(int) % _FOLDS
    parts = [_predicted(rows[folds == fold], *_learned(rows[folds != fold])) for fold in range(_FOLDS)]
    return _learned(rows), pd.concat(parts)


def main() -> None:
    """Measure what is not there yet, learn, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=50001, help="seed of the first vehicle")
    parser.add_argument("--vehicles", type=int, default=18)
    parser.add_argument("--judge", action="store_true", help="learn nothing")
    add_data_option(parser)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    seeds = range(given.first, given.first + given.vehicles)
    for seed in seeds:
        _errors(seed, given.folder)
    files = [file for file in sorted(given.folder.glob("*.csv")) if int(file.stem.partition("-")[0]) in seeds]
    errors = pd.concat(map(pd.read_csv, files)).replace([np.inf, -np.inf], np.nan).dropna()
    table = []
    for tests, few in (("1 to 4", True), ("5 to 12", False)):
        for name in _SHOWN:
            rows = errors[(errors["metric"] == name) & (errors["spread"] > 0)]
            forms = {"shipped": (np.array(USUAL_ERRORS[name]), _predicted(rows, *USUAL_ERRORS[name]))}
            forms |= {} if given.judge else {"learned": _learned_without(rows)}
            for form, (shares, predicted) in forms.items():
                known = {"tests": tests, "metric": name, "form": form, "a": shares[0], "b": shares[1]}
                table.append(known | _judged(predicted[(predicted["size"] < _FEW) == few]))
    shown = pd.DataFrame(table)
    print(shown.to_string(index=False, float_format="{:.3f}".format))
    if given.data is not None:
        vehicles = f"{given.vehicles} random vehicles from seed {given.first}"
        shown.insert(0, "vehicles", vehicles)
        write(shown.map(lambda x: f"{x:.3f}" if isinstance(x, float) else x), given.data / "metric_errors.csv", "vehicles")


if __name__ == "__main__":
    main()
