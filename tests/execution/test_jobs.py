"""Background jobs: shared, watched, cancelled, and never silent about what went wrong."""

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from crashfuse.errors import OUT_OF_MEMORY, DataError, Problem
from crashfuse.execution.jobs import Job, Jobs
from crashfuse.execution.progress import Watch
from crashfuse.execution.visitors import Visitor

SOON = 60.0
ANNA, BEN = Visitor("k1", "anna@example.com"), Visitor("k2", "browser 0a1b2c")
Work = Callable[[Watch], object]


@pytest.fixture
def gate() -> Iterator[threading.Event]:
    """Holds the work of a test back; opened at its end, whatever happens."""
    event = threading.Event()
    yield event
    event.set()


@pytest.fixture
def held(gate: threading.Event) -> Work:
    return lambda _: gate.wait(SOON)


@pytest.fixture
def jobs() -> Jobs:
    return Jobs()


def ended(job: Job[Any]) -> object:
    assert job.wait(SOON)
    return job.result


def test_who_asks_for_the_same_joins_the_same_job_and_others_wait(jobs: Jobs, gate: threading.Event) -> None:
    """The work is done once, whether it still runs or has ended; one job runs at a time, in the order of asking."""
    calls: list[bool] = []

    def work(_: Watch) -> None:
        calls.append(gate.wait(SOON))

    first = jobs.start("a", "A", work, ANNA)
    assert jobs.start("a", "A", work, ANNA) is first
    second = jobs.start("b", "Second", lambda _: first.state, ANNA)
    assert second.state == "waiting"
    assert jobs.active == [first, second]
    gate.set()
    assert ended(second) == "done"
    assert jobs.active == []
    assert jobs.start("a", "A", work, ANNA) is first
    assert calls == [True]


def test_what_two_want_stops_at_its_next_report_once_neither_does_and_can_be_started_again(jobs: Jobs) -> None:
    """Anna cancels for herself; the job runs on for Ben, and stops once he cancels, too. Nothing hangs or is kept."""
    reached = threading.Event()

    def endless(watch: Watch) -> None:
        for i in range(10**9):
            watch.report("Step", i, 10**9)
            reached.set()

    job = jobs.start("a", "A", endless, ANNA)
    assert jobs.start("a", "A", endless, BEN) is job
    assert reached.wait(SOON)
    job.cancel(ANNA)
    assert (job.state, job.cancelling, job.wanted_by) == ("running", False, {BEN})
    job.cancel(BEN)
    assert (ended(job), job.state) == (None, "cancelled")
    again = jobs.start("a", "A", lambda _: 1, ANNA)
    assert (ended(again), again.state) == (1, "done")


def test_a_job_cancelled_while_it_waits_has_ended_and_never_begins(
    jobs: Jobs, held: Work, gate: threading.Event, caplog: pytest.LogCaptureFixture
) -> None:
    """At once, whatever is still ahead of it; its work is not called, and the log says who cancelled it."""
    calls: list[int] = []
    jobs.start("a", "A", held, ANNA)
    waiting = jobs.start("b", "B", lambda _: calls.append(1), BEN)
    with caplog.at_level(logging.INFO, "crashfuse"):
        waiting.cancel(BEN)
        assert waiting.wait(0)
        assert (waiting.state, waiting in jobs.active) == ("cancelled", False)
        gate.set()
        ended(jobs.start("c", "C", lambda _: None, ANNA))
    assert calls == []
    assert [told for told in caplog.messages if told.endswith(": B")] == [f"{BEN.name}: cancelled: B"]


TOLD = DataError(Problem("tests.csv", "two tests", "one", "add a test"))
ERRORS: list[tuple[BaseException, str]] = [
    (TOLD, "tests.csv: expected two tests, found one; add a test."),
    (MemoryError(), OUT_OF_MEMORY),
    (RuntimeError("DefaultCPUAllocator: can't allocate memory: 9 bytes"), OUT_OF_MEMORY),
    *((own, type(own).__name__) for own in (ZeroDivisionError(), SystemExit("bye"), KeyboardInterrupt())),
]


@pytest.mark.parametrize(("error", "told"), ERRORS)
def test_a_failed_job_has_a_sentence_and_the_queue_goes_on(
    jobs: Jobs, error: BaseException, told: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Whoever ran out of memory, or called sys.exit; the rest of what nobody foresaw is for the log."""

    def fail(_: Watch) -> None:
        raise error

    with caplog.at_level(logging.ERROR):
        job = jobs.start("a", "A", fail, ANNA)
        ended(jobs.start("b", "B", lambda _: None, ANNA))
    assert job.state == "failed"
    assert told in job.message
    assert "Traceback" not in job.message
    assert ("Traceback" in caplog.text) is (told == type(error).__name__)


@pytest.mark.parametrize("way", ["cancelled", "silent"])
@pytest.mark.parametrize("at_once", [False, True])
def test_a_job_that_hangs_does_not_hold_up_the_others(
    jobs: Jobs, gate: threading.Event, monkeypatch: pytest.MonkeyPatch, way: str, *, at_once: bool
) -> None:
    """It is left behind, once it was cancelled or has not reported for long; what it returns later is not wanted."""
    monkeypatch.setattr("crashfuse.execution.jobs._LOOK_S", 0.01)
    monkeypatch.setattr(f"crashfuse.execution.jobs.{'_STOPS_S' if way == 'cancelled' else '_SILENT_S'}", 0.05)
    begun, returned = threading.Event(), threading.Event()

    def hang(_: Watch) -> int:
        begun.set()
        gate.wait(SOON)
        returned.set()
        return 1

    job = jobs.start("a", "A", hang, ANNA, at_once=at_once)
    assert begun.wait(SOON)
    if way == "cancelled":
        job.cancel(ANNA)
        assert job.wait(SOON)
    ended(jobs.start("b", "B", lambda _: 2, BEN))
    gate.set()
    assert returned.wait(SOON)
    assert (ended(job), job.state) == ((None, "cancelled") if way == "cancelled" else (1, "done"))


def test_a_job_that_reports_is_waited_for(jobs: Jobs, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crashfuse.execution.jobs._LOOK_S", 0.01)
    monkeypatch.setattr("crashfuse.execution.jobs._SILENT_S", 0.3)

    def work(watch: Watch) -> None:
        for i in range(20):
            watch.report("Step", i, 20)
            time.sleep(0.05)

    first = jobs.start("a", "A", work, ANNA)
    assert ended(jobs.start("b", "B", lambda _: first.state, BEN)) == "done"


def test_progress_and_reported_values_can_be_read(jobs: Jobs, gate: threading.Event) -> None:
    """Each step with its values as points over how far it was."""
    reached = threading.Event()

    def work(watch: Watch) -> None:
        watch.report("Read", 1, 1)
        for i in range(4):
            watch.report("Train", i, 10, loss=1 / (i + 1))
        reached.set()
        gate.wait(SOON)

    job = jobs.start("a", "A", work, ANNA)
    assert reached.wait(SOON)
    read, train = job.steps.items()
    assert (read[0], read[1].finished, train[0]) == ("Read", True, "Train")
    assert train[1].progress.fraction == pytest.approx(0.3)
    assert train[1].curves["loss"] == [(0, 1), (1, 1 / 2), (2, 1 / 3), (3, 1 / 4)]


def test_only_the_last_outcomes_are_kept(jobs: Jobs) -> None:
    for i in range(40):
        ended(jobs.start(i, str(i), lambda _: None, ANNA))
    kept = [i for i in range(40) if jobs.get(i) is not None]
    assert kept[-1] == 39
    assert len(kept) <= 25


def test_who_asks_for_what_is_being_stopped_gets_a_job_of_their_own(
    jobs: Jobs, held: Work, gate: threading.Event
) -> None:
    first = jobs.start("a", "A", held, ANNA)
    first.cancel(ANNA)
    second = jobs.start("a", "A", lambda _: 2, BEN)
    assert second is not first
    first.join(BEN)
    assert first.wanted_by == set()
    gate.set()
    assert ended(second) == 2


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a thread cannot be given a priority of its own")
def test_pages_go_before_jobs_and_the_threads_that_jobs_start() -> None:
    """The job's thread is nicer than the one that draws pages, and so are the threads in which networks train."""

    def niceness() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def work(_: Watch) -> tuple[int, int]:
        with ThreadPoolExecutor(1) as pool:
            return niceness(), pool.submit(niceness).result()

    with ThreadPoolExecutor(1) as nice:  # a server may have been started by "nice"
        nice.submit(os.setpriority, os.PRIO_PROCESS, 0, niceness() + 1).result()
        job, server = nice.submit(lambda: Jobs().start("a", "A", work, ANNA)).result(), nice.submit(niceness).result()
    assert job.wait(SOON)
    assert job.result is not None
    assert min(job.result) > server > niceness()
