"""How long a computation takes on this machine as it is now."""

import threading

import pytest

from crashfuse.execution import jobs as jobs_module
from crashfuse.execution.jobs import Job, Jobs, Pace, slowness
from tests.execution.test_jobs import ANNA, SOON


def test_a_range_follows_what_the_latest_jobs_took_and_how_slow_the_machine_is_now() -> None:
    """Twice as slow takes twice as long; a job read from the cache says nothing; three later ones replace the first."""
    pace = Pace()
    lower, upper = pace.range_s(20.0, 1.0)
    assert lower < 20.0 < upper
    assert pace.range_s(20.0, 4.0)[0] == 4 * lower
    assert pace.range_s(20.0, 4.0)[1] > 4 * upper  # where others compute, their work may grow
    pace.learn(10.0, 30.0)
    assert pace.range_s(20.0, 1.0) == pytest.approx((3 * lower, 3 * upper))
    pace.learn(10.0, 0.1)
    assert pace.range_s(20.0, 1.0) == pytest.approx((3 * lower, 3 * upper))
    for _ in range(3):
        pace.learn(10.0, 10.0)
    assert pace.range_s(20.0, 1.0) == (lower, upper)
    assert slowness() > 0


def test_a_job_knows_its_range_once_it_runs_and_teaches_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measured as it begins; what it took counts for the next; a job of unknown length has none."""
    monkeypatch.setattr(jobs_module, "slowness", lambda: 2.0)
    gate, jobs = threading.Event(), Jobs()
    unknown: Job[bool] = jobs.start("unknown", "Unknown", lambda _: gate.wait(SOON), ANNA)
    job: Job[None] = jobs.start("known", "Known", lambda _: None, ANNA, usual_s=1e-6)
    assert job.expected_s is None  # it waits, and who knows how the machine is then
    gate.set()
    assert job.wait(SOON)
    assert unknown.expected_s is None
    assert job.expected_s == Pace().range_s(1e-6, 2.0)
    assert jobs.pace.range_s(1.0, 1.0)[0] > Pace().range_s(1.0, 1.0)[0]
