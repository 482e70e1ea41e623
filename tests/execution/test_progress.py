"""Progress reports and cancelling."""

import threading

import pytest

from crashfuse.errors import Cancelled
from crashfuse.execution.progress import Progress, Watch


def test_a_part_can_be_cancelled_on_its_own() -> None:
    """The whole goes on; the part ends with the whole, too, and reports to the same place."""
    seen: list[Progress] = []
    whole, part = threading.Event(), threading.Event()
    watch = Watch(seen.append, whole)
    own = watch.also_cancelled_by(part)
    own.report("Training", 1, 2)
    part.set()
    watch.report("Training", 2, 2)
    assert [progress.done for progress in seen] == [1, 2]
    with pytest.raises(Cancelled):
        own.report("Training", 2, 2)
    whole.set()
    with pytest.raises(Cancelled):
        watch.also_cancelled_by(threading.Event()).report("Training", 2, 2)


def test_parts_are_told_to_who_waits_for_them() -> None:
    """And to nobody else."""
    told: list[object] = []
    watch = Watch(on_part=told.append)
    for each in (watch, Watch()):
        each.show_part("half")
    assert told == ["half"]
    assert watch.wants_parts
    assert not Watch().wants_parts
