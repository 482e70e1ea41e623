"""Records unlike the others of their campaign: a shifted time zero, an offset of the sensor's zero, a failed sensor.

All are seen against what the CAE runs at a test's speed do, less what the other tests do against theirs: a CAE model
that is off by as much in every test accuses none.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from crashfuse.campaign_folder.condition_tables import ConditionTable
from crashfuse.campaign_folder.plausibility import CREEP_MPS, NEAR
from crashfuse.crash_test import SPEED_STEP_MPS
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray
from crashfuse.signals.sensor_faults import SensorFault, confirmed
from crashfuse.units import MS, G
from crashfuse.wording import number, signed

_ONSET = 0.02
"""Share of the impact speed that is gone when deceleration has begun; at CFC 60, or with 0.6 g of noise, as well."""
_LATE_S = 1.5e-3
"""Good simulated tests differ by up to 1.0 ms."""
_OFFSET_MPS2 = 0.9 * G
"""Good simulated tests differ by up to 0.6 g."""
_SCATTERED = 3.0  # times the median deviation of the others: what is usual in this campaign is no finding
_FEWEST_OTHERS = 2  # fewer do not tell which of the tests is odd: the CAE runs alone have to


def unlike_others(tables: Mapping[str, ConditionTable], pulses: Mapping[str, FloatArray]) -> list[str]:
    """Warnings of tests whose onset, or mean acceleration over 0 to 100 ms, is unlike that of the other tests.

    Parameters
    ----------
    tables, pulses : mapping
        Of ``tests`` and ``cae``: the conditions, and pulses on the study grid in m/s², shape (n, 1250).
    """
    speeds, runs = (_speeds(tables[role]) for role in ("tests", "cae"))
    moving, runs_moving = np.flatnonzero(speeds > CREEP_MPS), np.flatnonzero(runs > CREEP_MPS)
    if not runs_moving.size:
        return []
    ids, speeds, own = [tables["tests"].ids[row] for row in moving], speeds[moving], pulses["tests"][moving]
    onsets, means = _onsets(own, speeds), _means(own)
    usual_onsets, usual_means = np.empty_like(onsets), np.empty_like(means)
    for i, v0 in enumerate(speeds.tolist()):
        near = runs_moving[np.argsort(np.abs(runs[runs_moving] - v0), kind="stable")[:NEAR]]
        usual_onsets[i] = np.median(_onsets(pulses["cae"][near], runs[near]))
        usual_means[i] = v0 * np.median(_means(pulses["cae"][near]) / runs[near])
    by = "by the other tests and the CAE runs near its speed"
    share = f"{100 * _ONSET:.0f} % of its speed is gone"
    return [
        *(
            f"tests.csv, {ids[i]}: its deceleration begins {abs(off) / MS:.1f} ms {'late' if off > 0 else 'early'}: "
            f"{share} at {onsets[i] / MS:.1f} ms, expected at {(onsets[i] - off) / MS:.1f} "
            f"ms {by}; check its time zero, which is first contact."
            for i, off in _odd(onsets - usual_onsets, _LATE_S)
        ),
        *(
            f"tests.csv, {ids[i]}: its mean acceleration over 0 to 100 ms is {number(means[i] / G, '.1f')} g, expected "
            f"{number((means[i] - off) / G, '.1f')} g {by}; check the zero of its sensor (off by "
            f"{signed(off / G, 1)} g?), its time zero, scale and speed."
            for i, off in _odd(means - usual_means, _OFFSET_MPS2)
        ),
    ]


def confirmed_faults(
    tables: Mapping[str, ConditionTable],
    pulses: Mapping[str, FloatArray],
    faults: Mapping[str, Sequence[SensorFault]],
    *,
    is_comparable: bool = True,
) -> dict[str, tuple[SensorFault, ...]]:
    """The faults of sensors that a record shows alone, and those likely ones that the other tests do not show.

    What is flat in all tests is the structure. Tests are not comparable if the CAE runs begin before the barrier.
    """

    def expected(row: int) -> FloatArray:
        return _expected(tables, pulses, row) if is_comparable else pulses["tests"][row]

    rows = {test_id: row for row, test_id in enumerate(tables["tests"].ids)}
    judged = {
        test_id: confirmed(likely, GRID_S, pulses["tests"][rows[test_id]], expected(rows[test_id]))
        for test_id, likely in faults.items()
    }
    return {test_id: sure for test_id, sure in judged.items() if sure}


def _expected(tables: Mapping[str, ConditionTable], pulses: Mapping[str, FloatArray], row: int) -> FloatArray:
    """What the CAE runs near a test's speed show, and what the other tests at about that speed (else all) add to it."""
    tests, runs = (_speeds(tables[role]) for role in ("tests", "cae"))

    def model(v0: float) -> FloatArray:
        near = np.argsort(np.abs(runs - v0), kind="stable")[:NEAR]
        pulse: FloatArray = np.median(pulses["cae"][near], axis=0)
        return pulse

    others = np.delete(np.arange(tests.size), row)
    alike = others[np.abs(tests[others] - tests[row]) < SPEED_STEP_MPS]
    added = [pulses["tests"][other] - model(tests[other]) for other in (alike if alike.size else others)]
    return model(tests[row]) + (np.median(added, axis=0) if added else 0.0)


def _odd(differences: FloatArray, limit: float) -> list[tuple[int, float]]:
    """Place and deviation of each test that is further than the limit from what the others are."""
    found = []
    for i, own in enumerate(differences):
        others = np.delete(differences, i)
        usual, most = 0.0, 2 * limit
        if others.size >= _FEWEST_OTHERS:
            usual = float(np.median(others))
            most = max(limit, _SCATTERED * float(np.median(np.abs(others - usual))))
        if abs(own - usual) > most:
            found.append((i, float(own - usual)))
    return found


def _onsets(accel: FloatArray, speeds: FloatArray) -> FloatArray:
    """When each pulse has taken its share of the impact speed, in s."""
    early = accel[:, : GRID_S.size // 2]
    gone = np.cumsum(early, axis=1, dtype=np.float64) * -DT_S >= _ONSET * speeds[:, None]
    return np.where(gone.any(axis=1), GRID_S[gone.argmax(axis=1)], GRID_S[early.shape[1]])


def _means(accel: FloatArray) -> FloatArray:
    means: FloatArray = accel.mean(axis=1, dtype=np.float64)
    return means


def _speeds(table: ConditionTable) -> FloatArray:
    return np.array([condition.speed_mps for condition in table.conditions])
