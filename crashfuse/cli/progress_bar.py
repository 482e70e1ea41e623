"""Progress on standard error: one line a step, with the time that remains."""

import sys
from types import TracebackType
from typing import Self

from tqdm import tqdm

from crashfuse.execution.progress import Progress


class ProgressBar:
    """Shows each :class:`Progress` that it is handed, a line a step; as a context it closes its bars at the end."""

    def __init__(self) -> None:
        self._bars: dict[str, tqdm[None]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for bar in self._bars.values():
            bar.close()

    def show(self, progress: Progress) -> None:
        """Move the bar of this step; a step that begins anew (for the next test) takes its line again."""
        bar = self._bars.get(progress.step)
        if bar is None:
            bar = tqdm(
                total=progress.total, desc=progress.step, file=sys.stderr, position=len(self._bars), dynamic_ncols=True
            )
            self._bars[progress.step] = bar
        elif progress.done < bar.n:
            bar.reset(progress.total)
        if progress.values:
            bar.set_postfix({name: f"{value:.3g}" for name, value in progress.values.items()}, refresh=False)
        bar.update(progress.done - bar.n)
