"""Random vehicles beside measured tests: ``python benchmarks/population.py [MEASURED.csv]``.

Peak (CFC 60) and maximum crush of both families of random vehicles at 40, 48 and 56 km/h: mean, standard deviation and
the central 90 % of those that stop within 100 ms. ``MEASURED.csv`` has one row a full-frontal test, with ``speed_kph``,
``calc_peak_g`` and ``calc_crush_mm``; tests within 1.5 km/h of a speed count. With ``--data`` the table is written to
``population.csv``.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from many_vehicles import crashes
from tables import add_data_option, write
from vehicles import World, recorded

from crashfuse.condition import Condition
from crashfuse.signals.metrics import metric_values
from crashfuse.signals.pulse import FloatArray

_SPEEDS_KPH = (40.0, 48.0, 56.0)
_WITHIN_KPH = 1.5
_FIRST_SEED = 70_000_000  # no vehicle from here on was learned from


def _judged_by(seed: int, speeds_mps: Sequence[float]) -> FloatArray:
    world = World.any(seed, n_runs=2)
    middle = Condition.of_vector((0.5 * (world.range.low.vector + world.range.high.vector)).tolist())
    return recorded([world.truth], [replace(middle, speed_mps=speed) for speed in speeds_mps], None)


def _simulated(pulses: Callable[[int, Sequence[float]], FloatArray], n: int) -> dict[float, tuple[FloatArray, ...]]:
    """Peaks and crushes of ``n`` vehicles by speed."""
    speeds = np.array(_SPEEDS_KPH) / 3.6
    with np.errstate(all="ignore"):
        values = [metric_values(pulses(_FIRST_SEED + i, speeds.tolist()), speeds) for i in range(n)]
    peaks, crushes = (np.array([value[name] for value in values]).T for name in ("peak", "max_crush"))
    rows = zip(_SPEEDS_KPH, peaks, crushes, strict=True)
    return {speed: (peak[np.isfinite(crush)], crush[np.isfinite(crush)]) for speed, peak, crush in rows}


def _measured(file: Path) -> dict[float, tuple[FloatArray, ...]]:
    tests = pd.read_csv(file)
    near = {speed: tests[(tests["speed_kph"] - speed).abs() <= _WITHIN_KPH] for speed in _SPEEDS_KPH}
    return {speed: (rows["calc_peak_g"].to_numpy(), rows["calc_crush_mm"].to_numpy()) for speed, rows in near.items()}


def _columns(what: str, values: FloatArray, digits: int) -> dict[str, str]:
    low, high = np.quantile(values, [0.05, 0.95])
    ends = {"5 %": f"{low:.0f}", "95 %": f"{high:.0f}"}
    numbers = {"mean": f"{values.mean():.{digits}f}", "sd": f"{values.std():.{digits}f}", **ends}
    return {f"{what}, {name}": number for name, number in numbers.items()}


def main() -> None:
    """Print the table and write it."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("measured", type=Path, nargs="?")
    arguments.add_argument("--vehicles", type=int, default=400)
    add_data_option(arguments)
    chosen = arguments.parse_args()
    groups = {  # drawn by these modules: those that predictions are judged by, and those that were learned from
        "vehicles.py": _simulated(_judged_by, chosen.vehicles),
        "many_vehicles.py": _simulated(crashes, chosen.vehicles),
    }
    if chosen.measured:
        groups["measured"] = _measured(chosen.measured)
    table = pd.DataFrame(
        {"vehicles": name, "speed (km/h)": f"{speed:.0f}", "vehicles or tests": len(peak)}
        | _columns("peak (g)", peak, 1)
        | _columns("crush (mm)", crush, 0)
        for name, speeds in groups.items()
        for speed, (peak, crush) in speeds.items()
    )
    print(table.to_string(index=False))
    if chosen.data is not None:
        write(table, chosen.data / "population.csv", "vehicles")


if __name__ == "__main__":
    main()
