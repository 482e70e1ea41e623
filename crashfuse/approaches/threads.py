"""One thread for torch: the same numbers on any machine, under any load.

Torch has a number of threads for each thread that computes, and one for those that begin: to set the first sets both.
"""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

T = TypeVar("T")

_lock = threading.Lock()
_within = 0
_usual = 1


@contextmanager
def single_thread() -> Iterator[None]:
    """Context in which torch computes with one thread; threads may enter and leave in any order."""
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
