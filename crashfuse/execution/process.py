"""What is set for a process as a whole: one heap, and one thread for linear algebra."""

import ctypes
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController, threadpool_limits

_ARENA_MAX = -8  # parameter of mallopt, in <malloc.h>
_lock = threading.Lock()
_limit = ExitStack()
_within = 0


@cache
def _glibc() -> ctypes.CDLL | None:
    library = ctypes.CDLL(None) if sys.platform == "linux" else None
    return library if library is not None and hasattr(library, "malloc_trim") else None


def share_one_heap() -> None:
    """Let all threads allocate from the first one's heap: freed memory stays with glibc, a third of one that trains."""
    if (library := _glibc()) is not None:
        library.mallopt(_ARENA_MAX, 1)


def give_back() -> None:
    """Return what is free to the system, in some milliseconds."""
    if (library := _glibc()) is not None:
        library.malloc_trim(0)


@contextmanager
def one_thread_throughout() -> Iterator[None]:
    """:func:`one_thread`, and one thread for whatever computes by OpenMP in the calling thread, PyTorch among it."""
    with one_thread(), threadpool_limits(1, user_api="openmp"):  # a limit of OpenMP is each thread's own
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Context in which NumPy and SciPy compute with one thread, in the whole process; entered and left in any order.

    Two contended threads cost many times the work of one, and change the numbers.
    """
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


@cache  # to look for them at every turn would take milliseconds of each prediction
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401 - it has a BLAS of its own, which has to be there when libraries are looked for

    return ThreadpoolController().select(user_api="blas")
