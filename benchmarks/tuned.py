"""How much a record flatters where the CAE model was tuned to some tests: ``python benchmarks/tuned.py --vehicles 6``.

Each seed is a vehicle of any kind (``benchmarks/vehicles.py``) with eight tests over speed. Its CAE model is tuned to
two of them, as an engineer would: the forces of each crush zone are scaled along the crush until both pulses fit. Each
test is then left out and predicted from the others. Printed, by approach: the mean relative error of peak, crush, SM25,
OLC and VPI and the mean rating, of tests that the model was tuned to, of the other tests, and of new ones. With
``--data`` the table is written to ``tuned.csv``.
"""

import argparse
from dataclasses import replace

import numpy as np
import pandas as pd
from certification import LIMITED, limiting, limits, shown
from tables import add_data_option, write
from vehicles import CRUSH_M, World, by_zone, recorded, runs_of

from crashfuse.campaign import Campaign
from crashfuse.certification.certify import certify_matrix
from crashfuse.certification.criteria import Criteria, Criterion
from crashfuse.certification.matrix import Matrix
from crashfuse.crash_test import CrashTest
from crashfuse.execution.run import Run
from crashfuse.signals.pulse import GRID_S, FloatArray, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import estimate_at
from crashfuse.synthetic.vehicle import CrushZone, Vehicle

_N_TESTS, _N_NEW = 8, 30
_KNOTS_M = np.linspace(0.0, 0.9, 7)  # of the factors on a zone's forces
_ZONES = 4
_STIFFNESS = 0.3  # a factor of exp(0.3) costs as much as an error of its weight


def _scaled(model: Vehicle, logs: FloatArray) -> Vehicle:
    rows = iter(logs.reshape(_ZONES, -1))

    def zone(old: CrushZone) -> CrushZone:
        factors = np.exp(np.interp(CRUSH_M, _KNOTS_M, next(rows)))
        return replace(old, force_n=tuple((factors * np.array(old.force_n)).tolist()))

    return by_zone(model, zone)


def _tuned(model: Vehicle, tests: list[CrashTest], n_steps: int = 6) -> Vehicle:
    """The model with forces that fit these tests, by damped Gauss-Newton steps."""
    measured = np.array([test.pulse.accel_mps2 for test in tests])
    scale, logs = float(np.sqrt((measured**2).mean())), np.zeros(_ZONES * _KNOTS_M.size)

    def residuals(points: FloatArray) -> FloatArray:
        models = [_scaled(model, point) for point in points for _ in tests]
        conditions = [test.condition for _ in points for test in tests]
        pulses = recorded(models, conditions, None).reshape(len(points), len(tests), -1)
        errors = (pulses - measured).reshape(len(points), -1)[:, ::5] / scale * np.sqrt(5 / measured.size)
        return np.hstack([errors, 0.05 * points / _STIFFNESS / np.sqrt(logs.size)])

    best = float((residuals(logs[None]) ** 2).sum())
    for _ in range(n_steps):
        step = 0.02
        here, *moved = residuals(np.vstack([logs, logs + step * np.eye(logs.size)]))
        jacobian = (np.array(moved) - here).T / step
        for damping in (0.003, 0.03, 0.3):
            change = np.linalg.solve(jacobian.T @ jacobian + damping * 0.01 * np.eye(logs.size), -jacobian.T @ here)
            if (found := float((residuals((logs + change)[None]) ** 2).sum())) < best:
                best, logs = found, logs + change
                break
        else:
            break
    return _scaled(model, logs)


def _rows(seed: int, approach: str) -> list[dict[str, object]]:
    world, rng = World.any(seed), np.random.default_rng([seed, 11])
    tests = list(world.test(world.over_speed(rng, _N_TESTS), first=0))
    places = sorted(rng.choice(_N_TESTS, 2, replace=False).tolist())
    model = _tuned(world.model, [tests[place] for place in places])
    tuned = replace(world, model=model, cae=runs_of(model, world.cae.conditions, world.folding_m, seed))
    marked = tuple(replace(test, cae_tuned=place in places) for place, test in enumerate(tests))
    campaign = Campaign(f"vehicle {seed}", tuned.library(marked), marked)
    new = world.test(world.conditions(rng, _N_NEW), first=1000)
    ratings = Criterion("rating", "rating", at_least=0.8, window_ms=60.0)
    criteria = Criteria((*limiting(limits(shown(new), 0.5)).items, ratings), 0.95)
    matrix = Matrix(tuple(test.id for test in new), tuple(test.condition for test in new))
    found = certify_matrix(campaign, criteria, matrix, StudyConfig(approaches=(approach,)), Run())
    rows: list[dict[str, object]] = []
    for kind, trials in (("tuned to", found.record.tuned), ("not tuned to", found.record.trials)):
        for trial in trials:
            if trial.left_out == "test":
                name, value = trial.verdict.criterion.metric, trial.verdict.value
                rated = trial.measured if name == "rating" else None
                error = None if rated is not None or value is None else abs(value / trial.measured - 1)
                rows.append({"tests": kind, "error": error, "rating": rated})
    truth = shown(new)
    for i, row in found.rows.items():
        for verdict in row[: len(LIMITED)]:
            value, name = verdict.value, verdict.criterion.metric
            error = None if value is None else abs(value / truth.loc[i, name] - 1)
            rows.append({"tests": "new", "error": error, "rating": None})
    for test in new[:10]:
        said = estimate_at(campaign, test.condition, approach).accel_mps2
        rating = rate_windows(test.pulse, Pulse(GRID_S, said), [60.0])[60.0].overall
        rows.append({"tests": "new", "error": None, "rating": rating})
    return rows


def main() -> None:
    """Tune, leave out, and print the means."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--vehicles", type=int, default=6)
    parser.add_argument("--first", type=int, default=801, help="seed of the first vehicle")
    parser.add_argument("--approach", nargs="+", default=["cae", "fused"])
    add_data_option(parser)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.vehicles)
    for approach in given.approach:
        table = pd.DataFrame(row for seed in seeds for row in _rows(seed, approach))
        means = table.astype({"error": float, "rating": float}).groupby("tests", sort=False)[["error", "rating"]].mean()
        print(approach, means.round(4).to_string(), sep="\n", flush=True)
        if given.data is not None:
            shown = {
                "error (%)": (100 * means["error"]).map("{:.1f}".format),
                "rating": means["rating"].map("{:.2f}".format),
            }
            about = {"approach": approach, "vehicles": f"{seeds[0]}–{seeds[-1]}", "tests": means.index}
            write(pd.DataFrame({**about, **shown}), given.data / "tuned.csv", "approach")


if __name__ == "__main__":
    main()
