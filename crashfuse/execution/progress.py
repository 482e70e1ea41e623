"""Progress of long computations: its reports, how they are cancelled, and bars on a terminal or lines in a log."""

import sys
import threading
import warnings
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

from crashfuse.errors import Cancelled


@dataclass(frozen=True, slots=True)
class Progress:
    """One report: ``done`` of ``total`` units of ``step``, and values worth showing (a loss, say)."""

    step: str
    done: int
    total: int
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def fraction(self) -> float:
        """Fraction of the step that is done, 0 to 1."""
        return self.done / self.total if self.total else 1.0


class Watch:
    """Passed to every long computation, which reports its progress to it and is cancelled through it.

    ``on_progress`` is called at each report, in the computing thread; once ``cancel`` is set, the next report raises
    Cancelled. ``on_part`` is called with what is known of the result.
    """

    def __init__(
        self,
        on_progress: Callable[[Progress], None] | None = None,
        cancel: threading.Event | None = None,
        on_part: Callable[[Any], None] | None = None,
    ) -> None:
        self._on_progress = on_progress
        self._cancel = () if cancel is None else (cancel,)
        self._on_part = on_part

    def also_cancelled_by(self, cancel: threading.Event) -> "Watch":
        """The same watch for a part of the computation that can be cancelled on its own."""
        other = Watch(self._on_progress)
        other._cancel = (*self._cancel, cancel)
        return other

    def report(self, step: str, done: int, total: int, **values: float) -> None:
        """Report how far ``step`` is."""
        if any(cancel.is_set() for cancel in self._cancel):
            raise Cancelled(f"Stopped on request during: {step}.")
        if self._on_progress is not None:
            self._on_progress(Progress(step, done, total, values))

    @property
    def wants_parts(self) -> bool:
        """Whether anyone waits for :meth:`show_part`."""
        return self._on_part is not None

    def show_part(self, part: object) -> None:
        """Show what is known of the result, of the result's own type."""
        if self._on_part is not None:
            self._on_part(part)


SILENT = Watch()
_LINES = 4  # parts of a step written as lines: one at its start, and one after each part


class ProgressBar(AbstractContextManager["ProgressBar"]):
    """Shows each :class:`Progress` passed to it; as a context manager it closes its bars on exit."""

    def __init__(self) -> None:
        from tqdm import TqdmWarning, notebook  # it takes a while, and most progress is shown elsewhere

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TqdmWarning)  # a notebook without ipywidgets gets lines
            from tqdm.auto import tqdm
        self._new_bar, self._bars = tqdm, dict[str, "tqdm[None]"]()
        self._written: dict[str, int] = {}
        self._draw = sys.stderr.isatty() or issubclass(tqdm, notebook.tqdm)

    def __exit__(self, *_: object) -> None:
        for bar in self._bars.values():
            bar.close()

    def show(self, progress: Progress) -> None:
        """Show the progress of a step; one that starts again (for the next test) reuses its line."""
        (self._move_bar if self._draw else self._write_line)(progress)

    def _move_bar(self, progress: Progress) -> None:
        bar = self._bars.get(progress.step)
        if bar is None:
            line = {"desc": progress.step, "position": len(self._bars), "file": sys.stderr, "dynamic_ncols": True}
            self._bars[progress.step] = bar = self._new_bar(total=progress.total, **line)
        elif progress.done < bar.n:
            bar.reset(progress.total)
        if progress.values:
            bar.set_postfix({name: f"{value:.3g}" for name, value in progress.values.items()}, refresh=False)
        bar.update(progress.done - bar.n)

    def _write_line(self, progress: Progress) -> None:
        part = int(_LINES * progress.fraction)
        if part > self._written.get(progress.step, -1):
            self._written[progress.step] = part
            sys.stderr.write(f"{progress.step}: {progress.done} of {progress.total}\n")
            sys.stderr.flush()
