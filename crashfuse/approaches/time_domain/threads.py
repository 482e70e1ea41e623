"""Threads for small networks: one thread per network, never several for one product.

Threads within a product wait for each other at every step, which costs more than it gains if the machine does any
other work. Also, one thread gives the same numbers on any machine under any load.
"""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from typing import Self, TypeVar

import torch

from crashfuse.approaches.threads import single_thread
from crashfuse.approaches.time_domain.network import Tcn

S = TypeVar("S")
T = TypeVar("T")

_SMALL = 1_000_000  # weights of a member; above this, threads within a product pay off


def quick_threads(network: Tcn) -> AbstractContextManager[None]:
    """Context in which a single thread computes a small network."""
    return single_thread() if network.size < _SMALL else nullcontext()


class Crew:
    """Threads for small networks, one each; a single network runs in the caller's thread."""

    def __init__(self, n: int) -> None:
        self._pool = ThreadPoolExecutor(n, initializer=torch.set_num_threads, initargs=(1,)) if n > 1 else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool:
            self._pool.shutdown()

    def map(self, work: Callable[[S], T], items: Iterable[S]) -> list[T]:
        """Do the work for all items in parallel; returns the results in the order of the items."""
        return list(self._pool.map(work, items) if self._pool else map(work, items))
