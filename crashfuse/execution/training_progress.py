"""A computation while it runs: how far each of its steps is, and what networks report as they train."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Event
from typing import Any

from crashfuse import views
from crashfuse.errors import UsageError, one_of
from crashfuse.execution.progress import Progress, ProgressBar, Watch

_CURVE_POINTS = 1000


@dataclass(repr=False)
class Step:
    """One step of a computation: its progress, start time and reported values."""

    progress: Progress
    started: float
    updated: float
    curves: dict[str, list[tuple[int, float]]] = field(default_factory=dict)
    """By the value's name: ``done`` and the value, thinned to at most 1000 points."""

    @property
    def finished(self) -> bool:
        """True if the whole step is done."""
        return self.progress.done >= self.progress.total

    @property
    def learns(self) -> bool:
        """True if it has reported enough values for a figure."""
        return any(len(points) > 1 for points in list(self.curves.values()))

    def draw(self) -> "views.Drawing":
        """The values reported so far over the step's progress; a UsageError if there are none."""
        if not self.learns:
            raise UsageError(f"The step {self.progress.step} has reported no values to draw.")
        curves = {name.replace("_", " "): list(points) for name, points in list(self.curves.items())}
        value = "Loss" if all(name.endswith("loss") for name in curves) else "Error"
        return views.learning_curves(curves, value=value, total=self.progress.total)

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""

    def _take(self, progress: Progress) -> None:
        self.progress, self.updated = progress, time.monotonic()
        for name, value in progress.values.items():
            points = self.curves.setdefault(name, [])
            if len(points) >= _CURVE_POINTS:
                self.curves[name] = points = points[::2]
            points.append((progress.done, float(value)))


class Watched(Watch):
    """A watch that keeps what is reported: every step so far by its name; of one that starts over the last."""

    def __init__(
        self,
        on_progress: Callable[[Progress], None],
        cancel: Event | None = None,
        on_part: Callable[[Any], None] | None = None,
    ) -> None:
        def take(progress: Progress) -> None:
            step = self.steps.get(progress.step)
            if step is None or progress.done < step.progress.done:  # a new step, or the same step for the next test
                self.steps.pop(progress.step, None)
                now = time.monotonic()
                step = self.steps[progress.step] = Step(progress, now, now)
            step._take(progress)
            on_progress(progress)

        super().__init__(take, cancel, on_part)
        self.steps: dict[str, Step] = {}

    def draw(self, step: str = "") -> "views.Drawing":
        """What a step has reported so far, by default the last that reported values, see :meth:`Step.draw`."""
        learning = [name for name, own in self.steps.items() if own.learns]
        if not (step or learning):
            raise UsageError("No step has reported values to draw.")
        return one_of("step", step or learning[-1], self.steps).draw()

    plot = views.as_plotly(draw)
    """The same as a Plotly figure."""


@contextmanager
def watching() -> Iterator[Watched]:
    """Show the progress of the computations that are given this watch, which then has figures of their training.

    On a terminal a bar each step, in a notebook as well where ipywidgets is installed, else a few lines.

    >>> with watching() as watch:
    ...     study = run_study(campaign, watch=watch)
    >>> watch.plot()
    """
    with ProgressBar() as bar:
        yield Watched(bar.show)
