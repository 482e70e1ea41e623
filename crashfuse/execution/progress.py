"""Progress reports of long computations, and how they are cancelled."""

import threading
from collections.abc import Callable, Mapping
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
    :class:`crashfuse.errors.Cancelled`. ``on_part`` is called with a part of the result each time that more of it is
    known.
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
        """Show what is known of the result, of the result's own type, while the rest is computed."""
        if self._on_part is not None:
            self._on_part(part)


SILENT = Watch()
