"""The sample campaign: 1009 runs of the CAE model over the paper's ranges, and 11 tests at the paper's conditions."""

import json
from pathlib import Path
from shutil import copyfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError
from crashfuse.files.atomic import new_folder
from crashfuse.signals.pulse import GRID_S, Pulse
from crashfuse.synthetic.vehicle import CONSTANTS, cae_pulses, measured_pulses
from crashfuse.units import LB, MPH, MS, G

NAME = "Sample (synthetic)"
NOTICE = "Synthetic: every pulse comes from a lumped-parameter simulation; no real vehicle was modelled or crashed."

TABLE_1 = tuple(map(tuple, CONSTANTS["table_1"]))  # speed (mph), front and rear weight (lb), powertrain and drive
_N_RUNS = 1009
_LOW, _HIGH = (0.0, 1922.0, 1349.0), (35.2, 2185.0, 1770.0)  # mph, lb, lb: Zeng et al. 2023, Sec. 4
_STORED_G = 0.002  # resolution of the stored CAE pulses: far finer than any sensor, and compresses well
_TEXTS = Path(__file__).with_name("texts")  # what is the same for every seed: README, criteria, matrix


def sample_campaign(seed: int = 0) -> Campaign:
    """Simulate the sample campaign: 11 tests, 1009 CAE runs and one at each test's condition, named ``CAE-<test>``.

    The seed chooses the Latin hypercube, the tests' scatter and their noise; 0 is the sample that comes with crashfuse.
    """
    test_conditions = [_condition(*row) for row in TABLE_1]
    measured = zip(test_conditions, measured_pulses(test_conditions, seed), strict=True)
    tests = [CrashTest(f"T{n:02d}", c, Pulse(GRID_S, accel)) for n, (c, accel) in enumerate(measured, start=1)]
    from scipy.stats import qmc  # half a second

    hypercube = qmc.scale(qmc.LatinHypercube(d=3, rng=seed).random(_N_RUNS), _LOW, _HIGH).round(2).tolist()
    conditions = [_condition(*row) for row in hypercube + [list(row[:3]) for row in TABLE_1]]
    ids = [f"CAE-{number:04d}" for number in range(1, _N_RUNS + 1)] + [f"CAE-{test.id}" for test in tests]
    library = CaeLibrary(tuple(ids), tuple(conditions), cae_pulses(conditions).astype(np.float32))
    return Campaign(NAME, library, tuple(tests), NOTICE)


def write_sample(folder: Path) -> None:
    """Write the sample campaign as a campaign folder, which appears only once complete.

    Raises a UsageError if the folder is not empty, an OSError if it cannot be written.
    """
    folder = Path(folder).resolve()
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise UsageError(f"{folder} is not empty; name a folder that does not exist yet.")
    campaign = sample_campaign()
    with new_folder(folder) as draft:
        (draft / "tests").mkdir()
        _write(campaign, draft)


def _write(campaign: Campaign, folder: Path) -> None:
    texts = (f"{name} = {json.dumps(getattr(campaign, name))}\n" for name in ("name", "notice"))
    _write_text(folder / "campaign.toml", "".join([*texts, 'channel_filter_class = "none"\n']))
    for path in _TEXTS.iterdir():
        copyfile(path, folder / path.name)
    header = "id,speed_mph,front_weight_lb,rear_weight_lb"
    tests = ((test.id, test.condition) for test in campaign.tests)
    rows = [",".join([test_id, _in_mph_and_lb(c), *(value for _, value in c.factors)]) for test_id, c in tests]
    _write_text(folder / "tests.csv", "\n".join([f"{header},powertrain,drive", *rows, ""]))
    runs = zip(campaign.cae.ids, campaign.cae.conditions, strict=True)
    _write_text(folder / "cae.csv", "\n".join([header, *(f"{run},{_in_mph_and_lb(c)}" for run, c in runs), ""]))
    for test in campaign.tests:
        curve = zip(test.pulse.time_s / MS, test.pulse.accel_mps2 / G, strict=True)
        lines = ["time_ms,acceleration_g", *(f"{time:.2f},{accel:.4f}" for time, accel in curve), ""]
        _write_text(folder / "tests" / f"{test.id}.csv", "\n".join(lines))
    _write_cae_pulses(campaign.cae, folder / "cae_pulses.parquet")


def _write_cae_pulses(library: CaeLibrary, path: Path) -> None:
    run = pa.array(np.repeat(np.arange(len(library), dtype=np.int16), library.accel_mps2.shape[1]))
    accel = np.round(library.accel_mps2.ravel() / G / _STORED_G) * _STORED_G
    ids = pa.DictionaryArray.from_arrays(run, list(library.ids))
    time_ms = np.tile((GRID_S / MS).astype(np.float32), len(library))
    table = pa.table({"id": ids, "time_ms": time_ms, "acceleration_g": accel.astype(np.float32)})
    pq.write_table(table, path, compression="zstd", compression_level=12)


def _condition(speed_mph: float, front_weight_lb: float, rear_weight_lb: float, *kind: str) -> Condition:
    factors = tuple(zip(("powertrain", "drive"), kind, strict=False))
    return Condition.of_vector([speed_mph * MPH, front_weight_lb * LB, rear_weight_lb * LB], factors)


def _in_mph_and_lb(condition: Condition) -> str:
    return f"{condition.speed_mps / MPH:.2f},{condition.front_weight_kg / LB:.2f},{condition.rear_weight_kg / LB:.2f}"


def _write_text(path: Path, text: str) -> None:
    path.write_bytes(text.encode())
