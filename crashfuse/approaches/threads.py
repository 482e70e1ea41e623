"""Threads for torch: one for a small network, several networks side by side, the same numbers under any load."""

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from typing import TypeVar

import torch

S = TypeVar("S")
T = TypeVar("T")

_SMALL = 1_000_000  # weights of a network; above this, threads within a product pay off
_lock = threading.Lock()
_within = 0
_usual = 1


@contextmanager
def single_thread() -> Iterator[None]:
    """Context in which torch computes with one thread; threads may enter and leave in any order.

    Torch has a number for each thread that computes, and one for those that begin: setting the first sets both.
    """
    global _within, _usual
    with _lock:
        if not _within:
            _usual = _in_a_new_thread(torch.get_num_threads)
        _within += 1
        before = torch.get_num_threads()
        torch.set_num_threads(1)
    try:
        yield
    finally:
        with _lock:
            _within -= 1
            torch.set_num_threads(before)
            new = 1 if _within else _usual
            if before != new:
                _in_a_new_thread(torch.set_num_threads, new)


def _in_a_new_thread(function: Callable[..., T], *arguments: int) -> T:
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(function, *arguments).result()


def quick_threads(n_weights: int) -> AbstractContextManager[None]:
    """One thread for a network of few weights."""
    return single_thread() if n_weights < _SMALL else nullcontext()


def side_by_side(work: Callable[[S], T], items: Iterable[S]) -> list[T]:
    """Do the work for all in parallel; it must not call this function."""
    items = list(items)
    return list((_crew().map if len(items) > 1 else map)(work, items))


@cache
def _crew() -> ThreadPoolExecutor:
    """Threads that are kept: to start them takes as long as their work."""
    return ThreadPoolExecutor(os.cpu_count(), initializer=torch.set_num_threads, initargs=(1,))
