"""Progress: a bar per step on a terminal, or in a notebook with ipywidgets; otherwise a few lines, as in a log."""

import sys
import warnings
from contextlib import AbstractContextManager

from tqdm import TqdmWarning
from tqdm.notebook import tqdm as in_notebook

from crashfuse.execution.progress import Progress

with warnings.catch_warnings():
    warnings.simplefilter("ignore", TqdmWarning)  # a notebook without ipywidgets gets lines
    from tqdm.auto import tqdm

_LINES = 4  # parts of a step written as lines: one at its start, and one after each part


class ProgressBar(AbstractContextManager["ProgressBar"]):
    """Shows each :class:`Progress` passed to it; as a context manager it closes its bars on exit."""

    def __init__(self) -> None:
        self._bars: dict[str, tqdm[None]] = {}
        self._written: dict[str, int] = {}
        self._draw = sys.stderr.isatty() or issubclass(tqdm, in_notebook)

    def __exit__(self, *_: object) -> None:
        for bar in self._bars.values():
            bar.close()

    def show(self, progress: Progress) -> None:
        """Show the progress of a step."""
        if self._draw:
            self._move_bar(progress)
        else:
            self._write_line(progress)

    def _move_bar(self, progress: Progress) -> None:
        """Move the bar of this step; a step that starts again (for the next test) reuses its line."""
        bar = self._bars.get(progress.step)
        if bar is None:
            place = len(self._bars)
            bar = tqdm(total=progress.total, desc=progress.step, file=sys.stderr, position=place, dynamic_ncols=True)
            self._bars[progress.step] = bar
        elif progress.done < bar.n:
            bar.reset(progress.total)
        if progress.values:
            bar.set_postfix({name: f"{value:.3g}" for name, value in progress.values.items()}, refresh=False)
        bar.update(progress.done - bar.n)

    def _write_line(self, progress: Progress) -> None:
        """Write a line if a step has progressed enough; one that starts again (for the next test) is not repeated."""
        part = int(_LINES * progress.fraction)
        if part > self._written.get(progress.step, -1):
            self._written[progress.step] = part
            sys.stderr.write(f"{progress.step}: {progress.done} of {progress.total}\n")
            sys.stderr.flush()
