"""One thread for linear algebra: two contended threads cost many times the work of one, and change the numbers.

The limit is the whole process's. To look for the libraries at every turn would take milliseconds of each prediction.
"""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache

import scipy.linalg  # noqa: F401 - it has a BLAS of its own, which has to be there when libraries are looked for
from threadpoolctl import ThreadpoolController, threadpool_limits

_lock = threading.Lock()
_limit = ExitStack()
_within = 0


@contextmanager
def one_thread_throughout() -> Iterator[None]:
    """:func:`one_thread`, and one thread for whatever computes by OpenMP in the calling thread, PyTorch among it."""
    with one_thread(), threadpool_limits(1, user_api="openmp"):  # a limit of OpenMP is each thread's own
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Context in which NumPy and SciPy compute with one thread; threads may enter and leave in any order."""
    global _within
    with _lock:
        if not _within:
            _limit.enter_context(_libraries().limit(limits=1))
        _within += 1
    try:
        yield
    finally:
        with _lock:
            _within -= 1
            if not _within:
                _limit.close()


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")
