"""Progress reports and cancelling; a bar on a terminal, a few plain lines where there is none."""

import threading

import pytest

from crashfuse.errors import Cancelled
from crashfuse.execution.progress import Progress, ProgressBar, Watch
from tests.conftest import Capture


def test_a_part_can_be_cancelled_on_its_own() -> None:
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
    told: list[object] = []
    watch = Watch(on_part=told.append)
    for each in (watch, Watch()):
        each.show_part("half")
    assert told == ["half"]
    assert watch.wants_parts
    assert not Watch().wants_parts


def show(steps: int) -> None:
    """A long step, and then a short one that begins anew for each of three tests."""
    with ProgressBar() as bar:
        for done in range(steps + 1):
            bar.show(Progress("Training", done, steps, {"loss": 1 / (done + 1)}))
        for _ in range(3):
            for done in range(2):
                bar.show(Progress("Fit", done, 1))


def test_a_log_gets_a_few_plain_lines_a_step(capsys: Capture) -> None:
    """However often it reports, whatever begins anew; no control codes, one step never on the line of another."""
    show(1000)
    parts = [0, 250, 500, 750, 1000]
    training = [f"Training: {done} of 1000" for done in parts]
    assert capsys.readouterr().err.splitlines() == [*training, "Fit: 0 of 1", "Fit: 1 of 1"]


def test_a_terminal_gets_a_bar(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    show(10)
    said = capsys.readouterr().err
    assert "\r" in said
    assert "Training: 100%" in said
    assert "loss=0.0909" in said
