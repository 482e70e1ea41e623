"""Threads for small networks: one thread per network, never several for one product.

Threads within a product wait for each other at every step, which costs more than it gains if the machine does any
other work. Also, one thread gives the same numbers on any machine under any load.
"""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import TypeVar

import torch

from crashfuse.approaches.threads import single_thread
from crashfuse.approaches.time_domain.network import Tcn

S = TypeVar("S")
T = TypeVar("T")

_SMALL = 1_000_000  # weights of a member; above this, threads within a product pay off


def quick_threads(network: Tcn) -> AbstractContextManager[None]:
    """Context in which a single thread computes a small network."""
    return single_thread() if network.size < _SMALL else nullcontext()


def side_by_side(work: Callable[[S], T], items: Iterable[S]) -> list[T]:
    """Do the work for all networks in parallel; returns the results in their order.

    A single one is done by the caller's thread. The work itself must not call this function.
    """
    items = list(items)
    return list((_crew().map if len(items) > 1 else map)(work, items))


@cache
def _crew() -> ThreadPoolExecutor:
    """One thread for each core, once for all: to start them takes as long as their work in a prediction."""
    return ThreadPoolExecutor(os.cpu_count(), initializer=torch.set_num_threads, initargs=(1,))
