"""Progress on standard error: one bar a step, with the time that remains."""

import sys
from types import TracebackType
from typing import Self

from tqdm import tqdm

from crashfuse.progress import Progress


class ProgressBar:
    """Shows each :class:`Progress` that it is handed; use it as a context so that the last bar is closed."""

    def __init__(self) -> None:
        self._bar: tqdm[None] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def show(self, progress: Progress) -> None:
        """Move the bar of this step, or start it."""
        if self._bar is None or self._bar.desc != progress.step:
            if self._bar is not None:
                self._bar.close()
            self._bar = tqdm(total=progress.total, desc=progress.step, file=sys.stderr, dynamic_ncols=True)
            self._bar.desc = progress.step
        if progress.values:
            self._bar.set_postfix({name: f"{value:.3g}" for name, value in progress.values.items()}, refresh=False)
        self._bar.update(progress.done - self._bar.n)
