"""Threads for small networks: one each, never several for one product.

Threads within a product wait for each other at every step: next to any other work on the machine that costs more than
they give. And one thread gives the same numbers whatever the machine has and does.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Self, TypeVar

import torch

from crashfuse.approaches.time_domain.network import Tcn

S = TypeVar("S")
T = TypeVar("T")

_SMALL = 1_000_000  # weights of a member: above it, threads within a product do pay


@contextmanager
def quick_threads(network: Tcn) -> Iterator[None]:
    """Within this context one thread computes a small network."""
    before = torch.get_num_threads()
    if network.size < _SMALL:
        torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class Crew:
    """Threads for small networks, one each; a single one is computed by the caller's own."""

    def __init__(self, n: int) -> None:
        self._pool = ThreadPoolExecutor(n, initializer=torch.set_num_threads, initargs=(1,)) if n > 1 else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool:
            self._pool.shutdown()

    def map(self, work: Callable[[S], T], items: Iterable[S]) -> list[T]:
        """Do the work for each item, side by side; results in their order."""
        return list(self._pool.map(work, items) if self._pool else map(work, items))
